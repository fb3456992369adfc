"""A = B S^-1 B^T from the factorised Schur complement S of K on the contact nodes, on any number of ranks."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..factors import FirstRankSolver, MultifrontalSolver
from ..reductions import Reductions, summed
from .compliance import LimitedProducts, MatrixFreeCompliance
from .coupled import Elimination
from .low_rank import RecycledColumns

SchurSolver = MultifrontalSolver | FirstRankSolver

_ACCURATE: Final = 20
"""Products with K, of those that nothing is known about beforehand, that take as long as a factorisation of K."""

_ENOUGH: Final = 1e-2
"""Error of L with which Newton steps are as good as with A; products at the iterates are accurate."""

_FEW: Final = 600
"""Contact unknowns up to which A is kept: products and the diagonal are then a few calls."""

_REST: Final = 1e-11
"""Forces that a displacement is wrong by, over all, below which it is known."""

_RESIDUAL: Final = 1e-7
"""Accuracies below this are asked for where a residual is computed, not by Krylov methods."""


class SchurCompliance(LimitedProducts):
    """A = B S^-1 B^T with S = L L^T the Schur complement of K on the contact nodes, a block per body.

    A product takes two solves with the dense triangles L, which cost what a product with the dense A would; with the
    inverse of S, half as much: it is formed where there are many (`MultifrontalSolver.schur_solve`).

    With L in single precision such a product has an error, `MultifrontalSolver.error`, and more accurate ones are
    solves with K.  Those of a sequence of iterates are sums, A x = A x' + A (x - x'): the first term accurate, with
    u' = K^-1 B^T x', and the second by L.  x' is replaced by x, which is a solve with K, when the error of the second
    term exceeds what is asked for.  If accurate products are asked for again and again by `mult`, K is factorised in
    double precision.

    `solver` has the nodes of B's columns last; `diagonal` (3 m,) replaces the exact one; `reference` is the last
    accurate response, of the same A in other frames.  `halved`: A is one of many in a sequence, each for few products,
    which are those by A as a matrix, where it is small.
    """

    name = "explicit"
    matrix_free: MatrixFreeCompliance | None = None

    def __init__(
        self,
        B: PETSc.Mat,
        solver: SchurSolver,
        diagonal: FloatArray | None = None,
        reference: _Reference | None = None,
        halved: bool = False,
    ):
        self.B = B  # kept, since the communicator lives as long as the matrix
        self.comm: MPI.Comm = B.getComm().tompi4py()
        self.nodes = B.getLocalSize()[0] // 3
        self.products, self.learnt = 0, RecycledColumns()
        self._solver, self._diagonal = solver, diagonal
        self._formed: FloatArray | None = None
        self._halved = halved
        indptr, indices, values = B.getValuesCSR()
        last = (3 * solver.last[:, None] + np.arange(3)).ravel()
        shape = (len(indptr) - 1, B.getSize()[1])
        self._rows = scipy.sparse.csr_matrix((values, indices, indptr), shape=shape)[:, last]
        self._columns = self._rows.T.tocsr()
        self._reference = reference or _Reference(solver)
        self._before: FloatArray = np.zeros(len(last))
        if reference is None and self._solver.single:
            self._measure_error()

    def _measure_error(self) -> None:
        """Factorise in double precision at once, if products by L are not as good as with A.

        The error depends on the forces: that of the free displacement may be 1e-6 where that of contact forces on a
        slender body is 2e-2, and K factorised anew in the course of a solution changes A.
        """
        z = self._forces(np.ones(3 * self.nodes))
        self._solver.improved(self._solver.contact_forces(z), np.zeros_like(self._reference.u), 0.5)
        if self._solver.error > _ENOUGH:
            self._solver.use_double()

    def _forces(self, x: FloatArray) -> FloatArray:
        """B^T x on the contact nodes of all ranks, the same on each."""
        return summed(self.comm, self._columns @ x)

    @property
    def exact(self) -> bool:
        return not self._solver.single

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        self._begin()
        z = self._forces(x)
        self.products += 1
        if not self._suffices(tolerance):
            self._reference.accurate += 1
            if self._reference.accurate > _ACCURATE:
                self._solver.use_double()
        if self._formed is not None:
            y[:] = self._formed @ x
        elif self._suffices(tolerance):
            y[:] = self._rows @ self._solver.schur_solve(z)
        else:
            alone = _Reference(self._solver)
            y[:] = self._rows @ alone.renew(z, tolerance * float(np.linalg.norm(z)))

    def _suffices(self, tolerance: float) -> bool:
        """Whether products by L may be used where products of this accuracy are asked for.

        The error of L is no noise: products by it are those by a matrix near to A, with which a Krylov method converges
        as with A.
        """
        return self._solver.error <= (max(tolerance, _ENOUGH) if tolerance >= _RESIDUAL else tolerance)

    def mult_incremental(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        z, known = self._forces(x), self._reference
        self.products += 1
        if self.exact:
            y[:] = self._rows @ self._solver.schur_solve(z)
            return
        change, self._before = float(np.linalg.norm(z - self._before)), z
        far, most = z - known.z, tolerance * change
        if self._solver.error * float(np.linalg.norm(far)) + known.rest <= most:
            y[:] = self._rows @ (known.contact_part + self._solver.schur_solve(far))
        else:
            y[:] = self._rows @ known.renew(z, 0.5 * most)

    def diagonal(self) -> FloatArray:
        if self._diagonal is None:
            formed = self.formed() if self._few else None
            self._diagonal = self._solver.schur_diagonal(self._rows) if formed is None else formed.diagonal().copy()
        return self._diagonal

    def dense(self) -> FloatArray:
        """See `Formed`; on one rank."""
        assert isinstance(self._solver, MultifrontalSolver)
        self._solver.use_double()
        formed = self.formed()
        assert formed is not None
        return formed

    def formed(self) -> FloatArray | None:
        """To the accuracy of the factors, and in their precision."""
        if self._formed is not None or not isinstance(self._solver, MultifrontalSolver):
            return self._formed
        formed: FloatArray = np.zeros(2 * self._rows.shape[:1], dtype=np.float64 if self.exact else np.float32)
        start = 0
        for inverse in self._solver.schur_inverses():
            rows = self._rows[:, start : start + len(inverse)].astype(formed.dtype)
            formed += rows @ (rows @ inverse.T).T  # symmetric, and by columns
            start += len(inverse)
        self._formed = formed if self._few else None
        return formed

    @property
    def _few(self) -> bool:
        return self._halved and self.exact and 3 * self.nodes <= _FEW

    def elimination(self) -> Elimination:
        """K^-1 by one application of the factors as they are."""
        solver = self._solver

        def begin(f: FloatArray) -> FloatArray:
            return (self._rows @ solver.begin(f).T).T

        def end(x: FloatArray) -> FloatArray:
            return solver.end(-summed(self.comm, (self._columns @ x.T).T))

        return Elimination(solver, self.B, begin, end)

    def rotated(self, B: PETSc.Mat, turn: FloatArray) -> SchurCompliance:
        return SchurCompliance(B, self._solver, reference=self._reference, halved=self._halved)

    def known_product(self, x: FloatArray) -> FloatArray | None:
        """With factors in double precision always, else of the forces of the last accurate product."""
        z, known = self._forces(x), self._reference
        if self.exact:
            return self._rows @ self._solver.schur_solve(z)
        accurate = known.rest <= _REST * float(np.linalg.norm(z)) and np.array_equal(z, known.z)
        return self._rows @ known.contact_part if accurate else None

    def under_load(self, f: PETSc.Vec, free: FloatArray) -> None:
        """Products by the factors do not depend on the load."""

    def displacement(self, x: FloatArray, f: PETSc.Vec, free: FloatArray) -> FloatArray:
        given, zero = self._solver.contact_forces(self._forces(x)), np.zeros_like(free)
        if self.exact and Reductions(self.comm).all(np.all(np.isfinite(free))):
            return free - self._solver.improved(given, zero, 0.0)[0]  # on contact nodes: no forward substitution
        near = zero if self.exact else free - self._reference.u
        return self._solver.improved(f.array_r - given, near, 0.0)[0]


class _Reference:
    """A response u = K^-1 z to forces z on the contact nodes.

    Attributes:
        z: Nodal forces in newtons, in the order of L, shape (3 m,), the same on all ranks.
        u: Displacements of this rank's nodes in metres, shape (n,).
        contact_part: Displacements where z acts, shape (3 m,), the same on all ranks.
        rest: Size of the forces that u is wrong by, newtons.
        accurate: Accurate products asked for without regard to the one before.
    """

    def __init__(self, solver: SchurSolver):
        self._solver = solver
        self.z: FloatArray = np.zeros(3 * len(solver.last))
        self.u: FloatArray = np.zeros_like(solver.contact_forces(self.z))
        self.contact_part: FloatArray = self.z
        self.rest, self.accurate = 0.0, 0

    def renew(self, z: FloatArray, rest: float) -> FloatArray:
        """Replace z, and u by its response, to an error of the size of `rest` newtons; u at the contact nodes."""
        distance = float(np.linalg.norm(z - self.z))
        relative = rest / distance if distance > 0.0 else 0.0
        self.u, left = self._solver.improved(self._solver.contact_forces(z), self.u, relative)
        self.z, self.rest, self.contact_part = z, left * distance, self._solver.contact_part(self.u)
        return self.contact_part
