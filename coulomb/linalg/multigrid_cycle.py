"""A V-cycle of multigrid with the grids that PETSc's GAMG made, in blocks of single precision (block_matrix.py).

A cycle is limited by memory bandwidth.  Here its matrices are a quarter to a half of PETSc's, a step of the smoother
reads them once and does all else that it has to do on the way, and the first step of a cycle, from zero, does not read
them at all.  Vectors stay in double precision: rounding then has the effect of a slightly different matrix of the
smoother, of relative size 1e-7.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from .block_matrix import SHAPES, BlockInterpolation, SymmetricBlocks, padded
from .coarse_grids import CoarseSolver
from .reductions import Reductions

_SMOOTHED = (0.05, 1.05)  # part of the spectrum that the smoother damps, over its estimated largest eigenvalue, as GAMG
_LANCZOS = 10  # steps of the estimate


@dataclass(frozen=True)
class Grid:
    """A grid of multigrid with a coarser one.

    Attributes:
        K: Its matrix.
        P: Interpolation from the next coarser grid.
        steps: Steps of the smoother before and after the coarser grids.
    """

    K: PETSc.Mat
    P: PETSc.Mat
    steps: int = 2

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a block of P."""
        rows, columns = self.P.getBlockSizes()
        return int(rows), int(columns)


def grids_of(pc: PETSc.PC, steps: int = 2) -> list[Grid]:
    """The grids of PETSc's multigrid that have a coarser one, finest first."""
    levels = range(pc.getMGLevels() - 1, 0, -1)
    return [Grid(pc.getMGSmoother(k).getOperators()[1], pc.getMGInterpolation(k), steps) for k in levels]


class Level:
    """A grid in blocks with its smoother: Chebyshev's iteration with the diagonal.

    Args:
        library: The kernels.
        K: The matrix; not kept.
        interpolation: From the next coarser grid.
        steps: Steps of the smoother before and after the coarser grids.
        finest: Whether products by K are as accurate as in double precision.
    """

    def __init__(
        self, library: ctypes.CDLL, K: PETSc.Mat, interpolation: BlockInterpolation, steps: int, finest: bool = False
    ):
        comm = K.comm.tompi4py()
        self.blocks = SymmetricBlocks(library, K, interpolation.shape[0], accurate=finest)
        self.interpolation = interpolation
        diagonal = K.getDiagonal()
        values = diagonal.array_r
        self._inverse: FloatArray = 1.0 / np.where(values > 0.0, values, 1.0)  # 0: an aggregate with fewer motions
        diagonal.destroy()
        self.b, self.x, self._d, self._r = (padded(self.blocks.size) for _ in range(4))
        largest = self._largest_eigenvalue(comm)
        low, high = (part * largest for part in _SMOOTHED)
        self._factors = _chebyshev(0.5 * (high + low), 0.5 * (high - low), steps)

    def _largest_eigenvalue(self, comm: MPI.Comm) -> float:
        """Of D^-1 K, by CG with a random right-hand side, which is Lanczos' method; a little too small."""
        over, n = Reductions(comm), self.blocks.size
        r, p, image = padded(n), padded(n), padded(n)
        r[:] = np.random.default_rng([1618, comm.rank]).standard_normal(n) / np.sqrt(self._inverse)
        z = self._inverse * r
        p[:] = z
        size = over.dot(r, z)
        diagonal, beside, alpha, beta = [], [], 1.0, 0.0
        for _ in range(_LANCZOS):
            self.blocks.mult(p, image)
            before, alpha = alpha, size / over.dot(p, image)
            diagonal.append(1.0 / alpha + beta / before)
            r -= alpha * image
            z = self._inverse * r
            new = over.dot(r, z)
            beta, size = new / size, new
            if size <= 0.0:
                break
            beside.append(math.sqrt(beta) / alpha)
            p[:] = z + beta * p
        largest: float = scipy.linalg.eigvalsh_tridiagonal(diagonal, beside[: len(diagonal) - 1])[-1]
        return largest

    def smooth_from_zero(self) -> None:
        """x from 0."""
        (_, second), *others = self._factors
        np.multiply(self._inverse, self.b, out=self._d)
        self._d *= second
        self.x[:] = self._d
        for factors in others:
            self.blocks.step(self._inverse, self.b, self.x, self._d, *factors)

    def smooth(self) -> None:
        """x from x."""
        for factors in self._factors:
            self.blocks.step(self._inverse, self.b, self.x, self._d, *factors)

    def rounding(self, x: FloatArray) -> float:
        """The square of this rank's 2^-24 diag(K) x."""
        forces = np.divide(x, self._inverse, out=self._d)
        return 2.0**-48 * float(forces @ forces)

    def restrict(self, coarse: FloatArray) -> None:
        """coarse <- P^T (b - K x)."""
        self.blocks.residual(self.b, self.x, self._r)
        self.interpolation.restrict(self._r, coarse)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.blocks.destroy()
        self.interpolation.destroy()


def _chebyshev(theta: float, delta: float, steps: int) -> list[tuple[float, float]]:
    """Factors of the direction and of the residual in each step, for eigenvalues in theta -+ delta."""
    rho = delta / theta
    factors = [(0.0, 1.0 / theta)]
    for _ in range(steps - 1):
        new = 1.0 / (2.0 * theta / delta - rho)
        factors.append((new * rho, 2.0 * new / delta))
        rho = new
    return factors


class MultigridCycle:
    """A preconditioner for K on the first of some grids.

    Args:
        levels: The grids that have a coarser one, finest first.
        coarsest: The solver on the grid after them.

    Attributes:
        size: Unknowns of this rank on the finest grid.
    """

    def __init__(self, levels: list[Level], coarsest: CoarseSolver):
        self._levels = levels
        self._coarsest, self.size = coarsest, self._levels[0].blocks.size
        self._right = padded(self._levels[-1].interpolation.columns)

    def __call__(self, r: FloatArray) -> FloatArray:
        """A cycle for r, from zero; to be read before the next one; collective."""
        finest = self._levels[0]
        finest.b = r
        self._cycle(0)
        return finest.x

    def mult(self, x: FloatArray, y: FloatArray) -> None:
        """y <- K x, as accurate as in double precision; x padded; collective."""
        self._levels[0].blocks.mult(x, y)

    def mult_roughly(self, x: FloatArray, y: FloatArray) -> None:
        """y <- K x in single precision; x padded; collective."""
        self._levels[0].blocks.mult(x, y, accurate=False)

    def rounding(self, x: FloatArray) -> float:
        """The square of this rank's part of a bound of the error of `mult_roughly`: two to three times as large."""
        return self._levels[0].rounding(x)

    def _cycle(self, k: int) -> None:
        level, last = self._levels[k], k + 1 == len(self._levels)
        level.smooth_from_zero()
        level.restrict(self._right if last else self._levels[k + 1].b)
        if last:
            error = self._coarsest(self._right)
        else:
            self._cycle(k + 1)
            error = self._levels[k + 1].x
        level.interpolation.prolong(error, level.x)
        level.smooth()

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for level in self._levels:
            level.destroy()
        self._coarsest.destroy()


def supported(grids: list[Grid]) -> bool:
    """Whether there are kernels for the blocks of these grids; the same on all ranks."""
    return len(grids) > 0 and all(grid.shape in SHAPES for grid in grids)
