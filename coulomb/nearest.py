"""Nearest points, by scipy's k-d tree.  It is loaded when it is first needed: a run on one plain mesh needs none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .arrays import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def tree_of(points: FloatArray, leaf: int = 16) -> cKDTree:
    """The k-d tree of points, shape (k, d), with at most `leaf` points in its leaves."""
    from scipy.spatial import cKDTree

    return cKDTree(points, leafsize=leaf)


def among(x: FloatArray, points: FloatArray) -> npt.NDArray[np.bool_]:
    """Which places (..., 3) are one of some points (k, 3), to 1e-9 of the largest coordinate of either."""
    unit = 1e-9 * (max(float(np.max(np.abs(of), initial=0.0)) for of in (x, points)) or 1.0)

    def cells(of: FloatArray) -> npt.NDArray[np.void]:
        # shifted, so that coordinates of meshes are not on the edge of a cell
        numbers = np.floor(of.reshape(-1, 3) / unit + 0.1234567).astype(np.int64)
        return np.ascontiguousarray(numbers).view([("", np.int64)] * 3).ravel()

    found: npt.NDArray[np.bool_] = np.isin(cells(x), cells(points)).reshape(x.shape[:-1])
    return found
