"""Second-order meshes: from first-order ones, and as finer first-order ones on the same nodes (`split`).

The first by the smooth surface for which the facets of a first-order mesh stand, from their normals.

Where facets meet at less than CREASE, they stand for one smooth surface, whose normal N at a vertex is the mean of
those of the facets around it, weighted with the sine of their angle there over the lengths of its two edges, which is
exact on a sphere however unlike the facets are (Max, Weights for computing vertex normals from facet normals, 1999).
The edge d from a to b is then a cubic curve that is perpendicular to both normals (Vlachos, Peters, Boyd and Mitchell,
Curved PN triangles, 2001), whose middle is off that of the chord by

    (d.N_b N_b - d.N_a N_a)/8

which is the height d^2/(8 R) of the arc on a circle of radius R; over (1 + c) c/2, with the cosine c of half the angle
between the normals, it is exactly that.  At a crease it is the shortest vector with the components of both surfaces
along their normals.  Where a surface ends at a crease, its last facet has all around the
vertex, and N is that of the facet: then it is the mirror image of that at the other end, as on a circle.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, unit_vectors
from ...exchange import starts_of
from ...nearest import tree_of
from .. import compat
from .among_ranks import global_numbers
from .lagrange import corner_geometry, facet_columns, lagrange_points, lagrange_values
from .mesh_parts import boundary_facets, corners_of, distinct, local_cells, local_facets, neighbours
from .named_mesh import NamedMesh

CREASE = math.radians(40.0)
"""Angle between facets from which on they are of different surfaces; a circle of ten chords is still smooth."""

CORNER = math.radians(75.0)
"""Angle from which on facets are those of an edge; a circle of five chords has 72 degrees."""


def arcs(mesh: NamedMesh) -> tuple[IntArray, FloatArray]:
    """The edges of the boundary of a first-order mesh, and how far the middles of their arcs are off those of their
    chords; the same on every rank; collective.

    Returns:
        Numbers of the two corners of every edge, the smaller one first, in lexicographic order, shape (e, 2), and
        vectors in metres, shape (e, 3).  Corners have the numbers of `domain.geometry`.
    """
    corners, x = _boundary(mesh)
    width = corners.shape[1]
    before, after = np.roll(x, 1, axis=1) - x, np.roll(x, -1, axis=1) - x
    crossed = np.cross(after, before)
    normal = unit_vectors(crossed.sum(axis=1))
    lengths = np.linalg.norm(before, axis=2) * np.linalg.norm(after, axis=2)
    weight = np.linalg.norm(crossed, axis=2) / lengths**2

    at_vertex = scipy.sparse.csr_matrix((np.ones(corners.size), corners.ravel(), np.arange(corners.size + 1)))
    around = (at_vertex @ at_vertex.T).tocoo()  # pairs of corners of facets at the same vertex
    near = np.einsum("pi,pi->p", normal[around.row // width], normal[around.col // width]) > math.cos(CREASE)
    creased = np.zeros(corners.shape, dtype=bool)
    creased.ravel()[around.row[~near]] = True
    around.data *= near
    N = unit_vectors(around.tocsr() @ (weight[:, :, None] * normal[:, None]).reshape(-1, 3)).reshape(x.shape)
    N, Nb = _completed(N, np.roll(N, -1, axis=1), after, creased)
    off = np.einsum("fki,fki,fkj->fkj", after, Nb, Nb) - np.einsum("fki,fki,fkj->fkj", after, N, N)
    half = np.maximum(np.linalg.norm(N + Nb, axis=2, keepdims=True) / 2.0, 0.5)
    off /= 4.0 * (1.0 + half) * half
    side = unit_vectors((N + Nb).reshape(-1, 3))
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    first, number = distinct(ends)
    return ends[first], _shortest(len(first), number, side, off.reshape(-1, 3))


def _completed(Na: FloatArray, Nb: FloatArray, d: FloatArray, creased: BoolArray) -> tuple[FloatArray, FloatArray]:
    """The normals at both ends of edges d, shape (f, k, 3), with those at the ends of a surface as mirror images;
    `creased` are the corners at a crease, shape (f, k)."""
    along = unit_vectors(d)
    a, b = (np.einsum("fki,fki->fk", along, N) for N in (Na, Nb))
    flat_a = creased & (np.abs(a) < 0.1 * np.abs(b))
    flat_b = np.roll(creased, -1, axis=1) & (np.abs(b) < 0.1 * np.abs(a))
    mirror_a, mirror_b = Nb - 2.0 * b[..., None] * along, Na - 2.0 * a[..., None] * along
    return np.where(flat_a[..., None], mirror_a, Na), np.where(flat_b[..., None], mirror_b, Nb)


def put_on_surfaces(mesh: NamedMesh) -> None:
    """Move the nodes of faces onto the surfaces of which they are meshes (`NamedMesh.surfaces`), in place; collective.

    Where a face meets others at a crease, nodes stay on the facets of these.
    """
    if not mesh.surfaces:
        return
    domain, comm = mesh.domain, mesh.comm
    facets, cells, side = _own_boundary(domain)
    number = global_numbers(domain.geometry.index_map())
    rows = compat.cell_geometry(domain)[cells]
    nodes = np.take_along_axis(rows, facet_columns(domain.topology.cell_type, mesh.degree)[side], axis=1)
    of = {name: np.isin(facets, mesh.facets(name, "surface")) for name in mesh.surfaces}
    x = domain.geometry.x[nodes]
    normal = unit_vectors(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]))
    out = x[:, 0] - domain.geometry.x[corner_geometry(domain)[cells]].mean(axis=1)
    normal *= np.sign(np.einsum("fi,fi->f", normal, out))[:, None]
    every, x, normal = (np.concatenate(comm.allgather(part)) for part in (number[nodes], x, normal))
    given, first, at = np.unique(every, return_index=True, return_inverse=True)
    at, places = at.reshape(every.shape), x.reshape(-1, 3)[first]
    for _ in range(_ROUNDS):
        for name, surface in mesh.surfaces.items():
            on = np.concatenate(comm.allgather(of[name]))
            beside = np.zeros_like(places)
            np.add.at(beside, at[~on], normal[~on, None])
            moving = np.unique(at[on])
            n, beside = surface.normal(places[moving]), unit_vectors(beside[moving])
            along = n - np.einsum("ki,ki->k", n, beside)[:, None] * beside
            slope = np.linalg.norm(along, axis=1)
            along = np.where((slope > math.sin(CREASE))[:, None], along / np.maximum(slope, 1e-300)[:, None], n)
            slope = np.einsum("ki,ki->k", along, n)
            places[moving] -= (surface.signed_distance(places[moving]) / slope)[:, None] * along
    where = np.minimum(np.searchsorted(given, number), len(given) - 1)
    here = given[where] == number
    domain.geometry.x[here] = places[where[here]]


_ROUNDS: Final = 5
"""Newton steps towards a surface, which double the number of digits: from a tenth of its radius to rounding errors."""


def _own_boundary(domain: Any, facets: Int32Array | None = None) -> tuple[Int32Array, Int32Array, IntArray]:
    """Those facets on the boundary, by default of all, that are of this rank's own cells, these cells, and which of
    their sides the facets are, shapes (f,)."""
    for dims in ((2, 3), (3, 2)):
        domain.topology.create_connectivity(*dims)
    facets, cell_of = boundary_facets(domain) if facets is None else facets, domain.topology.connectivity(2, 3)
    cells = cell_of.array[cell_of.offsets[facets]]
    own = cells < domain.topology.index_map(3).size_local
    facets, cells = facets[own], cells[own]
    of_cell = domain.topology.connectivity(3, 2).array.reshape(-1, len(facet_columns(domain.topology.cell_type, 1)))
    return facets, cells, np.argmax(of_cell[cells] == facets[:, None], axis=1)


def _shortest(edges: int, number: IntArray, side: FloatArray, off: FloatArray) -> FloatArray:
    """For every edge the shortest vector whose components along the normals `side` (k, 3) of its facets are those of
    their vectors `off` (k, 3): least squares, without the directions in which the facets of a smooth surface differ."""
    matrices, right = np.zeros((edges, 3, 3)), np.zeros((edges, 3))
    np.add.at(matrices, number, side[:, :, None] * side[:, None, :])
    np.add.at(right, number, side * np.einsum("ki,ki->k", side, off)[:, None])
    return np.einsum("eij,ej->ei", np.linalg.pinv(matrices, rcond=0.1, hermitian=True), right)


def few_chords(mesh: NamedMesh) -> dict[str, float]:
    """Faces of which most facets meet others of the face at angles from CREASE to CORNER, as chords do of which fewer
    than ten make a circle, with the largest of these angles in radians; not of curved cells, nor of those whose surface
    is known; collective."""
    if mesh.degree == 2 and curved_faces(mesh, facet_columns(mesh.domain.topology.cell_type, 1)[:, None]) is not None:
        return {}
    angle_of = {}
    for name, facets in mesh.faces.items():
        if name in mesh.surfaces:
            continue
        corners, x = _boundary(mesh, facets)
        normal = unit_vectors(np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0]))
        one, other = neighbours(corners)
        angle = np.arccos(np.clip(np.einsum("ki,ki->k", normal[one], normal[other]), -1.0, 1.0))
        steep = (angle > CREASE) & (angle < CORNER)
        if len(np.union1d(one[steep], other[steep])) > 0.5 * len(corners):
            angle_of[name] = float(angle[steep].max())
    return angle_of


def _boundary(mesh: NamedMesh, facets: Int32Array | None = None) -> tuple[IntArray, FloatArray]:
    """Corners of facets on the boundary, by default of all, in cyclic order, with normals outwards, shape (f, 3 or 4),
    and their places, shape (f, 3 or 4, 3); the same on every rank; collective."""
    domain, comm = mesh.domain, mesh.comm
    facets, cells, _ = _own_boundary(domain, facets)
    local = corners_of(domain, facets)
    if local.shape[1] == 4:
        local = local[:, [0, 1, 3, 2]]
    x = domain.geometry.x[local]
    out = x.mean(axis=1) - domain.geometry.x[corner_geometry(domain)[cells]].mean(axis=1)
    outward = np.cross(x[:, 1] - x[:, 0], x[:, -1] - x[:, 0])
    inwards = np.einsum("fi,fi->f", outward, out) < 0.0
    local[inwards], x[inwards] = local[inwards, ::-1], x[inwards, ::-1]
    number = global_numbers(domain.geometry.index_map())[local]
    return np.concatenate(comm.allgather(number)), np.concatenate(comm.allgather(x))


@dataclass(frozen=True, eq=False)
class CurvedFaces:
    """The boundary of curved second-order cells as that for which first-order facets with corners on it stand: a
    `RigidFoundation` as far as these ask, in their corners and in the middles of their edges and of themselves.

    Attributes:
        middles: Of straight edges and facets, metres, shape (k, 3).
        off: The way from there to the boundary, metres, shape (k, 3).
    """

    middles: FloatArray
    off: FloatArray

    def _way(self, x: FloatArray) -> FloatArray:
        distance, near = tree_of(self.middles).query(x)
        return np.where((distance <= 0.1 * np.linalg.norm(self.off, axis=1)[near])[:, None], self.off[near], 0.0)

    def signed_distance(self, x: FloatArray) -> FloatArray:
        """Of points x (k, 3) in metres, shape (k,)."""
        return -np.linalg.norm(self._way(x), axis=1)

    def bulges(self, corners: FloatArray, facet: IntArray, local: FloatArray) -> FloatArray:
        """The way in metres to the boundary from points (k, 3) of first-order facets with corners (f, 3 or 4, 3) in
        VTK's order: on the facets (k,), by the linear functions of the corners there (k, 3 or 4)."""
        kind = compat.mesh.CellType.triangle if local.shape[1] == 3 else compat.mesh.CellType.quadrilateral
        order, ends = ([0, 1, 2], ([1], [2])) if local.shape[1] == 3 else ([0, 1, 3, 2], ([1, 2], [2, 3]))
        nodes = lagrange_values(kind, 1, lagrange_points(kind, 2)) @ corners[:, order]
        off = self._way(nodes.reshape(-1, 3)).reshape(nodes.shape)
        values = lagrange_values(kind, 2, np.stack([local[:, end].sum(axis=1) for end in ends], axis=1))
        return np.einsum("kn,kni->ki", values, off[facet])

    def normal(self, x: FloatArray) -> FloatArray:
        """Unit vectors at points x (k, 3), shape (k, 3); 0 where they are on the boundary."""
        return unit_vectors(self._way(x))


def curved_faces(mesh: NamedMesh, pieces: IntArray) -> CurvedFaces | None:
    """The boundary of second-order cells, None if its edges are straight; collective.

    Args:
        pieces: Columns of the nodes of a cell that are corners of first-order facets on each of its facets, in VTK's
            order, shape (facets, pieces, 3 or 4).
    """
    domain, cell = mesh.domain, mesh.domain.topology.cell_type
    count, (_, of, side) = pieces.shape[2], _own_boundary(domain)
    kind = compat.mesh.CellType.triangle if count == 3 else compat.mesh.CellType.quadrilateral
    linear = lagrange_values(kind, 1, lagrange_points(kind, 2)[count:])
    corners = pieces if count == 3 else pieces[:, :, [0, 1, 3, 2]]
    X = linear @ lagrange_points(cell, 2)[corners]
    values = lagrange_values(cell, 2, X.reshape(-1, 3)).reshape(*X.shape[:3], -1)
    x = domain.geometry.x[compat.cell_geometry(domain)[of]]
    straight = linear @ np.take_along_axis(x[:, None], corners[side].reshape(len(of), 1, -1, 1), axis=2).reshape(
        len(of), pieces.shape[1], count, 3
    )
    off = (values[side] @ x[:, None] - straight).reshape(-1, 3)
    middles, off = (np.concatenate(mesh.comm.allgather(part.reshape(-1, 3))) for part in (straight, off))
    far = np.linalg.norm(off, axis=1)
    curved = far > 1e-9 * np.max(np.abs(middles), initial=0.0)
    return CurvedFaces(middles[curved], off[curved]) if np.any(curved) else None


def split(mesh: NamedMesh) -> NamedMesh:
    """The mesh with eight first-order cells in place of each, on its nodes, which are at curved faces; collective.

    Args:
        mesh: A second-order mesh with its named faces and groups of cells, which are kept.
    """
    old, comm = mesh.domain, mesh.comm
    parts, on_facets = _pattern(old.topology.cell_type)
    nodes, own = old.geometry.index_map(), old.topology.index_map(3).size_local
    of_cells = global_numbers(nodes)[compat.cell_geometry(old)]
    cells, x = of_cells[:own, parts].reshape(-1, parts.shape[1]), old.geometry.x[: nodes.size_local].copy()
    domain = compat.create_mesh(comm, old.topology.cell_type.name, cells, x)

    for dims in ((2, 3), (3, 2)):
        old.topology.create_connectivity(*dims)
    cell_of, facets_of = old.topology.connectivity(2, 3), old.topology.connectivity(3, 2)
    facets = facets_of.array.reshape(-1, len(on_facets))
    rows = {}
    for name, mine in mesh.faces.items():
        cell = cell_of.array[cell_of.offsets[mine]]
        place = np.argmax(facets[cell] == mine[:, None], axis=1)
        rows[name] = np.sort(of_cells[cell[:, None, None], on_facets[place]].reshape(-1, on_facets.shape[2]), axis=1)
    first, eight = 8 * old.topology.index_map(3).local_range[0], np.arange(8)
    groups = {
        name: first + (8 * np.asarray(mine, dtype=np.int64)[:, None] + eight).ravel()
        for name, mine in mesh.cells.items()
    }
    faces = local_facets(domain, rows)
    cells_of = local_cells(domain, starts_of(comm, 8 * own), groups)
    return NamedMesh(domain, faces, cells_of, curved=curved_faces(mesh, on_facets), surfaces=mesh.surfaces)


@functools.cache
def _pattern(cell: Any) -> tuple[IntArray, IntArray]:
    """Columns of the nodes of a second-order cell that are the corners of its eight parts, shape (8, corners), and the
    corners of the parts' facets on each of its facets, shape (facets, 4, corners of a facet)."""
    lattice = np.round(2.0 * lagrange_points(cell, 2)).astype(int)
    corners = np.round(lagrange_points(cell, 1)).astype(int)
    column = {tuple(place): k for k, place in enumerate(lattice)}
    if len(corners) == 8:
        parts = [[column[tuple(first + corner)] for corner in corners] for first in corners]
    else:
        middle = {(i, j): column[tuple(corners[i] + corners[j])] for i in range(4) for j in range(4)}
        at_corners = [[middle[i, j] for j in range(4)] for i in range(4)]
        around = [(0, 1), (0, 3), (2, 3), (1, 2)]  # of the octahedron in the middle, about its diagonal (0, 2)-(1, 3)
        inside = [
            [middle[0, 2], middle[1, 3], middle[one], middle[other]]
            for one, other in zip(around, [*around[1:], around[0]], strict=True)
        ]
        parts = at_corners + inside
    sides = facet_columns(cell, 1)
    on_facets = [
        [[part[k] for k in side] for part in parts for side in sides if {part[k] for k in side} <= set(nodes)]
        for nodes in facet_columns(cell, 2)
    ]
    return np.array(parts, dtype=np.int64), np.array(on_facets, dtype=np.int64)
