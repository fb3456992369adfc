"""A V-cycle of multigrid in blocks of single precision (block_matrix.py).

A cycle is limited by memory bandwidth.  Here its matrices are a quarter to a half of PETSc's, a step of the smoother
reads them once and does all else that it has to do on the way, and the first step of a cycle, from zero, does not read
them at all.  Vectors stay in double precision: rounding then has the effect of a slightly different matrix of the
smoother, of relative size 1e-7.

Grids go from K, in second order by way of linear displacements, to one that is factorised.  On several ranks every rank
has the small ones as a whole.  On a grid of a thousand unknowns a product takes a few microseconds, and the messages
for it more: each rank restricts to the whole of the first such grid, all add up what they have, in one call per cycle,
and each computes the rest of the cycle, from which it interpolates without messages.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple, Protocol

import numpy as np
import scipy.linalg
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg.blas import dtrsv

from ...arrays import FloatArray
from ..petsc_arrays import configured_ksp, distributed_entries
from ..reductions import Reductions, concatenated
from ..solve_errors import CGNotConverged
from ..uncoupled import Parts, parts_of
from .block_matrix import (
    PADDING,
    BlockInterpolation,
    Blocks,
    DistributedBlocks,
    SymmetricBlocks,
    distributed_blocks,
    on_every_rank,
    padded,
    sum_of,
    symmetric_blocks,
)
from .coarsening import WholeRows, coarser, galerkin, whole, with_diagonal

REPLICATED_UP_TO: Final = 1500
"""Unknowns of all ranks up to which each rank has a grid as a whole."""


DENSE_UP_TO: Final = 500
"""Unknowns up to which there is no coarser grid: a matrix of so few is nearly full."""

_FACTORISED: dict[str, object] = {"pc_type": "lu", "pc_factor_shift_type": "inblocks"}


class CoarseSolver(Protocol):
    """Solves on a coarse grid."""

    def __call__(self, r: FloatArray) -> FloatArray:
        """The solution for r, padded, to be read before the next one; collective."""
        ...

    def stiffened(self, S: DistributedBlocks, size: int) -> CoarseSolver:
        """That of K + S, in `symmetric_blocks` of so many rows; collective."""
        ...

    def destroy(self) -> None:
        return


class DenseSolver(CoarseSolver):
    """On a small coarsest grid, on one rank; LinAlgError if K is not positive definite, to rounding."""

    def __init__(self, K: scipy.sparse.csr_matrix):
        self._K, dense = K, K.toarray(order="F")
        self._factor = scipy.linalg.cholesky(dense, lower=True, overwrite_a=True, check_finite=False)
        self._solution = padded(len(dense))

    def __call__(self, r: FloatArray) -> FloatArray:
        # of one right-hand side LAPACK's dpotrs takes 2.7 times as long as these
        self._solution[:] = dtrsv(self._factor, r, lower=1)
        self._solution[:] = dtrsv(self._factor, self._solution, lower=1, trans=1)
        return self._solution

    def stiffened(self, S: DistributedBlocks, size: int) -> CoarseSolver:
        return exact_solver(self._K + entries_of(S.own, size))


class SparseSolver:
    """On a coarsest grid of any size, on one rank."""

    def __init__(self, K: scipy.sparse.csr_matrix):
        self._K, csr = K, (array.astype(PETSc.IntType) for array in (K.indptr, K.indices))
        matrix = PETSc.Mat().createAIJ(K.shape, csr=(*csr, K.data), comm=PETSc.COMM_SELF)
        self._ksp = configured_ksp(matrix, "preonly", _FACTORISED)
        matrix.destroy()
        self._b, self._x = self._ksp.getOperators()[1].createVecs()
        self._solution = padded(self._x.getLocalSize())

    def __call__(self, r: FloatArray) -> FloatArray:
        self._b.array[:] = r
        self._ksp.solve(self._b, self._x)
        self._solution[:] = self._x.array_r
        return self._solution

    def stiffened(self, S: DistributedBlocks, size: int) -> CoarseSolver:
        return exact_solver(self._K + entries_of(S.own, size))

    def destroy(self) -> None:
        for thing in (self._ksp, self._b, self._x):
            thing.destroy()


def entries_of(upper: Blocks, size: int) -> scipy.sparse.csr_matrix:
    """All entries of a symmetric matrix on one rank."""
    assert upper.low is not None
    blocks = np.add(upper.values, upper.low, dtype=np.float64)[:-PADDING].reshape(-1, size, size)
    n = len(upper.pointers) - 1
    half = scipy.sparse.triu(scipy.sparse.bsr_matrix((blocks, upper.columns, upper.pointers), (size * n, size * n)))
    return (half + scipy.sparse.triu(half, 1).T).tocsr()


def exact_solver(K: scipy.sparse.csr_matrix) -> CoarseSolver:
    """Of the coarsest grid."""
    if K.shape[0] < DENSE_UP_TO:
        try:
            return DenseSolver(K)
        except scipy.linalg.LinAlgError:  # rigid motions that nothing but rounding holds
            pass
    return SparseSolver(K)


class Replicated:
    """A solver that each rank has for itself, of a grid that every rank has as a whole."""

    def __init__(self, comm: MPI.Comm, solver: CoarseSolver):
        self._comm, self._solver = comm, solver

    def __call__(self, r: FloatArray) -> FloatArray:
        """The solution for the sum of all ranks' r, which is in r afterwards."""
        self._comm.Allreduce(MPI.IN_PLACE, r)
        return self._solver(r)

    def stiffened(self, S: DistributedBlocks, size: int) -> CoarseSolver:
        return Replicated(self._comm, self._solver.stiffened(whole(S), size))

    def destroy(self) -> None:
        self._solver.destroy()


_SMOOTHED = (0.1, 1.05)
"""Part of the spectrum that the smoother damps, over its estimated largest eigenvalue.

From 0.05 on, as in GAMG, two steps damp the upper part less: a linear solve on cubes takes 13 iterations in place of
10, and on flat cells or with a Poisson's ratio of 0.49 a twentieth fewer (interior-point-settings.csv).
"""
_LANCZOS: Final = 20
"""Steps of the estimate.

The largest eigenvalues may belong to few cells: after 10 steps the estimate was 14 % too small on a bracket of 450 000
unknowns.  The smoother then amplifies them, and the cycle is not definite.  After 20 steps it is within 0.5 % on seven
parts and blocks.
"""

_FEW: Final = 6  # steps for an eigenvalue that stiffnesses added to K have raised: it is apart from the others


class Level:
    """A grid in blocks of `size` rows with its smoother: Chebyshev's iteration with the diagonal.

    Args:
        K: In `symmetric_blocks`.
        steps: Of the smoother before and after the coarser grids.
        least: Largest eigenvalue of D^-1 K without what has been added to K; 0 if nothing has.

    Raises:
        CGNotConverged: On every rank, if a diagonal entry is not positive: K is indefinite.

    Attributes:
        largest: Estimated eigenvalue of D^-1 K.
        interpolation: From the next coarser grid, if there is one,
        P: and its rows; set when that is known.
    """

    interpolation: BlockInterpolation | None = None
    P: DistributedBlocks

    def __init__(self, K: DistributedBlocks, size: int, steps: int = 2, least: float = 0.0):
        self.size, self._steps = size, steps
        self.blocks = SymmetricBlocks(K, size)
        if not Reductions(K.comm).all(np.all(self.blocks.diagonal > 0.0)):
            raise CGNotConverged(0, 1.0, 0.0, indefinite=True)
        self.inverse: FloatArray = 1.0 / self.blocks.diagonal
        self.b, self.x, self._d, self._r = (padded(self.blocks.size) for _ in range(4))
        self.largest = max(least, self._largest_eigenvalue(K.comm, _LANCZOS if least == 0.0 else _FEW))
        low, high = (part * self.largest for part in _SMOOTHED)
        self._factors = _chebyshev(0.5 * (high + low), 0.5 * (high - low), steps)

    def _largest_eigenvalue(self, comm: MPI.Comm, steps: int) -> float:
        """Of D^-1 K, by CG with a random right-hand side, which is Lanczos' method; a little too small."""
        over, n = Reductions(comm), self.blocks.size
        r, p, image = padded(n), padded(n), padded(n)
        r[:] = np.random.default_rng([1618, comm.rank]).standard_normal(n) / np.sqrt(self.inverse)
        z = self.inverse * r
        p[:] = z
        size = over.dot(r, z)
        diagonal, beside, alpha, beta = [], [], 1.0, 0.0
        for _ in range(steps):
            self.blocks.mult(p, image)
            before, alpha = alpha, size / over.dot(p, image)
            diagonal.append(1.0 / alpha + beta / before)
            r -= alpha * image
            z = self.inverse * r
            new = over.dot(r, z)
            beta, size = new / size, new
            if size <= 0.0:
                break
            beside.append(math.sqrt(beta) / alpha)
            p[:] = z + beta * p
        return scipy.linalg.eigvalsh_tridiagonal(diagonal, beside[: len(diagonal) - 1])[-1]

    def stiffened(self, S: DistributedBlocks) -> Level:
        """That of K + S, with the same interpolation, in single precision; collective."""
        level = Level(sum_of(self.blocks.matrix, S), self.size, self._steps, self.largest)
        level.interpolation = self.interpolation
        return level

    def smooth_from_zero(self) -> None:
        self.blocks.smooth(self.inverse, self.b, self.x, self._d, self._factors, zero=True)

    def smooth(self) -> None:
        self.blocks.smooth(self.inverse, self.b, self.x, self._d, self._factors)

    def rounding(self, x: FloatArray) -> float:
        """The square of this rank's 2^-24 diag(K) x."""
        forces = np.divide(x, self.inverse, out=self._d)
        return 2.0**-48 * float(forces @ forces)

    def residual(self) -> FloatArray:
        """b - K x; to be read before the next one."""
        self.blocks.residual(self.b, self.x, self._r)
        return self._r

    def destroy(self) -> None:
        self.blocks.destroy()
        if self.interpolation is not None:
            self.interpolation.destroy()


def _chebyshev(theta: float, delta: float, steps: int) -> FloatArray:
    """Factors of direction and residual in each step, shape (steps, 2), for eigenvalues in theta -+ delta."""
    rho = delta / theta
    factors = [(0.0, 1.0 / theta)]
    for _ in range(steps - 1):
        new = 1.0 / (2.0 * theta / delta - rho)
        factors.append((new * rho, 2.0 * new / delta))
        rho = new
    return np.array(factors)


class MultigridCycle:
    """A preconditioner for K on a grid, with the solver on the next one, if there is one.

    `again` is whether a call makes a second cycle for the residual of the first (W-cycle), for a coarse grid: there it
    takes little time, and the finer grid then needs fewer iterations.  The residual has to be accurate: on soft springs
    the first cycle makes large rigid motions.
    """

    def __init__(self, level: Level, coarser: CoarseSolver | None = None, again: bool = False):
        self._level, self._coarser, self._again = level, coarser, again
        self.size = level.blocks.size
        self._right = padded(level.interpolation.columns if level.interpolation is not None else 0)
        self._sum, self._left = (padded(self.size if again else 0) for _ in range(2))

    def __call__(self, r: FloatArray) -> FloatArray:
        """Cycles for r, from zero; to be read before the next call; collective."""
        level = self._level
        self._cycle(r)
        if self._again:
            self._sum[:] = level.x
            level.blocks.mult(level.x, self._left)
            np.subtract(r, self._left, out=self._left)
            self._cycle(self._left)
            level.x += self._sum
        return level.x

    def _cycle(self, r: FloatArray) -> None:
        level = self._level
        level.b = r
        level.smooth_from_zero()
        if level.interpolation is not None and self._coarser is not None:
            level.interpolation.restrict(level.residual(), self._right)
            level.interpolation.prolong(self._coarser(self._right), level.x)
        level.smooth()

    def stiffened(self, S: DistributedBlocks, _: int = 3) -> MultigridCycle:
        """That of K + S, whose stiffnesses are few, in `symmetric_blocks`, by the same interpolations; not to be
        destroyed; collective."""
        level, coarser = self._level, self._coarser
        if level.interpolation is not None and coarser is not None:
            width = level.interpolation.shape[1]
            coarser = coarser.stiffened(galerkin(WholeRows(S, level.size), level.P, width), width)
        return MultigridCycle(level.stiffened(S), coarser, self._again)

    def mult(self, x: FloatArray, y: FloatArray) -> None:
        """y <- K x, as accurate as in double precision; x padded; collective."""
        self._level.blocks.mult(x, y)

    def mult_roughly(self, x: FloatArray, y: FloatArray) -> None:
        """y <- K x in single precision; x padded; collective."""
        self._level.blocks.mult(x, y, accurate=False)

    def rounding(self, x: FloatArray) -> float:
        """The square of this rank's part of a bound of the error of `mult_roughly`: two to three times as large."""
        return self._level.rounding(x)

    def destroy(self) -> None:
        self._level.destroy()
        if self._coarser is not None:
            self._coarser.destroy()


SECOND_ORDER_STEPS: Final = 1
"""Steps of the smoother in second order; two take 0.9 of the iterations."""

TWICE_FROM: Final = 1000
"""Unknowns per rank from which a visit of a distributed coarse grid after the first is two cycles (W-cycle): on smaller
ones messages take longer than products, and parts take as many iterations without (cycles.csv)."""

_STALLED: Final = 0.7  # unknowns over those of the finer grid from which on ranks have a grid as a whole


class Stiffness(NamedTuple):
    """All that multigrid needs of a stiffness K, three rows per node.

    Attributes:
        blocks: In `symmetric_blocks`.
        motions: Six rigid motions that it maps to almost zero, shape (rows of this rank, 6).
        parts: Those that it does not couple.
        linear: In second order the interpolation of linear displacements, and the motions of these.
    """

    blocks: DistributedBlocks
    motions: FloatArray
    parts: Parts
    linear: tuple[DistributedBlocks, FloatArray] | None


def stiffness_in_blocks(K: PETSc.Mat) -> Stiffness:
    """Of a matrix with the motions as its near-nullspace, and in second order with an attribute that makes the
    interpolation, which has those of linear displacements; collective."""
    interpolation, linear = K.getAttr("interpolation"), None
    P = None if interpolation is None else interpolation()
    if P is not None:
        linear = distributed_blocks(distributed_entries(P), (3, 3)), _motions(P)
        P.destroy()
    return Stiffness(symmetric_blocks(distributed_entries(K), 3), _motions(K), parts_of(K), linear)


def multigrid(K: Stiffness) -> MultigridCycle:
    """Multigrid for K; collective."""
    if K.linear is None:
        cycle = _cycle(K.blocks, 3, K.motions)
        return MultigridCycle(Level(K.blocks, 3)) if cycle is None else cycle
    level, (P, motions) = Level(K.blocks, 3, SECOND_ORDER_STEPS), K.linear
    linear = with_diagonal(galerkin(WholeRows(K.blocks, 3), P, 3), 3)
    return _cycle_on(level, P, (3, 3), _solver(linear, 3, motions))


def _motions(matrix: PETSc.Mat) -> FloatArray:
    """Its near-nullspace, shape (rows of this rank, 6)."""
    return np.column_stack([vector.array_r for vector in matrix.getNearNullSpace().getVecs()])


def _cycle(matrix: DistributedBlocks, size: int, motions: FloatArray, first: bool = False) -> MultigridCycle | None:
    """On a grid with its coarser ones; None if there are none; `first` if it is the first of aggregates."""
    level, unknowns = Level(matrix, size), size * int(matrix.starts[-1])
    coarse = coarser(matrix, size, motions, level.inverse, level.largest)
    if coarse is None:
        level.blocks.destroy()
        return None
    stalled = 6 * coarse.matrix.starts[-1] > _STALLED * unknowns
    solver = _solver(coarse.matrix, 6, coarse.motions, stalled, first=size == 3)
    large = first or matrix.others is None or unknowns >= TWICE_FROM * matrix.comm.size
    return _cycle_on(level, coarse.P, (size, 6), solver, again=size == 6 and large)


def _cycle_on(
    level: Level, P: DistributedBlocks, shape: tuple[int, int], coarser: CoarseSolver, again: bool = False
) -> MultigridCycle:
    """With the solver on the coarser grid from which P, in blocks of this shape, interpolates."""
    level.P, P = P, on_every_rank(P) if isinstance(coarser, Replicated) else P
    level.interpolation = BlockInterpolation(P, shape)
    return MultigridCycle(level, coarser, again)


def _solver(
    matrix: DistributedBlocks, size: int, motions: FloatArray, stalled: bool = False, first: bool = False
) -> CoarseSolver:
    """For a coarse grid; `stalled` if aggregates, each of one rank, are hardly fewer; `first` as of `_cycle`."""
    unknowns = size * int(matrix.starts[-1])
    cycle = None
    if matrix.others is None:
        if unknowns > DENSE_UP_TO:
            cycle = _cycle(matrix, size, motions)
        return exact_solver(entries_of(matrix.own, size)) if cycle is None else cycle
    if unknowns > REPLICATED_UP_TO and not stalled:
        cycle = _cycle(matrix, size, motions, first=first)
    if cycle is None:
        solver = _solver(whole(matrix), size, concatenated(matrix.comm, motions))
        return Replicated(matrix.comm, solver)
    return cycle
