"""What an answer is judged by, taken from the problem as it was given: faces, foundations, motions, coefficients.

The contact surface and the slip origin that the solver works with take no part: nodes come from the facets of the named
faces, normals and gaps from the foundations where they are at this time, and the place from which slip counts from the
displacement that the step before has left.  So a node that the surface has lost, a foundation that was not moved, or a
slip that was forgotten is seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.body import ElasticBody
from ..fem.contact_matrix import at_nodes_of, contact_matrix, rows_of
from ..fem.surface import tangent_frames, way_along
from ..fem.user_values import evaluate_motion, on_all_ranks
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw
from .nodal_answer import closure

if TYPE_CHECKING:
    from .problem import ContactProblem

HELD_BEYOND = 1.0 - 1e-10
"""Length of the part of a node's normal along prescribed components from which on the node cannot touch."""


@dataclass(frozen=True)
class Evidence:
    """What an answer is judged by: this rank's part, k nodes of which m are judged as contact nodes; newtons, metres.

    Those m are all nodes of the named contact faces but the ones whose displacement along the normal is prescribed; and
    any other node that has a contact force, as one that is pulled.

    Attributes:
        comm: The ranks.
        x: Coordinates, shape (k, 3).
        displacement: Shape (k, 3).
        internal: Nodal forces of its stress, assembled anew, shape (k, 3).
        load: Shape (k, 3).
        spring: Stiffness of the springs along x, y and z in N/m, shape (k, 3).
        fixed: Which components are prescribed, shape (k, 3).
        prescribed: Their values, shape (k, 3).
        on_body: Contact forces on the body, shape (k, 3).
        force: The same at the contact nodes along n, t1, t2, with x_n >= 0 pressing, shape (m, 3).
        closure: Displacement of the contact nodes along n, and their slip along t1, t2, shape (m, 3).
        gap: Before deformation, shape (m,).
        bound: Slip bound of the law at these forces, shape (m,).
        rounding: Nodal forces that rounding the displacement may make (`rounding_forces`), shape (k, 3).
        compliance: Mean diagonal of A, metres per newton.
    """

    comm: MPI.Comm
    x: FloatArray
    displacement: FloatArray
    internal: FloatArray
    load: FloatArray
    spring: FloatArray
    fixed: npt.NDArray[np.bool_]
    prescribed: FloatArray
    on_body: FloatArray
    force: FloatArray
    closure: FloatArray
    gap: FloatArray
    bound: FloatArray
    rounding: FloatArray
    compliance: float


class Before(Protocol):
    """Where a load step begins: the time and the displacement (k, 3) in metres that the step before has left."""

    @property
    def time(self) -> float: ...

    @property
    def displacement(self) -> FloatArray: ...


def evidence(problem: ContactProblem, x: FloatArray, u: FloatArray, before: Before | None = None) -> Evidence:
    """What speaks for and against an answer; collective.

    Args:
        problem: The contact problem.
        x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2) of its surface.
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        before: What the load step before has left; without, slip counts from the problem's `slip_origin`.
    """
    elasticity, surface = problem.elasticity, problem.surface
    faces = [_face(problem, number, before) for number in range(len(problem.contacts))]
    nodes, n, gap, cohesion, friction, moved = (np.concatenate(part) for part in zip(*faces, strict=True))
    frames = tangent_frames(n)
    B = contact_matrix(elasticity, nodes, frames)

    number = np.full(len(u), -1)
    number[nodes] = np.arange(len(nodes))
    judged = number[surface.nodes]  # the rows of the solver's contact points among those that are judged
    known = judged >= 0

    def taken(components: FloatArray) -> FloatArray:
        """Of the solver's contact points, in the frames that are judged; 0 where it has none."""
        vectors = np.zeros((len(nodes), 3))
        np.add.at(vectors, judged[known], surface.vectors(components)[known])
        components_: FloatArray = np.einsum("kij,kj->ki", frames, vectors)
        return components_

    x = x.reshape(-1, 3)
    force = taken(x)
    on_body = -at_nodes_of(B, force)
    stray = surface.vectors(x)[~known]  # where no force can be, it pulls, whichever way it points
    np.subtract.at(on_body, surface.nodes[~known], stray)
    stray = stray[np.any(stray != 0.0, axis=1)]
    none = np.zeros(len(stray))
    if before is None:
        origin = taken(problem.slip_origin)
    else:
        origin = rows_of(B, before.displacement) + np.einsum("kij,kj->ki", frames, moved)
    closed = closure(rows_of(B, u), origin)
    B.destroy()
    bound = FrictionLaw(cohesion, friction).radius(force[:, 0])
    return Evidence(
        comm=problem.comm,
        x=elasticity.x,
        displacement=u,
        internal=elasticity.internal_force(u),
        load=elasticity.load,
        spring=elasticity.spring,
        fixed=elasticity.fixed,
        prescribed=elasticity.prescribed,
        on_body=on_body,
        force=np.concatenate([force, np.column_stack([-np.max(np.abs(stray), axis=1, initial=0.0), none, none])]),
        closure=np.concatenate([closed, np.zeros((len(stray), 3))]),
        gap=np.concatenate([gap, none]),
        bound=np.concatenate([bound, none]),
        rounding=rounding_forces(elasticity, u),
        compliance=problem.mean_compliance,
    )


def rounding_forces(body: ElasticBody, u: FloatArray) -> FloatArray:
    """Nodal forces in newtons of a change of the displacement u by one rounding, shapes (k, 3); collective.

    2^-52 of the largest component of u, with signs that change from node to node.
    """
    motion = Reductions(body.domain.comm).max(np.abs(u))
    size = Reductions(body.domain.comm).max(np.abs(body.x)) or 1.0
    signs = np.where(
        np.sin(body.x / size @ np.array([[1e4, 2e4, 3e4], [5e4, 4e4, 7e4], [9e4, 8e4, 6e4]])) > 0, 1.0, -1.0
    )
    return body.internal_force(2.0**-52 * motion * signs)


def _face(
    problem: ContactProblem, number: int, before: Before | None
) -> tuple[npt.NDArray[np.int32], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of a contact face, the nodes that are not prescribed along their normal; collective.

    Returns:
        Their numbers among this rank's nodes; n; gap in metres; cohesion in newtons and friction, as the contact was
        given; and the foundation's displacement in this step in metres, shape (m, 3).
    """
    contact, elasticity, comm = problem.contacts[number], problem.elasticity, problem.comm
    nodes = elasticity.nodes(contact.face, "contact")
    what = f"contact face {contact.face!r}"

    def way() -> tuple[FloatArray, FloatArray]:
        here = evaluate_motion(contact.motion, problem.time, what)
        return here, here - evaluate_motion(contact.motion, before.time, what) if before else np.zeros(3)

    here, moved = on_all_ranks(way, "", comm)
    foundation, place = problem.foundations[number], elasticity.x[nodes] - here  # seen by the foundation at rest
    if contact.normals == "body":
        outward = elasticity.nodal_normal(contact.face)[nodes]
        n = outward / np.linalg.norm(outward, axis=1)[:, None]
    else:
        n = on_all_ranks(lambda: -foundation.normal(place) if len(place) else np.zeros((0, 3)), what, comm)
    free = np.linalg.norm(np.where(elasticity.fixed[nodes], n, 0.0), axis=1) <= HELD_BEYOND
    nodes, n, place = nodes[free], n[free], place[free]

    def remaining() -> FloatArray:
        if len(place) == 0:
            return np.zeros(0)
        distance = foundation.signed_distance(place)
        return way_along(n, place, distance, foundation) if contact.normals == "body" else distance

    gap = on_all_ranks(remaining, what, comm)
    law = contact.law(elasticity.x[nodes], elasticity.nodal_area(contact.face)[nodes], comm)
    return nodes, n, gap, law.cohesion, law.friction, np.tile(moved, (len(nodes), 1))
