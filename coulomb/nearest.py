"""Nearest points, by scipy's k-d tree, and the nodes of a mesh among those of another numbering.  The tree is loaded
when it is first needed: a run on one plain mesh needs none."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from .arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def tree_of(points: FloatArray, leaf: int = 16) -> cKDTree:
    """The k-d tree of points, shape (k, d), with at most `leaf` points in its leaves."""
    from scipy.spatial import cKDTree

    return cKDTree(points, leafsize=leaf)


def among(x: FloatArray, points: FloatArray) -> BoolArray:
    """Which places (..., 3) are one of some points (k, 3), to 1e-9 of the largest coordinate of either."""
    unit = 1e-9 * (max(float(np.max(np.abs(of), initial=0.0)) for of in (x, points)) or 1.0)

    def cells(of: FloatArray) -> npt.NDArray[np.void]:
        # shifted, so that coordinates of meshes are not on the edge of a cell
        numbers = np.floor(of.reshape(-1, 3) / unit + 0.1234567).astype(np.int64)
        return np.ascontiguousarray(numbers).view([("", np.int64)] * 3).ravel()

    return np.isin(cells(x), cells(points)).reshape(x.shape[:-1])


_AT_ONCE: Final = 200_000  # rows read at a time: no rank needs memory for the whole mesh


def same_nodes(x: FloatArray, inside: FloatArray, points: Any, rows: Any, near: float) -> IntArray:
    """The number of every node x (k, 3) of a mesh among the points (n, 3) of the same mesh with other numbers, -1 for
    one that is farther than `near` from all of them, shape (k,).

    Nodes at one place, as of parts that touch and of the sides of a cut, are told apart by their cells, which do not
    overlap.

    Args:
        x: Nodes in metres.
        inside: The middle of a cell of every node, the mean of the nodes of this cell, shape (k, 3): `in_a_cell`.
        points: Nodes of the other numbering, an array or a data set of HDF5, which is read in parts.
        rows: Numbers of the points of every cell, likewise, shape (c, m).
        near: Distance in metres up to which points are at one place.
    """
    number_of: IntArray = np.full(len(x), -1, dtype=np.int64)
    if not len(x):
        return number_of
    tree, mine, other = tree_of(x), [number_of[:0]], [number_of[:0]]
    for first in range(0, len(points), _AT_ONCE):
        part = tree_of(np.asarray(points[first : first + _AT_ONCE], dtype=np.float64))
        pairs = tree.sparse_distance_matrix(part, near, output_type="ndarray")
        mine.append(pairs["i"].astype(np.int64))
        other.append(first + pairs["j"].astype(np.int64))
    node, number = np.concatenate(mine), np.concatenate(other)
    number_of[node] = number
    several = np.bincount(node, minlength=len(x)) > 1
    if not np.any(several):
        return number_of
    kept, wanted = [], np.unique(number[several[node]])
    for first in range(0, len(rows), _AT_ONCE):
        cells = np.asarray(rows[first : first + _AT_ONCE], dtype=np.int64)
        kept.append(cells[np.any(np.isin(cells, wanted), axis=1)])
    cells = np.concatenate(kept)
    used, inverse = np.unique(cells, return_inverse=True)
    corners = np.asarray(points[used], dtype=np.float64)[inverse.reshape(cells.shape)]
    distance, cell = tree_of(corners.mean(axis=1)).query(inside[several])
    corner = np.argmin(np.linalg.norm(corners[cell] - x[several, None], axis=2), axis=1)
    number_of[several] = np.where(distance <= near, cells[cell, corner], -1)
    return number_of


def in_a_cell(points: FloatArray, rows: npt.NDArray[np.integer[Any]]) -> FloatArray:
    """For every point (n, 3) the middle of a cell that has it, of rows of points (c, m); shape (n, 3)."""
    middles = np.empty_like(points)
    middles[rows] = points[rows].mean(axis=1)[:, None]
    return middles
