"""A = B S^-1 B^T on several ranks, S the Schur complement of K on the contact nodes."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from .compliance import MatrixFreeCompliance
from .distributed_multifrontal import DistributedMultifrontalSolver
from .learnt_columns import LearntColumns


class DistributedSchurCompliance:
    """A = B S^-1 B^T; a product takes two sums over the ranks, of as many numbers as S has rows.

    Args:
        B: Contact matrix, 3 rows per contact node, on the node's rank.
        solver: The factorised K, with the nodes of B's columns last.
    """

    name = "explicit"
    exact = True
    matrix_free: MatrixFreeCompliance | None = None

    def __init__(self, B: PETSc.Mat, solver: DistributedMultifrontalSolver):
        self.B = B  # kept, since the communicator lives as long as the matrix
        self.comm: MPI.Comm = B.getComm().tompi4py()
        self.nodes = B.getLocalSize()[0] // 3
        self.products, self.learnt = 0, LearntColumns()
        self._solver = solver
        indptr, indices, values = B.getValuesCSR()
        columns = (3 * solver.last[:, None] + np.arange(3)).ravel()
        shape = (len(indptr) - 1, B.getSize()[1])
        self._rows = scipy.sparse.csr_matrix((values, indices, indptr), shape=shape)[:, columns]
        self._columns = self._rows.T.tocsr()

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        part, forces = self._columns @ x, np.empty(self._rows.shape[1])
        self.comm.Allreduce(part, forces)
        y[:] = self._rows @ self._solver.schur_product(forces)
        self.products += 1

    def mult_incremental(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        self.mult(x, y)

    def diagonal(self) -> FloatArray:
        return self._diagonal

    @cached_property
    def _diagonal(self) -> FloatArray:
        everywhere = scipy.sparse.hstack(self.comm.allgather(self._columns), format="csr")
        start = sum(self.comm.allgather(self._rows.shape[0])[: self.comm.rank])
        diagonal: FloatArray = self._solver.schur_squares(everywhere)[start : start + self._rows.shape[0]]
        return diagonal

    def rotated(self, B: PETSc.Mat) -> DistributedSchurCompliance:
        return DistributedSchurCompliance(B, self._solver)

    def displacement(self, x: FloatArray, f: PETSc.Vec, free: FloatArray) -> FloatArray:
        rhs, forces = self.B.createVecs()
        u = rhs.duplicate()
        forces.array[:] = x
        self.B.multTranspose(forces, rhs)
        rhs.aypx(-1.0, f)
        self._solver.solve(rhs, u)
        values: FloatArray = u.array_r.copy()
        for done in (rhs, forces, u):
            done.destroy()
        return values
