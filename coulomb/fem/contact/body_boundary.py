"""The boundary facets and the cells of a body; which places are in which cells, and how far behind facets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, permutations, product
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, IntArray
from ...nearest import tree_of
from .. import compat
from ..bodies import DisplacementSpace
from ..meshes import SEPARATOR, boundary_facets, lagrange_points, starts_of
from .facet_patch import FacetPatch, facet_patch

Flags = npt.NDArray[np.bool_]

_SAME: Final = 1e-9
"""Distances that differ by less than this part are the same."""


class Part(NamedTuple):
    """A body: its name, "" if it is alone, its displacements before deformation, and the facets of its named faces."""

    name: str
    space: DisplacementSpace
    faces: Mapping[str, npt.NDArray[np.int32]]


Face = tuple[int, npt.NDArray[np.int32]]
"""The number of a body and facets of it."""


@dataclass(frozen=True)
class BodyBoundary:
    """What this rank owns of a body, before deformation.

    Attributes:
        part: The body.
        starts: First node of every rank, and the number of all (`starts_of`).
        facet: Its facets, ascending, shape (f,).
        patch: These with their nodes.
        triangles: These divided, metres, shape (t, 3, 3).
        row: The row of the facet of each triangle, shape (t,).
        numbers: Nodes of the cells, numbered over all ranks, shape (c, n).
        x: Their places, metres, shape (c, n, 3).
        tetrahedra: Columns of the corners of those that a cell is divided into, shape (s, 4).
    """

    part: Part
    starts: IntArray
    facet: npt.NDArray[np.int32]
    patch: FacetPatch
    triangles: FloatArray
    row: IntArray
    numbers: IntArray
    x: FloatArray
    tetrahedra: IntArray

    @classmethod
    def of(cls, part: Part) -> BodyBoundary:
        space, domain = part.space, part.space.domain
        outer, sizes = boundary_facets(domain), domain.topology.index_map
        patch, own = facet_patch(space, outer), np.arange(sizes(3).size_local, dtype=np.int32)
        pieces = patch.kind.pieces
        three = np.concatenate([pieces[:, [0, k, k + 1]] for k in range(1, pieces.shape[1] - 1)])
        dofs = compat.cell_dofs(space.V)[own]
        numbers = space.V.dofmap.index_map.local_to_global(dofs.ravel().astype(np.int32))
        return cls(
            part,
            starts_of(space.comm, space.numbering.local),
            outer[outer < sizes(2).size_local],
            patch,
            patch.x[:, three].reshape(-1, 3, 3),
            np.repeat(np.arange(len(patch)), len(three)),
            np.asarray(numbers, dtype=np.int64).reshape(dofs.shape),
            space.points_of_cells(own),
            tetrahedra_of(domain.topology.cell_type, space.degree),
        )

    def on(self, number: int, faces: Sequence[Face]) -> Flags:
        """Which facets are on each of some faces, the number of this body given, shape (f, faces)."""
        found: Flags = np.zeros((len(self.facet), len(faces)), dtype=bool)
        for column, (part, facets) in zip(found.T, faces, strict=True):
            column[:] = (part == number) & np.isin(self.facet, facets)
        return found

    def name_of(self, row: int) -> str:
        """The smallest named face that has the facet in this row, in words."""
        name, faces = self.part.name, self.part.faces
        here = [(len(facets), face) for face, facets in faces.items() if self.facet[row] in facets]
        if here:
            return repr(f"{name}{SEPARATOR}{min(here)[1]}" if name else min(here)[1])
        return f"the unnamed boundary of body {name!r}" if name else "the unnamed boundary"

    def normal(self, row: int) -> FloatArray:
        """The outward unit normal of the facet in this row."""
        vector = self.patch.middle_vectors[row]
        unit: FloatArray = vector / np.linalg.norm(vector)
        return unit


@cache
def tetrahedra_of(cell: Any, degree: int) -> IntArray:
    """Columns of a cell's nodes that are the corners of the tetrahedra that it is divided into, shape (s, 4): Kuhn's,
    of a hexahedron in each of its cubes; a tetrahedron is 1 >= x + y + z >= y + z >= z >= 0."""
    points = np.round(degree * lagrange_points(cell, degree)).astype(np.int64)
    if cell.name == "tetrahedron":
        points = points @ np.array([[1, 0, 0], [1, 1, 0], [1, 1, 1]])
    column = {tuple(map(int, point)): k for k, point in enumerate(points)}
    found = []
    for corner in product(range(degree), repeat=3):
        for axes in permutations(np.eye(3, dtype=np.int64)):
            nodes = [tuple(node) for node in (np.array(corner) + np.cumsum([np.zeros(3, int), *axes], axis=0)).tolist()]
            if all(node in column for node in nodes):
                found.append([column[node] for node in nodes])
    return np.array(found)


def in_boxes(places: FloatArray, corners: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs (place, cell) of places (p, 3) in the boxes around the nodes of cells (c, n, 3), searched by size."""
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    ends = places.min(axis=0, initial=np.inf), places.max(axis=0, initial=-np.inf)
    cells = np.flatnonzero(np.all((low <= ends[1]) & (high >= ends[0]), axis=1))
    low, high = low[cells], high[cells]
    around = (1.0 + _SAME) * 0.5 * (high - low).max(axis=1, initial=0.0) + 1e-300
    size = np.floor(np.log2(around))
    found = [(cells[:0], cells[:0])]
    for one in np.unique(size):
        some = np.flatnonzero(size == one)
        tree = tree_of(0.5 * (low + high)[some])
        place, which = _flat(tree.query_ball_point(places, around[some].max(), p=np.inf))
        cell = some[which]
        near = np.all((places[place] >= low[cell]) & (places[place] <= high[cell]), axis=1)
        found.append((place[near], cells[cell[near]]))
    place, cell = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return place, cell


def _flat(lists: npt.NDArray[np.object_]) -> tuple[IntArray, IntArray]:
    """Lists of numbers (p,) as pairs of the number of the list and these."""
    return np.repeat(np.arange(len(lists)), list(map(len, lists))), np.fromiter(chain.from_iterable(lists), np.int64)


def in_tetrahedra(places: FloatArray, nodes: FloatArray, tetrahedra: IntArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Which of the places (p, 3) are in their cells with these nodes (p, n, 3), each divided into tetrahedra (s, 4):
    numbers of the places, once each, the weights of the corners, (k, 4), and the columns of these, (k, 4)."""
    found, left = [], np.arange(len(places))
    for columns in tetrahedra:
        a, b, c, d = np.moveaxis(nodes[left][:, columns] - places[left][:, None], 1, 0)  # volumes with the place
        volumes = np.stack([_volume(b, d, c), _volume(a, c, d), _volume(a, d, b), _volume(a, b, c)], axis=1)
        whole = volumes.sum(axis=1)
        inside = np.all(volumes * np.sign(whole)[:, None] >= 0.0, axis=1) & (whole != 0.0)
        weights = volumes[inside] / whole[inside, None]
        found.append((left[inside], weights, np.broadcast_to(columns, weights.shape)))
        left = left[~inside]
    point, weights, columns = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return point, weights, columns


def _volume(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    volume: FloatArray = np.einsum("pi,pi->p", a, np.cross(b, c))
    return volume


def depths_below(
    x: FloatArray, most: FloatArray, triangles: FloatArray, row: IntArray
) -> tuple[IntArray, FloatArray, IntArray]:
    """Distances of places (p, 3) from triangles (t, 3, 3) that they are behind, up to these (p,): numbers of the
    places, distances, and the row of the triangle."""
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
    distance = np.where(over, np.abs(height), distance)
    use = (distance <= most[place]) & (height <= _SAME * most[place])
    return place[use], distance[use], row[which[use]]
