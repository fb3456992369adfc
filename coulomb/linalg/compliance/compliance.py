"""The contact compliance (Delassus operator) A = B K^-1 B^T: displacements of the contact nodes under their forces."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple, Protocol, runtime_checkable

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..reductions import Reductions
from ..solve_errors import LEAST_RESIDUAL, CGNotConverged, TooSlow
from ..uncoupled import Parts
from .coupled import Elimination
from .low_rank import RecycledColumns, turned_diagonal
from .stiffness import IterativeSolver, SoftMotions, StiffnessSolver

_DISPLACED: Final = 1e-8
"""Accuracy of a displacement, relative to all forces: products by K in it have rounding errors that are not much
smaller, and it is refined by forces that are assembled anew (`refined`)."""


class Compliance(Protocol):
    """A, in metres per newton, symmetric positive semidefinite; rows node by node (n, t1, t2), on the node's rank.

    Attributes:
        nodes: Contact nodes m of this rank, possibly 0.
        products: Products made so far.
        exact: Whether a product is as exact as rounding allows, at any tolerance.
        name: Its name in the summary.
        matrix_free: Itself if it has K and B, which condensed Newton systems need; else None.
        learnt: What earlier problems with it have found of it.
    """

    comm: MPI.Comm
    nodes: int
    products: int
    name: str
    learnt: RecycledColumns

    @property
    def exact(self) -> bool: ...

    @property
    def matrix_free(self) -> MatrixFreeCompliance | None: ...

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        """y <- A x, newtons and metres, both of shape (3 m,); counted, collective.

        If a product is the solution of a system, `tolerance` is its largest relative residual.
        """
        ...

    def mult_incremental(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        """As `mult` for an x that changes little from call to call: only the change is solved for.

        Its relative residual may be `tolerance`; residuals do not add up from call to call.  With 0, the product is as
        exact as mult's.
        """
        ...

    def diagonal(self) -> FloatArray:
        """diag(A), or an estimate of it, shape (3 m,); collective."""
        ...


@runtime_checkable
class BodyCompliance(Compliance, Protocol):
    """A = B K^-1 B^T with access to K and B."""

    def rotated(self, B: PETSc.Mat, turn: FloatArray) -> BodyCompliance:
        """T A T^T, B the contact matrix in these frames, `turn` T node by node, shape (m, 3, 3); collective."""
        ...

    def known_product(self, x: FloatArray) -> FloatArray | None:
        """A x in metres, shape (3 m,), as accurate as any product, if it takes no solve with K; else None; not counted;
        collective."""
        ...

    def allow(self, products: float) -> None:
        """Make no more than so many products from now on (by default inf): `mult` then raises TooSlow, on all ranks."""
        ...

    def under_load(self, f: PETSc.Vec, free: FloatArray) -> None:
        """The load f in newtons and K^-1 f in metres, this rank's part (n,), of the problem to which the products to
        come belong.

        A x - b is then as accurate as the displacement under both allows.  Not to be changed afterwards; collective.
        """
        ...

    def formed(self) -> FloatArray | None:
        """A, nearly, shape (3 m, 3 m), if it takes no solve with K, on one rank; else None; not to be changed."""
        ...

    def elimination(self) -> Elimination:
        """K, B, and an approximation of K^-1 that takes little time; collective, as all that it does."""
        ...

    def displacement(self, x: FloatArray, f: PETSc.Vec, free: FloatArray) -> FloatArray:
        """K^-1 (f - B^T x) in metres, this rank's part, shape (n,), to be refined; x and f in newtons, `free` is K^-1
        f; collective.
        """
        ...


@runtime_checkable
class Formed(Protocol):
    """A compliance that has A as a matrix."""

    def dense(self) -> FloatArray:
        """This rank's rows, shape (3 m, all columns); not to be changed."""
        ...


_ACCURACY: Final = 0.03
"""Relative residual of the products."""


class DiagonalEstimate(NamedTuple):
    """diag(A), and `rest`, its part without the large eigenvalues of A that were found; shape (3 m,)."""

    whole: FloatArray
    rest: FloatArray


def estimated_diagonal(
    A: Compliance, B: PETSc.Mat, stiffness: FloatArray, probes: int = 8, rigid: FloatArray | None = None
) -> DiagonalEstimate:
    """diag(A) of A = B K^-1 B^T from a few products, or that of A - F F^T with `rigid` columns F, shape (3 m, q);
    `stiffness` is the diagonal of K, this rank's entries, shape (n,).

    From products Y = A V with random signs V, Nyström's approximation Y (V^T Y)^-1 Y^T <= A has the few large
    eigenvalues of slender bodies, along which diag(A) varies by orders of magnitude.  The diagonal of the rest is close
    to a multiple of diag(B diag(K)^-1 B^T), one multiple for each of n, t1 and t2.  They are found from what the other
    probes leave of A v, R v, since the mean of v_i (R v)_i is R_ii (Hutchinson 1989; E. N. Epperly, J. A. Tropp, R. J.
    Webber: XTrace, SIAM J. Matrix Anal. Appl. 45, 2024).  The inverse is shifted by the square of the products'
    accuracy, the error of v^T A v.
    """
    over, local = Reductions(A.comm), _of_diagonal(B, stiffness)
    random = np.random.default_rng([2718, A.comm.rank])
    V: FloatArray = random.choice([-1.0, 1.0], size=(probes, local.size))
    Y, y = np.empty_like(V), np.empty(local.size)
    for v, image in zip(V, Y, strict=True):
        try:
            A.mult(v, y, _ACCURACY)
        except CGNotConverged:  # the scale of diag(K)^-1 then; path following reports the failure
            return DiagonalEstimate(local.ravel(), local.ravel())
        image[:] = y if rigid is None else y - rigid @ over.total(rigid.T @ v)
    G = over.total(V @ Y.T)
    size = float(np.trace(G))
    if not size > 0.0:
        return DiagonalEstimate(local.ravel(), local.ravel())
    eigenvalues, Q = np.linalg.eigh(0.5 * (G + G.T) / size)
    inverse: FloatArray = (Q / (np.maximum(eigenvalues, 0.0) + _ACCURACY**2)) @ Q.T
    known = np.sum(Y * (inverse / size @ Y), axis=0)
    left = np.sum(V * ((inverse / inverse.diagonal()).T @ Y), axis=0) / probes
    traces, local_traces = over.totals(left.reshape(-1, 3).sum(axis=0), local.sum(axis=0))
    whole = max(float(traces.sum()), _ACCURACY**2 * size / probes)
    common = np.full(3, whole / float(local_traces.sum()))
    factors = np.divide(traces, local_traces, out=common, where=(traces > 0.0) & (local_traces > 0.0))
    rest: FloatArray = (local * factors).ravel()
    return DiagonalEstimate(known + rest, rest)


def _of_diagonal(B: PETSc.Mat, stiffness: FloatArray) -> FloatArray:
    """diag(B diag(K)^-1 B^T), shape (m, 3)."""
    u, x = B.createVecs()
    squares = B.duplicate(copy=True)
    indptr, indices, values = squares.getValuesCSR()
    squares.setValuesCSR(indptr, indices, values**2)
    squares.assemble()
    u.array[:] = 1.0 / stiffness
    squares.mult(u, x)
    local: FloatArray = x.array_r.reshape(-1, 3).copy()
    for done in (squares, u, x):
        done.destroy()
    return local


class LimitedProducts:
    """The number of products by a compliance, and its limit."""

    products = 0
    _most = math.inf

    def allow(self, products: float) -> None:
        """See `BodyCompliance`."""
        self._most = self.products + products

    def _begin(self) -> None:
        if self.products >= self._most:
            raise TooSlow("Newton systems with A take too many Krylov iterations")


class DiagonalOfStiffness(Protocol):
    """K may have been let go."""

    @property
    def diagonal(self) -> FloatArray: ...


class Stiffness(Protocol):
    """Of bodies: K, assembled if it has to be, and what is known of it without."""

    @property
    def K(self) -> PETSc.Mat: ...

    @property
    def reduced(self) -> DiagonalOfStiffness: ...


class MatrixFreeCompliance(LimitedProducts):
    """A as a solve with K between B^T and B, its diagonal estimated by `probes` products (`estimated_diagonal`).

    Args:
        stiffness: Has K for those who ask.
        solver: K^-1.
        parts: Those that K does not couple.
        diagonal: Replaces the estimate of the diagonal of A - F F^T.
        soft: The motions that the solver computes apart, if there are any.

    Attributes:
        rigid: F, what soft motions move the contact nodes, shape (3 m, q): F F^T is a part of A; None without any.
        latest: The x of the last `mult_incremental` or `displacement` that did not fail, shape (3 m,); or None.
    """

    name = "matrix-free"

    def __init__(
        self,
        B: PETSc.Mat,
        stiffness: Stiffness,
        solver: StiffnessSolver,
        parts: Parts,
        probes: int = 8,
        diagonal: DiagonalEstimate | None = None,
        soft: SoftMotions | None = None,
    ):
        self.B, self._stiffness, self._solver, self._soft, self._parts = B, stiffness, solver, soft, parts
        self.comm: MPI.Comm = B.getComm().tompi4py()
        self.nodes = B.getLocalSize()[0] // 3
        self.products, self.learnt = 0, RecycledColumns()
        self._u, self._x = B.createVecs()
        self._rhs = self._u.duplicate()
        self._last = self._u.duplicate()
        of_nodes = stiffness.reduced.diagonal
        self._root: FloatArray = np.sqrt(np.abs(of_nodes))
        self._last.set(0.0)
        self._accurate: FloatArray | None = None
        self.latest: FloatArray | None = None
        self._load: PETSc.Vec | None = None
        self._guessed = self._found = False
        self._free: FloatArray = self._u.array.copy()
        self.rigid = None if soft is None else np.column_stack([self._moved(motion) for motion in soft.motions.T])
        self._elastic = estimated_diagonal(self, B, of_nodes, probes, self.rigid) if diagonal is None else diagonal

    @property
    def K(self) -> PETSc.Mat:
        """The stiffness, assembled anew if it has been let go."""
        return self._stiffness.K

    def _moved(self, u: FloatArray) -> FloatArray:
        """B u."""
        self._u.array[:] = u
        self.B.mult(self._u, self._x)
        return self._x.array.copy()

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        self._begin()
        self._x.array[:] = x
        self.B.multTranspose(self._x, self._rhs)
        self._solver.solve(self._rhs, self._u, tolerance)
        self.B.mult(self._u, self._x)
        y[:] = self._x.array_r
        self.products += 1

    def under_load(self, f: PETSc.Vec, free: FloatArray) -> None:
        """Compute A x of iterates as B (K^-1 f - u) from now on, u the displacement under loads and contact forces.

        Where soft springs hold the body, f and B^T x alone move it far, and together hardly: rounding errors of K u are
        then those of the small displacement, and errors of K^-1 f cancel in A x - b.
        """
        if f is self._load:
            return
        self._accurate = self.latest = None
        self._last.array[:] = free - (self._free - self._last.array_r)
        self._load, self._free = f, free

    def mult_incremental(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None:
        """B (K^-1 f - u), K u = f - B^T x, for u by a correction of the last u; f is 0 before `under_load`."""
        self._follow(x, tolerance, self._solver.tolerance)
        self.latest = x.copy()
        self._accurate = self.latest if tolerance == 0.0 else None
        y[:] = self.latest_product()
        self.products += 1

    def latest_product(self) -> FloatArray:
        """A x of `latest`."""
        return self._moved(self._free - self._last.array_r)

    def _follow(self, x: FloatArray, change: float, whole: float) -> None:
        """The last displacement corrected for another x, to an accuracy relative to the change or to the whole of the
        contact forces, in each of the parts that K does not couple; where there are none, of all forces."""
        self._x.array[:] = -x
        self.B.multTranspose(self._x, self._rhs)
        norms = self._parts.norms
        size = norms(self._rhs.array_r)
        if self._load is not None:
            self._rhs.axpy(1.0, self._load)
        forces = norms(self._rhs.array_r)
        size = np.where(size > 0.0, size, forces)
        self._solver.multiply(self._last, self._u)
        self._u.aypx(-1.0, self._rhs)
        left = norms(self._u.array_r)
        worse = left > forces  # than nothing: a correction would keep a part of what vanished loads caused
        if np.any(worse):
            self._parts.zero(worse, self._last.array)
            left, self._accurate = np.where(worse, forces, left), None
            self._parts.zero(~worse, self._rhs.array)
            self._parts.zero(worse, self._u.array)
            self._rhs.axpy(1.0, self._u)
        else:
            self._u.copy(self._rhs)
        self._found = self._guessed and self.factorised and self._balanced(self._rhs.array_r)
        wrong = left > whole * size
        if np.any(wrong) and not self._found:
            self._parts.zero(~wrong, self._rhs.array)
            self._solver.solve(self._rhs, self._u, max(change, float(np.min(whole * size[wrong] / left[wrong]))))
            self._last.axpy(1.0, self._u)
            self._accurate = None

    @property
    def exact(self) -> bool:
        return self._solver.exact

    @property
    def found(self) -> bool:
        """Whether the last displacement is one of `guess`, from factors of K, that balances all forces to rounding
        errors of K u: where K is ill-conditioned, a correction is larger than what is wrong."""
        return self._found

    def _balanced(self, residual: FloatArray) -> bool:
        """Whether a residual of the last displacement is of the size of rounding errors of K u."""
        over = Reductions(self.comm)
        return over.norm(residual / self._root) <= LEAST_RESIDUAL * over.norm(self._root * self._last.array_r)

    @property
    def factorised(self) -> bool:
        return self._solver.tolerance == 0.0

    @property
    def matrix_free(self) -> MatrixFreeCompliance:
        return self

    def forces(self, x: FloatArray, v: PETSc.Vec) -> None:
        """v <- B^T x - f in newtons; f is 0 before `under_load`."""
        self._x.array[:] = x
        self.B.multTranspose(self._x, v)
        if self._load is not None:
            v.axpy(-1.0, self._load)

    def response(self, x: FloatArray, v: PETSc.Vec, tolerance: float = 0.0) -> None:
        """v <- K^-1 (B^T x - f), its change to a relative accuracy; by a correction of the last one."""
        self.mult_incremental(x, np.empty_like(x), tolerance)
        v.array[:] = -self._last.array_r

    def left_over(self, x: FloatArray) -> FloatArray:
        """f - B^T x - K u of the last displacement u, newtons, shape (n,); collective."""
        self.forces(x, self._rhs)
        self._solver.multiply(self._last, self._u)
        left: FloatArray = -self._rhs.array_r - self._u.array_r
        return left

    def move(self, x: FloatArray, du: FloatArray) -> None:
        """The last displacement and its change du (n,) in metres are one under x."""
        self._last.array[:] += du
        self.latest, self._accurate = x.copy(), None

    def guess(self, v: PETSc.Vec) -> None:
        """An approximation of K^-1 (B^T x - f) for the next x: `mult_incremental` starts there."""
        self._last.array[:] = -v.array_r
        self._guessed = True
        self._accurate = self.latest = None

    def displaced(self, v: PETSc.Vec) -> FloatArray:
        """A x = B (v + K^-1 f) of v = K^-1 (B^T x - f)."""
        return self._moved(self._free + v.array_r)

    def formed(self) -> None:
        """None: there is no A."""

    @property
    def stiffened(self) -> bool:
        """Whether `elimination` may have springs: where bodies are held without soft ones, by multigrid."""
        return self._soft is None and isinstance(self._solver, IterativeSolver)

    @property
    def local(self) -> FloatArray:
        """diag(B diag(K)^-1 B^T), the order of what the body gives way around a point, metres per newton, (m, 3)."""
        return _of_diagonal(self.B, self._stiffness.reduced.diagonal)

    def elimination(self, springs: FloatArray | None = None) -> Elimination:
        """K^-1 by a V-cycle; with springs (m, 3, 3) of contact points, newtons per metre, of K + B^T springs B."""
        cycle, displacements = self._cycle if springs is None else self._stiffened(springs), list[FloatArray]()

        def begin(forces: FloatArray) -> FloatArray:
            displacements[:] = (cycle(f).copy() for f in forces)
            return np.array([self._moved(u) for u in displacements])

        def end(_: FloatArray) -> FloatArray:  # what contact forces leave over is for the next application
            return np.array(displacements)

        return Elimination(self._solver, self.B, begin, end, springs is not None)

    def _cycle(self, forces: FloatArray) -> FloatArray:
        self._rhs.array[:] = forces
        self._solver.approximate(self._rhs, self._u)
        return self._u.array_r

    def _stiffened(self, springs: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """A V-cycle of K + B^T springs B; collective."""
        assert isinstance(self._solver, IterativeSolver)
        sizes, first, each = self.B.getSizes()[0], self.B.getOwnershipRange()[0], np.arange(3 * self.nodes)
        columns = np.broadcast_to((first + each).reshape(-1, 1, 3), springs.shape)
        pattern = (of.astype(PETSc.IntType) for of in (np.arange(0, springs.size + 1, 3), columns.ravel()))
        of_points = PETSc.Mat().createAIJ((sizes, sizes), csr=(*pattern, springs.ravel()), comm=self.B.comm)
        added = of_points.PtAP(self.B)
        cycle = self._solver.stiffened(added)
        for done in (of_points, added):
            done.destroy()
        return cycle

    def rotated(self, B: PETSc.Mat, turn: FloatArray) -> MatrixFreeCompliance:
        rest: FloatArray = np.einsum("iab,ib->ia", turn**2, self._elastic.rest.reshape(-1, 3)).ravel()
        diagonal = DiagonalEstimate(turned_diagonal(self._elastic.whole, self.learnt, turn), rest)
        return MatrixFreeCompliance(B, self._stiffness, self._solver, self._parts, diagonal=diagonal, soft=self._soft)

    def known_product(self, x: FloatArray) -> FloatArray | None:
        """That of the last most accurate product, if x is the same."""
        last = self._accurate
        if not Reductions(self.comm).all(last is not None and np.array_equal(last, x)):
            return None
        return self.latest_product()

    def displacement(self, x: FloatArray, f: PETSc.Vec, free: FloatArray) -> FloatArray:
        """By a correction of K^-1 B^T x of the last products; if that fails, with what it reached: the certificate
        judges it."""
        try:
            self._follow(x, 0.0, _DISPLACED)
            self.latest = x.copy()
        except CGNotConverged:
            self._last.axpy(1.0, self._u)
            self._accurate = self.latest = None
        u: FloatArray = self._last.array_r.copy()
        return u if free is self._free else free - (self._free - u)

    def diagonal(self) -> FloatArray:
        whole = self._elastic.whole
        return whole if self.rigid is None else whole + np.sum(self.rigid**2, axis=1)

    @property
    def rest_of_diagonal(self) -> FloatArray:
        """An estimate of diag(A) without the few large eigenvalues of A, shape (3 m,)."""
        return self._elastic.rest
