"""The bar of the largest displacement, whose place may be another one on finer meshes: between nodes, or beside a face
whose displacement is prescribed."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Deformable
from ..linalg.reductions import Reductions

ValueAndBar = tuple[FloatArray, FloatArray]
"""Shapes (1,)."""

LARGEST = "maximum.displacement"

FREE = "maximum.displacement of free nodes"
"""Place among the totals of what only the bar of the largest displacement is made of."""


def largest_free(elasticity: Deformable, u: FloatArray) -> FloatArray:
    """Largest displacement u (n, 3) in metres of nodes that are free along some direction, shape (1,); collective."""
    held = elasticity.held
    free = np.delete(u, held.nodes[np.trace(held.projector, axis1=1, axis2=2) > 2.5], axis=0)
    largest = Reductions(elasticity.comm).max(np.linalg.norm(free, axis=1))
    return np.array([max(largest, 0.0)])


def least_bar(value: FloatArray, energy: ValueAndBar, free: ValueAndBar, single: bool, safety: float) -> FloatArray:
    """The least bar of the largest displacement, shape (1,).

    Where a single node has the largest displacement, it may be between nodes that all meshes share: their difference is
    then 0.  The strain energy is that of the loads on their displacements (Clapeyron), so that these have errors as it
    has: its relative bar.  Where a prescribed displacement is the largest, all meshes agree on it as well, but free
    nodes may have more on finer ones: by (bar/safety) - (prescribed - free), extrapolated, times the safety factor, and
    at most that bar.

    Args:
        value: The largest displacement.
        energy: The strain energy and its bar.
        free: The largest displacement of free nodes and its bar.
        single: Whether a single node has the largest displacement.
        safety: The factor in all bars.
    """
    if not energy[0][0] > 0.0:
        return np.zeros(1)
    least: FloatArray = value * np.minimum(1.0, energy[1] / energy[0])
    return least if single else np.clip(free[1] - safety * (value - free[0]), 0.0, least)
