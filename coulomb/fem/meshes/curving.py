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
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray, IntArray, unit_vectors
from .. import compat
from .exchange import global_numbers, starts_of
from .lagrange import corner_geometry, facet_columns, lagrange_points
from .mesh_parts import boundary_facets, corners_of, distinct, local_cells, local_facets
from .named_mesh import NamedMesh

CREASE = math.radians(40.0)
"""Angle between facets from which on they are of different surfaces; a circle of ten chords is still smooth."""


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


def _completed(
    Na: FloatArray, Nb: FloatArray, d: FloatArray, creased: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """The normals at both ends of edges d, shape (f, k, 3), with those at the ends of a surface as mirror images;
    `creased` are the corners at a crease, shape (f, k)."""
    along = unit_vectors(d)
    a, b = (np.einsum("fki,fki->fk", along, N) for N in (Na, Nb))
    flat_a = creased & (np.abs(a) < 0.1 * np.abs(b))
    flat_b = np.roll(creased, -1, axis=1) & (np.abs(b) < 0.1 * np.abs(a))
    mirror_a, mirror_b = Nb - 2.0 * b[..., None] * along, Na - 2.0 * a[..., None] * along
    return np.where(flat_a[..., None], mirror_a, Na), np.where(flat_b[..., None], mirror_b, Nb)


def _shortest(edges: int, number: IntArray, side: FloatArray, off: FloatArray) -> FloatArray:
    """For every edge the shortest vector whose components along the normals `side` (k, 3) of its facets are those of
    their vectors `off` (k, 3): least squares, without the directions in which the facets of a smooth surface differ."""
    matrices, right = np.zeros((edges, 3, 3)), np.zeros((edges, 3))
    np.add.at(matrices, number, side[:, :, None] * side[:, None, :])
    np.add.at(right, number, side * np.einsum("ki,ki->k", side, off)[:, None])
    return np.einsum("eij,ej->ei", np.linalg.pinv(matrices, rcond=0.1, hermitian=True), right)


def _boundary(mesh: NamedMesh) -> tuple[IntArray, FloatArray]:
    """Corners of all boundary facets in cyclic order, with normals outwards, shape (f, 3 or 4), and their places, shape
    (f, 3 or 4, 3); the same on every rank; collective."""
    domain, comm = mesh.domain, mesh.comm
    facets = boundary_facets(domain)
    cell_of = domain.topology.connectivity(2, 3)
    cells = cell_of.array[cell_of.offsets[facets]]
    own = cells < domain.topology.index_map(3).size_local
    facets, cells = facets[own], cells[own]
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
    return NamedMesh(domain, faces, local_cells(domain, starts_of(comm, 8 * own), groups))


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
