"""The law of friction at the contact nodes: |x_t| <= r(x_n) with r = min(c a + F(x_n) x_n, q).

c a is the cohesion of a node in newtons (cohesion in pascals times nodal area), F its coefficient of friction, constant
or piecewise linear in the pressure, q the largest friction that the surface bears, if any.  F = 0 is Tresca's law,
c = 0 Coulomb's, both together Mohr-Coulomb's; nodes of one problem may have different ones.  Where there is slip,
friction is at its bound and opposes the slip.

Solvers ask a law for `radius` and `slope`, and for `majorants` where they need cones: another r(x_n) is written here,
in `model.Contact` and in the table of case files.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions

LAWS = ("coulomb", "tresca", "mohr-coulomb")
"""Names of the laws; Mohr-Coulomb's is also that of faces with different laws together."""

_LARGEST: Final = 1e100
"""Cohesion, coefficient or pressure whose square is far from overflow."""

_ALIKE: Final = 1e-12
"""Relative difference up to which numbers of nodes are the same: they are rounded in files."""


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """The bound of the friction force of every contact node of this rank.

    Attributes:
        cohesion: Part of the bound that does not depend on the pressure, c a >= 0 in newtons, shape (m,).
        friction: Coefficient of friction F >= 0, shape (m,); or, where it depends on the pressure, its values at
            `knots`, shape (m, k): linear between, constant outside.
        limit: The largest friction q > 0 in newtons, shape (m,); inf, or None for all, where there is none.
        knots: Normal forces in newtons, >= 0 and ascending, shape (m, k); None where F is constant.
    """

    cohesion: FloatArray
    friction: FloatArray
    limit: FloatArray | None = None
    knots: FloatArray | None = None

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
        most = max((law._table[0].shape[1] for law in laws), default=1)
        tables = [
            tuple(np.pad(part, ((0, 0), (0, most - part.shape[1])), "edge") for part in law._table) for law in laws
        ]
        knots, friction = (np.concatenate(part) for part in zip(*tables, strict=True))
        limit = None if all(law.limit is None for law in laws) else np.concatenate([law._limit for law in laws])
        cohesion = np.concatenate([law.cohesion for law in laws])
        return (
            FrictionLaw(cohesion, friction, limit, knots) if most > 1 else FrictionLaw(cohesion, friction[:, 0], limit)
        )

    @property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        """Normal forces, and F at them, shapes (m, k); k = 1 where F is constant."""
        if self.knots is None:
            return np.zeros((len(self.friction), 1)), self.friction[:, None]
        return self.knots, self.friction

    @property
    def _limit(self) -> FloatArray:
        return np.full(len(self.cohesion), np.inf) if self.limit is None else self.limit

    def validate(self, nodes: int, over: Reductions) -> None:
        """Check shapes and numbers; collective.

        Raises:
            ValueError: On every rank, if the law is not one of this many nodes, or has a number that is not permitted.
        """
        shape = (nodes,) if self.knots is None else self.knots.shape
        for name, values in (("cohesion", self.cohesion), ("friction", self.friction)):
            wanted = shape if name == "friction" else (nodes,)
            must = f"{name} must have shape {wanted}, one per contact node, but has {values.shape}"
            over.require(values.shape == wanted, must)
            permitted = np.all(np.isfinite(values) & (values >= 0.0))
            over.require(permitted, f"{name} has entries that are negative or not finite")
            within = np.all(values <= _LARGEST)
            given = "cohesion, or slip_stress, times area" if name == "cohesion" else name
            over.require(within, f"{given} has entries above {_LARGEST:g}: that overflows, and holds no better")
        if self.limit is not None:
            must = f"limit must have shape ({nodes},), one per contact node, and be positive"
            over.require(self.limit.shape == (nodes,) and np.all(self.limit > 0.0), must)
        if self.knots is not None:
            ascending = len(shape) == 2 and np.all(np.isfinite(self.knots)) and np.all(np.diff(self.knots) >= 0.0)
            must = f"knots must be ascending normal forces >= 0 of shape ({nodes}, k), but have shape {shape}"
            over.require(ascending and shape[0] == nodes and np.all(self.knots >= 0.0), must)

    def name(self, over: Reductions) -> str:
        """Name of the law over all ranks, one of `LAWS`: Coulomb's without cohesion, Tresca's without friction."""
        if over.max(self.cohesion) <= 0.0:
            return "coulomb"
        return "mohr-coulomb" if over.max(self.friction) > 0.0 else "tresca"

    def numbers(self, area: FloatArray, lengths: FloatArray, over: Reductions) -> dict[str, Any]:
        """Name and coefficients at nodes of these areas (m,) in m^2; collective, the same on all ranks.

        Friction, and cohesion and limit in pascals, are a number where all nodes have the same, else the smallest and
        the largest.  Where friction is orthotropic, with tangents of the `lengths` (m, 2), `friction` is the larger
        coefficient, and those along t1 and t2 follow.  With Tresca's law the cohesion has its name, slip_stress,
        besides, and there is no friction.
        """

        def number(values: FloatArray) -> float | dict[str, float]:
            least, largest = (float(f"{value:.15g}") for value in (over.min(values), over.max(values)))
            return least if largest - least <= _ALIKE * largest else {"min": least, "max": largest}

        name, cohesion = self.name(over), number(self.cohesion / area)
        table, limited = self._table[1], over.any(bool(np.any(np.isfinite(self._limit))))
        pair = table[:, :1] * lengths
        orthotropic = over.max(np.abs(pair[:, 0] - pair[:, 1])) > _ALIKE * over.max(self.friction)
        along, across = (number(pair[:, k]) if orthotropic else None for k in range(2))
        return {
            "law": name,
            "friction": None if name == "tresca" else number(table),
            "slip_stress": cohesion if name == "tresca" else None,
            "cohesion": cohesion,
            "friction_along": along,
            "friction_across": across,
            "friction_limit": number(np.minimum(self._limit / area, _LARGEST)) if limited else None,
        }

    def at(self, which: npt.NDArray[np.bool_ | np.int64]) -> FrictionLaw:
        """The law of some of the nodes, a mask or their numbers."""
        parts = (self.cohesion, self.friction, self.limit, self.knots)
        return FrictionLaw(*(None if part is None else part[which] for part in parts))  # type: ignore[arg-type]

    def rough(self, friction: float) -> FrictionLaw:
        """The law with this coefficient at all nodes whose bound grows with pressure, and no limit."""
        return FrictionLaw(self.cohesion, np.where(self.sloped, friction, 0.0))

    def only(self, which: npt.NDArray[np.bool_], otherwise: float) -> FrictionLaw:
        """The law at some of the nodes (m,); at the others a bound that does not depend on the pressure."""
        cohesion = np.where(which, self.cohesion, otherwise)
        friction = np.where(which if self.knots is None else which[:, None], self.friction, 0.0)
        limit = None if self.limit is None else np.where(which, self.limit, np.inf)
        return FrictionLaw(cohesion, friction, limit, self.knots)

    def coefficient(self, x_n: FloatArray) -> FloatArray:
        """F at normal forces x_n, both of shape (m,)."""
        return self.friction if self.knots is None else self._between(x_n)[0]

    def _between(self, x_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        """F at normal forces x_n (m,), and its derivative, both (m,)."""
        knots, values = self._table
        after, nodes = np.sum(knots <= x_n[:, None], axis=1), np.arange(len(x_n))
        low, high = np.maximum(after - 1, 0), np.minimum(after, knots.shape[1] - 1)
        width = knots[nodes, high] - knots[nodes, low]
        rise = (values[nodes, high] - values[nodes, low]) / np.where(width > 0.0, width, 1.0)
        return values[nodes, low] + rise * (x_n - knots[nodes, low]), rise

    @property
    def sloped(self) -> npt.NDArray[np.bool_]:
        """Nodes whose bound grows with pressure, shape (m,)."""
        return np.any(self._table[1] > 0.0, axis=1)

    @property
    def proportional(self) -> bool:
        """Whether this rank's bounds are F x_n with a constant F: Coulomb's law alone."""
        return self.limit is None and self.knots is None and not np.any(self.cohesion > 0.0)

    @property
    def frictional(self) -> npt.NDArray[np.bool_]:
        """Nodes whose friction is not zero at every pressure, shape (m,)."""
        return (self.cohesion > 0.0) | self.sloped

    def radius(self, x_n: FloatArray) -> FloatArray:
        """Bound of the friction force in newtons at normal forces x_n in newtons, both of shape (m,)."""
        x = np.maximum(x_n, 0.0)
        bound: FloatArray = self.cohesion + self.coefficient(x) * x
        return bound if self.limit is None else np.minimum(bound, self.limit)

    def parts(self, x_n: FloatArray) -> dict[str, FloatArray]:
        """The parts of the bound at normal forces x_n, by what each is in proportion to, newtons, shape (m,)."""
        x, within = np.maximum(x_n, 0.0), self.below_limit(x_n)
        friction = self.coefficient(x) * x
        return {
            "friction": np.where(within, friction, 0.0),
            "cohesion": np.where(within, self.cohesion, 0.0),
            "friction limit": np.where(within, 0.0, self._limit),
        }

    def below_limit(self, x_n: FloatArray) -> npt.NDArray[np.bool_]:
        """Where the limit does not decide the bound, at normal forces x_n in newtons, both of shape (m,)."""
        x = np.maximum(x_n, 0.0)
        below: npt.NDArray[np.bool_] = self.cohesion + self.coefficient(x) * x < self._limit
        return below

    def slope(self, x_n: FloatArray) -> FloatArray:
        """dr/dx_n at normal forces x_n > 0, both of shape (m,)."""
        F, rise = (self.friction, 0.0) if self.knots is None else self._between(x_n)
        slope: FloatArray = F + rise * x_n
        return slope if self.limit is None else np.where(self.cohesion + F * x_n < self.limit, slope, 0.0)

    def majorants(self) -> tuple[FrictionLaw, ...]:
        """Laws c a + F x_n with constant F that allow all that this one allows, the steepest first; itself if it is
        one."""
        if self.limit is None and self.knots is None:
            return (self,)
        knots, values = self._table
        last = values[:, -1:]
        left, right, rise = knots[:, :-1], knots[:, 1:], np.diff(values)
        width = right - left
        s = rise / np.where(width > 0.0, width, 1.0)  # (F(x) - F_last) x has its largest value in a piece or at an end
        at = np.where(
            s < 0.0, np.clip(0.5 * (left - (values[:, :-1] - last) / np.where(s < 0.0, s, 1.0)), left, right), right
        )
        above = np.hstack([knots * (values - last), (values[:, :-1] + s * (at - left) - last) * at])
        steep = FrictionLaw(self.cohesion + np.max(above, axis=1, initial=0.0), last[:, 0])
        if self.limit is None:
            return (steep,)
        held = np.isfinite(self.limit)
        cohesion, friction = np.where(held, self.limit, steep.cohesion), np.where(held, 0.0, steep.friction)
        return steep, FrictionLaw(cohesion, friction)

    def scaled(self, normal: FloatArray | float, friction: FloatArray | float | None = None) -> FrictionLaw:
        """The law for normal forces in units of `normal` and friction in units of `friction`, by default the same; one
        number or one per node, shape (m,)."""
        unit = normal if friction is None else friction
        limit = None if self.limit is None else self.limit / unit
        knots, values = self._table
        knots, values = (knots.T / normal).T, (values.T * (normal / unit)).T
        cohesion = self.cohesion / unit
        return (
            FrictionLaw(cohesion, values[:, 0], limit)
            if self.knots is None
            else FrictionLaw(cohesion, values, limit, knots)
        )

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
