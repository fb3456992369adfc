"""Rigid faces and sections of bolts that turn by finite angles, of bodies of large displacements.

A node X has moved to c + d + R(theta) (X - c), with the translation d of the reference point c and the rotation vector
theta: these six are the components that are prescribed, free, or on springs.  At a displacement the pose (d, theta) is
that of the nearest rigid motion; changes move nodes by dd + J dtheta x r, with r from the moved point and J of
`turn_by_change`; and nodes that are off the pose are moved to where it takes them.  So iterates converge quadratically
to nodes that are exactly where the face takes them, if K has the second derivative of these places times the forces
there, `FiniteMotion.bent`.

The direction of a bolt turns with its section: u_slave = W u + s R n, with R of the rigid motion that is nearest to
that of the outermost points W x (of all, rows would be dense).  A change turns n by dtheta, which follows from those of
these points, so that the rows of the slave nodes have s dtheta x R n as well: no rigid motion is resisted, and forces
and their moments are in balance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ..geometry import rotation_matrix, rotation_vector, turn_by_change
from .rigid_modes import Wrench, nearest_turn
from .ties import FaceMotion, Section, Tie, moved_at

_DIFFERENCE: Final = 1e-3
"""Step in radians of the differences of fourth order that second derivatives are: errors of 1e-12."""


@dataclass(frozen=True, eq=False)
class FiniteMotion(FaceMotion):
    """The motion of a rigid face with a finite rotation; `motions`, `given_part` and `spread` are of changes of its six
    components, and `values` of these.

    Attributes:
        arms: From the reference point to its nodes before deformation, metres, shape (m, 3).
        pose: Translation of the point in metres and rotation vector in radians, shape (6,).
    """

    finite: ClassVar[bool] = True
    arms: FloatArray = field(kw_only=True)
    pose: FloatArray = field(default_factory=lambda: np.zeros(6), kw_only=True)

    @property
    def point(self) -> FloatArray:
        """The reference point where it has moved to, metres, shape (3,)."""
        return self.place + self.pose[:3]

    @property
    def turn(self) -> FloatArray:
        return self.pose[3:]

    @property
    def _by_changes(self) -> FloatArray:
        """Translations and rotations in space by changes of the six components, shape (6, 6)."""
        T = np.eye(6)
        T[3:, 3:] = turn_by_change(self.pose[3:])
        return T

    def at_place(self, x: FloatArray, near: FloatArray, comm: MPI.Comm) -> FiniteMotion:
        """The same of nodes at x (k, 3), metres; the rotation vector is the nearest to another (3,); collective."""
        from_, to, R = nearest_turn(self.arms, x[self.nodes] - self.place, comm)
        pose = np.concatenate([to - R @ from_, rotation_vector(R, near)])
        there = replace(self, pose=pose)
        modes = moved_at(there._by_changes, x[self.nodes] - there.point)
        modes *= np.any(self.spread != 0.0, axis=(1, 2))[:, None, None]
        size = np.repeat([1.0, comm.allreduce(float(np.max(np.abs(self.arms), initial=0.0)), op=MPI.MAX)], 3)
        gram = comm.allreduce(np.einsum("mcp,mcq->pq", modes / size, modes / size))
        return replace(there, spread=(modes / size) @ np.linalg.pinv(gram, hermitian=True) / size)

    def own(self, x: FloatArray) -> FloatArray:
        """N: displacements of its nodes by its free amounts, of those of the body at x (k, 3), shape (m, 3, r)."""
        return moved_at(self._by_changes @ self.motions, x[self.nodes] - self.point)

    def prescribed(self, x: FloatArray, time: float, comm: MPI.Comm) -> FloatArray:
        """From nodes x (k, 3) of the face to where it takes them, with what is prescribed at a time and the rest of its
        pose, 0 at others, metres, shape (k, 3); collective."""
        q = np.where(self.given.prescribed, self.values(time, comm), self.pose)
        t = np.zeros_like(x)
        t[self.nodes] = self.place + q[:3] + self.arms @ rotation_matrix(q[3:]).T - x[self.nodes]
        return t

    def prescribed_rate(self, x: FloatArray, time: float, comm: MPI.Comm) -> FloatArray:
        t = np.zeros_like(x)
        t[self.nodes] = self.of_components(x) @ np.where(self.given.prescribed, self.values(time, comm), 0.0)
        return t

    def of_components(self, x: FloatArray) -> FloatArray:
        return moved_at(self._by_changes, x[self.nodes] - self.point)

    def moved_by(self, y: FloatArray, time: float, comm: MPI.Comm) -> tuple[FloatArray, FloatArray]:
        return self.point, self.pose

    def pull(self, u: FloatArray, comm: MPI.Comm) -> FloatArray:
        forces = np.zeros_like(u)
        forces[self.nodes] = -self.spread @ (self.given.stiffness * self.pose)
        return forces

    def pull_rate(self, x: FloatArray, way: FloatArray, comm: MPI.Comm) -> FloatArray:
        size = comm.allreduce(float(np.max(np.abs(way[self.nodes]), initial=0.0)), op=MPI.MAX)
        arm = comm.allreduce(float(np.max(np.abs(self.arms), initial=0.0)), op=MPI.MAX)
        h = _DIFFERENCE * arm / (size or 1.0)
        return _derivative(lambda step: self.at_place(x + step * way, self.turn, comm).pull(way, comm), h)

    def bent(self, forces: FloatArray, wrenches: Sequence[Wrench], comm: MPI.Comm) -> FloatArray:
        """The stiffness of its own unknowns by the forces f (k, 3) that its nodes lack, beside wrenches, N/m, shape (r,
        r): along dtheta these are M = J^T sum(r x f), of which dM/dtheta at constant f is the second derivative of f .
        R(theta) (X - c); of the moment of a wrench, which has no potential, the symmetric part; collective."""
        H, about = self.moment_rates(forces, wrenches, comm), self.motions[3:]
        return about.T @ (0.5 * (H + H.T)) @ about

    def moment_rates(self, forces: FloatArray, wrenches: Sequence[Wrench], comm: MPI.Comm) -> FloatArray:
        """dM/dtheta of `bent`, newton metres, shape (3, 3); arguments as there; collective."""
        P = comm.allreduce(self.arms.T @ forces[self.nodes])
        P -= sum((np.outer(wrench.point - self.place, wrench.force) for wrench in wrenches), np.zeros((3, 3)))
        moment = sum((wrench.moment for wrench in wrenches), np.zeros(3))

        def moments(theta: FloatArray) -> FloatArray:
            A = rotation_matrix(theta) @ P
            whole = np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]]) - moment
            return turn_by_change(theta).T @ whole

        theta = self.pose[3:]

        def about(axis: FloatArray) -> FloatArray:
            return _derivative(lambda step: moments(theta + step * axis), _DIFFERENCE)

        return np.column_stack([about(axis) for axis in np.eye(3)])


def _derivative(of: Callable[[float], FloatArray], h: float) -> FloatArray:
    """At 0, by differences of fourth order."""
    near, far = ((of(step) - of(-step)) / (2.0 * step) for step in (h, 2.0 * h))
    return (4.0 * near - far) / 3.0


def turned_section(tie: Tie, x: FloatArray, apart: FloatArray, tied: FloatArray, comm: MPI.Comm) -> Section:
    """The section of a bolt, with its nodes at x (m, 3), which are `apart` (m, 3) from the points that they follow,
    metres, along the directions of projectors (m, 3, 3); collective."""
    section = tie.bolt
    assert section is not None
    from_, to, R = nearest_turn(section.arms, (x - apart)[section.rim], comm)
    n = R @ section.direction
    N = tied @ n
    along, size = comm.allreduce(np.array([np.sum(N * apart), np.sum(N * N)]))
    place, arms = to - R @ from_, section.arms @ R.T
    return replace(section, place=place, direction=n, arms=arms, shortening=float(along / size))


def turned_tie(tie: Tie, x: FloatArray, apart: FloatArray, tied: FloatArray, comm: MPI.Comm) -> Tie:
    """The tie of a bolt's section with its `turned_section`, and with rows of changes; arguments as there;
    collective."""
    section = turned_section(tie, x, apart, tied, comm)
    own = np.tile(section.direction[:, None], (len(x), 1, 1))
    if section.shortening == 0.0:
        return replace(tie, own=own, bolt=section)
    rim, followed = section.rim, (x - apart)[section.rim]
    sums = comm.allreduce(np.array([*section.arms.sum(axis=0), *followed.sum(axis=0), len(rim)]))
    a, b = section.arms - sums[:3] / sums[6], followed - sums[3:6] / sums[6]
    size = comm.allreduce(np.sum(a * b) * np.eye(3) - a.T @ b)  # of sum(a x db) = size dtheta
    dofs = (3 * rim[:, None] + np.arange(3)).ravel()
    levers = scipy.sparse.csr_matrix(np.moveaxis(_crossing(a), 0, 1).reshape(3, -1)) @ tie.rows[dofs]
    turning = scipy.sparse.csr_matrix(np.linalg.inv(size)) @ sum(comm.allgather(levers))
    across = -section.shortening * (tied @ _crossing(section.direction)).reshape(-1, 3)
    return replace(tie, own=own, bolt=section, rows=(tie.rows + scipy.sparse.csr_matrix(across) @ turning).tocsr())


def _crossing(vectors: FloatArray) -> FloatArray:
    """The matrices C of vectors v (..., 3) with C w = v x w, shape (..., 3, 3)."""
    return np.cross(vectors[..., None, :], np.eye(3)).swapaxes(-1, -2)
