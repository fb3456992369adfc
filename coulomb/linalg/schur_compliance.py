"""A = B S^-1 B^T on one rank, from the factorised Schur complement S of K on the contact nodes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg.blas import dtrsv, strsv
from scipy.linalg.lapack import dtrtri, strtri

from ..arrays import FloatArray
from .compliance import MatrixFreeCompliance
from .frontal_factors import Real
from .learnt_columns import LearntColumns
from .multifrontal import MultifrontalSolver
from .nested_dissection import Nodes

_ACCURATE = 20
"""Products with K, of those that nothing is known about beforehand, that take as long as a factorisation of K."""

_ENOUGH = 1e-2
"""Error of L with which Newton steps are as good as with A; products at the iterates are accurate."""

_RESIDUAL = 1e-7
"""Accuracies below this are asked for where a residual is computed, not by Krylov methods."""


class SchurCompliance:
    """A = B S^-1 B^T with S = L L^T the Schur complement of K on the contact nodes, a block per body; on one rank.

    A product takes two solves with the dense triangles L, which cost what a product with the dense A would.

    With L in single precision such a product has an error, `MultifrontalSolver.error`, and more accurate ones are
    solves with K.  Those of a sequence of iterates are sums, A x = A x' + A (x - x'): the first term accurate, with
    u' = K^-1 B^T x', and the second by L.  x' is replaced by x, which is a solve with K, when the error of the second
    term exceeds what is asked for.  If accurate products are asked for again and again by `mult`, K is factorised in
    double precision.

    Args:
        B: Contact matrix, 3 rows per contact node.
        solver: The factorised K, with the nodes of B's columns last.
        diagonal: Replaces the exact diagonal, shape (3 m,).
        reference: The last accurate response, of the same A in other frames.
    """

    name = "explicit"
    matrix_free: MatrixFreeCompliance | None = None

    def __init__(
        self,
        B: PETSc.Mat,
        solver: MultifrontalSolver,
        diagonal: FloatArray | None = None,
        reference: _Reference | None = None,
    ):
        self.B = B  # kept, since the communicator lives as long as the matrix
        self.comm: MPI.Comm = B.getComm().tompi4py()
        self.nodes = B.getLocalSize()[0] // 3
        self.products, self.learnt = 0, LearntColumns()
        self._solver, self._given_diagonal = solver, diagonal
        indptr, indices, values = B.getValuesCSR()
        self._last = (3 * solver.last[:, None] + np.arange(3)).ravel()
        self._rows = scipy.sparse.csr_matrix((values, indices, indptr), shape=B.getSize())[:, self._last]
        self._columns = self._rows.T.tocsr()
        self._reference = reference or _Reference(solver, self._last, B.getSize()[1])
        self._before: FloatArray = np.zeros(len(self._last))

    @property
    def exact(self) -> bool:
        """Whether the factors are in double precision."""
        return not self._solver.single

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        z = self._columns @ x
        self.products += 1
        if not self._suffices(tolerance):
            self._reference.accurate += 1
            if self._reference.accurate > _ACCURATE:
                self._solver.use_double()
        if self._suffices(tolerance):
            y[:] = self._rows @ self._solved(z)
        else:
            alone = _Reference(self._solver, self._last, len(self._reference.u))
            y[:] = self._rows @ alone.renew(z, tolerance * float(np.linalg.norm(z)))

    def _suffices(self, tolerance: float) -> bool:
        """Whether products by L may be used where products of this accuracy are asked for.

        The error of L is no noise: products by it are those by a matrix near to A, with which a Krylov method converges
        as with A.
        """
        return self._solver.error <= (max(tolerance, _ENOUGH) if tolerance >= _RESIDUAL else tolerance)

    def mult_incremental(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        z, known = self._columns @ x, self._reference
        self.products += 1
        if self.exact:
            y[:] = self._rows @ self._solved(z)
            return
        change, self._before = float(np.linalg.norm(z - self._before)), z
        far, most = z - known.z, tolerance * change
        if self._solver.error * float(np.linalg.norm(far)) + known.rest <= most:
            y[:] = self._rows @ (known.u[self._last] + self._solved(far))
        else:
            y[:] = self._rows @ known.renew(z, 0.5 * most)

    def _solved(self, z: FloatArray) -> FloatArray:
        """S^-1 z by the factors."""
        size = float(np.max(np.abs(z), initial=0.0)) or 1.0
        w: Real = z / size if self.exact else (z / size).astype(np.float32)
        trsv = dtrsv if self.exact else strsv
        for L, here in self._blocks():
            half = trsv(L, w[here], lower=1)
            w[here] = trsv(L, half, lower=1, trans=1, overwrite_x=1)
        solution: FloatArray = w * np.float64(size)
        return solution

    def diagonal(self) -> FloatArray:
        return self._diagonal

    @cached_property
    def _diagonal(self) -> FloatArray:
        if self._given_diagonal is not None:
            return self._given_diagonal
        inverses = [_inverse_factor(L) for L, _ in self._blocks()]
        columns = [half[i:, i : i + 3] for half in inverses for i in range(0, len(half), 3)]
        blocks = np.array([c.T @ c for c in columns], dtype=np.float64).reshape(-1, 3, 3)
        each = np.arange(len(blocks) + 1)
        whole = (len(self._last),) * 2
        nodal = scipy.sparse.bsr_matrix((blocks, each[:-1], each), whole)  # all that a row of B sees of S^-1
        diagonal: FloatArray = np.asarray((self._rows @ nodal).multiply(self._rows).sum(axis=1)).ravel()
        return diagonal

    def dense(self) -> FloatArray:
        """A as an array, shape (3 m, 3 m), in double precision."""
        self._solver.use_double()
        whole = np.zeros((self._rows.shape[0],) * 2)
        for L, here in self._blocks():
            half = self._rows[:, here] @ np.tril(_inverse_factor(L)).T
            whole += half @ half.T
        return whole

    def _blocks(self) -> Iterator[tuple[Real, slice]]:
        """L of every body, and its displacements among those of all contact nodes."""
        start = 0
        for L in self._solver.schur_factors:
            yield L, slice(start, start + len(L))
            start += len(L)

    def rotated(self, B: PETSc.Mat) -> SchurCompliance:
        return SchurCompliance(B, self._solver, reference=self._reference)

    def displacement(self, x: FloatArray, f: PETSc.Vec, free: FloatArray) -> FloatArray:
        z, known = self._columns @ x, self._reference
        if self.exact:
            if np.all(np.isfinite(free)):  # forces on contact nodes need no forward substitution
                return free - self._solver.improved(known.forces(z), np.zeros_like(free), 0.0)[0]
            return self._solver.improved(f.array_r - known.forces(z), np.zeros_like(free), 0.0)[0]
        return self._solver.improved(f.array_r - known.forces(z), free - known.u, 0.0)[0]  # u is near, or 0


def _inverse_factor(L: Real) -> Real:
    """L^-1, with zeros above the diagonal of its nodal blocks, and anything above these."""
    inverse: Real = (strtri if L.dtype == np.float32 else dtrtri)(L, lower=1)[0]
    for i in range(0, len(inverse), 3):
        inverse[i, i + 1 : i + 3] = inverse[i + 1, i + 2] = 0.0
    return inverse


class _Reference:
    """A response u = K^-1 z to forces z on the contact nodes.

    Args:
        solver: K^-1.
        last: The unknowns on which z acts.
        unknowns: Of K.

    Attributes:
        z: Nodal forces in newtons, in the order of L, shape (3 m,).
        u: Displacements of all nodes in metres, shape (n,).
        rest: Size of the forces that u is wrong by, newtons.
        accurate: Accurate products asked for without regard to the one before.
    """

    def __init__(self, solver: MultifrontalSolver, last: Nodes, unknowns: int):
        self._solver, self._last = solver, last
        self.z: FloatArray = np.zeros(len(last))
        self.u: FloatArray = np.zeros(unknowns)
        self.rest, self.accurate = 0.0, 0

    def renew(self, z: FloatArray, rest: float) -> FloatArray:
        """Replace z, and u by its response, to an error of the size of `rest` newtons; u at the contact nodes."""
        distance = float(np.linalg.norm(z - self.z))
        relative = rest / distance if distance > 0.0 else 0.0
        self.u, left = self._solver.improved(self.forces(z), self.u, relative)
        self.z, self.rest = z, left * distance
        return self.u[self._last]

    def forces(self, z: FloatArray) -> FloatArray:
        """z among the unknowns of K."""
        rhs = np.zeros_like(self.u)
        rhs[self._last] = z
        return rhs
