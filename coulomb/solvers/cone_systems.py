"""The linear system of a step of the one loop: (A + C) dx = r, C nodal and unsymmetric.

In a node's block of C nothing of the tangential pair acts on the normal row: friction follows the pressure, not the
other way.  P = rest(A) + C + U U^T therefore has a nodal part that is triangular by blocks, inverted in closed form,
and a low-rank part that was learnt of A (recycling.py).  (A + C) P^-1 - 1 = (A - rest(A) - U U^T) P^-1: P is as good
as the stand-in for A, whatever friction does; with diag(A) alone it is the unsymmetric P_SC.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple, Protocol

import numpy as np
import scipy.linalg
from petsc4py import PETSc

from ..arrays import FloatArray
from ..linalg.krylov import CarryingKrylov
from ..linalg.recycling import LearntCompliance, LowRankUpdate
from .cone import ConeLinearization
from .dense_system import formed
from .newton_systems import disc_inverse, like
from .scaled_compliance import FreshImages, ScaledCompliance

_PRODUCT = (0.03, 0.1)  # accuracy of a product in FGMRES: the tolerance of the step, kept between these


class ConeStep(NamedTuple):
    """dx (m, 3), A dx (m, 3), and the Krylov iterations it took."""

    dx: FloatArray
    A_dx: FloatArray
    iterations: int


class ConeSystem(Protocol):
    """Solves the system of one step after another; made once for a problem.

    Args of the constructor:
        A: The scaled compliance.
    """

    def __init__(self, A: ScaledCompliance): ...

    def start(self, x: FloatArray, tolerance: float) -> FloatArray:
        """A x of the first iterate, see FreshImages."""
        ...

    def carry(self, x: FloatArray, predicted: FloatArray | None, alpha: float, tolerance: float) -> FloatArray:
        """A x of the next iterate."""
        ...

    def judge(self, x: FloatArray) -> FloatArray:
        """A x as exact as can be."""
        ...

    def solve(
        self, at: ConeLinearization, rhs: FloatArray, weight: FloatArray, tolerance: float, cap: float
    ) -> ConeStep:
        """Solve to |W residual| <= min(tolerance |W rhs|, cap), W the weight of the rows, shape (m, 3)."""
        ...

    def estimate(self, x: FloatArray) -> FloatArray:
        """A x from what is known of A, without a product; (m, 3)."""
        ...

    def destroy(self) -> None:
        """Give back what it holds of PETSc."""
        ...


class KrylovConeSystem(FreshImages):
    """FGMRES, preconditioned by P from the right; the default."""

    rank = 100
    """Columns of U to keep in the preconditioner; 0 is diag(A) alone."""

    def __init__(self, A: ScaledCompliance):
        super().__init__(A)
        self._comm, self._A = A.comm, LearntCompliance(A.comm, A.diagonal, self.rank, A.A.exact)
        self._accuracy = 0.0

        def recorded(x: FloatArray) -> FloatArray:
            y = A.mult(x, self._accuracy)
            self._A.record(x, y)
            return y

        self._krylov = CarryingKrylov(
            A.comm, A.nodes, 3, recorded, self._operator, self._precondition, PETSc.KSP.Type.FGMRES
        )

    def solve(
        self, at: ConeLinearization, rhs: FloatArray, weight: FloatArray, tolerance: float, cap: float
    ) -> ConeStep:
        self._at, self._weight = at, weight
        self._accuracy = min(max(tolerance, _PRODUCT[0]), _PRODUCT[1])
        D = self._D = self._A.rest.copy()
        D[:, 1:] += at.h[:, None]
        self._S = at.D22[:, 1] + np.sum(at.y**2 / D[:, 1:], axis=1)
        U = self._A.nodal_U(3)
        U[~at.frictional, 1:] = 0.0
        self._preconditioner = LowRankUpdate(self._comm, self._nodal_inverse, U)
        weighted = weight * rhs
        size = float(np.sqrt(self._comm.allreduce(float(np.vdot(weighted, weighted)))))
        atol = max(min(tolerance * size, cap), 1e-14 * size)
        dx, A_dx, iterations = self._krylov.solve(weighted, np.zeros_like(rhs), atol)
        self._A.learn()
        return ConeStep(dx, A_dx, iterations)

    def _operator(self, p: FloatArray, A_p: FloatArray) -> FloatArray:
        y = A_p + self._at.C(p)
        y[~self._at.frictional, 1:] = 0.0
        weighted: FloatArray = self._weight * y
        return weighted

    def _precondition(self, r: FloatArray) -> FloatArray:
        return self._preconditioner(r / self._weight)

    def _nodal_inverse(self, r: FloatArray) -> FloatArray:
        """(rest(A) + C)^-1 on (m, 3, ...): the normal unknown first, then the pair that follows it.

        The pair's 2 x 2 block is that of the disc; what the normal unknown does to it, h F y + y c/d22, is kept apart,
        so that nothing cancels as d22 -> 0.
        """
        at, D, S = self._at, like(self._D, r), like(self._S[:, None], r)
        y, D22 = like(at.y, r), like(at.D22, r)
        z = np.empty_like(r)
        z[:, 0] = r[:, 0] * D22[:, 0] / (1.0 + D[:, 0] * D22[:, 0])
        follows = (at.h * at.F)[:, None] * at.y
        pair = r[:, 1:] + like(follows, r) * z[:, :1]
        widens = like(at.c * at.frictional, r) * z[:, 0]
        z[:, 1:] = disc_inverse(D[:, 1:], y, D22[:, 1:], S, pair) + y / D[:, 1:] * widens[:, None] / S
        z[~at.frictional, 1:] = 0.0
        return z

    def estimate(self, x: FloatArray) -> FloatArray:
        low_rank: FloatArray = self._A.U @ self._comm.allreduce(self._A.U.T @ x.ravel())
        return self._A.rest * x + low_rank.reshape(x.shape)

    def destroy(self) -> None:
        self._krylov.free()


class DenseConeSystem(FreshImages):
    """A + C factorised (LU); on one rank, 3 m products to get A and (3 m)^3 work a step.

    Raises:
        ValueError: From the constructor, on more than one rank.
    """

    def __init__(self, A: ScaledCompliance):
        super().__init__(A)
        self._A = formed(A)

    def solve(
        self, at: ConeLinearization, rhs: FloatArray, weight: FloatArray, tolerance: float, cap: float
    ) -> ConeStep:
        """The step, as exact as rounding allows; tolerance and cap have no say."""
        M = cone_matrix(self._A, at)
        rows = 1.0 / np.abs(M).max(axis=1)
        columns = 1.0 / np.abs(rows[:, None] * M).max(axis=0)
        with warnings.catch_warnings():  # a singular matrix shows as a step that is not finite, and ends the start
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
            factors = scipy.linalg.lu_factor(rows[:, None] * M * columns, overwrite_a=True, check_finite=False)
        dx = (columns * scipy.linalg.lu_solve(factors, rows * rhs.ravel())).reshape(rhs.shape)
        return ConeStep(dx, (self._A @ dx.ravel()).reshape(rhs.shape), 0)

    def estimate(self, x: FloatArray) -> FloatArray:
        return (self._A @ x.ravel()).reshape(x.shape)

    def destroy(self) -> None:
        """Nothing of PETSc's to give back."""


def cone_matrix(A: FloatArray, at: ConeLinearization) -> FloatArray:
    """A + C, shape (3 m, 3 m); the tangential pair of a node without friction is replaced by the identity."""
    M = A.copy()
    dropped = (np.flatnonzero(~at.frictional)[:, None] * 3 + np.array([1, 2])).ravel()
    M[dropped], M[:, dropped] = 0.0, 0.0
    i = 3 * np.arange(len(at.F))[:, None, None] + np.arange(3)[:, None]
    j = 3 * np.arange(len(at.F))[:, None, None] + np.arange(3)
    M[i, j] += at.blocks()
    return M
