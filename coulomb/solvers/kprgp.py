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
from .friction_problem import FrictionProblem, SolverSettings, Task
from .results import ActiveSetStep, Progress, SolverResult, Status, StepKind
from .settings import within

_PATIENCE: Final = 1000  # steps without a better residual after the certificate has refused an answer
_ON_CIRCLE: Final = 1.0 - 1e-13  # a projected point lies on its circle up to rounding


@dataclass(frozen=True)
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
        over, (goal, start, _, progress) = qp.reductions, task
        a = self.step / norm_of(qp)
        x = qp.completed(qp.project(np.zeros_like(qp.b) if start is None else start))
        gradient = qp.gradient(x)
        residual = qp.residual(x, gradient)
        best, best_at = residual, 0
        reached = goal.reached(residual, x)
        history: list[ActiveSetStep] = []
        split = _split(qp, x, gradient, a)
        p, status = split.phi, Status.MAX_ITERATIONS
        while not reached and len(history) < self.max_iterations:
            reduced = (x - qp.project(x - a * split.phi.ravel())) / a
            krylov = 0
            if over.dot(split.beta, split.beta) <= self.proportionality**2 * over.dot(reduced, split.phi.ravel()):
                A_p = np.empty_like(x)
                qp.A.mult(p.ravel(), A_p)
                krylov, curvature = 1, over.dot(p.ravel(), A_p)
                slope = over.dot(gradient, p.ravel())
                to_minimum = slope / curvature if curvature > 0.0 else math.inf if slope > 0.0 else 0.0
                to_boundary = _feasible_step(qp, x.reshape(-1, 3), p, split.free)
                if to_minimum <= to_boundary:
                    kind: StepKind = "cg"
                    x, gradient = x - to_minimum * p.ravel(), gradient - to_minimum * A_p
                    split = _split(qp, x, gradient, a)
                    p = split.phi - (over.dot(split.phi.ravel(), A_p) / curvature * p if curvature > 0.0 else 0.0)
                else:
                    kind = "expansion"
                    x, gradient = x - to_boundary * p.ravel(), gradient - to_boundary * A_p
                    phi = _split(qp, x, gradient, a).phi
                    x, gradient, split = self._projected(qp, x - a * phi.ravel(), a)
                    p = split.phi
            else:
                kind = "proportioning"
                x, gradient, split = self._projected(qp, x - a * split.beta.ravel(), a)
                p = split.phi
            residual = qp.residual(x, gradient)
            if (
                residual <= goal.residual and kind == "cg"
            ):  # the gradient was updated: compute the residual with a fresh product
                gradient = qp.gradient(x)
                residual = qp.residual(x, gradient)
            reached = goal.reached(residual, x)
            stationarity = over.norm(split.phi + split.beta)
            history.append(ActiveSetStep(len(history) + 1, residual, krylov, kind, stationarity))
            if progress is not None and progress(Progress(0, len(history), residual)):
                status = Status.INTERRUPTED
                break
            if residual < 0.9 * best:
                best, best_at = residual, len(history)
            if goal.refused and len(history) - best_at >= _PATIENCE:
                status = Status.STAGNATED
                break
        result = SolverResult(
            x=x,
            gradient=gradient,
            slip_bound=qp.slip_bound(x),
            multipliers=_multipliers(qp, x, gradient),
            status=goal.verdict(residual, x, status),
            residual=residual,
            history=tuple(history),
        )
        message = f"KPRGP ended with a residual of {residual:.1e} after {len(history)} steps ({result.status.value}), "
        return result if result.status is Status.CONVERGED else replace(result, message=message + goal.missed(residual))

    def _projected(self, qp: FrictionProblem, x: FloatArray, a: float) -> tuple[FloatArray, FloatArray, Split]:
        """P(x), the gradient there by a fresh product, and its split."""
        x = qp.project(x)
        gradient = qp.gradient(x)
        return x, gradient, _split(qp, x, gradient, a)


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
