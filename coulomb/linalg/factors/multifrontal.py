"""K = L L^T on one rank by nested dissection, the contact nodes last: K^-1, and their Schur complement as a factor.

The multifrontal method (Duff and Reid 1983) with dense fronts and LAPACK, in single precision where that is faster: at
twice the rate, with half the memory.  A solve is then conjugate gradients in double precision, preconditioned by the
factors: every iteration gains three to four digits on the block, and the last residual is that of a factorisation in
double precision.  Where K is too ill-conditioned for that, because a pivot fails or the iterations converge slowly, it
is factorised in double precision.

Whole contact problems by MUMPS take 1.6 to 4 times as long where factors are chosen (docs/measurements.md).  With the
same order of elimination it takes 1.2 to 1.7 times as long, but PETSc cannot pass the order on.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc
from scipy.linalg.blas import dsymv, dtrsm, dtrsv, strsm, strsv
from scipy.linalg.lapack import dlauum, dpotri, dtrtri, slauum, spotri, strtri

from ...arrays import FloatArray
from ..petsc_arrays import NodalRows
from ..solve_errors import LEAST_RESIDUAL
from .frontal_factors import FrontalFactors, NotPositiveDefinite, Real, stack_heights
from .nested_dissection import Front, Nodes, dissect

_log = logging.getLogger(__name__)

_SLOW: Final = 0.1
"""Factor by which an iteration must decrease the residual, in the mean over a solve, in single precision."""

_MOST: Final = 50  # iterations of a solve, beyond any that is fast enough

_KEPT: Final = 4000
"""Rows of S up to which the inverses of its factors are kept: derivatives take half the time for its inverse."""

_FEW: Final = 1.0 / 3.0
"""Part of the numbers of a vector up to which a product by the columns of those that are not 0 reads less memory than
one by the triangle."""


class DenseInverse:
    """A symmetric matrix whose products with vectors of many zeros read only the columns that these need.

    At most contact nodes of a wide face there is often no force: of a plate with a hole 90 % of the products in a load
    history have less than a third of the forces.  Columns are gathered from the lower triangle (n, n) as they are
    needed, and kept, since the forces of the next product are mostly at the same nodes.
    """

    def __init__(self, lower: FloatArray):
        self._lower = lower
        self.size = n = len(lower)
        self._columns: FloatArray = np.empty((n, int(_FEW * n)), order="F")  # memory is taken as columns are filled
        self._place: npt.NDArray[np.int64] = np.full(n, -1)
        self._count = 0

    def __matmul__(self, z: FloatArray) -> FloatArray:
        room = self._columns.shape[1]
        if np.count_nonzero(z) > room:
            return dsymv(1.0, self._lower, z, lower=1)
        needed = np.flatnonzero(z)
        new = needed[self._place[needed] < 0]
        if self._count + len(new) > room:  # forget those of earlier forces
            self._place[:], self._count, new = -1, 0, needed
        if len(new):
            here = slice(self._count, self._count + len(new))
            self._columns[:, here] = self._lower[new].T
            for place, column in zip(range(self._count, here.stop), new, strict=True):
                self._columns[column:, place] = self._lower[column:, column]
            self._place[new] = np.arange(here.start, here.stop)
            self._count = here.stop
        few = np.zeros(self._count)
        few[self._place[needed]] = z[needed]
        return self._columns[:, : self._count] @ few


SINGLE_FROM: Final = 5e8
"""Operations from which single precision is faster, refinement included (single-precision.csv)."""


_MANY: Final = 1 / 8
"""Solves with the Schur complement per row of it from which on its inverse is formed."""

_PANEL: Final = 256  # rows of the inverse of a factor that are used at once


class Work(NamedTuple):
    """What a factorisation takes: additions and multiplications together; memory of factors and update matrices in
    single precision (in double twice as much).
    """

    operations: float
    bytes: float


def predicted_work(fronts: list[Front]) -> Work:
    """What it takes to factorise K with these fronts, without doing it."""
    own = 3.0 * np.array([len(front.own) for front in fronts])
    border = 3.0 * np.array([len(front.border) for front in fronts])
    operations = float(np.sum(own**3 / 3 + own**2 * border + own * border**2))
    entries = float(np.sum(own * (own + border))) + sum(stack_heights(fronts)[1])
    return Work(operations, 4.0 * entries)


def usual_work(displacement: int, contact: int) -> Work:
    """`predicted_work` by unknowns alone: of solid bodies within a factor of two, of sheets many times too much."""
    n, m = float(displacement), float(contact)
    return Work(25.0 * n**2 + m**3 / 3.0, 132.0 * n ** (4.0 / 3.0))


def symbolic(K: PETSc.Mat, points: FloatArray, last: npt.NDArray[np.integer[Any]]) -> list[Front]:
    """The fronts of K, children before parents; arguments as of `MultifrontalSolver`."""
    return _fronts_of(NodalRows(K), points, last)


class MultifrontalSolver:
    """Cholesky factorisation of K, three rows per node of `points` (k, 3), on one rank, the nodes `last` (ascending)
    last.

    Args:
        single: Whether to factorise in single precision; by default where it is faster.
        fronts: The result of `symbolic`, if it is known.
        many: Whether many solves with the Schur complement are expected, which are then by its inverse as soon as it
            has had a diagonal.

    Attributes:
        fronts: As the argument; of every K of the same sparsity.
        last: The same nodes, in the order of `schur_factors`, body after body.
        refinements: Iterations of all solves so far; 0 in double precision.

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
        many: bool = False,
    ):
        self._K, self._vectors = K, K.createVecs()
        self.refinements, self._error = 0, math.inf
        diagonal = K.getDiagonal()
        self._root: FloatArray = np.sqrt(np.abs(diagonal.array_r))
        diagonal.destroy()
        nodal = NodalRows(K)
        self.fronts = _fronts_of(nodal, points, last) if fronts is None else fronts
        roots = [number for number, front in enumerate(self.fronts) if front.root]
        self._roots = [number for number in roots if len(self.fronts[number].own)]
        self.last: Nodes = np.concatenate([np.empty(0, np.int64), *(self.fronts[root].own for root in self._roots)])
        self._schur_solves, self._inverses = 0, list[DenseInverse]()
        self._many, self._halves = many, list[Real]()
        self._last: Nodes = (3 * self.last[:, None] + np.arange(3)).ravel()
        if single is None:
            single = predicted_work(self.fronts).operations >= SINGLE_FROM
        self._factorise(nodal, single)

    def _factorise(self, nodal: NodalRows, single: bool) -> None:
        """Make the factors, in double precision if single is wanted but fails."""
        if single:
            try:
                self._factors = FrontalFactors(nodal, self.fronts, np.float32)
                return
            except NotPositiveDefinite:
                _report("it is too ill-conditioned for single")
        try:
            self._factors = FrontalFactors(nodal, self.fronts, np.float64)
        except NotPositiveDefinite:
            raise NotPositiveDefinite(
                "the stiffness matrix is not positive definite to rounding: the body can move without resistance, or "
                "stiffnesses of its materials, springs and cells are too far apart"
            ) from None

    @property
    def single(self) -> bool:
        return self._factors.dtype == np.float32

    @property
    def exact(self) -> bool:
        """Whether the factors are in double precision."""
        return not self.single

    @property
    def error(self) -> float:
        """Largest relative residual of the first iteration of a solve so far; infinite before the first solve, 0 in
        double precision."""
        return self._error if self.single else 0.0

    @property
    def name(self) -> str:
        """With the precision of the factors."""
        how = "single precision, refined" if self.single else "LAPACK Cholesky"
        return f"{self.method[:-1]}, {how})"

    def use_double(self) -> None:
        """Factorise in double precision, if the factors are not yet."""
        if self.single:
            del self._factors  # before the memory of the new ones is needed
            self._halves = []
            self._factorise(NodalRows(self._K), single=False)

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        """u <- K^-1 rhs; see `StiffnessSolver`."""
        u.array[:], _ = self.improved(rhs.array_r, np.zeros(len(self._root)), tolerance)

    def improved(self, rhs: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, float]:
        """K^-1 rhs from an approximation u, 0 if nothing is known, all of shape (n,), and its residual.

        Only what is left over is solved for; `tolerance` and residual are relative to the residual of u.
        """
        if self.single:
            solution = self._conjugate_gradients(rhs, u, tolerance)
            if solution is not None:
                return solution
            _report("refinement in single is slow")
            self.use_double()
        return u + self._factors.solve((rhs - self._product(u)).reshape(-1, 3)).ravel(), 0.0

    def _conjugate_gradients(self, rhs: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, float] | None:
        """K^-1 rhs and the relative residual, in the norm of D^-1/2, which does not depend on the units of single
        unknowns; None if the residual decreases slowly."""
        x, r = u.copy(), rhs - self._product(u)
        first, along = np.linalg.norm(r / self._root), 0.0
        p: FloatArray = np.zeros_like(r)
        for iteration in range(_MOST):
            size = np.linalg.norm(r / self._root)
            if size <= max(tolerance * first, LEAST_RESIDUAL * np.linalg.norm(self._root * x)):
                return x, float(size / first) if first > 0.0 else 0.0
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
                left = float(np.linalg.norm(r / self._root) / first)
                self._error = left if math.isinf(self._error) else max(self._error, left)
        return None

    def approximate(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        """u <- K^-1 rhs, to the accuracy of the factors; see `StiffnessSolver`."""
        self.begin(rhs.array_r)
        u.array[:] = self.end(np.zeros(3 * len(self.last)))

    def begin(self, rhs: FloatArray) -> FloatArray:
        """Displacements of the nodes `last`, shape (..., 3 last), under forces rhs (..., n), to the accuracy of the
        factors."""
        self._begun, self._unit = self._factors.eliminated(rhs.reshape(*rhs.shape[:-1], -1, 3))
        parts = [self._substituted(L, self._begun[..., here], trans=1) for L, here in self._last_fronts()]
        return np.concatenate([np.empty((*rhs.shape[:-1], 0)), *parts], axis=-1) * self._unit

    def end(self, z: FloatArray) -> FloatArray:
        """The displacement, shape (..., n), under the forces of `begin` and z (..., 3 last) on the nodes `last`; these
        are forgotten."""
        x, start, z = self._begun, 0, z / self._unit
        for L, here in self._last_fronts():
            x[..., here] += self._substituted(L, z[..., start : start + len(L)].astype(x.dtype), trans=0)
            start += len(L)
        return self._factors.substituted(x, self._unit).reshape(*x.shape[:-1], -1)

    def _substituted(self, L: Real, x: Real, trans: int) -> Real:
        """L^-1 x, or L^-T x, shapes (..., rows of L)."""
        trsm = strsm if self.single else dtrsm
        solution: Real = trsm(1.0, L, x.reshape(-1, len(L)).T, lower=1, trans_a=trans).T.reshape(x.shape)
        return solution

    def _last_fronts(self) -> list[tuple[Real, slice]]:
        """L of the nodes `last` of each body, and their places in the order of elimination."""
        ends = 3 * np.cumsum([len(front.own) for front in self.fronts])
        return [
            (self._factors.heads[root], slice(ends[root] - len(self._factors.heads[root]), ends[root]))
            for root in self._roots
        ]

    def multiply(self, u: PETSc.Vec, product: PETSc.Vec) -> None:
        """product <- K u."""
        self._K.mult(u, product)

    def _product(self, u: FloatArray) -> FloatArray:
        if not np.any(u):
            return np.zeros_like(u)
        x, y = self._vectors
        x.array[:] = u
        self._K.mult(x, y)
        return y.array_r.copy()

    @property
    def schur_factors(self) -> list[Real]:
        """L of the Schur complement S = L L^T on the nodes `last` of each of the bodies, which S does not couple.

        Lower triangles, shape (3 m, 3 m), Fortran order; entries above the diagonal are undefined.  The block of K^-1
        on these nodes is S^-1.
        """
        return [self._factors.heads[root] for root in self._roots]

    def contact_part(self, u: FloatArray) -> FloatArray:
        """Displacements of the nodes `last`, shape (3 last,), of those of all nodes, shape (n,)."""
        return u[self._last]

    def contact_forces(self, z: FloatArray) -> FloatArray:
        """Forces on the nodes `last`, shape (3 last,), among those on all nodes, shape (n,)."""
        forces = np.zeros(len(self._root))
        forces[self._last] = z
        return forces

    def schur_inverses(self) -> list[Real]:
        """S^-1 of each of the bodies, to the accuracy of the factors: in half the time if the diagonal has left the
        inverses of these."""
        if not self._halves:
            return [inverse_of(L) for L in self.schur_factors]
        return [_symmetric(_by_lapack(dlauum if self.exact else slauum, half)) for half in self._halves]

    def schur_solve(self, z: FloatArray) -> FloatArray:
        """S^-1 z, shape (3 last,): by the factors, or in double precision by the inverse, where many solves are
        expected.

        A product with a symmetric matrix reads half as much memory as two substitutions, and the inverse takes about as
        long as `_MANY` solves per row save; a third of that where the inverse of the factor is known.
        """
        if self.exact:
            self._schur_solves += 1
            if (self._many and self._halves) or self._inverses or self._schur_solves > _MANY * len(self._last):
                return self._by_inverse(z)
        size = float(np.max(np.abs(z), initial=0.0)) or 1.0  # single precision has a small range
        w: Real = (z / size).astype(self._factors.dtype)
        trsv = strsv if self.single else dtrsv
        start = 0
        for L in self.schur_factors:
            here = slice(start, start + len(L))
            half = trsv(L, w[here], lower=1)
            w[here] = trsv(L, half, lower=1, trans=1, overwrite_x=1)
            start += len(L)
        return w * np.float64(size)

    def _by_inverse(self, z: FloatArray) -> FloatArray:
        if not self._inverses:
            if self._halves:
                inverses = [dlauum(half, lower=1, overwrite_c=1)[0] for half in self._halves]
                self._halves = []
            else:
                inverses = [dpotri(np.array(L, order="F"), lower=1, overwrite_c=1)[0] for L in self.schur_factors]
            self._inverses = [DenseInverse(inverse) for inverse in inverses]
        w, start = np.empty(len(z)), 0
        for inverse in self._inverses:
            here = slice(start, start + inverse.size)
            w[here] = inverse @ z[here]
            start += inverse.size
        return w

    def schur_diagonal(self, rows: scipy.sparse.csr_matrix) -> FloatArray:
        """b^T S^-1 b for each row b of a matrix, shape (k, 3 last)."""
        inverses = [inverse_factor(L) for L in self.schur_factors]
        diagonal: FloatArray = np.zeros(rows.shape[0])
        start = 0
        for half in inverses:
            diagonal += _squares(half, rows[:, start : start + len(half)])
            start += len(half)
        if not self._inverses and ((self._many and self.exact) or len(self._last) <= _KEPT):
            self._halves = inverses
        return diagonal

    def destroy(self) -> None:
        """Free the factors."""
        del self._factors
        for vector in self._vectors:
            vector.destroy()
        self.fronts, self._inverses, self._halves = [], [], []


def _report(reason: str) -> None:
    _log.info("the stiffness matrix is factorised in double precision: %s", reason)


def inverse_factor(L: Real) -> Real:
    """L^-1, with zeros above the diagonal of its nodal blocks, and anything above these."""
    inverse = _by_lapack(strtri if L.dtype == np.float32 else dtrtri, L)
    for i in range(0, len(inverse), 3):
        inverse[i, i + 1 : i + 3] = inverse[i + 1, i + 2] = 0.0
    return inverse


def inverse_of(L: Real) -> Real:
    """(L L^T)^-1."""
    return _symmetric(_by_lapack(spotri if L.dtype == np.float32 else dpotri, L))


def _symmetric(lower: Real) -> Real:
    """The matrix of this lower triangle, in its place; entries above the diagonal are undefined."""
    for first in range(0, len(lower), _PANEL):  # transposed as a whole it does not fit into the cache
        end = min(first + _PANEL, len(lower))
        square = np.tril(lower[first:end, first:end])
        lower[first:end, first:end] = square + np.tril(square, -1).T
        lower[first:end, end:] = lower[end:, first:end].T
    return lower


def _by_lapack(routine: Callable[..., Any], L: Real) -> Real:
    """By a routine for lower triangles, whose entries above the diagonal are undefined."""
    n = len(L) + len(L) % 2  # even: with others OpenBLAS 0.3.21 crashes, in single precision on newer processors
    even = np.eye(n, dtype=L.dtype, order="F")
    even[: len(L), : len(L)] = L
    inverse: Real = routine(even, lower=1, overwrite_c=1)[0][: len(L), : len(L)]
    return inverse


def _squares(inverse: Real, rows: scipy.sparse.csr_matrix) -> FloatArray:
    """|L^-1 b|^2 for each row b of a matrix, shape (k, n), with the `inverse_factor` of a body.

    For a row that sees one node, as before a rigid foundation and on the slave's side, only three columns count.
    """
    columns = [inverse[i:, i : i + 3] for i in range(0, len(inverse), 3)]
    blocks = np.array([c.T @ c for c in columns], dtype=np.float64).reshape(-1, 3, 3)
    each = np.arange(len(blocks) + 1)
    nodal = scipy.sparse.bsr_matrix((blocks, each[:-1], each), inverse.shape)
    squares: FloatArray = np.asarray((rows @ nodal).multiply(rows).sum(axis=1)).ravel()
    of_row, node = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr)), rows.indices // 3
    several = np.unique(of_row[node != node[rows.indptr[of_row]]])
    squares[several], chosen = 0.0, rows[several]
    for first in range(0, len(inverse), _PANEL) if len(several) else ():
        end = min(first + _PANEL, len(inverse))
        panel = np.triu(inverse.T[:end, first:end], -first)
        squares[several] += np.sum((chosen[:, :end] @ panel) ** 2, axis=1)
    return squares


def _fronts_of(rows: NodalRows, points: FloatArray, last: npt.NDArray[np.integer[Any]]) -> list[Front]:
    coupled = (np.empty(len(rows.indices), np.int8), rows.indices, rows.indptr)
    graph = scipy.sparse.csr_matrix(coupled, shape=(len(points), len(points)))
    return dissect(graph, points, last.astype(np.int64))
