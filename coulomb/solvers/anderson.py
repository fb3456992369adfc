"""Anderson acceleration of a fixed point g <- G(g).

D. G. Anderson, J. ACM 12, 1965; H. F. Walker, P. Ni, SIAM J. Numer. Anal. 49, 2011.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions

_RANK_DEFICIENT = 1e-12  # eigenvalues of the normal equations below this fraction of the largest are rounding errors


class Anderson:
    """Type II: the combination of the last points whose residual is smallest, to first order.

    Args:
        memory: Differences kept; 0 is the plain, damped iteration.
        over: Reductions over the ranks that share g.
    """

    def __init__(self, memory: int, over: Reductions):
        self._memory, self._over = memory, over
        self._points: list[tuple[FloatArray, FloatArray]] = []

    def restart(self) -> None:
        """Discard the points so far."""
        self._points.clear()

    def next(self, g: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
        """The next point; the given one is stored.

        Args:
            g: The point.
            residual: G(g) - g.
            damping: The fraction of the residual that is added, in (0, 1].
        """
        self._points.append((g, residual))
        del self._points[: -self._memory - 1]
        new: FloatArray = g + damping * residual
        if len(self._points) == 1:
            return new
        dg = np.column_stack([b[0] - a[0] for a, b in zip(self._points, self._points[1:], strict=False)])
        dr = np.column_stack([b[1] - a[1] for a, b in zip(self._points, self._points[1:], strict=False)])
        size = np.array([self._over.norm(column) for column in dr.T])
        kept = size > 0.0
        dg, dr = dg[:, kept] / size[kept], dr[:, kept] / size[kept]
        normal, right = self._over.totals(dr.T @ dr, dr.T @ residual)
        values, V = np.linalg.eigh(normal)
        solid = values > _RANK_DEFICIENT * max(values[-1:], default=0.0)
        weights = V[:, solid] @ ((V[:, solid].T @ right) / values[solid])
        new -= (dg + damping * dr) @ weights
        return new
