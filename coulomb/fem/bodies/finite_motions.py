"""Rigid faces that turn by finite angles, of bodies of large displacements.

A node X has moved to c + d + R(theta) (X - c), with the translation d of the reference point c and the rotation vector
theta: these six are the components that are prescribed, free, or on springs.  At a displacement the pose (d, theta) is
that of the nearest rigid motion; changes move nodes by dd + J dtheta x r, with r from the moved point and J of
`turn_by_change`; and nodes that are off the pose are moved to where it takes them.  So iterates converge quadratically
to nodes that are exactly where the face takes them, if K has the second derivative of these places times the forces
there, `FiniteMotion.bent`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ..geometry import rotation_matrix, rotation_vector, turn_by_change
from .rigid_modes import Wrench, nearest_turn
from .ties import FaceMotion, moved_at

_DIFFERENCE: Final = 1e-4
"""Step in radians of the differences that second derivatives are."""


@dataclass(frozen=True)
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
        gram = comm.allreduce(np.einsum("mcp,mcq->pq", modes / size, modes / size), op=MPI.SUM)
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

    def moved_by(self, y: FloatArray, time: float, comm: MPI.Comm) -> tuple[FloatArray, FloatArray]:
        return self.point, self.pose

    def pull(self, u: FloatArray, comm: MPI.Comm) -> FloatArray:
        forces = np.zeros_like(u)
        forces[self.nodes] = -self.spread @ (self.given.stiffness * self.pose)
        return forces

    def bent(self, forces: FloatArray, wrenches: Sequence[Wrench], comm: MPI.Comm) -> FloatArray:
        """The stiffness of its own unknowns by the forces f (k, 3) that its nodes lack, beside wrenches, N/m, shape (r,
        r): along dtheta these are M = J^T sum(r x f), of which dM/dtheta at constant f is the second derivative of f .
        R(theta) (X - c); of the moment of a wrench, which has no potential, the symmetric part; collective."""
        P = comm.allreduce(self.arms.T @ forces[self.nodes], op=MPI.SUM)
        P -= sum((np.outer(one.point - self.place, one.force) for one in wrenches), np.zeros((3, 3)))
        moment = sum((one.moment for one in wrenches), np.zeros(3))

        def moments(theta: FloatArray) -> FloatArray:
            A = rotation_matrix(theta) @ P
            whole = np.array([A[1, 2] - A[2, 1], A[2, 0] - A[0, 2], A[0, 1] - A[1, 0]]) - moment
            return turn_by_change(theta).T @ whole

        theta, h = self.pose[3:], _DIFFERENCE
        H = np.column_stack([(moments(theta + h * e) - moments(theta - h * e)) / (2.0 * h) for e in np.eye(3)])
        about = self.motions[3:]
        bent: FloatArray = about.T @ (0.5 * (H + H.T)) @ about
        return bent
