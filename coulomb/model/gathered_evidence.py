"""The evidence of a problem, gathered from its input: faces, foundations, motions, coefficients.

The solver's contact surface and slip origin are not used: nodes come from the facets of the contact faces, normals and
gaps from the foundations at their current place, and slip is measured from the displacement after the step before.  So
a node missing in the surface, a foundation that was not moved or a wrong slip origin is detected.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..fem.contact_frames import held_length, inverse_frames
from ..fem.contact_matrix import at_nodes_of, contact_matrix, rows_of
from ..fem.rigid_motion import RigidMotion
from ..fem.surface import way_along
from ..fem.user_values import on_all_ranks
from ..solvers.laws import FrictionLaw
from .contact_body import ContactBody
from .evidence import HELD_BEYOND, Evidence, rounding_forces
from .nodal_answer import closure
from .state import Before, ContactState


def gather_evidence(
    body: ContactBody,
    state: ContactState,
    x: FloatArray,
    u: FloatArray,
    compliance: float,
    before: Before | None,
) -> Evidence:
    """The evidence for an answer; collective.

    Args:
        body: The body with its contact faces.
        state: The time, the loads, and the contact points to which the forces belong.
        x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2) of its surface.
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        compliance: Mean diagonal of A, metres per newton.
        before: End of the load step before; None if slip is measured from the state's `slip_origin`.
    """
    elasticity, surface = body.elasticity, state.surface
    slip_rate = np.zeros(len(u))
    slip_rate[surface.nodes] = state.slip_rate if before is None else before.slip_rate
    faces = [_face(body, number, state.time, before, slip_rate) for number in range(len(body.contacts))]
    nodes, frames, gap, cohesion, friction, carried = (np.concatenate(part) for part in zip(*faces, strict=True))
    B = contact_matrix(elasticity, nodes, frames)

    number = np.full(len(u), -1)
    number[nodes] = np.arange(len(nodes))
    judged = number[surface.nodes]  # the solver's contact points among those of the evidence
    known = judged >= 0

    def taken(vectors: FloatArray, axes: FloatArray) -> FloatArray:
        """Space vectors at the solver's contact points as components at those of the evidence; 0 elsewhere."""
        there = np.zeros((len(nodes), 3))
        np.add.at(there, judged[known], vectors[known])
        components: FloatArray = np.einsum("kij,kj->ki", axes, there)
        return components

    x = x.reshape(-1, 3)
    force = taken(surface.vectors(x), inverse_frames(frames))
    on_body = -at_nodes_of(B, force)
    stray = surface.vectors(x)[~known]  # a force where none is possible counts as tensile
    np.subtract.at(on_body, surface.nodes[~known], stray)
    stray = stray[np.any(stray != 0.0, axis=1)]
    none = np.zeros(len(stray))
    if before is None:
        origin = taken(surface.displacements(state.slip_origin), frames)
    else:
        origin = rows_of(B, before.displacement) + np.einsum("kij,kj->ki", frames, carried)
    closed = closure(rows_of(B, u), origin)
    B.destroy()
    bound = FrictionLaw(cohesion, friction).radius(force[:, 0])
    return Evidence(
        comm=body.comm,
        x=elasticity.x,
        displacement=u,
        internal=elasticity.internal_force(u),
        load=state.loading.load,
        spring=elasticity.spring,
        held=elasticity.held,
        prescribed=state.loading.prescribed,
        on_body=on_body,
        force=np.concatenate([force, np.column_stack([-np.max(np.abs(stray), axis=1, initial=0.0), none, none])]),
        closure=np.concatenate([closed, np.zeros((len(stray), 3))]),
        gap=np.concatenate([gap, none]),
        bound=np.concatenate([bound, none]),
        rounding=rounding_forces(elasticity, u),
        compliance=compliance,
    )


def _face(
    body: ContactBody, number: int, time: float, before: Before | None, slip_rate: FloatArray
) -> tuple[npt.NDArray[np.int32], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The nodes of a contact face that are not prescribed along their normal; collective.

    Returns:
        Their numbers among this rank's nodes; frames, shape (m, 3, 3); gap in metres; cohesion in newtons and friction,
        of the contact; and the foundation's displacement in this step in metres, shape (m, 3).
    """
    contact, elasticity, comm = body.contacts[number], body.elasticity, body.comm
    nodes = elasticity.nodes(contact.face, "contact")
    what = f"contact face {contact.face!r}"

    def way() -> tuple[RigidMotion, RigidMotion]:
        here = contact.rigid_motion(time, what)
        return here, contact.rigid_motion(before.time, what) if before else here

    here, then = on_all_ranks(way, "", comm)
    foundation, place = body.foundations[number], here.undone(elasticity.x[nodes])  # in the foundation's coordinates
    if contact.normals == "body":
        outward = elasticity.nodal_normal(contact.face)[nodes]
        n = outward / np.linalg.norm(outward, axis=1)[:, None]
    else:
        n = on_all_ranks(lambda: here.turned(-foundation.normal(place)) if len(place) else np.zeros((0, 3)), what, comm)
    H = elasticity.held.projector_at(nodes)
    free = held_length(n, H) <= HELD_BEYOND
    nodes, n, place, H = nodes[free], n[free], place[free], H[free]

    def remaining() -> FloatArray:
        if len(place) == 0:
            return np.zeros(0)
        distance = foundation.signed_distance(place)
        return way_along(here.turned_back(n), place, distance, foundation) if contact.normals == "body" else distance

    given = contact.gap_factor(time, comm) * contact.gap_at(elasticity.x[nodes], comm)
    gap = on_all_ranks(remaining, what, comm) + given
    law = contact.law(elasticity.x[nodes], elasticity.nodal_area(contact.face)[nodes], time, slip_rate[nodes], comm)
    frames = contact.frames(n, H, elasticity.x[nodes], comm)
    return nodes, frames, gap, law.cohesion, law.friction, here.since(then, elasticity.x[nodes])
