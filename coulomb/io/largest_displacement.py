"""The bar of the largest displacement, whose place may be another one on finer meshes: between nodes, or beside a face
whose displacement is prescribed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Deformable
from ..linalg.reductions import Reductions

if TYPE_CHECKING:
    from .error_bars import ErrorBars

LARGEST = "maximum.displacement"

FREE = "maximum.displacement of free nodes"
"""Place among the totals of what only the bar of the largest displacement is made of."""


def largest_free(elasticity: Deformable, u: FloatArray) -> FloatArray:
    """Largest displacement u (n, 3) in metres of nodes that are free along some direction, shape (1,); collective."""
    held = elasticity.held
    free = np.delete(u, held.nodes[np.trace(held.projector, axis1=1, axis2=2) > 2.5], axis=0)
    largest = Reductions(elasticity.comm).max(np.linalg.norm(free, axis=1))
    return np.array([max(largest, 0.0)])


def with_largest(bars: ErrorBars, single: bool, safety: float) -> ErrorBars:
    """With the least bar of the largest displacement, and without that of FREE.

    Where a single node has the largest displacement, it may be between nodes that all meshes share: their difference is
    then 0.  The strain energy is that of the loads on their displacements (Clapeyron), so that these have errors as it
    has: its relative bar.  Where a prescribed displacement is the largest, all meshes agree on it as well, but free
    nodes may have more on finer ones: by (bar/safety) - (prescribed - free), extrapolated, times the safety factor, and
    at most that bar.
    """
    found = {one.quantity: one for one in bars.bars}
    free, one, energy = found.pop(FREE), found[LARGEST], found["strain_energy"]
    if energy.value[0] > 0.0:
        least = one.value * np.minimum(1.0, energy.bar / energy.value)
        beyond = free.bar - safety * (one.value - free.value)
        found[LARGEST] = replace(one, bar=np.maximum(one.bar, least if single else np.minimum(least, beyond)))
    return replace(bars, bars=tuple(found.values()))
