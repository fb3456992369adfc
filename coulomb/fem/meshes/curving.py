"""The smooth surface for which the facets of a first-order mesh stand, from their normals.

Where facets meet at less than CREASE, they stand for one smooth surface, whose normal N at a vertex is the mean of
those of the facets around it, weighted with their angles there.  The edge d from a to b is then a cubic curve that is
perpendicular to both normals (Vlachos, Peters, Boyd and Mitchell, Curved PN triangles, 2001), whose middle is off that
of the chord by

    (d.N_b N_b - d.N_a N_a)/8

which is the height d^2/(8 R) of the arc on a circle of radius R.  At a crease it is the shortest vector with the
components of both surfaces along their normals.  Where a surface ends at a crease, its last facet has all around the
vertex, and N is that of the facet: then it is the mirror image of that at the other end, as on a circle.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray, IntArray
from .exchange import global_numbers
from .lagrange import corner_geometry
from .mesh_parts import boundary_facets, corners_of
from .named_mesh import NamedMesh
from .rows import distinct

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
    angle = np.arctan2(np.linalg.norm(crossed, axis=2), np.einsum("fki,fki->fk", before, after))

    at_vertex = scipy.sparse.csr_matrix((np.ones(corners.size), corners.ravel(), np.arange(corners.size + 1)))
    around = (at_vertex @ at_vertex.T).tocoo()  # pairs of corners of facets at the same vertex
    near = np.einsum("pi,pi->p", normal[around.row // width], normal[around.col // width]) > math.cos(CREASE)
    creased = np.zeros(corners.shape, dtype=bool)
    creased.ravel()[around.row[~near]] = True
    around.data *= near
    N = unit_vectors(around.tocsr() @ (angle[:, :, None] * normal[:, None]).reshape(-1, 3)).reshape(x.shape)
    N, Nb = _completed(N, np.roll(N, -1, axis=1), after, creased)
    off = (np.einsum("fki,fki,fkj->fkj", after, Nb, Nb) - np.einsum("fki,fki,fkj->fkj", after, N, N)) / 8.0
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


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) over their lengths; 0 remains."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
