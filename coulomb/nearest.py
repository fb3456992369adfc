"""Nearest points, by scipy's k-d tree.  It is loaded when it is first needed: a run on one plain mesh needs none."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .arrays import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def tree_of(points: FloatArray, leaf: int = 16) -> cKDTree:
    """The k-d tree of points, shape (k, d), with at most `leaf` points in its leaves."""
    from scipy.spatial import cKDTree

    return cKDTree(points, leafsize=leaf)
