"""Solves with K by factors in single precision, refined to the accuracy of double precision."""

from __future__ import annotations

import logging
import math
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..reductions import Reductions
from .frontal_factors import NotPositiveDefinite

_log = logging.getLogger(__name__)

_SLOW: Final = 0.1
"""Factor by which an iteration must decrease the residual, in the mean over a solve, in single precision."""

_ROUNDING = 2.0 * float(np.finfo(np.float64).eps)
"""Residual of a solve in double precision, relative to |D u| with D = diag(K), in the norm of D^-1/2."""

NOT_POSITIVE_DEFINITE = (
    "the stiffness matrix is not positive definite to rounding: the body can move without resistance, or stiffnesses "
    "of its materials, springs and cells are too far apart"
)

_MOST: Final = 50  # iterations of a solve, beyond any that is fast enough


class Factors(Protocol):
    """K = L L^T in float32 or float64."""

    dtype: np.dtype[Any]

    def solve(self, rhs: FloatArray) -> FloatArray:
        """K^-1 rhs in this precision, of this rank's nodes, shapes (k, 3); collective."""
        ...


class RefinedSolver:
    """K^-1 by factors; of a subclass that makes them.  All calls are collective.

    Attributes:
        method: Its name without the precision, which is known once K is factorised.
        refinements: Iterations of all solves so far; 0 in double precision.
        error: Largest relative residual of the first iteration of a solve so far; infinite before the first solve, 0 in
            double precision.
    """

    method: str
    tolerance = 0.0
    iterations = 0
    _factors: Factors

    def __init__(self, K: PETSc.Mat):
        self._K = K
        self.comm: MPI.Comm = K.getComm().tompi4py()
        self.refinements, self._error = 0, math.inf
        self._vectors = K.createVecs()
        diagonal = K.getDiagonal()
        self._root: FloatArray = np.sqrt(np.abs(diagonal.array_r))
        diagonal.destroy()

    def _factorised_in(self, dtype: npt.DTypeLike) -> Factors:
        """The factors; NotPositiveDefinite on every rank if a pivot is not positive in this precision."""
        raise NotImplementedError

    def _factorise(self, single: bool) -> None:
        """Make the factors, in double precision if single is wanted but fails."""
        if single:
            try:
                self._factors = self._factorised_in(np.float32)
                return
            except NotPositiveDefinite:
                self._report("it is too ill-conditioned for single")
        try:
            self._factors = self._factorised_in(np.float64)
        except NotPositiveDefinite:
            raise NotPositiveDefinite(NOT_POSITIVE_DEFINITE) from None

    @property
    def single(self) -> bool:
        return self._factors.dtype == np.float32

    @property
    def exact(self) -> bool:
        """Whether the factors are in double precision."""
        return not self.single

    @property
    def error(self) -> float:
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
            self._factorise(single=False)

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
            self._report("refinement in single is slow")
            self.use_double()
        return u + self._factors.solve((rhs - self._product(u)).reshape(-1, 3)).ravel(), 0.0

    def _conjugate_gradients(self, rhs: FloatArray, u: FloatArray, tolerance: float) -> tuple[FloatArray, float] | None:
        """K^-1 rhs and the relative residual; None if the residual decreases slowly."""
        x, r = u.copy(), rhs - self._product(u)
        first, along = self._size(r), 0.0
        p: FloatArray = np.zeros_like(r)
        for iteration in range(_MOST):
            size = self._size(r)
            if size <= max(tolerance * first, _ROUNDING * self._norm(self._root * x)):
                return x, size / first if first > 0.0 else 0.0
            if not size <= first * _SLOW ** float(iteration - 1):
                return None
            z = self._factors.solve(r.reshape(-1, 3)).ravel()
            before, along = along, self._dot(r, z)
            p = z + (along / before if before else 0.0) * p
            image = self._product(p)
            step = along / self._dot(p, image)
            x += step * p
            r -= step * image
            self.refinements += 1
            if iteration == 0:
                left = self._size(r) / first
                self._error = left if math.isinf(self._error) else max(self._error, left)
        return None

    def multiply(self, u: PETSc.Vec, product: PETSc.Vec) -> None:
        """product <- K u."""
        self._K.mult(u, product)

    def _product(self, u: FloatArray) -> FloatArray:
        if not Reductions(self.comm).any(np.any(u)):
            return np.zeros_like(u)
        x, y = self._vectors
        x.array[:] = u
        self._K.mult(x, y)
        return y.array_r.copy()

    def _size(self, r: FloatArray) -> float:
        """|D^-1/2 r|, which does not depend on the units of single unknowns."""
        return self._norm(r / self._root)

    def _norm(self, x: FloatArray) -> float:
        return math.sqrt(self._dot(x, x))

    def _dot(self, x: FloatArray, y: FloatArray) -> float:
        return Reductions(self.comm).sum(float(x @ y))

    def _report(self, reason: str) -> None:
        if self.comm.rank == 0:
            _log.info("the stiffness matrix is factorised in double precision: %s", reason)

    def destroy(self) -> None:
        """Free the factors."""
        del self._factors
        for vector in self._vectors:
            vector.destroy()
