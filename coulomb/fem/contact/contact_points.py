"""Contact points of a face: which nodes the displacement, the gap and the place of each are averages of.

On first-order faces and those of 27-node hexahedra a contact point is a node.  On faces of 10-node tetrahedra the
integrals of the vertices' hat functions vanish; there a contact point is a vertex j with a function psi_j that on its
facets is linear, 2 at j and -1/2 at the other vertices,

    u_j = (1/a_j) int psi_j u dS,    a_j = int psi_j dS

and a force x_j at it is the traction psi_j x_j/a_j.  The functions add up to 1, so a uniform pressure is exact.  They
are halfway between the linear hats phi_j (1 at j, 0 at the others; Puso, Laursen and Solberg 2008) and the functions
dual to these (3, -1, -1).  On a plane triangle of any shape the average with psi_j of a quadratic function is that of
its tangent plane at j: where a curved face touches at a vertex, the average of the gap is 0, with phi_j it is
h^2/(8 R) above (equilateral), with dual functions as much below.  So the gap may be averaged as the displacement is,
and vertices that touch are not inside the foundation.  Measured: means-of-vertices.csv.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from ..bodies import (
    AddedSprings,
    DisplacementSpace,
    HeldDirections,
    Nodes,
    at_nodes_of,
    block_diagonal,
    distributed_rows,
    local_rows,
    matrix_product,
)
from ..geometry import FrictionAxes, friction_frames, held_length
from ..meshes import Exchange, fetched, owner_of, starts_of
from .facet_patch import facet_patch

if TYPE_CHECKING:
    from ..bodies import Deformable, Member

_NO_ENTRY: Final = 1e-10
"""An entry of a row, or of a difference of rows, below this part of the row's largest is a rounding error: normals of
facets of a length h at coordinates x have errors of 1e-16 |x|/h."""


def contact_matrix(points: ContactPoints, frames: FloatArray) -> PETSc.Mat:
    """B, shape (3 m, n): the displacements of contact points against what they touch, in frames of rows n, t1, t2 (m,
    3, 3); collective."""
    seen = frames
    if points.mirrored is not None:
        across = np.einsum("mai,mij->maj", frames, points.mirrored)
        near = np.abs(across - frames) <= _NO_ENTRY
        seen = np.where(near, 0.0, frames - across)
    local = _blocks(points.difference, seen)
    local.eliminate_zeros()
    return _distributed(local, points)


def springs_at(points: ContactPoints, at_points: FloatArray, forces: FloatArray, at_nodes: FloatArray) -> AddedSprings:
    """Springs that resist the displacements of contact points against what they touch, N/m, (m, 3, 3), and those of
    nodes, (k, 3, 3), with forces in newtons (m, 3) where nothing is displaced; collective.

    A point that is an average couples its nodes: W^T S W by the weights W.
    """
    if points.mirrored is not None:
        along = np.eye(3) - points.mirrored
        at_points, forces = along @ at_points @ along, np.einsum("mij,mj->mi", along, forces)
    W, S = (
        _distributed(_blocks(points.difference, blocks), points)
        for blocks in (np.tile(np.eye(3), (len(forces), 1, 1)), at_points)
    )
    own = _distributed(block_diagonal(at_nodes, points.space.numbering), points)
    stiffness, force = W.transposeMatMult(S), at_nodes_of(W, forces)
    stiffness.axpy(1.0, own, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    for done in (W, S, own):
        done.destroy()
    return AddedSprings(stiffness, force, points.nodal and points.opposite is None)


def places_among(
    points: tuple[npt.NDArray[np.integer[Any]], IntArray],
    others: tuple[npt.NDArray[np.integer[Any]], IntArray],
) -> IntArray:
    """Numbers of contact points among others, -1 of those that are none of them, shape (m,); both by their nodes and
    the numbers of their contacts: a node has a point in every contact of its faces."""
    (nodes, part), (their_nodes, their_part) = points, others
    count = 1 + int(max(np.max(part, initial=0), np.max(their_part, initial=0)))
    key, keys = (count * node.astype(np.int64) + of for node, of in ((nodes, part), (their_nodes, their_part)))
    order = np.argsort(keys)
    place = order[np.minimum(np.searchsorted(keys, key, sorter=order), len(keys) - 1)] if len(keys) else key
    return np.where(keys[place] == key, place, -1) if len(keys) else np.full(len(key), -1)


class KeptMatrix:
    """The `contact_matrix` of points that are nodes, made anew only where nodes or frames have changed."""

    def __init__(self) -> None:
        self._last: tuple[ContactPoints, FloatArray, PETSc.Mat] | None = None

    def of(self, points: ContactPoints, frames: FloatArray) -> PETSc.Mat:
        """That of some points in their frames, not to be changed or destroyed; collective."""
        if self._last is None or not points.space.comm.allreduce(self._same(points, frames), op=MPI.LAND):
            self._last = points, frames.copy(), contact_matrix(points, frames)
        return self._last[2]

    def _same(self, points: ContactPoints, frames: FloatArray) -> bool:
        assert self._last is not None
        before, there, _ = self._last
        if points is not before:
            for one in (points, before):
                if not one.nodal or one.opposite is not None or one.mirrored is not None:
                    return False
            if points.space is not before.space or not np.array_equal(points.nodes, before.nodes):
                return False
        return np.array_equal(frames, there)


def _blocks(weights: scipy.sparse.csr_matrix, frames: FloatArray) -> scipy.sparse.csr_matrix:
    """Weights (m, nodes) times the rows of frames (m, r, 3), shape (r m, 3 nodes)."""
    of = np.repeat(np.arange(len(frames)), np.diff(weights.indptr))
    entries = weights.data[:, None, None] * frames[of], weights.indices, weights.indptr
    return scipy.sparse.bsr_matrix(entries, (frames.shape[1] * len(frames), 3 * weights.shape[1])).tocsr()


def free_contact_matrix(B: PETSc.Mat, points: ContactPoints, body: Deformable) -> tuple[PETSc.Mat, bool]:
    """B T, T from the unknowns of K to displacements, and whether it differs from B: B itself if neither the entries
    nor the number of unknowns do; collective.

    A contact force acts on free displacements only: A = B T K^-1 T^T B^T.  A row along prescribed directions is zero.
    """
    comm = points.space.comm
    P = body.reduction.projection()
    product = B.matMult(P)
    P.destroy()
    whole, free = (local_rows(matrix) for matrix in (B, product))
    columns = product.getSizes()[1]
    product.destroy()
    largest = abs(whole).max(axis=1).toarray().ravel()
    free.data[np.abs(free.data) <= _NO_ENTRY * np.repeat(largest, np.diff(free.indptr))] = 0.0
    free.eliminate_zeros()
    wide = scipy.sparse.csr_matrix((whole.data, whole.indices, whole.indptr), free.shape)
    other = comm.allreduce((free != wide).nnz > 0, op=MPI.LOR)
    if not other and free.shape == whole.shape:
        return B, False
    return distributed_rows(free, columns, points.space, None), other


def free_lengths(points: ContactPoints, n: FloatArray, body: Deformable) -> FloatArray:
    """Length of the row of B T along n over that of B, of unit normals n (m, 3) of every point, shape (m,); collective.

    u = T v + g, v the unknowns: it is 0 where the displacement along n is prescribed, by supports of the nodes, or of
    those that they follow.
    """
    if points.opposite is None and not body.constraints.ties:
        return np.sqrt(np.maximum(1.0 - held_length(n, points.held(body.held)) ** 2, 0.0))
    rows, size = _blocks(points.difference, n[:, None]), points.space.numbering
    B, P = distributed_rows(rows, (3 * size.local, 3 * size.total), points.space, None), body.reduction.projection()
    product = B.matMult(P)
    free, whole = (np.sqrt(np.asarray(of.multiply(of).sum(axis=1)).ravel()) for of in (local_rows(product), rows))
    for matrix in (B, P, product):
        matrix.destroy()
    return free / whole


def row_products(B: PETSc.Mat, points: ContactPoints) -> FloatArray:
    """Products of the three rows of every contact point with each other, over the sum of the squares of the point's
    weights: 1 on the diagonal, if nothing is held; shape (m, 3, 3)."""
    rows = local_rows(B)
    weights = points.difference
    square = np.asarray(weights.multiply(weights).sum(axis=1)).ravel()
    products = np.empty((len(points.nodes), 3, 3))
    components = [rows[i::3] for i in range(3)]
    for i in range(3):
        for j in range(i + 1):
            products[:, i, j] = np.asarray(components[i].multiply(components[j]).sum(axis=1)).ravel() / square
            products[:, j, i] = products[:, i, j]
    return products


def _distributed(rows: scipy.sparse.csr_matrix, points: ContactPoints) -> PETSc.Mat:
    size = points.space.numbering
    B = distributed_rows(rows, (3 * size.local, 3 * size.total), points.space, None)
    B.assemble()
    return B


FUNCTIONS: FloatArray = 2.5 * np.eye(3) - 0.5
"""The functions psi_j of a facet with six nodes as combinations of the linear ones of its vertices, shape (3, 3)."""

_DEGREE: Final = 8
"""Of the rule for their integrals: exact where the facet is plane, with curved edges too."""

_NO_WEIGHT: Final = 1e-14
"""Weights below this are rounding errors."""


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """This rank's m contact points.

    Attributes:
        space: The nodes, of one body or of several.
        nodes: The node that stands for each, among this rank's k nodes, shape (m,).
        area: a_j in m^2, shape (m,).
        weights: Weight of every node of all ranks in the average of each point, shape (m, nodes).
        nodal: Whether each point is its node.
        opposite: On faces against another deformable face, the weights of its nodes in the average over that face,
            shape (m, nodes); rows against a foundation are empty.  None if there are no such faces.
        mirrored: Projectors on the directions across planes of symmetry that both faces end on, shape (m, 3, 3):
            averages have no part along them, as those over the face and its mirror image.  None if there are none.
    """

    space: Nodes
    nodes: Int32Array
    area: FloatArray
    weights: scipy.sparse.csr_matrix
    nodal: bool
    opposite: scipy.sparse.csr_matrix | None = None
    mirrored: FloatArray | None = None

    @property
    def difference(self) -> scipy.sparse.csr_matrix:
        """The weights of the nodes in the displacement of each point against what it touches, shape (m, nodes): against
        a deformable face the difference of two averages."""
        if self.opposite is None:
            return self.weights
        difference = (self.weights - self.opposite).tocsr()
        difference.sort_indices()
        return difference

    def average(self, values: FloatArray) -> FloatArray:
        """Averages of values at this rank's nodes (k,) or (k, d), shape (m,) or (m, d); collective."""
        if self.nodal:
            return values[self.nodes]
        if values.ndim == 1:
            return self.average(values[:, None])[:, 0]
        return np.column_stack([matrix_product(self._matrix, column) for column in values.T])

    def before_deformation(self, x: FloatArray) -> FloatArray:
        """Where points that are at x (m, 3) now were before their bodies were deformed, metres; collective."""
        space = self.space
        return x if space.x is space.reference else x - self.average(space.x - space.reference)

    def frames(
        self,
        axes: FrictionAxes | None,
        n: FloatArray,
        H: FloatArray,
        x: FloatArray,
        face: str,
        u: FloatArray | None = None,
    ) -> FloatArray:
        """`friction_frames` of points that are at x (m, 3) now, after small displacements u (k, 3) of the nodes if they
        are given, metres: axes and coefficients belong to the material; collective."""
        space = self.space
        if axes is None or (u is None and space.x is space.reference):
            return friction_frames(axes, n, H, x, face, space.comm)
        way = space.x - space.reference + (0.0 if u is None else u)
        gradients = self.average(space.deformation(way).reshape(-1, 9)).reshape(-1, 3, 3)
        return friction_frames(axes, n, H, x - self.average(way), face, space.comm, gradients)

    def gap(self, values: FloatArray) -> FloatArray:
        """The gap of each point by those at this rank's nodes (k,), metres, shape (m,): their average, but no less than
        the smallest of them, or than 0 if none is negative: what does not overlap has no interference.  Collective."""
        if self.nodal:
            return values[self.nodes]
        comm, (nodes, place) = self.space.comm, np.unique(self.weights.indices, return_inverse=True)
        there = fetched(comm, starts_of(comm, self.space.numbering.local), nodes.astype(np.int64), values)[place]
        return bounded_gap(self.average(values), self.weights, there)

    def opposite_average(self, values: FloatArray) -> FloatArray | None:
        """Averages over the faces opposite of nodal values (k, d), shape (m, d), 0 against foundations; None without
        such faces; collective."""
        return None if self.opposite is None else replace(self, weights=self.opposite, nodal=False).average(values)

    def diagonal(self, values: FloatArray) -> FloatArray:
        """The stiffness against which a point moves as its nodes do against values (k,) in N/m, all others at rest,
        shape (m,): means of the values with squares of the weights, over the sum of these; collective."""
        square = self.difference.multiply(self.difference).tocsr()
        total = np.asarray(square.sum(axis=1)).ravel()
        whole = replace(self, weights=square, nodal=False, opposite=None).average(values)
        return whole / np.where(total > 0.0, total, 1.0) ** 2

    def held(self, held: HeldDirections) -> FloatArray:
        """How far each point is held: the mean M of the projectors of its nodes, shape (m, 3, 3); collective.

        Weighted with the squares of the weights, so that of a row of B along a unit vector d the part sqrt(d^T M d) of
        its length is along held directions.  At a point that is a node, M is its projector.  At a held vertex beside
        free nodes it is less: the row acts on these, and without the point their part of the traction would be missing.
        """
        if self.nodal:
            return held.projector_at(self.nodes)
        square = self.weights.multiply(self.weights).tocsr()
        square = scipy.sparse.diags(1.0 / np.asarray(square.sum(axis=1)).ravel()) @ square
        projectors = held.projector_at(np.arange(held.count)).reshape(-1, 9)
        return replace(self, weights=square.tocsr()).average(projectors).reshape(-1, 3, 3)

    def spread(self, values: FloatArray) -> FloatArray:
        """Values at the contact points (m,) or (m, d) as nodal fields, 0 at other points, linear between vertices that
        are contact points; shape (k,) or (k, d); collective."""
        field = np.zeros((len(self.space.x), *values.shape[1:]))
        field[self.nodes] = values
        return field if self.nodal else self.space.linear_between_vertices(field)

    def only(self, which: BoolArray) -> ContactPoints:
        if np.all(which):
            return self
        return replace(
            self,
            nodes=self.nodes[which],
            area=self.area[which],
            weights=self.weights[which],
            opposite=None if self.opposite is None else self.opposite[which],
            mirrored=None if self.mirrored is None else self.mirrored[which],
        )

    def of(self, member: Member, whole: Deformable) -> ContactPoints:
        """The points of a body alone among the nodes of all bodies; without `opposite`."""
        if whole is member.body:
            return self
        nodes = (member.nodes.start + self.nodes).astype(np.int32)
        return replace(self, space=whole, nodes=nodes, weights=among_all(self.weights, member, whole))

    @cached_property
    def _matrix(self) -> PETSc.Mat:
        size = self.space.numbering
        return distributed_rows(self.weights, (size.local, size.total), self.space, None)


def bounded_gap(average: FloatArray, weights: scipy.sparse.csr_matrix, values: FloatArray) -> FloatArray:
    """`ContactPoints.gap` by the averages (m,) and the gaps at the node of every entry of the weights, shape (e,)."""
    least = np.minimum.reduceat(np.append(values, 0.0), weights.indptr[:-1]) if len(average) else average
    return np.maximum(average, np.minimum(least, 0.0))


def among_all(weights: scipy.sparse.csr_matrix, member: Member, whole: Deformable) -> scipy.sparse.csr_matrix:
    """Weights of the nodes of one body (m, its nodes) as weights of the nodes of all bodies."""
    columns = whole.numbers_of(member, weights.indices.astype(np.int64))
    shape = (weights.shape[0], whole.numbering.total)
    matrix = scipy.sparse.csr_matrix((weights.data, columns, weights.indptr), shape=shape)
    matrix.sort_indices()
    return matrix


def contact_points(space: DisplacementSpace, facets: Int32Array) -> ContactPoints:
    """The contact points of boundary facets, in the order of their nodes, kept for the evidence of load steps;
    collective."""
    key = space.key_of(facets)
    if key not in space.points_of_faces:
        points = (nodal_points if space.positive else _weighted)(space, facets)
        space.points_of_faces[key] = points.only(~np.isin(points.nodes, space.without_area))
    return space.points_of_faces[key]


def nodal_points(space: DisplacementSpace, facets: Int32Array) -> ContactPoints:
    """The nodes of boundary facets, each by itself; collective."""
    nodes, numbering = space.nodes_of(facets), space.numbering
    entries = np.ones(len(nodes)), numbering.first + nodes, np.arange(len(nodes) + 1)
    weights = scipy.sparse.csr_matrix(entries, (len(nodes), numbering.total))
    return ContactPoints(space, nodes, space.area_of(facets)[nodes], weights, True)


def joined_points(parts: Sequence[ContactPoints]) -> ContactPoints:
    """The contact points of several faces, in their order."""
    if len(parts) == 1:
        return parts[0]
    opposite = None
    if any(part.opposite is not None for part in parts):
        none = [scipy.sparse.csr_matrix(part.weights.shape) for part in parts]
        rows = [empty if part.opposite is None else part.opposite for part, empty in zip(parts, none, strict=True)]
        opposite = scipy.sparse.vstack(rows, format="csr")
    mirrored = None
    if any(part.mirrored is not None for part in parts):
        flat = [np.zeros((len(part.nodes), 3, 3)) if part.mirrored is None else part.mirrored for part in parts]
        mirrored = np.concatenate(flat)
    return ContactPoints(
        parts[0].space,
        np.concatenate([part.nodes for part in parts]),
        np.concatenate([part.area for part in parts]),
        scipy.sparse.vstack([part.weights for part in parts], format="csr"),
        all(part.nodal for part in parts),
        opposite,
        mirrored,
    )


def _weighted(space: DisplacementSpace, facets: Int32Array) -> ContactPoints:
    """Vertices, each with the integrals of its function psi_j against those of the nodes before deformation, and its
    present area: weights that changed as the face is stretched would couple forces along normals to displacements along
    tangents, and not the other way round."""
    before = space.undeformed
    if before is not space:
        points = contact_points(before, facets)
        vertex, integrals, _ = _integrals(space, facets, False)
        present = np.zeros(len(space.x))
        np.add.at(present, vertex - space.numbering.first, integrals[:, 0])
        return replace(points, space=space, area=present[points.nodes])
    numbering = space.numbering
    vertex, entries, columns = _integrals(space, facets, True)
    triplets = entries.ravel(), (np.repeat(vertex - numbering.first, columns.shape[1]), columns.ravel())
    weights = scipy.sparse.csr_matrix(triplets, shape=(numbering.local, numbering.total))
    area: FloatArray = np.asarray(weights.sum(axis=1)).ravel()
    nodes = np.flatnonzero(area > 0.0)
    weights = (scipy.sparse.diags(1.0 / area[nodes]) @ weights[nodes]).tocsr()
    weights.data[np.abs(weights.data) < _NO_WEIGHT] = 0.0
    weights.eliminate_zeros()
    weights.sort_indices()
    return ContactPoints(space, nodes.astype(np.int32), area[nodes], weights, False)


def _integrals(space: DisplacementSpace, facets: Int32Array, by_nodes: bool) -> tuple[IntArray, FloatArray, IntArray]:
    """Of every facet at a vertex of this rank the vertex, the integrals of its psi_j against the functions of the
    facet's nodes, or against 1, and these nodes, (f,), (f, nodes) or (f, 1), (f, nodes); collective."""
    patch = facet_patch(space, facets)
    local, size = patch.kind.rule(_DEGREE)
    values = np.stack(patch.kind.values(local[:, 0], local[:, 1]))
    sizes = size * np.linalg.norm(patch.area_vectors(local), axis=2)
    against = values if by_nodes else np.ones((1, len(local)))
    integrals = np.einsum("fq,jq,nq->fjn", sizes, FUNCTIONS @ patch.kind.vertex_functions @ values, against)
    vertex = patch.nodes[:, :3].ravel()
    exchange = Exchange(space.comm, owner_of(starts_of(space.comm, space.numbering.local), vertex))
    return (
        exchange.send(vertex),
        exchange.send(integrals.reshape(-1, len(against))),
        exchange.send(np.repeat(patch.nodes, 3, axis=0)),
    )
