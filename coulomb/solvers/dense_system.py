"""The Newton system by dense algebra: for small problems on which a Krylov method with a nodal preconditioner fails."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ..arrays import FloatArray
from .linearization import Linearization
from .newton_systems import NewtonEquations, NewtonStep, NewtonSystem
from .scaled_compliance import IterateProducts, ScaledCompliance


@dataclass(frozen=True)
class DenseSystem:
    """J_AM factorised (LU, scaled), with slope J_SC; on one rank, 3 m products to get A and (5 m)^3 or (3 m)^3 work per
    step.

    Slower than a Krylov method that converges, but independent of the condition of A: rank-deficient problems with
    slip bounds over many orders of magnitude are solved only by this system.
    """

    def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
        """See `NewtonChoice`; a ValueError on more than one rank."""
        return _DenseSchur(A) if sloped else _Dense(A)


class _Dense:
    def __init__(self, A: ScaledCompliance):
        self._scaled, self.products = A, IterateProducts(A)
        if A.comm.size > 1:
            raise ValueError("dense Newton systems work on one rank; use a Krylov one: solver.newton of the case file")
        self._A: FloatArray = A.dense()

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        """The step to rounding accuracy; weight, tolerance and cap are not used."""
        at, r1, r2, r3 = equations.at, equations.r1, equations.r2, equations.r3
        J = self._bordered(augmented_matrix(self._A, at))
        rows = 1.0 / np.sqrt(np.abs(np.diag(J)) + 1e-3 * np.abs(J).max(axis=1))
        columns = 1.0 / np.sqrt(np.abs(np.diag(J)) + 1e-3 * np.abs(J).max(axis=0))
        solution = _solved(J, np.concatenate([r1.ravel(), r2.ravel(), r3]), rows, columns)
        dx, dnu = solution[: r1.size].reshape(r1.shape), solution[r1.size : r1.size + r2.size].reshape(r2.shape)
        return NewtonStep(dx, dnu, self._image(dx), 0, solution[r1.size + r2.size :])

    def _bordered(self, M: FloatArray) -> FloatArray:
        """[M, -G^T; G, 0], G on the first unknowns; M without rigid motions."""
        G = self._scaled.G.reshape(3 * self._scaled.nodes, -1)
        n, r = len(M), G.shape[1]
        if r == 0:
            return M
        bordered = np.zeros((n + r, n + r))
        bordered[:n, :n] = M
        bordered[: len(G), n:], bordered[n:, : len(G)] = -G, G.T
        return bordered

    def correction(self, r2: FloatArray) -> NewtonStep | None:
        return None

    def _image(self, x: FloatArray) -> FloatArray:
        return (self._A @ x.ravel()).reshape(x.shape)

    def learn(self, pairs: Sequence[tuple[FloatArray, FloatArray]]) -> None:
        """It has A itself."""

    def keep(self) -> None:
        """It has A itself."""

    def destroy(self) -> None:
        """There are no PETSc objects to free."""


class _DenseSchur(_Dense):
    """J_SC by LU: with slope J_AM is as accurate, and takes three times as long (block, p = 10, F = 0.3)."""

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        """The step to rounding accuracy; weight, tolerance and cap are not used."""
        at, r1, r2, r3 = equations.at, equations.r1, equations.r2, equations.r3
        rhs = r1 + at.J12(r2 / at.D22)
        rhs[~at.frictional, 1:] = 0.0
        M = self._bordered(schur_matrix(self._A, at))
        rows = 1.0 / np.abs(M).max(axis=1)
        columns = 1.0 / np.abs(rows[:, None] * M).max(axis=0)
        solution = _solved(M, np.concatenate([rhs.ravel(), r3]), rows, columns)
        dx = solution[: r1.size].reshape(r1.shape)
        return NewtonStep(dx, (at.J21(dx) - r2) / at.D22, self._image(dx), 0, solution[r1.size :])


def _solved(J: FloatArray, rhs: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    """J^-1 rhs by LU of diag(rows) J diag(columns)."""
    with warnings.catch_warnings():  # a singular matrix gives a step that is not finite, which ends the start
        warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
        factors = scipy.linalg.lu_factor(rows[:, None] * J * columns, overwrite_a=True, check_finite=False)
    return columns * scipy.linalg.lu_solve(factors, rows * rhs)


def schur_matrix(A: FloatArray, at: Linearization) -> FloatArray:
    """J_SC = A + C + J12 D22^-1 J21 with this A, shape (3 m, 3 m); the identity for pairs without friction."""
    M, n = A.copy(), 3 * np.arange(len(at.h))
    dropped = (n[~at.frictional][:, None] + np.array([1, 2])).ravel()
    M[dropped], M[:, dropped] = 0.0, 0.0
    M[n[:, None, None] + np.arange(3)[:, None], n[:, None, None] + np.arange(3)] += at.blocks()
    return M


def augmented_matrix(A: FloatArray, at: Linearization) -> FloatArray:
    """J_AM = [J11 J12; J21 -D22] with this A, shape (5 m, 5 m); with diag(A) in its place, P_AM.

    The tangential pair of a node without friction is replaced by the identity.
    """
    m = len(at.h)
    J = np.zeros((5 * m, 5 * m))
    J[: 3 * m, : 3 * m] = A
    n, bound = 3 * np.arange(m), 3 * m + 2 * np.arange(m)
    t, disc = n[:, None] + np.array([1, 2]), bound + 1
    J[t, t] += at.h[:, None]
    J[t, n[:, None]] -= (at.h * at.slope)[:, None] * at.y
    J[n, bound] = J[bound, n] = -1.0
    J[t, disc[:, None]] = J[disc[:, None], t] = at.y
    J[disc, n] = -at.k
    dropped = np.concatenate([t[~at.frictional].ravel(), disc[~at.frictional]])
    J[dropped], J[:, dropped] = 0.0, 0.0
    J[dropped, dropped] = 1.0
    J[bound, bound], J[disc, disc] = -at.D22[:, 0], -at.D22[:, 1]
    return J
