"""The coarse grids of multigrid on several ranks: every rank has the small ones as a whole.

On a grid of a thousand unknowns a product takes a few microseconds, and the messages for it more.  Each rank restricts
to the whole of the first such grid, all add up what they have, in one call per cycle, and each computes the rest of the
cycle, from which it interpolates without messages.
"""

from __future__ import annotations

from typing import Protocol

import scipy.linalg
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg.blas import dtrsv

from ...arrays import FloatArray
from ..petsc_arrays import Entries
from ..petsc_options import configured_ksp
from .ghost_blocks import padded

REPLICATED_UP_TO = 1500
"""Unknowns of all ranks up to which each rank has a grid as a whole."""


DENSE_UP_TO = 500
"""Unknowns up to which there is no coarser grid: a matrix of so few is nearly full."""

_FACTORISED: dict[str, object] = {"pc_type": "lu", "pc_factor_shift_type": "inblocks"}


class CoarseSolver(Protocol):
    """Solves on a coarse grid."""

    def __call__(self, r: FloatArray) -> FloatArray:
        """The solution for r, padded, to be read before the next one; collective."""
        ...

    def destroy(self) -> None:
        """Free its PETSc objects."""
        ...


class DenseSolver:
    """On a small coarsest grid.

    Args:
        K: Its matrix, on one rank, positive definite.

    Raises:
        LinAlgError: If it is not, to rounding.
    """

    def __init__(self, K: Entries):
        n = len(K.indptr) - 1
        dense = scipy.sparse.csr_matrix((K.values, K.indices, K.indptr), shape=(n, n)).toarray(order="F")
        self._factor = scipy.linalg.cholesky(dense, lower=True, overwrite_a=True, check_finite=False)
        self._solution = padded(n)

    def __call__(self, r: FloatArray) -> FloatArray:
        # of one right-hand side LAPACK's dpotrs takes 2.7 times as long as these
        self._solution[:] = dtrsv(self._factor, r, lower=1)
        self._solution[:] = dtrsv(self._factor, self._solution, lower=1, trans=1)
        return self._solution

    def destroy(self) -> None:
        """It has no PETSc objects."""


class SparseSolver:
    """On a coarsest grid of any size.

    Args:
        K: Its matrix, on one rank; not kept.
    """

    def __init__(self, K: Entries):
        n = len(K.indptr) - 1
        csr = tuple(array.astype(PETSc.IntType) for array in K[:2])
        matrix = PETSc.Mat().createAIJ((n, n), csr=(*csr, K.values), comm=PETSc.COMM_SELF)
        self._ksp = configured_ksp(matrix, "preonly", _FACTORISED)
        matrix.destroy()
        self._b, self._x = self._ksp.getOperators()[1].createVecs()
        self._solution = padded(self._x.getLocalSize())

    def __call__(self, r: FloatArray) -> FloatArray:
        self._b.array[:] = r
        self._ksp.solve(self._b, self._x)
        self._solution[:] = self._x.array_r
        return self._solution

    def destroy(self) -> None:
        for thing in (self._ksp, self._b, self._x):
            thing.destroy()


def exact_solver(K: Entries) -> CoarseSolver:
    """Of the coarsest grid."""
    if len(K.indptr) <= DENSE_UP_TO:
        try:
            return DenseSolver(K)
        except scipy.linalg.LinAlgError:  # rigid motions that nothing but rounding holds
            pass
    return SparseSolver(K)


class Replicated:
    """A solver that each rank has for itself, of a grid that every rank has as a whole.

    Args:
        comm: The ranks.
        solver: For all unknowns; the same on every rank.
    """

    def __init__(self, comm: MPI.Comm, solver: CoarseSolver):
        self._comm, self._solver = comm, solver

    def __call__(self, r: FloatArray) -> FloatArray:
        """The solution for the sum of all ranks' r, which is in r afterwards."""
        self._comm.Allreduce(MPI.IN_PLACE, r)
        return self._solver(r)

    def destroy(self) -> None:
        self._solver.destroy()
