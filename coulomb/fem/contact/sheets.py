"""Sheets of a surface: as far as it goes on without an edge, and not round to what is opposite."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray, IntArray, unit_vectors


def sheets_of(nodes: IntArray, corners: FloatArray, against: IntArray) -> list[IntArray]:
    """The facets of each sheet, in the order of their smallest places, by the nodes and the places of the corners,
    shapes (f, n) and (f, n, 3): neighbours whose normals differ by less than a right angle are on one, and those
    `against` each other, pairs (p, 2), on two."""
    count, width = nodes.shape
    n = unit_vectors(np.cross(corners[:, 1] - corners[:, 0], corners[:, -1] - corners[:, 0]))
    edges = np.sort(np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    on = scipy.sparse.coo_matrix((np.ones(len(edges)), (np.repeat(np.arange(count), width), edge.ravel()))).tocsr()
    beside = (on @ on.T).tocoo()
    flat = np.einsum("pi,pi->p", n[beside.row], n[beside.col]) > 0.0
    graph = scipy.sparse.coo_matrix((np.ones(flat.sum()), (beside.row[flat], beside.col[flat])), shape=(count, count))
    sheet = connected_components(graph, directed=False)[1].astype(np.int64)
    for both in np.unique(sheet[against[sheet[against[:, 0]] == sheet[against[:, 1]], 0]]):  # round its end
        of = sheet == both
        across = np.linalg.eigh(n[of].T @ n[of])[1][:, 2]
        sheet[of] = np.where(n[of] @ across > 0.0, both, count + both)
    middle = corners.mean(axis=1)
    order = np.lexsort(middle.T[::-1])
    return [np.flatnonzero(sheet == one) for one in dict.fromkeys(sheet[order].tolist())]


def goes_on(facets: IntArray, width: int, named: int, bare: int) -> bool:
    """Whether the side `bare`, of facets without a name, is opposite to a `named` one of its component only beside
    another face of it that has a name: by rows (side, side opposite, facet), where a side is `width` times its
    component and the number of its face."""
    if bare % width or named // width != bare // width:
        return False
    _, against, facet = facets[facets[:, 0] == named].T
    face = (against // width == bare // width) & (against % width > 0)
    return bool(np.all(np.isin(facet[against == bare], facet[face])))
