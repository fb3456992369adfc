"""A face in contact with itself: the two sides that it has, slave and master of a pair, at a displacement.

From the middle of every facet a line goes along its normal.  What it meets first before the facet is opposite to it:
both are on different sides.  What it meets first behind it is the other surface of the wall, on the same side, since a
wall does not touch itself through its thickness.  Neighbours are on the same side.  Where these conditions contradict
each other, those of opposite facets hold before those of walls, these before those of neighbours, and the nearer ones
first: they join the facets to a minimum spanning forest (Kruskal 1956), along which the sides follow.  So the sides of
a fold end in its bend, those of a bore where it is widest, and a zigzag or a spiral of many layers has two as well.
In large motions folds form and open: load steps begin with the sides that the face has then.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from .. import compat
from ..bodies import DisplacementSpace
from ..meshes import NamedMesh, boundary_facets, neighbours
from .closest_points import facets_of, gathered, hits

_TOUCHES: Final = 1e-3
"""Distance over the radius of the smallest facet up to which opposite facets may be behind each other."""

_OF_WALL: Final = 0.5
"""Part of the thinnest wall up to which penetrations are found."""

_PRESSED: Final = 0.5
"""Part of that up to which, after deformation, opposite facets are behind each other: contact holds in the mean."""

_SAME: Final = 1e-9
"""Distances that differ by less than this part of the extent of the body are the same."""

_GENERIC: Final = np.array([0.7937, 0.5321, 0.2953])
"""A direction along which no two facets of a mesh have the same place: one order on any number of ranks."""


class TwoSides(NamedTuple):
    """This rank's facets of the two sides of a face; half of the thinnest wall behind it in metres, inf without one,
    the largest penetration that can be told from the other surface of a wall; and whether any part is before another
    one, without which the second side is a single facet."""

    first: Int32Array
    second: Int32Array
    depth: float
    meet: bool


def two_sides(
    mesh: NamedMesh,
    face: Int32Array,
    u: FloatArray | None = None,
    depth: float | None = None,
) -> TwoSides:
    """The sides of a face in contact with itself, of this rank's facets; collective, the same on any number of ranks.

    Args:
        face: This rank's facets.
        u: Displacement of this rank's nodes, metres, shape (k, 3); by default the sides are those before deformation.
        depth: With a displacement, that of the sides before it.
    """
    domain, comm = mesh.domain, mesh.comm
    space, outer = DisplacementSpace(compat.functionspace(domain, mesh.degree, (3,))), boundary_facets(domain)
    outer = outer[outer < domain.topology.index_map(2).size_local]
    (of, nodes), on_face = facets_of(space, outer), np.isin(outer, face)
    own = np.flatnonzero(np.concatenate(comm.allgather(on_face)))
    places, touches = of.middle[own] @ _GENERIC, _TOUCHES * float(of.radius.min())
    if u is not None:
        of = replace(of, x=of.x + gathered(space, nodes, u))
        touches = max(touches, _PRESSED * depth) if depth is not None and np.isfinite(depth) else touches
    start, along = of.middle[own], of.normal[own]
    before = hits(start, along, of, touches, of.extent)
    behind = hits(start, along, of, of.extent, -touches)
    number: IntArray = np.full(len(of) + 1, -1)  # among those of the face, the last one for the hit -1
    number[own] = np.arange(len(own))
    opposite, wall = number[before.facet], number[behind.facet]
    conditions = [(np.flatnonzero(other >= 0), other[other >= 0]) for other in (opposite, wall)]
    conditions.append(neighbours(of.nodes[own, : of.corners]))
    one, other = (np.concatenate(ends) for ends in zip(*conditions, strict=True))
    kind = np.repeat(np.arange(3), [len(ends[0]) for ends in conditions])
    way = np.where(opposite >= 0, np.abs(before.way), np.inf)
    near = np.select([kind == 0, kind == 1], [way[one], -behind.way[one]], np.maximum(way[one], way[other]))
    order = np.lexsort((places[one] + places[other], np.round(near / (_SAME * of.extent)), kind))
    first = _first_side(one[order], other[order], kind[order] == 0, places)
    if not (meet := bool(np.any(opposite >= 0))) and len(places):
        first[np.argmax(places)] = False
    counts = comm.allgather(int(np.sum(on_face)))
    mine = first[sum(counts[: comm.rank]) :][: counts[comm.rank]]
    depth = _OF_WALL * float(np.min(np.abs(behind.way), initial=np.inf))
    return TwoSides(outer[on_face][mine], outer[on_face][~mine], depth, meet)


def _first_side(one: IntArray, other: IntArray, differ: BoolArray, places: FloatArray) -> BoolArray:
    """Which facets are on the first side, that of the one with the least of the `places` (f,) in each tree; by
    conditions between facets `one` and `other`, which come first in their order, and whether their sides differ."""
    count = len(places)
    pairs = np.sort(np.column_stack([one, other]), axis=1)
    _, kept = np.unique(pairs, axis=0, return_index=True)
    kept = kept[pairs[kept, 0] != pairs[kept, 1]]
    tree = scipy.sparse.coo_matrix((1.0 + kept, pairs[kept].T), shape=(count, count))
    kept = minimum_spanning_tree(tree.tocsr()).data.astype(np.int64) - 1
    one, other, differ = one[kept], other[kept], differ[kept]
    ends = np.concatenate([one, one + count]), np.concatenate([other + count * differ, other + count * ~differ])
    both = scipy.sparse.coo_matrix((np.ones(2 * len(kept)), ends), shape=(2 * count, 2 * count))
    label = connected_components(both, directed=False)[1].reshape(2, count)  # of each facet on either side
    tree_of = np.unique(label.min(axis=0), return_inverse=True)[1]
    order = np.lexsort((places, tree_of))
    root = order[np.searchsorted(tree_of[order], tree_of)]
    return np.asarray(label[0] == label[0, root])
