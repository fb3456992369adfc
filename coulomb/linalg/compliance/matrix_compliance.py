"""The contact compliance as a matrix."""

from __future__ import annotations

from typing import Any

import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from .compliance import MatrixFreeCompliance
from .low_rank import RecycledColumns


class MatrixCompliance:
    """A as an assembled matrix, dense or sparse, 3 rows per contact node, those of a node on one rank.

    `rows` are this rank's rows in scipy's compressed format, if they are at hand.
    """

    name = "matrix"
    exact = True
    matrix_free: MatrixFreeCompliance | None = None

    def __init__(self, matrix: PETSc.Mat, rows: Any = None):
        self.matrix, self._rows = matrix, rows
        self.comm: MPI.Comm = matrix.getComm().tompi4py()
        self.nodes = matrix.getLocalSize()[0] // 3
        self.products, self.learnt = 0, RecycledColumns()
        self._y, self._x = matrix.createVecs("left"), matrix.createVecs("right")
        d = matrix.getDiagonal()
        self._diagonal: FloatArray = d.array.copy()
        d.destroy()

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        self._x.array[:] = x
        self.matrix.mult(self._x, self._y)
        y[:] = self._y.array_r
        self.products += 1

    def mult_incremental(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        self.mult(x, y)

    def diagonal(self) -> FloatArray:
        return self._diagonal

    def dense(self) -> FloatArray:
        """See `Formed`."""
        return self.matrix.getDenseArray() if self._is_dense else self.sparse().toarray()

    @property
    def _is_dense(self) -> bool:
        return self.matrix.getType() in (PETSc.Mat.Type.SEQDENSE, PETSc.Mat.Type.MPIDENSE, PETSc.Mat.Type.DENSE)

    def sparse(self) -> Any:
        """This rank's rows as a sparse matrix, shape (3 m, all columns); not to be changed."""
        if self._rows is not None:
            return self._rows
        if self._is_dense:
            return scipy.sparse.csr_matrix(self.dense())
        indptr, indices, data = self.matrix.getValuesCSR()
        return scipy.sparse.csr_matrix((data, indices, indptr), shape=(3 * self.nodes, self.matrix.getSize()[1]))
