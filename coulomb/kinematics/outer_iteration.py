"""Contact forces from one iterate of a load step to the next, and the acceleration of iterates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from ..fem.contact import ContactSurface
from ..linalg.reductions import Reductions
from ..solvers.successive_tresca import Anderson

_MEMORY = 4
"""Differences of iterates by which they are accelerated."""

NEAR = 3e-4
"""Residual below which they are."""

_LINEAR = (0.03, 0.7)
"""Ratios of successive changes of the displacement between which convergence is linear: below it is faster."""

_WORTH = 0.3
"""Part of the residual before an accelerated iterate, which has made it larger, that the next one must reach."""

_OPPOSITE = 1e-6
"""One more than the cosine of the angle of two normals, at least: forces are not carried between opposite ones."""


@dataclass(frozen=True)
class CarriedForces:
    """Contact forces, space vectors in newtons, and the normals of their places, at this rank's nodes, shapes (k, 3); 0
    at nodes without."""

    vectors: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, x: FloatArray, surface: ContactSurface, nodes: int) -> CarriedForces:
        """Of forces x (3 m,) at the contact points of a surface, of so many nodes."""
        vectors, normals = np.zeros((2, nodes, 3))
        vectors[surface.nodes], normals[surface.nodes] = surface.vectors(x.reshape(-1, 3)), surface.frames[:, 0]
        return cls(vectors, normals)

    def at(self, surface: ContactSurface) -> FloatArray:
        """Along the frames of a surface, turned as its normals have (parallel transport), shape (3 m,)."""
        f, n, m = self.vectors[surface.nodes], self.normals[surface.nodes], surface.frames[:, 0]
        axis, cosine = np.cross(n, m), np.einsum("ki,ki->k", n, m)[:, None]
        along = np.einsum("ki,ki->k", axis, f)[:, None] / np.maximum(1.0 + cosine, _OPPOSITE)
        x: FloatArray = surface.force_components(cosine * f + np.cross(axis, f) + along * axis).ravel()
        return x


class Path:
    """The iterates of a load step, accelerated where they converge linearly: displacement, and contact forces times the
    mean compliance, by Anderson's method."""

    def __init__(self, over: Reductions):
        self._over, self._anderson, self._last = over, Anderson(_MEMORY, over), np.inf
        self._goal, self._ends = np.inf, False

    def restart(self) -> None:
        self._anderson.restart()

    def judge(self, size: float, before: float, accelerated: bool) -> None:
        """An iterate has this residual: one that makes it larger has to be worth it in the next, or is the last."""
        self._ends |= size > self._goal
        self._goal = _WORTH * before if accelerated and size > before else np.inf

    def next(
        self, u: FloatArray, du: FloatArray, before: CarriedForces, after: CarriedForces, compliance: float
    ) -> tuple[FloatArray, CarriedForces] | None:
        """The change of the displacement u and the next forces, from those that the linear problem has; None where
        these are as good; collective."""
        point = np.concatenate([u, compliance * before.vectors])
        change = np.concatenate([du, compliance * (after.vectors - before.vectors)])
        size, last = self._over.norm(du), self._last
        self._last = size
        if size > _LINEAR[1] * last:
            self.restart()
        mixed = self._anderson.next(point.ravel(), change.ravel(), 1.0).reshape(-1, 3) - point
        if self._ends or not _LINEAR[0] * last < size <= _LINEAR[1] * last:
            return None
        forces = before.vectors + mixed[len(u) :] / compliance
        return mixed[: len(u)], replace(after, vectors=forces)
