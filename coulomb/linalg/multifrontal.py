"""K = L L^T on one rank by nested dissection, the contact nodes last: K^-1, and their Schur complement as a factor.

The multifrontal method (Duff and Reid 1983) with dense fronts and LAPACK, in single precision where that is faster: at
twice the rate, with half the memory.  A solve is then conjugate gradients in double precision, preconditioned by the
factors: every iteration gains three to four digits on the block, and the last residual is that of a factorisation in
double precision.  Where K is too ill-conditioned for that, because a pivot fails or the iterations converge slowly, it
is factorised in double precision.

It was compared with MUMPS 5.5, called from C (docs/measurements.md): MUMPS accepts the same order of elimination
(ICNTL(7) = 1), also beside a Schur complement (ICNTL(19)), makes the same number of operations, and takes 1.2 to 1.7
times as long as this method in double precision at p = 8 to 16.  PETSc 3.18 cannot pass the order on: the option
mat_mumps_icntl_7 refuses 1, and MUMPS's Cholesky factorisation ignores the ordering of the preconditioner.  Without it
MUMPS uses AMD beside a Schur complement: twice the operations at p = 16, and 2.2 times as long.
"""

from __future__ import annotations

import logging
import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc

from ..arrays import FloatArray
from .frontal_factors import Factor as Factor
from .frontal_factors import FrontalFactors, NotPositiveDefinite, Real, stack_heights
from .frontal_factors import backward as backward
from .frontal_factors import forward as forward
from .nested_dissection import Front, Nodes, dissect
from .nodal_blocks import NodalRows

_log = logging.getLogger(__name__)

SINGLE_FROM = 5e8
"""Operations from which single precision is faster, refinement included (docs/measurements.md)."""

_SLOW = 0.1
"""Factor by which an iteration must decrease the residual, in the mean over a solve, in single precision."""

_ROUNDING = 2.0 * float(np.finfo(np.float64).eps)
"""Residual of a solve in double precision, relative to |D u| with D = diag(K), in the norm of D^-1/2."""

NOT_POSITIVE_DEFINITE = (
    "the stiffness matrix is not positive definite to rounding: the body can move without resistance, or its materials "
    "and springs are too far apart; clamp it, or give it stiffer springs"
)

_MOST = 50  # iterations of a solve, beyond any that is fast enough


class Work(NamedTuple):
    """What a factorisation takes.

    Attributes:
        operations: Additions and multiplications together.
        bytes: Memory of factors and update matrices, in single precision; in double precision twice as much.
        fronts: Number of fronts, each of which has an overhead of about 0.1 ms.
    """

    operations: float
    bytes: float
    fronts: int


def predicted_work(fronts: list[Front]) -> Work:
    """What it takes to factorise K with these fronts, without doing it."""
    own = 3.0 * np.array([len(front.own) for front in fronts])
    border = 3.0 * np.array([len(front.border) for front in fronts])
    operations = float(np.sum(own**3 / 3 + own**2 * border + own * border**2))
    entries = float(np.sum(own * (own + border))) + sum(stack_heights(fronts)[1])
    return Work(operations, 4.0 * entries, len(fronts))


def symbolic(K: PETSc.Mat, points: FloatArray, last: npt.NDArray[np.integer[Any]]) -> list[Front]:
    """The fronts of K, children before parents; arguments as of `MultifrontalSolver`."""
    return _fronts_of(NodalRows(K), points, last)


class MultifrontalSolver:
    """Cholesky factorisation of K on one rank, some of its nodes last.

    Args:
        K: Symmetric positive definite, assembled, 3 rows per node, on one rank.
        points: The nodes' coordinates, shape (k, 3).
        last: Nodes to eliminate last, ascending.
        single: Whether to factorise in single precision; by default where it is faster.
        fronts: The result of `symbolic`, if it is known.

    Attributes:
        method: Its name without the precision, which is known once K is factorised.
        last: The same nodes, in the order of `schur_factors`, body after body.
        refinements: Iterations of all solves so far; 0 in double precision.
        error: Largest relative residual of the first iteration of a solve so far; infinite before the first solve, 0 in
            double precision.

    Raises:
        ValueError: If K is not positive definite.
    """

    method = "direct (nested dissection)"
    tolerance = 0.0
    iterations = 0

    def __init__(
        self,
        K: PETSc.Mat,
        points: FloatArray,
        last: npt.NDArray[np.integer[Any]],
        single: bool | None = None,
        fronts: list[Front] | None = None,
    ):
        self._K, rows = K, NodalRows(K)
        self._fronts = _fronts_of(rows, points, last) if fronts is None else fronts
        roots = [number for number, front in enumerate(self._fronts) if front.root]
        self._roots = [number for number in roots if len(self._fronts[number].own)]
        self.last: Nodes = np.concatenate([np.empty(0, np.int64), *(self._fronts[root].own for root in self._roots)])
        self.refinements, self._error = 0, math.inf
        if single is None:
            single = predicted_work(self._fronts).operations >= SINGLE_FROM
        self._factors = self._in_single(rows) if single else self._in_double(rows)
        self._vectors = K.createVecs()
        diagonal = K.getDiagonal()
        self._root: FloatArray = np.sqrt(diagonal.array_r)
        diagonal.destroy()

    @property
    def single(self) -> bool:
        """Whether the factors are in single precision."""
        return self._factors.dtype == np.float32

    @property
    def exact(self) -> bool:
        return not self.single

    @property
    def error(self) -> float:
        return self._error if self.single else 0.0

    @property
    def name(self) -> str:
        """With the precision of the factors."""
        how = "single precision, refined" if self.single else "LAPACK Cholesky"
        return f"{self.method[:-1]}, {how})"

    @property
    def schur_factors(self) -> list[Real]:
        """L of the Schur complement S = L L^T on the nodes `last` of each of the bodies, which S does not couple.

        Lower triangles, shape (3 m, 3 m), Fortran order; entries above the diagonal are undefined.  The block of K^-1
        on these nodes is S^-1.
        """
        return [self._factors.heads[root] for root in self._roots]

    def _in_single(self, rows: NodalRows) -> FrontalFactors:
        try:
            return FrontalFactors(rows, self._fronts, np.float32)
        except NotPositiveDefinite:
            _log.info("the stiffness matrix is factorised in double precision: it is too ill-conditioned for single")
            return self._in_double(rows)

    def _in_double(self, rows: NodalRows) -> FrontalFactors:
        try:
            return FrontalFactors(rows, self._fronts, np.float64)
        except NotPositiveDefinite:
            raise ValueError(NOT_POSITIVE_DEFINITE) from None

    def use_double(self) -> None:
        """Factorise in double precision, if the factors are not yet."""
        if self.single:
            del self._factors  # before the memory of the new ones is needed
            self._factors = self._in_double(NodalRows(self._K))

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        """u <- K^-1 rhs; see `StiffnessSolver`."""
        u.array[:], _ = self.improved(rhs.array_r, np.zeros(len(self._root)), tolerance)

    def improved(self, rhs: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, float]:
        """K^-1 rhs from an approximation u, all of shape (n,), and its residual relative to that of u.

        Only what is left over is solved for.

        Args:
            rhs: Forces.
            u: Displacements, 0 if nothing is known.
            tolerance: Residual relative to that of u.
        """
        if self.single:
            solution = self._conjugate_gradients(rhs, u, tolerance)
            if solution is not None:
                return solution
            _log.info("the stiffness matrix is factorised in double precision: refinement in single is slow")
            self.use_double()
        return u + self._factors.solve((rhs - self._product(u)).reshape(-1, 3)).ravel(), 0.0

    def _conjugate_gradients(self, rhs: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, float] | None:
        """K^-1 rhs and the relative residual; None if the residual decreases slowly."""
        x, r = u.copy(), rhs - self._product(u)
        first, along = self._size(r), 0.0
        p: FloatArray = np.zeros_like(r)
        for iteration in range(_MOST):
            size = self._size(r)
            if size <= max(tolerance * first, _ROUNDING * float(np.linalg.norm(self._root * x))):
                return x, size / first if first > 0.0 else 0.0
            if not size <= first * _SLOW ** float(iteration - 1):
                return None
            z = self._factors.solve(r.reshape(-1, 3)).ravel()
            before, along = along, float(r @ z)
            p = z + (along / before if before else 0.0) * p
            image = self._product(p)
            step = along / float(p @ image)
            x += step * p
            r -= step * image
            self.refinements += 1
            if iteration == 0:
                left = self._size(r) / first
                self._error = left if math.isinf(self._error) else max(self._error, left)
        return None

    def _product(self, u: FloatArray) -> FloatArray:
        """K u, shapes (n,)."""
        if not np.any(u):
            return np.zeros_like(u)
        x, y = self._vectors
        x.array[:] = u
        self._K.mult(x, y)
        product: FloatArray = y.array_r.copy()
        return product

    def _size(self, r: FloatArray) -> float:
        """|D^-1/2 r|, which does not depend on the units of single unknowns."""
        return float(np.linalg.norm(r / self._root))

    def destroy(self) -> None:
        """Free the factors."""
        del self._factors
        for vector in self._vectors:
            vector.destroy()
        self._fronts = []


def _fronts_of(rows: NodalRows, points: FloatArray, last: npt.NDArray[np.integer[Any]]) -> list[Front]:
    coupled = (np.empty(len(rows.indices), np.int8), rows.indices, rows.indptr)
    graph = scipy.sparse.csr_matrix(coupled, shape=(len(points), len(points)))
    return dissect(graph, points, last.astype(np.int64))


def factorised(
    blocks: scipy.sparse.bsr_matrix, fronts: list[Front], dtype: npt.DTypeLike = np.float64
) -> tuple[list[Factor], dict[int, Real]]:
    """The columns of L of every front of a part, and the update matrix of its last front by its number.

    The update matrix is a lower triangle on the border; the entries above the diagonal are undefined.

    Raises:
        ValueError: If K is not positive definite on the nodes of the fronts.
    """
    try:
        factors = FrontalFactors(NodalRows(blocks), fronts, dtype)
    except NotPositiveDefinite:
        raise ValueError(NOT_POSITIVE_DEFINITE) from None
    return list(zip(factors.heads, factors.below, strict=True)), {len(fronts) - 1: factors.update}
