"""Evidence: the data from which an answer is certified, gathered from a problem or read from the files of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.bodies import HeldDirections
from ..linalg.reductions import Reductions


@dataclass(frozen=True)
class Evidence:
    """The data of a certificate: this rank's part, k nodes of which m are contact nodes; newtons, metres.

    These m are all nodes of the contact faces except those whose displacement along the normal is prescribed; and any
    other node with a contact force, which then counts as tensile.

    Attributes:
        comm: The ranks.
        x: Coordinates, shape (k, 3).
        displacement: Shape (k, 3).
        internal: Nodal forces of its stress, assembled anew, shape (k, 3).
        load: Shape (k, 3).
        spring: Forces of the springs, shape (k, 3).
        ground: Nodal forces of the `rigid_modes` in newtons, shape (k, 3, 6): those of springs, and of elastic
            foundations among the internal forces; None if there are none.
        held: The directions along which displacements are prescribed.
        prescribed: The displacement along them, shape (k, 3).
        on_body: Contact forces on the body, and those of ties, shape (k, 3).
        force: The same at the contact nodes along n, t1, t2, with x_n >= 0 pressing, shape (m, 3).
        closure: Displacement of the contact nodes along n, and their slip along t1, t2, shape (m, 3).
        gap: Before deformation, shape (m,).
        bound: Slip bound of the law at these forces, shape (m,).
        rounding: Nodal forces due to rounding of the displacement (`rounding_forces`), shape (k, 3).
        compliance: Mean diagonal of A, metres per newton.
        blocked: Scale of the displacements that loads would cause where nothing can move, metres
            (`Deformable.blocked_displacement`).
        component: Component of the meshes of each node, from 0, shape (k,); None if each body is one.
        averaged: Whether gaps and slips are averages over the facets around vertices, as on 10-node tetrahedra, or
            over parts of the two faces of a pair.
        bodies: The nodes of each body; empty for one.
        jump: How far tied nodes are from where they should be, shape (k, 3); None without ties.
        actions: Of every pair of faces, what acts on both: `pair_actions`, this rank's part, shape (pairs, 3, 7).
    """

    comm: MPI.Comm
    x: FloatArray
    displacement: FloatArray
    internal: FloatArray
    load: FloatArray
    spring: FloatArray
    held: HeldDirections
    prescribed: FloatArray
    on_body: FloatArray
    force: FloatArray
    closure: FloatArray
    gap: FloatArray
    bound: FloatArray
    rounding: FloatArray
    compliance: float
    blocked: float = 0.0
    averaged: bool = False
    ground: FloatArray | None = None
    component: npt.NDArray[np.int64] | None = None
    bodies: tuple[slice, ...] = ()
    actions: FloatArray | None = None
    jump: FloatArray | None = None


def pair_actions(
    x: FloatArray, slave: FloatArray, master: FloatArray, at: FloatArray, opposite: FloatArray, force: FloatArray
) -> FloatArray:
    """Resultants on this rank of nodal forces on slave and master (k, 3) of a pair, and of the couples of its forces
    (m, 3) on the slave `at` and on the master `opposite` across undeformed gaps: shape (3, 7), with three forces, three
    moments about the origin of x, and the sum of magnitudes."""
    couples = np.cross(at - opposite, force)
    none = np.zeros_like(couples)
    rows = ((slave, np.cross(x, slave)), (master, np.cross(x, master)), (none, couples))
    return np.array(
        [[*one.sum(axis=0), *moment.sum(axis=0), np.sum(np.linalg.norm(one, axis=1))] for one, moment in rows]
    )


class Strained(Protocol):
    """A body with nodes x (k, 3), internal nodal forces of displacements u (k, 3), and their largest gradient."""

    x: FloatArray

    @property
    def comm(self) -> MPI.Comm: ...

    def internal_force(self, u: FloatArray) -> FloatArray: ...

    def largest_gradient(self, u: FloatArray) -> float: ...


def rounding_forces(body: Strained, u: FloatArray) -> FloatArray:
    """Nodal forces in newtons of a rounding error of the displacement u, shapes (k, 3); collective.

    The error is 2^-52 of the largest component of u, with signs that vary from node to node.
    """
    motion = Reductions(body.comm).max(np.abs(u))
    size = Reductions(body.comm).max(np.abs(body.x)) or 1.0
    signs = np.where(
        np.sin(body.x / size @ np.array([[1e4, 2e4, 3e4], [5e4, 4e4, 7e4], [9e4, 8e4, 6e4]])) > 0, 1.0, -1.0
    )
    return body.internal_force(2.0**-52 * motion * signs)
