"""The contact matrix B: from the displacements of the nodes to those of the contact points, and back for the forces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..bodies import HeldNodes, distributed_rows
from .contact_points import ContactPoints

_ROUNDING = 1e-13
"""An entry of a row along free directions below this part of the row's largest is a rounding error."""


def contact_matrix(points: ContactPoints, frames: FloatArray) -> PETSc.Mat:
    """B: the displacements of contact points, against what they touch, in their frames; collective.

    Args:
        points: The contact points, averages of the displacements of nodes.
        frames: Rows n, t1, t2, shape (m, 3, 3).

    Returns:
        Shape (3 m, n), distributed.
    """
    seen = frames
    if points.mirrored is not None:
        across = np.einsum("mai,mij->maj", frames, points.mirrored)
        near = np.abs(across - frames) <= _ROUNDING
        seen = np.where(near, 0.0, frames - across)
    local = _blocks(points.difference, seen)
    return _distributed(local, points)


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
    """Weights (m, nodes) times the rows of frames (m, 3, 3), shape (3 m, 3 nodes)."""
    axes = np.arange(3)
    columns = (3 * weights.indices[:, None] + axes).astype(PETSc.IntType)
    of = np.repeat(np.arange(len(frames)), np.diff(weights.indptr))
    entries = weights.data[:, None, None] * frames[of]
    row = np.broadcast_to(3 * of[:, None, None] + axes[:, None], entries.shape)
    present = entries != 0.0
    return scipy.sparse.csr_matrix(
        (entries[present], (row[present], np.broadcast_to(columns[:, None, :], entries.shape)[present])),
        shape=(3 * len(frames), 3 * weights.shape[1]),
    )


def free_contact_matrix(B: PETSc.Mat, points: ContactPoints, body: HeldNodes) -> PETSc.Mat:
    """B P, P the projection on the free directions of the nodes; B itself if nothing changes; collective.

    A contact force acts on free displacements only: A = B P K^-1 P B^T.  A row along prescribed directions is zero.
    """
    comm = points.space.comm
    P = body.projection()
    product = B.matMult(P)
    P.destroy()
    whole, free = (_local(matrix) for matrix in (B, product))
    product.destroy()
    largest = abs(whole).max(axis=1).toarray().ravel()
    free.data[np.abs(free.data) <= _ROUNDING * np.repeat(largest, np.diff(free.indptr))] = 0.0
    free.eliminate_zeros()
    if comm.allreduce((free != whole).nnz == 0, op=MPI.LAND):
        return B
    return _distributed(free, points)


def row_products(B: PETSc.Mat, points: ContactPoints) -> FloatArray:
    """Products of the three rows of every contact point with each other, shape (m, 3, 3).

    They are divided by the sum of the squares of the point's weights: 1 on the diagonal, if nothing is held.
    """
    rows = _local(B)
    weights = points.difference
    square = np.asarray(weights.multiply(weights).sum(axis=1)).ravel()
    products = np.empty((len(points.nodes), 3, 3))
    for i in range(3):
        for j in range(3):
            products[:, i, j] = np.asarray(rows[i::3].multiply(rows[j::3]).sum(axis=1)).ravel() / square
    return products


def _local(matrix: PETSc.Mat) -> scipy.sparse.csr_matrix:
    """The rows of this rank, all columns."""
    indptr, columns, values = matrix.getValuesCSR()
    rows = scipy.sparse.csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, matrix.getSize()[1]))
    rows.sort_indices()
    return rows


def _distributed(rows: scipy.sparse.csr_matrix, points: ContactPoints) -> PETSc.Mat:
    """The matrix of the rows of every rank."""
    rows.sort_indices()
    size = points.space.numbering
    B = distributed_rows(rows, (3 * size.local, 3 * size.total), points.space, None)
    B.assemble()
    return B


def rows_of(B: PETSc.Mat, u: FloatArray) -> FloatArray:
    """B u in metres, shape (m, 3), of displacements u of this rank's nodes, shape (k, 3); collective."""
    displacement, image = B.createVecs()
    return _product(B.mult, u, displacement, image)


def at_nodes_of(B: PETSc.Mat, x: FloatArray) -> FloatArray:
    """B^T x in newtons, this rank's nodes, shape (k, 3), of forces x, shape (m, 3) or (3 m,); collective."""
    spread, forces = B.createVecs()
    return _product(B.multTranspose, x, forces, spread)


def _product(
    multiply: Callable[[PETSc.Vec, PETSc.Vec], None], values: FloatArray, given: PETSc.Vec, result: PETSc.Vec
) -> FloatArray:
    """A product of B or B^T with values, shape (rows, 3); the two vectors are destroyed."""
    given.array[:] = values.ravel()
    multiply(given, result)
    product: FloatArray = result.array_r.reshape(-1, 3).copy()
    given.destroy()
    result.destroy()
    return product
