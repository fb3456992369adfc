"""The components of a mesh in a file: which cells share facets, and where components touch without sharing nodes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..arrays import FloatArray
from ..nearest import tree_of

IntArray = npt.NDArray[np.int64]

SAME_PLACE = 1e-6
"""Distance of two nodes at the same place, relative to the extent of the mesh."""


def parts_of(count: int, one: IntArray, other: IntArray) -> tuple[int, IntArray]:
    """How many components cells make, and the component of each.

    Args:
        count: Number of cells.
        one: A cell of every facet between two.
        other: The other cell.
    """
    graph = coo_matrix((np.ones(len(one), dtype=np.int8), (one, other)), shape=(count, count))
    parts, part = connected_components(graph, directed=False)
    return int(parts), part.astype(np.int64)


def hinged(cells: IntArray, part: IntArray) -> IntArray:
    """Nodes that several components share, although they share no facet: hinges."""
    pairs = np.unique(np.column_stack([cells.ravel(), np.repeat(part, cells.shape[1])]), axis=0)
    nodes, times = np.unique(pairs[:, 0], return_counts=True)
    shared: IntArray = nodes[times > 1]
    return shared


def touching(points: FloatArray, cells: IntArray, part: IntArray, boundary: IntArray) -> FloatArray:
    """Places at which corners of several components coincide.

    Args:
        points: Coordinates of all nodes in metres, shape (p, 3).
        cells: Nodes of every cell, shape (c, n).
        part: Component of every cell; they share no nodes.
        boundary: The corners of facets on the boundary.

    Returns:
        Coordinates in metres, shape (k, 3).
    """
    of_node = np.zeros(len(points), dtype=np.int64)
    of_node[cells] = part[:, None]
    nodes = np.unique(boundary)
    near = SAME_PLACE * float(np.linalg.norm(np.ptp(points, axis=0)))
    pairs = tree_of(points[nodes]).query_pairs(near, output_type="ndarray")
    pairs = nodes[pairs[of_node[nodes[pairs[:, 0]]] != of_node[nodes[pairs[:, 1]]]]]
    first = np.setdiff1d(pairs.min(axis=1, initial=len(points)), pairs.max(axis=1, initial=-1))
    places: FloatArray = points[first]
    return places
