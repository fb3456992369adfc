"""The factors of K on the first of several ranks, which solves for all of them.

Beyond the sizes for which that is quick, bodies are left to multigrid.  PETSc's MUMPS on two ranks takes 3.5 times as
long for a contact problem by solves with K (docs/measurements.md), and for the 990 columns of K^-1 that make A on the
block of 11 000 unknowns (MatMatSolve) alone several times as long as the whole answer takes here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..reductions import concatenated, summed
from .multifrontal import MultifrontalSolver
from .nested_dissection import Nodes

Found = TypeVar("Found")


class FirstRankSolver:
    """`MultifrontalSolver` on the first rank, for all of them; all calls are collective.

    Args:
        K: As of `MultifrontalSolver`, the rows of a node on one rank.
        points: Coordinates of this rank's nodes, shape (k, 3).
        last: Nodes to eliminate last, by global number; those of all ranks together.
        single, many: As of `MultifrontalSolver`.

    Attributes:
        last: The same nodes on every rank, in the order of `schur_solve`, body after body.
        single: Whether the factors are in single precision.
        error: As of `MultifrontalSolver`.

    Raises:
        ValueError: On every rank, if K is not positive definite.
    """

    method = "direct (nested dissection, on the first rank)"
    tolerance = 0.0
    iterations = 0

    def __init__(
        self,
        K: PETSc.Mat,
        points: FloatArray,
        last: npt.NDArray[np.integer[Any]],
        single: bool | None = None,
        many: bool = False,
    ):
        self.comm: MPI.Comm = K.getComm().tompi4py()
        self._K, (self._start, self._end) = K, K.getOwnershipRange()
        size = K.getSize()[0] if self.comm.rank == 0 else 0
        everything = PETSc.IS().createStride(size, 0, 1, comm=PETSc.COMM_SELF)
        (whole,) = K.createSubMatrices(everything, everything)
        x, nodes = concatenated(self.comm, points), np.unique(concatenated(self.comm, last.astype(np.int64)))
        self._solvers: list[MultifrontalSolver] = []  # one on the first rank
        self._of_first(lambda: self._solvers.append(MultifrontalSolver(whole, x, nodes, single, None, many)))
        self.last: Nodes = self._of_first(lambda: self._solvers[0].last)
        unknowns = (3 * self.last[:, None] + np.arange(3)).ravel()
        self._mine = np.flatnonzero((unknowns >= self._start) & (unknowns < self._end))
        self._at = unknowns[self._mine] - self._start

    def _of_first(self, compute: Callable[[], Found]) -> Found:
        """What the first rank finds, or its error, on all ranks."""
        result: Any = None
        if self.comm.rank == 0:
            try:
                result = compute()
            except (ValueError, MemoryError) as error:
                result = error
            state = [(solver.single, solver.error, solver.name) for solver in self._solvers]
        else:
            state = []
        result, state = self.comm.bcast((result, state))
        if isinstance(result, Exception):
            raise result
        (self.single, self.error, self.name) = state[0]
        return result

    @property
    def exact(self) -> bool:
        """Whether the factors are in double precision."""
        return not self.single

    def use_double(self) -> None:
        """See `MultifrontalSolver`."""
        if self.single:
            self._of_first(lambda: self._solvers[0].use_double())

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        """u <- K^-1 rhs; see `StiffnessSolver`."""
        u.array[:], _ = self.improved(rhs.array_r, np.zeros(self._end - self._start), tolerance)

    def improved(self, rhs: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, float]:
        """See `MultifrontalSolver`, of this rank's parts of shape (n,)."""
        f, near = np.ascontiguousarray(concatenated(self.comm, np.column_stack([rhs, u])).T)
        solutions, left = self._of_first(lambda: self._solvers[0].improved(f, near, tolerance))
        return solutions[self._start : self._end], left

    def approximate(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        """u <- K^-1 rhs, to the accuracy of the factors; see `StiffnessSolver`."""
        self.begin(rhs.array_r)
        u.array[:] = self.end(np.zeros(3 * len(self.last)))

    def begin(self, rhs: FloatArray) -> FloatArray:
        """See `MultifrontalSolver`, of this rank's part of shape (..., n)."""
        f = np.ascontiguousarray(concatenated(self.comm, rhs.T).T)
        return self._of_first(lambda: self._solvers[0].begin(f))

    def end(self, z: FloatArray) -> FloatArray:
        """See `MultifrontalSolver`, z the same on all ranks."""
        return self._of_first(lambda: self._solvers[0].end(z))[..., self._start : self._end]

    def multiply(self, u: PETSc.Vec, product: PETSc.Vec) -> None:
        """product <- K u."""
        self._K.mult(u, product)

    def contact_part(self, u: FloatArray) -> FloatArray:
        """Displacements of the nodes `last`, shape (3 last,), the same on all ranks, of this rank's, shape (n,)."""
        part = np.zeros(3 * len(self.last))
        part[self._mine] = u[self._at]
        return summed(self.comm, part)

    def contact_forces(self, z: FloatArray) -> FloatArray:
        """Forces on the nodes `last`, shape (3 last,), among those on this rank's nodes, shape (n,)."""
        forces = np.zeros(self._end - self._start)
        forces[self._at] = z[self._mine]
        return forces

    def schur_solve(self, z: FloatArray) -> FloatArray:
        """S^-1 z, for the Schur complement S of K on the nodes `last`, shape (3 last,), the same on all ranks."""
        return self._of_first(lambda: self._solvers[0].schur_solve(z))

    def schur_diagonal(self, rows: scipy.sparse.csr_matrix) -> FloatArray:
        """b^T S^-1 b for each row b of this rank's matrix, shape (k, 3 last)."""
        every = self.comm.gather(rows)
        start = sum(self.comm.allgather(rows.shape[0])[: self.comm.rank])
        whole = self._of_first(lambda: self._solvers[0].schur_diagonal(scipy.sparse.vstack(every, format="csr")))
        return whole[start : start + rows.shape[0]]

    def destroy(self) -> None:
        """Free the factors."""
        for one in self._solvers:
            one.destroy()
        self._solvers = []
