"""Points of a mesh found in another one by their coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..fem import compat
from ..nearest import tree_of


def numbers(points: FloatArray, wanted: FloatArray, unfit: str) -> npt.NDArray[np.int64]:
    """Number of every wanted point (q, 3) among the points (k, 3), matched to 1e-9 of their extent.

    Raises:
        ValueError: `unfit`, if one is not among them.
    """
    found = places(points, wanted)
    if np.any(found < 0):
        raise ValueError(unfit)
    return found


def places(points: FloatArray, wanted: FloatArray) -> npt.NDArray[np.int64]:
    """As `numbers`, with -1 for a point that is not among them."""
    if not len(points):
        return np.full(len(wanted), -1)
    distance, number = tree_of(points).query(wanted)
    near = distance <= 1e-9 * float(np.max(np.ptp(points, axis=0)))
    return np.where(near, number, -1).astype(np.int64)


def midpoints(domain: Any) -> FloatArray:
    """Midpoints of the cells of a mesh on one rank, metres, shape (c, 3)."""
    middle: FloatArray = domain.geometry.x[compat.cell_geometry(domain)].mean(axis=1)
    return middle
