"""The coarse grids of multigrid on several ranks: every rank has the small ones as a whole.

On a grid of a thousand unknowns a product takes a few microseconds, and the messages for it more.  Here the right-hand
side of the first such grid is gathered on all ranks, in one call per cycle, and each computes the rest of the cycle.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from .ghost_blocks import padded
from .reductions import concatenated

REPLICATED_UP_TO = 1500
"""Unknowns of all ranks up to which each rank has a grid as a whole."""


class CoarseSolver(Protocol):
    """Solves on a coarse grid."""

    def __call__(self, r: FloatArray) -> FloatArray:
        """The solution for r, padded, to be read before the next one; collective."""
        ...

    def destroy(self) -> None:
        """Free its PETSc objects."""
        ...


class ExactSolver:
    """On the coarsest grid.

    Args:
        ksp: The solver.
    """

    def __init__(self, ksp: PETSc.KSP):
        self._ksp = ksp
        self._b, self._x = ksp.getOperators()[1].createVecs()
        self._solution = padded(self._x.getLocalSize())

    def __call__(self, r: FloatArray) -> FloatArray:
        self._b.array[:] = r
        self._ksp.solve(self._b, self._x)
        self._solution[:] = self._x.array_r
        return self._solution

    def destroy(self) -> None:
        for thing in (self._ksp, self._b, self._x):
            thing.destroy()


class Replicated:
    """A solver that each rank has for itself, of a grid whose unknowns are distributed.

    Args:
        comm: The ranks.
        size: Unknowns of this rank.
        solver: For all unknowns; the same on every rank.
    """

    def __init__(self, comm: MPI.Comm, size: int, solver: CoarseSolver):
        self._comm, self._solver = comm, solver
        self._counts = concatenated(comm, np.array([size]))
        first = int(self._counts[: comm.rank].sum())
        self._mine = slice(first, first + size)
        self._whole, self._solution = padded(int(self._counts.sum())), padded(size)

    def __call__(self, r: FloatArray) -> FloatArray:
        self._comm.Allgatherv(r, (self._whole, self._counts))
        self._solution[:] = self._solver(self._whole)[self._mine]
        return self._solution

    def destroy(self) -> None:
        self._solver.destroy()


def whole(matrix: PETSc.Mat) -> PETSc.Mat:
    """A distributed matrix as one that each rank has for itself; collective."""
    comm: MPI.Comm = matrix.comm.tompi4py()
    indptr, *entries = matrix.getValuesCSR()
    lengths = concatenated(comm, np.diff(indptr))
    pointers = np.concatenate([[0], np.cumsum(lengths)]).astype(PETSc.IntType)
    csr = (pointers, *(concatenated(comm, part) for part in entries))
    return PETSc.Mat().createAIJ(matrix.getSize(), csr=csr, comm=PETSc.COMM_SELF)
