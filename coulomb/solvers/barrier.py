"""What path following asks of its constraints, of a Tresca and a Coulomb problem alike: a bound and a disc a node."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions


class Barrier:
    """The constraints of this rank's nodes, and the norms over those of all ranks.

    Args:
        over: Reductions over the ranks.
        frictional: Which nodes have a disc to move in, shape (m,); the others have a bound alone.
    """

    def __init__(self, over: Reductions, frictional: npt.NDArray[np.bool_]):
        self._over, self.frictional, self.nodes = over, frictional, len(frictional)
        self._active = np.column_stack([np.ones(self.nodes, dtype=bool), frictional])
        self._constraints = over.sum(self._active.astype(float))
        self._unknowns = over.sum(1.0 + 2.0 * frictional)

    def theta(self, nu: FloatArray, z: FloatArray) -> float:
        """Duality measure nu^T z / (number of constraints)."""
        return self._over.dot(nu, z) / self._constraints

    def smallest_product(self, nu: FloatArray, z: FloatArray) -> float:
        return self._over.min((nu * z)[self._active])

    def on_constraints(self, values: FloatArray) -> FloatArray:
        """`values` (m, 2) where there is a constraint, 0 where there is no disc."""
        return np.where(self._active, values, 0.0)

    def safe(self, values: FloatArray) -> FloatArray:
        """`values` (m, 2) where there is a constraint, 1 where there is none: fit to be a divisor."""
        return np.where(self._active, values, 1.0)

    def rms(self, r: FloatArray) -> float:
        """Root mean square over the unknowns."""
        return self._over.norm(r) / math.sqrt(self._unknowns)

    def from_rms(self, value: float) -> float:
        """The Euclidean norm of a residual whose root mean square is `value`."""
        return value * math.sqrt(self._unknowns)

    def relative_change(self, old: tuple[FloatArray, ...], new: tuple[FloatArray, ...]) -> float:
        """err = |v_new - v| / |v_new| of v = (x, nu, z)."""
        change = math.hypot(*(self._over.norm(n - o) for n, o in zip(new, old, strict=True)))
        return change / math.hypot(*(self._over.norm(n) for n in new))

    def _longest(
        self,
        above: FloatArray,
        d_above: FloatArray,
        nu: FloatArray,
        dnu: FloatArray,
        t: FloatArray,
        dt: FloatArray,
        room: FloatArray,
    ) -> float:
        """Largest alpha that keeps above + alpha d_above and nu + alpha dnu >= 0 and t + alpha dt in its disc, or inf.

        On a disc, of which room = radius^2 - |t|^2 is left, it is the positive root in the form that does not cancel.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = np.where(d_above < 0.0, -above / d_above, math.inf)
            multiplier = np.where(dnu < 0.0, -nu / dnu, math.inf)[self._active]
            squared, outward = np.sum(dt**2, axis=1), np.sum(dt * t, axis=1)
            disc = (room / (outward + np.sqrt(outward**2 + squared * room)))[self.frictional & (squared > 0.0)]
        return min(self._over.min(bound), self._over.min(multiplier), self._over.min(disc))
