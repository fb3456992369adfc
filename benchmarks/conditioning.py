"""Theorem 1 and Figure 1 of the paper: spectra of the Newton systems along a path-following run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from coulomb.arrays import FloatArray
from coulomb.solvers.friction_problem import FrictionProblem
from coulomb.solvers.interior_point import InteriorPoint
from coulomb.solvers.linearization import Linearization
from coulomb.solvers.newton_systems import AugmentedSystem, NewtonEquations, NewtonStep, NewtonSystem, augmented_matrix
from coulomb.solvers.scaled_problem import ScaledCompliance, ScaledProblem


@dataclass(frozen=True)
class Spectra:
    """The Newton system of one step, with dense algebra.

    Attributes:
        iteration: Step number, from 1.
        cond_J_AM: Condition number of J_AM.
        cond_J_SC: Condition number of J_SC.
        augmented: Eigenvalues of P_AM^-1 J_AM, complex if rounding makes them so, shape (5 m,).
        schur: Eigenvalues of P_SC^-1 J_SC, ascending, shape (3 m,).
        lower: Theorem 1's bound a_min/d_max; a_min the smallest eigenvalue of A, d_max its largest diagonal entry.
        upper: Theorem 1's bound a_max/d_min.
    """

    iteration: int
    cond_J_AM: float
    cond_J_SC: float
    augmented: FloatArray
    schur: FloatArray
    lower: float
    upper: float

    @property
    def cond_preconditioned_AM(self) -> float:
        """Largest over smallest modulus of the eigenvalues of P_AM^-1 J_AM."""
        size = np.abs(self.augmented)
        return float(size.max() / size.min())

    @property
    def cond_preconditioned_SC(self) -> float:
        return float(self.schur[-1] / self.schur[0])


def measure(qp: FrictionProblem, solver: InteriorPoint | None = None) -> list[Spectra]:
    """Spectra of every step of a run on a small problem whose nodes all have a disc, on one rank.

    Args:
        qp: The problem; matrices are dense, of size (5 m)^2.
        solver: Default: InteriorPoint(); its Newton system is replaced by a J_AM/P_AM that records its linearisations.
    """
    seen: list[Linearization] = []

    class Recorded(AugmentedSystem):
        def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
            system = super().system(A, sloped)
            solve = system.solve

            def recorded(wanted: NewtonEquations) -> NewtonStep:
                seen.append(wanted.at)
                return solve(wanted)

            system.solve = recorded  # type: ignore[method-assign, assignment]
            return system

    replace(solver or InteriorPoint(), newton=Recorded(rank=0)).solve(qp)
    A = scaled_matrix(qp)
    return [_spectra(number, A, at) for number, at in enumerate(seen, start=1)]


def scaled_matrix(qp: FrictionProblem) -> FloatArray:
    """A in the variables in which the solver works, dense, shape (3 m, 3 m)."""
    problem = ScaledProblem(qp)
    columns = [problem.A.mult(e.reshape(-1, 3)).ravel() for e in np.eye(3 * problem.nodes)]
    return np.array(columns).T


def matrices(A: FloatArray, at: Linearization) -> tuple[FloatArray, FloatArray]:
    """J_AM and J_SC with this A, dense; with diag(A) in its place, P_AM and P_SC.  Multipliers come last in J_AM."""
    J_AM, n = augmented_matrix(A, at), 3 * len(at.h)
    J12 = J_AM[:n, n:]
    return J_AM, J_AM[:n, :n] + (J12 / at.D22.ravel()) @ J12.T


def _spectra(iteration: int, A: FloatArray, at: Linearization) -> Spectra:
    (J_AM, J_SC), (P_AM, P_SC) = matrices(A, at), matrices(np.diag(np.diag(A)), at)
    a, d = np.linalg.eigvalsh(A), np.diag(A)
    return Spectra(
        iteration=iteration,
        cond_J_AM=float(np.linalg.cond(J_AM)),
        cond_J_SC=float(np.linalg.cond(J_SC)),
        augmented=scipy.linalg.eigvals(J_AM, P_AM),
        schur=_generalized(J_SC, P_SC),
        lower=float(a[0] / d.max()),
        upper=float(a[-1] / d.min()),
    )


def _generalized(J: FloatArray, P: FloatArray) -> FloatArray:
    """Eigenvalues of P^-1 J for symmetric positive definite P, which is first scaled to a unit diagonal."""
    s = 1.0 / np.sqrt(np.diag(P))
    values: FloatArray = scipy.linalg.eigh(s[:, None] * J * s, s[:, None] * P * s, eigvals_only=True)
    return values
