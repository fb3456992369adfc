"""The Newton system of a PF step by dense algebra: for small problems on which CG with a nodal preconditioner fails."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..arrays import FloatArray
from .newton_systems import Linearization, NewtonStep
from .scaled_compliance import FreshImages, ScaledCompliance


def augmented_matrix(A: FloatArray, at: Linearization) -> FloatArray:
    """J_AM = [J11 J12; J21 -D22] with this A, shape (5 m, 5 m); with diag(A) in its place, P_AM.

    The tangential pair of a node without a disc is replaced by the identity.
    """
    m = len(at.h)
    J = np.zeros((5 * m, 5 * m))
    J[: 3 * m, : 3 * m] = A
    t = np.arange(m)[:, None] * 3 + np.array([1, 2])
    J[t, t] += at.h[:, None]
    J[3 * np.arange(m), 3 * m + 2 * np.arange(m)] = -1.0
    J[t, 3 * m + 2 * np.arange(m)[:, None] + 1] = at.y
    dropped = t[~at.frictional].ravel()
    J[dropped], J[:, dropped] = 0.0, 0.0
    J[dropped, dropped] = 1.0
    J[3 * m :, : 3 * m] = J[: 3 * m, 3 * m :].T
    J[3 * m + np.arange(2 * m), 3 * m + np.arange(2 * m)] = -at.D22.ravel()
    return J


def formed(A: ScaledCompliance) -> FloatArray:
    """A~ as a dense matrix, by as many products.

    Raises:
        ValueError: On more than one rank.
    """
    if A.comm.size > 1:
        raise ValueError("dense Newton systems work on one rank; use a Krylov one: solver.newton of the case file")
    matrix: FloatArray = np.array([A.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * A.nodes)]).T
    return matrix


class DenseSystem(FreshImages):
    """J_AM factorised (LU, scaled symmetrically); on one rank, 3 m products to get A and (5 m)^3 work a step.

    Slower than CG where that converges, and indifferent to the condition of A: rank-deficient problems with slip bounds
    over many orders of magnitude are solved by this alone.

    Raises:
        ValueError: From the constructor, on more than one rank.
    """

    def __init__(self, A: ScaledCompliance):
        super().__init__(A)
        self._A = formed(A)

    def solve(self, at: Linearization, r1: FloatArray, r2: FloatArray, tolerance: float, cap: float) -> NewtonStep:
        """The step, as exact as rounding allows; tolerance and cap have no say."""
        J = augmented_matrix(self._A, at)
        scale = 1.0 / np.sqrt(np.abs(np.diag(J)) + 1e-3 * np.abs(J).max(axis=1))
        factors = scipy.linalg.lu_factor(scale[:, None] * J * scale, overwrite_a=True, check_finite=False)
        solution = scale * scipy.linalg.lu_solve(factors, scale * np.concatenate([r1.ravel(), r2.ravel()]))
        dx = solution[: r1.size].reshape(r1.shape)
        A_dx = (self._A @ dx.ravel()).reshape(r1.shape)
        return NewtonStep(dx, solution[r1.size :].reshape(r2.shape), A_dx, 0)

    def destroy(self) -> None:
        """Nothing of PETSc's to give back."""
