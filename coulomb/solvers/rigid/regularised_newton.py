"""Semismooth Newton steps on regularised problems, for a compliance without full rank: forces of least norm.

    w = A x - b + eps a x - G^T alpha,   eps from 1 down to 0,   a the mean diagonal of A

For eps = 1 the problem is well conditioned and Newton's method converges from x = 0; every further eps begins from the
forces of the one before.  Where its steps end elsewhere, they are tried with other weights of forces against
displacements, which moves the kinks of the equations (contact_equations.py), and then a shorter step of eps is taken.
With given slip bounds the regularised problem is strictly convex, |x| is at most that of any solution, and x tends to
the solution of least norm (A. N. Tikhonov).  Forces in the null space of A, that interior-point methods leave at the
size of their start or let grow, do not arise.

Not proved: that Newton's method converges for each eps, nor, with friction that grows with pressure, that the
regularised problems have solutions that lead to eps = 0.  It is tried on small problems, and counts its systems.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from ...arrays import FloatArray
from ...linalg.compliance import MatrixCompliance
from ..contact_equations import ContactDerivative, ContactEquations
from ..driver import Answer, result_of
from ..equilibrium import balanced_forces
from ..friction_problem import FrictionProblem, SolverSettings, Task
from ..results import Progress, QPStep, SolverResult, Status
from ..rigid_motions import NO_MOTION
from ..settings import within
from .cone_interior_point import ConeInteriorPoint
from .cones import Scales

_WEIGHTS = (1.0, 0.1, 10.0, 0.01, 100.0)
_STEPS: Final = 25  # of Newton's method for one eps and weight
_SHORTEST: Final = 1e-3  # length of a step
_SOLVED, _EXACT = 1e-9, 1e-13  # what the equations may leave over, over 1 + |x|; below which steps end
_SLOWEST: Final = 1e-3  # step of log10 eps below which the regularised problem is left as it is
_LAST: Final = -12.0  # log10 eps
_LEAST: Final = 1e-6  # diagonal of a node over a, for the weights


@dataclass(frozen=True)
class RegularisedNewton(SolverSettings):
    """The method as a value, for a matrix A on one rank.

    Without it `MatrixAutomatic` gives up 7 of 300 random problems without full rank in place of 2
    (tests/singular_problems.py), takes three times as long, and forces under given slip bounds are more than 1 % larger
    in 51 of 92 of them, 23,000 times in one.

    A start is not used.  `solve` raises NotConverged with the status NO_EQUILIBRIUM, if no contact forces balance the
    loads of a body that contact alone holds.

    Attributes:
        tolerance: Residual at which to stop (`FrictionProblem.residual`).
        systems: Newton systems, dense, until it gives up.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    systems: int = within("[1, inf)", 1000)

    name = "regularised Newton"

    def suits(self, problem: FrictionProblem) -> bool:
        """Whether A is a matrix on one rank."""
        return isinstance(problem.A, MatrixCompliance) and problem.A.comm.size == 1

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        if not self.suits(problem):
            raise ValueError(f"the {self.name} method is for A as a matrix on one rank; use Automatic()")
        balanced_forces(problem, self.name)
        return _Run(self, problem, task).follow()


class _Ended(Exception):
    """The answer is found, the run interrupted, or all systems spent."""


class _Run:
    """The solution of one problem; forces in units of s, displacements of a s."""

    def __init__(self, settings: RegularisedNewton, problem: FrictionProblem, task: Task):
        assert isinstance(problem.A, MatrixCompliance)
        self._settings, self._problem, self._goal, self._progress = settings, problem, task.goal, task.progress
        self._history = list[QPStep]()
        a, m, rigid = problem.mean_diagonal, problem.A.nodes, problem.rigid
        alone, loads = (float(np.abs(forces).max()) for forces in (problem.project(problem.b / a), problem.b / a))
        self._a, self._s = a, alone or loads or 1.0  # a gap is far larger than the others' forces need
        self._e = NO_MOTION
        self._G: FloatArray = np.empty((0, 3 * m))
        self._T: FloatArray = np.empty((0, 0))
        if rigid is not None:
            basis = problem.motion_basis
            self._s = max(self._s, basis.distance(rigid.e))
            self._T, self._G, self._e = basis.T, basis.rows, basis.T @ rigid.e / self._s
        s = self._s
        self._A: FloatArray = problem.A.sparse().toarray() / a
        self._b: FloatArray = problem.b / (a * s)
        law = problem.law.scaled(s).only(problem.frictional, 0.0)
        self._d = np.maximum(self._A.diagonal().reshape(m, 3).max(axis=1), _LEAST)
        lower: FloatArray = np.broadcast_to(np.asarray(problem.lower, dtype=float) / s, (m,))
        self._equations = [ContactEquations(law, lower, problem.frictional, k * self._d, k * self._d) for k in _WEIGHTS]
        self._scales = Scales.of(problem) if ConeInteriorPoint().suits(problem) else None
        self._best: tuple[float, FloatArray, FloatArray] = np.inf, np.zeros(3 * m), np.zeros(self._T.shape[1])
        self._status = Status.STAGNATED

    def follow(self) -> SolverResult:
        """eps from 1 to 0, as far as it succeeds, then about the forces found."""
        zero = np.zeros(len(self._b) + len(self._e))
        try:
            derivative, solved = self._solved(zero, zero, 1.0)
            log, step = 0.0, 1.0
            while log > _LAST:
                v, solved = self._solved(derivative, zero, 10.0 ** max(log - step, _LAST))
                if solved or step < _SLOWEST:
                    derivative, log, step = v, max(log - step, _LAST), min(2.0 * step, 1.0) if solved else 1.0
                else:
                    step *= 0.4
            for _ in range(3):
                derivative, _ = self._solved(derivative, derivative, 1e-10)
        except _Ended:
            pass
        return self._result()

    def _solved(self, v: FloatArray, centre: FloatArray, eps: float) -> tuple[FloatArray, bool]:
        """Forces and motions (3 m + r,) for w = A x - b + eps (x - centre), from v, and whether they solve it."""
        best, at_best, close = np.inf, v, _SOLVED
        for equations in self._equations:
            new = self._newton(equations, v, centre, eps)
            left = self._left(self._equations[0], new, centre, eps)[1]
            if left < best:
                best, at_best = left, new
            close = _SOLVED * (1.0 + float(np.linalg.norm(at_best)))
            if best <= close:
                break
        self._judged(at_best)
        return at_best, best <= close

    def _left(
        self, equations: ContactEquations, v: FloatArray, centre: FloatArray, eps: float
    ) -> tuple[ContactDerivative, float, FloatArray]:
        """The equations at v, what they leave over, and what G x - e does."""
        n = len(self._b)
        x = v[:n]
        w = self._A @ x - self._b + eps * (x - centre[:n]) - v[n:] @ self._G
        derivative, lacking = equations.at(x.reshape(-1, 3), w.reshape(-1, 3)), self._G @ x - self._e
        return derivative, float(np.hypot(np.linalg.norm(derivative.value), np.linalg.norm(lacking))), lacking

    def _newton(self, equations: ContactEquations, v: FloatArray, centre: FloatArray, eps: float) -> FloatArray:
        """Newton steps as long as they decrease what is left over."""
        derivative, left, lacking = self._left(equations, v, centre, eps)
        for _ in range(_STEPS):
            if left <= _EXACT * (1.0 + float(np.linalg.norm(v))):
                break
            dv = self._step(derivative, lacking, eps)
            if not np.isfinite(dv).all():
                break
            length = 1.0
            while length > _SHORTEST:
                new = v + length * dv
                derivative, changed, lacking = self._left(equations, new, centre, eps)
                if changed < (1.0 - 1e-4 * length) * left:
                    break
                length *= 0.5
            else:
                break
            v, left = new, changed
        return v

    def _step(self, derivative: ContactDerivative, lacking: FloatArray, eps: float) -> FloatArray:
        """The Newton step, one system [P + Q (A + eps), -Q G^T; G, 0]."""
        if len(self._history) >= self._settings.systems:
            self._status = Status.MAX_ITERATIONS
            raise _Ended
        n, m = len(self._b), len(derivative.P)
        J = np.zeros((n + len(self._e), n + len(self._e)))
        J[:n, :n] = (derivative.Q @ self._A.reshape(m, 3, n)).reshape(n, n)
        nodal = np.arange(n).reshape(m, 3)
        J[nodal[:, :, None], nodal[:, None, :]] += derivative.P + eps * derivative.Q
        J[:n, n:], J[n:, :n] = -(derivative.Q @ self._G.T.reshape(m, 3, -1)).reshape(n, -1), self._G
        *_, dv, singular = scipy.linalg.lapack.dgesv(J, -np.concatenate([derivative.value.ravel(), lacking]), 1, 1)
        number = len(self._history) + 1
        self._history.append(QPStep(number, self._best[0], 0))
        if self._progress is not None and self._progress(Progress(0, number, self._best[0])):
            self._status = Status.INTERRUPTED
            raise _Ended
        return dv if singular == 0 else np.full(len(dv), np.nan)

    def _judged(self, v: FloatArray) -> None:
        """Judge an answer afresh, within the bounds of friction: of a contact whose compliance is small, what is
        beyond its bound counts more in other units."""
        problem, n = self._problem, len(self._b)
        forces = problem.project(problem.completed(self._s * v[:n]))
        alpha: FloatArray = self._a * self._s * (self._T.T @ v[n:])
        residual = self._residual(forces, problem.gradient(forces, alpha))
        if residual < self._best[0]:
            self._best = residual, forces, alpha
        if self._goal.reached(residual, forces, alpha):
            self._best = residual, forces, alpha
            raise _Ended

    def _residual(self, x: FloatArray, gradient: FloatArray) -> float:
        """As the cone method measures it, for problems that suit it; newtons and metres."""
        if self._scales is not None:
            return self._scales.residual(self._problem, x, gradient)
        return self._problem.residual(x, gradient)

    def _result(self) -> SolverResult:
        _, x, alpha = self._best
        answer = Answer(x, self._problem.without_motion(x), alpha)
        return result_of(self._problem, self._goal, answer, None, self._status, self._history, self._residual)
