"""The boundary facets and the cells of a body; which places are in which cells, and how far behind facets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain, permutations, product
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from ...nearest import tree_of
from .. import compat
from ..bodies import Member
from ..meshes import SEPARATOR, boundary_facets, facet_columns, lagrange_points, starts_of
from .facet_patch import FacetPatch, facet_patch

Rows = npt.NDArray[Any]

_SAME: Final = 1e-9
"""Distances that differ by less than this part are the same."""

_FEW: Final = 1_000_000
"""Pairs of boxes, near each other along one axis, that are looked at one by one, which takes 25 ms; to load the library
of trees takes 20, and to search them 10."""

_TALLEST: Final = 10.0
"""Height of a cell over a facet, over the extent of facets, at most."""


Face = tuple[int, Int32Array]
"""The number of a body and facets of it."""


@dataclass(frozen=True, eq=False)
class BodyBoundary:
    """What this rank owns of a body, before deformation.

    Attributes:
        starts: First node of every rank, and the number of all (`starts_of`).
        facet: Its facets, ascending, shape (f,).
        patch: These with their nodes.
        triangles: These divided, metres, shape (t, 3, 3).
        row: The row of the facet of each triangle, shape (t,).
        numbers: Nodes of the cells, numbered over all ranks, shape (c, n).
        x: Their places, metres, shape (c, n, 3).
        tetrahedra: Columns of the corners of those that a cell is divided into, shape (s, 4).
    """

    part: Member
    starts: IntArray
    facet: Int32Array
    patch: FacetPatch
    triangles: FloatArray
    row: IntArray
    numbers: IntArray
    x: FloatArray
    tetrahedra: IntArray

    @classmethod
    def of(cls, part: Member) -> BodyBoundary:
        space, domain = part.body, part.body.domain
        outer, sizes = boundary_facets(domain), domain.topology.index_map
        patch, own = facet_patch(space, outer), np.arange(sizes(3).size_local, dtype=np.int32)
        pieces = patch.kind.pieces
        three = np.concatenate([pieces[:, [0, k, k + 1]] for k in range(1, pieces.shape[1] - 1)])
        return cls(
            part,
            starts_of(space.comm, space.numbering.local),
            outer[outer < sizes(2).size_local],
            patch,
            patch.x[:, three].reshape(-1, 3, 3),
            np.repeat(np.arange(len(patch)), len(three)),
            space.global_numbers(compat.cell_dofs(space.V)[own]),
            space.points_of_cells(own),
            tetrahedra_of(domain.topology.cell_type, space.degree),
        )

    def points(self, number: int, rows: FloatArray, near: BoolArray, every: bool) -> Rows:
        """The nodes of facets, and the edges and diagonals of those that have something near them, or of every one; by
        their two ends, of nodes the same.

        Args:
            rows: At the nodes of the facets u in metres, deformation, component; for every pair 1 on the slave and 2 at
                what is kept out; and for every pair 1 on the master; shape (f, n, w).
            near: Which facets have something near them of this body, and of another, shape (f, 2).
        """
        patch, pairs, width, corners = (
            self.patch,
            (rows.shape[2] - 5) // 2,
            self.patch.kind.width,
            self.patch.kind.corners,
        )
        around = np.arange(min(width, 2 * corners)).reshape(-1, corners).T.ravel()  # with the middles between
        ends = np.stack([around, np.roll(around, -1)], axis=1)
        if width == 4:
            ends = np.concatenate([ends, [[0, 2], [1, 3]]])
        row, few = np.arange(len(patch)), np.flatnonzero(near.any(axis=1) | every)
        row = np.concatenate([np.repeat(row, width), np.repeat(few, len(ends))])
        end = np.concatenate([np.tile(np.arange(width), len(patch))[:, None] + [0, 0], np.tile(ends, (len(few), 1))])
        nodes = np.sort(patch.nodes[row[:, None], end])
        _, first, which = np.unique(nodes @ [self.starts[-1], 1], return_index=True, return_inverse=True)
        at = row[first, None], end[first]
        kinds = [("part", "i8"), ("nodes", "i8", (2,)), ("x", "f8", (2, 3)), ("u", "f8", (2, 3)), ("near", "?", (2,))]
        kinds += [("deformation", "f8"), ("slave", "?", (pairs,)), ("master", "?", (pairs,))]
        kinds += [("inside", "i8"), ("component", "i8"), ("was", "f8", (3,)), ("at", "f8"), ("kept", "?")]  # there
        points: Rows = np.zeros(len(first), dtype=kinds)
        points["part"], points["nodes"], points["x"], points["u"] = number, nodes[first], patch.x[at], rows[at][..., :3]
        np.logical_or.at(points["near"], which.ravel(), near[row])
        points["deformation"] = rows[at][:, 0, 3]
        points["slave"], points["master"] = sides_of(rows[at])
        return points

    def facets_with(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs (point, row) of facets that have both nodes of points (p, 2)."""
        sorted_nodes, rows = self._facets_at
        begin, end = (np.searchsorted(sorted_nodes, nodes[:, 0], side) for side in ("left", "right"))
        count = end - begin
        point = np.repeat(np.arange(len(nodes)), count)
        row = rows[np.arange(len(point)) + np.repeat(begin - np.cumsum(count) + count, count)]
        both = np.any(self.patch.nodes[row] == nodes[point, 1:], axis=1)
        return point[both], row[both]

    @cached_property
    def _facets_at(self) -> tuple[IntArray, IntArray]:
        """The nodes of the facets, ascending, and the rows of these."""
        nodes, row = self.patch.nodes.ravel(), np.repeat(np.arange(len(self.patch)), self.patch.kind.width)
        order = np.argsort(nodes, kind="stable")
        return nodes[order], row[order]

    def under(self, facets: Int32Array) -> BoolArray:
        """Which of this rank's cells have facets on the boundary, and all of them among these, shape (c,)."""
        topology = self.part.body.domain.topology
        topology.create_connectivity(3, 2)
        of_cells = topology.connectivity(3, 2).array.reshape(-1, len(facet_columns(topology.cell_type, 1)))
        outer = np.diff(topology.connectivity(2, 3).offsets) == 1  # between ranks as well, if a cell there is not known
        other = outer.copy()
        other[facets] = False
        of_cells = of_cells[: len(self.numbers)]
        return outer[of_cells].any(axis=1) & ~other[of_cells].any(axis=1)

    def name_of(self, row: int) -> str:
        """The smallest named face that has the facet in this row, in words."""
        name, faces = self.part.name, self.part.body.mesh.faces
        here = [(len(facets), face) for face, facets in faces.items() if self.facet[row] in facets]
        if here:
            return repr(f"{name}{SEPARATOR}{min(here)[1]}" if name else min(here)[1])
        return f"the unnamed boundary of body {name!r}" if name else "the unnamed boundary"

    def normal(self, row: int) -> FloatArray:
        """The outward unit normal of the facet in this row."""
        vector = self.patch.middle_vectors[row]
        return vector / np.linalg.norm(vector)


def sides_of(rows: FloatArray) -> tuple[BoolArray, BoolArray]:
    """On which slaves, next to what is kept out, and on which masters all nodes are of some facets or edges, by the
    rows (f, n, w) of `BodyBoundary.points`, shape (f, pairs) each."""
    slave, master = np.split(rows[:, :, 5:], 2, axis=2)
    return np.all(slave > 0.0, axis=1) & np.any(slave > 1.0, axis=1), np.all(master > 0.0, axis=1)


@cache
def tetrahedra_of(cell: Any, degree: int) -> IntArray:
    """Columns of a cell's nodes that are the corners of the tetrahedra that it is divided into, shape (s, 4): Kuhn's,
    of a hexahedron in each of its cubes; a tetrahedron is 1 >= x + y + z >= y + z >= z >= 0."""
    points = np.round(degree * lagrange_points(cell, degree)).astype(np.int64)
    if cell.name == "tetrahedron":
        points = points @ np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1]])
    column = {tuple(map(int, point)): k for k, point in enumerate(points)}
    tetrahedra = []
    for corner in product(range(degree), repeat=3):
        for axes in permutations(np.eye(3, dtype=np.int64)):
            nodes = [tuple(node) for node in (np.array(corner) + np.cumsum([np.zeros(3, int), *axes], axis=0)).tolist()]
            if all(node in column for node in nodes):
                tetrahedra.append([column[node] for node in nodes])
    return np.array(tetrahedra)


def boxes_of(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The least and the largest coordinates of cells with nodes x (c, n, 3), shape (c, 3) each."""
    nodes = [*np.moveaxis(x, 1, 0)]  # over these one by one in a quarter of the time of x.min(axis=1)
    return np.minimum.reduce(nodes), np.maximum.reduce(nodes)


Box = tuple[FloatArray, FloatArray]
"""Least and largest coordinates of several boxes, shape (k, 3) each."""


def in_boxes(places: Box, cells: Box) -> tuple[IntArray, IntArray]:
    """Pairs (place, cell) of boxes around places or edges and around cells that meet, searched by size of both."""
    (first, last), (low, high) = ([np.ascontiguousarray(end.T) for end in of] for of in (places, cells))
    mine, theirs = (
        np.flatnonzero(_everywhere((a <= _over(d.max, -np.inf)) & (b >= _over(c.min, np.inf))))
        for a, b, c, d in ((first, last, low, high), (low, high, first, last))
    )
    first, last, low, high = first[:, mine], last[:, mine], low[:, theirs], high[:, theirs]
    both = [(mine[:0], theirs[:0])]
    if len(mine) and len(theirs):
        along = int(np.argmax(np.max(last, axis=1) - np.min(first, axis=1)))
        order = np.argsort(low[along])
        start = np.searchsorted(np.maximum.accumulate(high[along, order]), first[along])
        end = np.searchsorted(low[along, order], last[along], "right")
        count = np.maximum(end - start, 0)
        if np.sum(count) <= _FEW:
            i = np.repeat(np.arange(len(mine)), count)
            j = order[np.arange(len(i)) + np.repeat(start - np.cumsum(count) + count, count)]
            for axis in range(3):
                met = (last[axis, i] >= low[axis, j]) & (first[axis, i] <= high[axis, j])
                i, j = i[met], j[met]
            return mine[i], theirs[j]
        for (own, reach, tree), (some, around, others) in product(_by_size(first, last, 8.0), _by_size(low, high, 2.0)):
            distance = (1.0 + _SAME) * (reach + around)
            pairs = tree.sparse_distance_matrix(others, distance, p=np.inf, output_type="ndarray")
            i, j = own[pairs["i"]], some[pairs["j"]]
            met = _everywhere((last[:, i] >= low[:, j]) & (first[:, i] <= high[:, j]))
            both.append((mine[i[met]], theirs[j[met]]))
    place, cell = (np.concatenate(parts) for parts in zip(*both, strict=True))
    return place, cell


def _by_size(low: FloatArray, high: FloatArray, factor: float) -> list[tuple[IntArray, float, Any]]:
    """Boxes (3, k) whose sizes differ by no more than a factor: their numbers, the largest half width, the tree of
    their middles.  For one edge of a large cell all others would otherwise be searched as far around."""
    half = 0.5 * np.maximum.reduce(high - low)
    size = np.floor(np.log2(half + 1e-300) / np.log2(factor))
    parts = [np.flatnonzero(size == one) for one in np.unique(size)]
    return [(some, float(half[some].max()), tree_of(0.5 * (low + high)[:, some].T)) for some in parts]


def _over(end: Callable[..., FloatArray], none: float) -> FloatArray:
    """The largest or least ends along each axis, shape (3, 1)."""
    return end(axis=1, initial=none, keepdims=True)


def _everywhere(along: BoolArray) -> BoolArray:
    """What holds along all three axes, (3, k), at once in a third of the time of `all`."""
    return np.asarray(along[0] & along[1] & along[2])


def _flat(lists: npt.NDArray[np.object_]) -> tuple[IntArray, IntArray]:
    """Lists of numbers (p,) as pairs of the number of the list and these."""
    return np.repeat(np.arange(len(lists)), list(map(len, lists))), np.fromiter(chain.from_iterable(lists), np.int64)


def in_tetrahedra(
    places: FloatArray, nodes: FloatArray, tetrahedra: IntArray
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Which of the places or edges, (p, 1 or 2, 3), pass through the tetrahedra (s, 4) of their cells with these nodes
    (p, n, 3): their numbers, where on the edge the middle of what is inside is, from 0 to 1, (k,), the weights of the
    corners there, (k, 4), and the columns of these, (k, 4)."""
    corners = nodes[:, tetrahedra]
    (first, last), (low, high) = boxes_of(places), boxes_of(corners.reshape(-1, 4, 3))
    shape, margin = (*corners.shape[:2], 3), _SAME * (high - low)
    low, high = (low - margin).reshape(shape), (high + margin).reshape(shape)
    point, which = np.nonzero(((last[:, None] >= low) & (first[:, None] <= high)).all(axis=2))
    corner, *edges = np.moveaxis(corners[point, which], 1, 0)
    b, c, d = (edge - corner for edge in edges)
    vectors = np.stack([np.cross(c, d), np.cross(d, b), np.cross(b, c)], axis=1)
    whole = np.einsum("pi,pi->p", b, vectors[:, 0])
    vectors /= np.where(whole != 0.0, whole, np.nan)[:, None, None]
    three = (places[point] - corner[:, None]) @ vectors.transpose(0, 2, 1)
    weights = np.concatenate([1.0 - three.sum(axis=2, keepdims=True), three], axis=2)
    first, last = weights[:, 0] + _SAME, weights[:, -1] + _SAME
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = first / (first - last)
    start = np.where(first >= 0.0, 0.0, np.where(last >= 0.0, crossing, np.inf)).max(axis=1)
    end = np.where(last >= 0.0, 1.0, np.where(first >= 0.0, crossing, -np.inf)).min(axis=1)
    inside = np.flatnonzero(start <= end)
    halfway = 0.5 * (start[inside] + end[inside])
    middle = (1.0 - halfway)[:, None] * weights[inside, 0] + halfway[:, None] * weights[inside, -1]
    return point[inside], halfway, middle, tetrahedra[which[inside]]


def depths_below(
    x: FloatArray, most: FloatArray, triangles: FloatArray, row: IntArray
) -> tuple[IntArray, FloatArray, IntArray]:
    """Distances of places (p, 3) from triangles (t, 3, 3) that they are behind, up to these (p,): numbers of the
    places, distances, and the row of the triangle.  What is before a triangle by no more than `in_tetrahedra` takes for
    inside of its cell is on it."""
    if not len(triangles):
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=np.int64)
    middle = triangles.mean(axis=1)
    around = np.linalg.norm(triangles - middle[:, None], axis=2).max()
    place, which = _flat(tree_of(middle).query_ball_point(x, most + around))
    a, b, c = np.moveaxis(triangles[which], 1, 0)
    p = x[place]
    n = np.cross(b - a, c - a)
    n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
    height = np.einsum("pi,pi->p", p - a, n)
    over = np.ones(len(p), dtype=bool)
    distance: FloatArray = np.full(len(p), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, away = end - start, p - start
        over &= np.einsum("pi,pi->p", np.cross(edge, away), n) >= 0.0
        along = np.einsum("pi,pi->p", away, edge) / np.maximum(np.einsum("pi,pi->p", edge, edge), 1e-300)
        foot = start + np.clip(along, 0.0, 1.0)[:, None] * edge
        distance = np.minimum(distance, np.linalg.norm(p - foot, axis=1))
    distance = np.where(over, np.maximum(-height, 0.0), distance)
    use = (distance <= most[place]) & (height <= _SAME * np.maximum(most[place], _TALLEST * around))
    return place[use], distance[use], row[which[use]]
