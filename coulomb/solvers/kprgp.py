"""KPRGP: conjugate gradients with proportioning and reduced gradient projections, the active-set baseline of the paper.

R. Kucera: Convergence rate of an optimization algorithm for minimizing quadratic functions with separable convex
constraints, SIAM J. Optim. 19 (2008); Z. Dostal and J. Schoberl for bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from .driver import Answer, drive, result_of
from .friction_problem import FrictionProblem, SolverSettings, Task
from .results import ActiveSetStep, Goal, SolverResult, Status, StepKind
from .settings import within

_PATIENCE: Final = 1000  # steps without a better residual after the certificate has refused an answer
_ON_CIRCLE: Final = 1.0 - 1e-13  # a projected point lies on its circle up to rounding


@dataclass(frozen=True, eq=False)
class Split:
    """The gradient at x, split into its parts on free and on active unknowns.

    Attributes:
        free: Components of free unknowns, shape (m, 3): inactive bounds, points inside their disc.
        phi: Free gradient, the gradient on free unknowns and 0 on active ones, shape (m, 3).
        beta: Chopped gradient on active ones, 0 on free ones, shape (m, 3); phi + beta = 0 exactly at the solution.
    """

    free: npt.NDArray[np.bool_]
    phi: FloatArray
    beta: FloatArray


@dataclass(frozen=True)
class KPRGP(SolverSettings):
    """Algorithm KPRGP as a value, for Tresca problems without rigid motions.

    Attributes:
        tolerance: Natural residual of the QP at which to stop (`FrictionProblem.residual`), as for InteriorPoint.
        proportionality: Gamma > 0: CG goes on while |beta|^2 <= Gamma^2 phi~^T phi.
        step: Fixed step of the gradient projections, times |A|, in (0, 2).
        max_iterations: Steps of all kinds before the solver gives up.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    proportionality: float = within("(0, inf)", 1.0)
    step: float = within("(0, 2)", 1.9)
    max_iterations: int = within("[1, inf)", 20_000)

    name = "KPRGP"

    def _solved(self, qp: FrictionProblem, task: Task) -> SolverResult:
        if qp.sloped:
            raise ValueError(
                "KPRGP solves problems with given slip bounds; where friction grows with pressure use "
                "InteriorPoint() or SuccessiveTresca(qp_solver=KPRGP())"
            )
        if qp.rigid is not None:
            raise ValueError(
                "KPRGP solves problems whose bodies are all held by supports; for bodies that contact alone holds use "
                "InteriorPoint() or SuccessiveTresca()"
            )
        goal, start = task.goal, task.start
        at = _Steps(self, qp, qp.completed(qp.project(np.zeros_like(qp.b) if start is None else start)), goal)
        status = drive(at, goal, at.history, self.max_iterations, task.progress, qp.residual(at.x, at.gradient))
        answer = Answer(at.x, at.gradient)
        result = result_of(qp, goal, answer, _multipliers(qp, at.x, at.gradient), status, at.history)
        message = (
            f"KPRGP ended with a residual of {result.residual:.1e} after {len(at.history)} steps "
            f"({result.status.value}), {goal.missed(result.residual)}"
        )
        return replace(result, newton_steps=0, message="" if result.status is Status.CONVERGED else message)


class _Steps:
    """Steps from x (3 m,) in newtons, a `driver.Iteration`; gradient A x - b in metres, shape (3 m,)."""

    def __init__(self, settings: KPRGP, qp: FrictionProblem, x: FloatArray, goal: Goal):
        self._settings, self._qp, self._goal, self._a = settings, qp, goal, settings.step / norm_of(qp)
        self.history: list[ActiveSetStep] = []
        self.x, self.gradient = x, qp.gradient(x)
        self._split = _split(qp, x, self.gradient, self._a)
        self._p, self._best, self._best_at = self._split.phi, qp.residual(x, self.gradient), 0

    def step(self) -> ActiveSetStep:
        qp, split, a, krylov = self._qp, self._split, self._a, 0
        kind: StepKind = "proportioning"
        over, x = qp.reductions, self.x
        reduced = (x - qp.project(x - a * split.phi.ravel())) / a
        proportional = self._settings.proportionality**2 * over.dot(reduced, split.phi.ravel())
        if over.dot(split.beta, split.beta) <= proportional:
            kind, krylov = self._conjugate_step(), 1
        else:
            self._to_projection(x - a * split.beta.ravel())
        residual = qp.residual(self.x, self.gradient)
        if residual <= self._goal.residual and kind == "cg":  # the gradient was updated: a fresh product decides
            self.gradient = qp.gradient(self.x)
            residual = qp.residual(self.x, self.gradient)
        stationarity = over.norm(self._split.phi + self._split.beta)
        return ActiveSetStep(len(self.history) + 1, residual, krylov, kind, stationarity)

    def _conjugate_step(self) -> StepKind:
        """A CG step on the free unknowns; to the boundary and beyond, projected, if that is nearer."""
        qp, p = self._qp, self._p
        over, A_p = qp.reductions, np.empty_like(self.x)
        qp.A.mult(p.ravel(), A_p)
        curvature, slope = over.dot(p.ravel(), A_p), over.dot(self.gradient, p.ravel())
        to_minimum = slope / curvature if curvature > 0.0 else math.inf if slope > 0.0 else 0.0
        to_boundary = _feasible_step(qp, self.x.reshape(-1, 3), p, self._split.free)
        length = min(to_minimum, to_boundary)
        self.x, self.gradient = self.x - length * p.ravel(), self.gradient - length * A_p
        self._split = _split(qp, self.x, self.gradient, self._a)
        if to_minimum > to_boundary:
            self._to_projection(self.x - self._a * self._split.phi.ravel())
            return "expansion"
        phi = self._split.phi
        self._p = phi - (over.dot(phi.ravel(), A_p) / curvature * p if curvature > 0.0 else 0.0)
        return "cg"

    def _to_projection(self, x: FloatArray) -> None:
        """To P(x), with the gradient there by a fresh product."""
        self.x = self._qp.project(x)
        self.gradient = self._qp.gradient(self.x)
        self._split = _split(self._qp, self.x, self.gradient, self._a)
        self._p = self._split.phi

    def answer(self) -> Answer:
        return Answer(self.x, self.gradient)

    def stop(self) -> Status | None:
        residual, made = self.history[-1].residual, len(self.history)
        if residual < 0.9 * self._best:
            self._best, self._best_at = residual, made
        return Status.STAGNATED if self._goal.refused and made - self._best_at >= _PATIENCE else None


def norm_of(qp: FrictionProblem) -> float:
    """|A|, its largest eigenvalue, by the power method, in metres per newton; one product per step.

    Increased by the precision of 1 %: a step of 1.9/|A| must stay below 2/|A|.
    """
    over = qp.reductions
    v: FloatArray = np.random.default_rng([1913, qp.A.comm.rank]).standard_normal(qp.b.shape)
    v /= over.norm(v)
    value, w = 0.0, np.empty_like(v)
    for _ in range(100):
        qp.A.mult(v, w)
        old, value = value, over.norm(w)
        v = w / value
        if abs(value - old) <= 1e-3 * value:
            break
    return 1.01 * value


def _split(qp: FrictionProblem, x: FloatArray, gradient: FloatArray, a: float) -> Split:
    v, g, r = x.reshape(-1, 3), qp.slip_bound(x), gradient.reshape(-1, 3)
    free = np.empty(v.shape, dtype=bool)
    free[:, 0] = v[:, 0] > qp.lower
    free[:, 1:] = (np.hypot(v[:, 1], v[:, 2]) < _ON_CIRCLE * g)[:, None]
    projected = ((x - qp.project(x - a * gradient)) / a).reshape(-1, 3)
    inward = np.einsum("ij,ij->i", v[:, 1:], r[:, 1:]) > 0.0  # -gradient leads into the disc
    chopped = np.column_stack([np.minimum(r[:, 0], 0.0), np.where(inward[:, None], r[:, 1:], projected[:, 1:])])
    return Split(free, np.where(free, r, 0.0), np.where(free, 0.0, chopped))


def _feasible_step(qp: FrictionProblem, x: FloatArray, p: FloatArray, free: npt.NDArray[np.bool_]) -> float:
    """Largest step along -p that keeps the free unknowns feasible; inf if there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(free[:, 0] & (p[:, 0] > 0.0), (x[:, 0] - qp.lower) / p[:, 0], np.inf)
        squared, outward = np.sum(p[:, 1:] ** 2, axis=1), -np.sum(p[:, 1:] * x[:, 1:], axis=1)
        room = qp.slip_bound(x.ravel()) ** 2 - np.sum(x[:, 1:] ** 2, axis=1)
        root = room / (outward + np.sqrt(outward**2 + squared * room))
    disc = root[free[:, 1] & (squared > 0.0)]
    return min(qp.reductions.min(bound), qp.reductions.min(disc))


def _multipliers(qp: FrictionProblem, x: FloatArray, gradient: FloatArray) -> FloatArray:
    """Multipliers of the bounds and of the discs in metres, shape (m, 2), from the gradient."""
    v, r = x.reshape(-1, 3), gradient.reshape(-1, 3)
    bound = np.where(v[:, 0] > qp.lower, 0.0, np.maximum(r[:, 0], 0.0))
    size = np.hypot(v[:, 1], v[:, 2])
    along = -np.einsum("ij,ij->i", v[:, 1:], r[:, 1:]) / np.where(size > 0.0, size, 1.0)
    on_circle = (size >= _ON_CIRCLE * qp.slip_bound(x.ravel())) & (size > 0.0)
    return np.column_stack([bound, np.where(on_circle, np.maximum(along, 0.0), 0.0)])
