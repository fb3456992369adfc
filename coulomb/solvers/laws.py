"""The law of friction at the contact nodes: |x_t| <= r(x_n) with r = c a + F x_n.

c a is the cohesion of a node in newtons (cohesion in pascals times nodal area), F its coefficient of friction.  F = 0
is Tresca's law, c = 0 Coulomb's, both together Mohr-Coulomb's; nodes of one problem may have different ones.  Where
there is slip, friction is at its bound and opposes the slip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions

LAWS = ("coulomb", "tresca", "mohr-coulomb")
"""Names of the laws; Mohr-Coulomb's is also that of faces with different laws together."""

_LARGEST: Final = 1e100
"""Cohesion, or coefficient, whose square is far from overflow."""


@dataclass(frozen=True)
class FrictionLaw:
    """The bound of the friction force of every contact node of this rank.

    Attributes:
        cohesion: Part of the bound that does not depend on the pressure, c a >= 0 in newtons, shape (m,).
        friction: Coefficient of friction F >= 0, shape (m,).
    """

    cohesion: FloatArray
    friction: FloatArray

    @staticmethod
    def tresca(slip_bound: FloatArray) -> FrictionLaw:
        """Given slip bounds in newtons, shape (m,), independent of pressure."""
        return FrictionLaw(slip_bound, np.zeros_like(slip_bound))

    @staticmethod
    def coulomb(friction: FloatArray) -> FrictionLaw:
        """Bounds in proportion to the normal forces, coefficients of shape (m,)."""
        return FrictionLaw(np.zeros_like(friction), friction)

    @staticmethod
    def joined(laws: Sequence[FrictionLaw]) -> FrictionLaw:
        """The law of the nodes of several laws, one after the other."""
        return FrictionLaw(*(np.concatenate([getattr(law, name) for law in laws]) for name in ("cohesion", "friction")))

    def validate(self, nodes: int, over: Reductions) -> None:
        """Check shapes and numbers; collective.

        Raises:
            ValueError: On every rank, if the law is not one of this many nodes, or has a number that is not permitted.
        """
        for name, values in (("cohesion", self.cohesion), ("friction", self.friction)):
            must = f"{name} must have shape ({nodes},), one per contact node, but has {values.shape}"
            over.require(values.shape == (nodes,), must)
            permitted = np.all(np.isfinite(values) & (values >= 0.0))
            over.require(permitted, f"{name} has entries that are negative or not finite")
            within = np.all(values <= _LARGEST)
            given = "cohesion, or slip_stress, times area" if name == "cohesion" else name
            over.require(within, f"{given} has entries above {_LARGEST:g}: that overflows, and holds no better")

    def name(self, over: Reductions) -> str:
        """Name of the law over all ranks, one of `LAWS`: Coulomb's without cohesion, Tresca's without friction."""
        if over.max(self.cohesion) <= 0.0:
            return "coulomb"
        return "mohr-coulomb" if over.max(self.friction) > 0.0 else "tresca"

    def at(self, which: npt.NDArray[np.bool_ | np.int64]) -> FrictionLaw:
        """The law of some of the nodes, a mask or their numbers."""
        return FrictionLaw(self.cohesion[which], self.friction[which])

    def rough(self, friction: float) -> FrictionLaw:
        """The law with this coefficient at all nodes whose bound grows with pressure."""
        return FrictionLaw(self.cohesion, np.where(self.sloped, friction, 0.0))

    def only(self, which: npt.NDArray[np.bool_], otherwise: float) -> FrictionLaw:
        """The law at some of the nodes (m,); at the others a bound that does not depend on the pressure."""
        return FrictionLaw(np.where(which, self.cohesion, otherwise), np.where(which, self.friction, 0.0))

    def slope(self, x_n: FloatArray) -> FloatArray:
        """dr/dx_n at normal forces x_n > 0, both of shape (m,): the coefficient of friction."""
        return self.friction

    @property
    def sloped(self) -> npt.NDArray[np.bool_]:
        """Nodes whose bound grows with pressure, shape (m,)."""
        return self.friction > 0.0

    @property
    def frictional(self) -> npt.NDArray[np.bool_]:
        """Nodes whose friction is not zero at every pressure, shape (m,)."""
        return (self.cohesion > 0.0) | (self.friction > 0.0)

    def radius(self, x_n: FloatArray) -> FloatArray:
        """Bound of the friction force in newtons at normal forces x_n in newtons, both of shape (m,)."""
        return self.cohesion + self.friction * np.maximum(x_n, 0.0)

    def scaled(self, normal: FloatArray | float, friction: FloatArray | float | None = None) -> FrictionLaw:
        """The law for normal forces in units of `normal` and friction in units of `friction`, by default the same; one
        number or one per node, shape (m,)."""
        unit = normal if friction is None else friction
        return FrictionLaw(self.cohesion / unit, self.friction * (normal / unit))

    def project(self, x: FloatArray, x_n: FloatArray, lower: float | FloatArray = 0.0) -> FloatArray:
        """The point nearest to x with x_n' >= lower and |x_t| <= r(x_n), node by node.

        Args:
            x: Forces in newtons, shape (3 m,), node by node (n, t1, t2).
            x_n: Normal forces in newtons at which the bound of friction is taken, shape (m,).
            lower: Lower bound of the normal forces in newtons, a number or shape (m,).
        """
        v, bound = x.reshape(-1, 3), self.radius(x_n)
        p = np.empty_like(v)
        p[:, 0] = np.maximum(v[:, 0], lower)
        size = np.hypot(v[:, 1], v[:, 2])
        inside = size <= bound
        shrink = np.where(inside, 1.0, bound / np.where(inside, 1.0, size))
        p[:, 1:] = v[:, 1:] * shrink[:, None]
        return p.ravel()

    def left_over(self, x: FloatArray, step: FloatArray, lower: float | FloatArray) -> FloatArray:
        """x - P(x - step) in newtons, shape (3 m,), also where x is so large that x - step rounds to x."""
        left = (x - self.project(x - step, x[0::3], lower)).reshape(-1, 3)
        v, s = x.reshape(-1, 3), step.reshape(-1, 3)
        left[:, 0] = np.minimum(s[:, 0], v[:, 0] - lower)
        inside = np.hypot(*(v - s)[:, 1:].T) <= self.radius(v[:, 0])
        left[inside, 1:] = s[inside, 1:]
        return left.ravel()

    def against(self, slip: FloatArray, x_n: FloatArray) -> FloatArray:
        """Friction where the slip is known, newtons, shape (m, 2): at its bound, and along the slip, as x_t is.

        0 where there is no slip: there friction is anything within its bound.

        Args:
            slip: Along t1 and t2, shape (m, 2).
            x_n: Normal forces in newtons, shape (m,).
        """
        way = np.hypot(slip[:, 0], slip[:, 1])
        return slip * (self.radius(x_n) / np.where(way > 0.0, way, 1.0))[:, None]

    def natural_residual(
        self, x: FloatArray, gradient: FloatArray, compliance: float, over: Reductions, lower: float | FloatArray = 0.0
    ) -> float:
        """|x - P(x - (A x - b)/a)| / |x|, P the projection with r(x_n) of x itself; 0 exactly at a solution.

        inf for x = 0 if that is not a solution.

        Args:
            x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
            gradient: A x - b in metres, shape (3 m,).
            compliance: a, metres per newton.
            over: Reductions over the ranks.
            lower: Lower bound of the normal forces in newtons, a number or shape (m,).
        """
        distance = over.norm(self.left_over(x, gradient / compliance, lower))
        size = over.norm(x)
        if size > 0.0:
            return distance / size
        return 0.0 if distance == 0.0 else math.inf
