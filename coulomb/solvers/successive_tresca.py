"""Successive Tresca problems, g <- r(x_n) = c + F x_n, until the residual of the problem with friction is small
enough."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .equilibrium import balanced_forces
from .friction_problem import FrictionProblem, Solver, SolverSettings, Task
from .interior_point import InteriorPoint
from .newton_systems import AugmentedSystem
from .results import Goal, NotConverged, OuterStep, Progress, ProgressCallback, SolverResult, Status
from .settings import within

_RANK_DEFICIENT: Final = 1e-12
"""Eigenvalues of the normal equations below this fraction of the largest are rounding errors."""


class Anderson:
    """Anderson acceleration of a fixed point g <- G(g), type II: the combination of the last points whose residual is
    smallest, to first order (D. G. Anderson, J. ACM 12, 1965; H. F. Walker, P. Ni, SIAM J. Numer. Anal. 49, 2011).

    `memory` differences are kept; 0 is the plain, damped iteration.
    """

    def __init__(self, memory: int, over: Reductions):
        self._memory, self._over = memory, over
        self._points: list[tuple[FloatArray, FloatArray]] = []

    def restart(self) -> None:
        """Discard the points so far."""
        self._points.clear()

    def next(self, g: FloatArray, residual: FloatArray, damping: float) -> FloatArray:
        """The point after g, which is stored; `residual` is G(g) - g, of which a fraction is added, in (0, 1]."""
        self._points.append((g, residual))
        del self._points[: -self._memory - 1]
        new: FloatArray = g + damping * residual
        if len(self._points) == 1:
            return new
        dg = np.column_stack([b[0] - a[0] for a, b in zip(self._points, self._points[1:], strict=False)])
        dr = np.column_stack([b[1] - a[1] for a, b in zip(self._points, self._points[1:], strict=False)])
        size = np.array([self._over.norm(column) for column in dr.T])
        kept = size > 0.0
        dg, dr = dg[:, kept] / size[kept], dr[:, kept] / size[kept]
        normal, right = self._over.totals(dr.T @ dr, dr.T @ residual)
        values, V = np.linalg.eigh(normal)
        solid = values > _RANK_DEFICIENT * max(values[-1:], default=0.0)
        weights = V[:, solid] @ ((V[:, solid].T @ right) / values[solid])
        new -= (dg + damping * dr) @ weights
        return new


_LEAST_DAMPING: Final = 0.05  # by the measured slope
_FINER: Final = 0.01  # part of the accuracy of Tresca problems that the worst contact needs
_ROUNDING: Final = 1e-14  # residual of a Tresca problem
_NEAR: Final = 0.1  # change of g below which acceleration starts: before, the map is too far from linear
_PATIENCE: Final = 12  # Tresca problems without a better change of g after which the iteration has stagnated
_TURNS: Final = 5  # successive changes of g, each opposite to the one before and none the smallest: an oscillation
_GROWTH = (8, 1e2)  # successive increases of the slip bound, and multiple of the first: divergence


@dataclass(frozen=True)
class SuccessiveTresca(SolverSettings):
    """Fixed-point iteration g <- r(x_n(g)) (Panagiotopoulos); every Tresca problem starts from the last answer.

    The first g is r(x_n) of the start, by default the cohesion; where rigid motions have no equilibrium with it, at
    least that of forces in equilibrium.  `history` has an OuterStep per Tresca problem.  NotConverged has the status
    STAGNATED, OSCILLATING, DIVERGED or MAX_ITERATIONS, with a diagnosis and advice.

    Attributes:
        tolerance: Residual at which to stop.
        qp_solver: Solver of the Tresca problems.
        inner_precision: Tolerance of a Tresca problem relative to the last residual, in (0, 1).
        memory: Differences kept by Anderson acceleration; 0 is the plain iteration.
        damping: The fraction of r(x_n) - g added to g, in (0, 1]; None chooses it by the measured slope of the map: on
            a wedge of slope s, where plain iteration has the factor -F/s, 1/(1 + F/s).
        max_iterations: Tresca problems before the solver gives up.
        newton_steps: Newton steps of all Tresca problems after which no further one begins.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    qp_solver: Solver = field(default_factory=lambda: InteriorPoint(r_tol=0.1, c_fact=0.9, newton=AugmentedSystem()))
    inner_precision: float = within("(0, 1)", 1e-2)
    memory: int = within("[0, inf)", 5)
    damping: float | None = within("(0, 1]", None)
    max_iterations: int = within("[1, inf)", 60)
    newton_steps: float = within("[1, inf]", math.inf)

    name = "successive Tresca"

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        over, A = problem.reductions, problem.A
        goal, start, _, progress = task
        anderson = Anderson(self.memory, over)
        balanced = balanced_forces(problem, self.name)
        g = problem.law.radius(np.zeros(problem.A.nodes)) if start is None else problem.slip_bound(start)
        old_g, old_image = None, None
        last: SolverResult | None = None
        best: tuple[float, SolverResult, FloatArray] | None = None
        residual, damping = 1.0, self.damping or 1.0
        whole, finer = 1.0, 1.0  # that of the bodies, and the accuracy for the worst contact where they reach the goal
        history: list[OuterStep] = []
        sizes: list[float] = []  # |r(x_n)|
        turns: list[float] = []  # cosines between successive r(x_n) - g
        misfit: FloatArray | None = None
        status, why = Status.MAX_ITERATIONS, ""
        for iteration in range(1, self.max_iterations + 1):
            began, before = time.perf_counter(), A.products
            inner = min(max(self.inner_precision * whole, 0.1 * goal.residual * finer, _ROUNDING), 1e-2)
            inner = inner if problem.sloped else goal.residual  # the only Tresca problem
            warm = last is not None
            last, steps, krylov, trouble = self._tresca(problem, g, last, inner, iteration, progress)
            if balanced is not None and last.equilibrium is not None:  # larger bounds have one
                g = np.maximum(g, problem.slip_bound(balanced))
                last, steps, krylov, trouble = self._tresca(problem, g, None, inner, iteration, progress)
            last = replace(last, x=problem.completed(last.x))  # where the slip is known, with r(x_n) in place of g
            image = problem.slip_bound(last.x)
            residual = problem.residual(last.x, last.gradient)
            whole = problem.residual_of_bodies(last.x, last.gradient)
            finer = _FINER if whole <= goal.residual else 1.0
            if best is None or residual < best[0]:
                best = (residual, last, g)
            old_misfit, misfit = misfit, image - g
            size = over.norm(image)
            sizes.append(size)
            if old_misfit is not None:
                turns.append(_cosine(old_misfit, misfit, over))
            contraction, slope = _measure(g, old_g, image, old_image, over)
            if self.damping is None and not math.isnan(slope):
                damping = max(1.0 / (1.0 - min(slope, 0.0)), _LEAST_DAMPING)
            history.append(
                OuterStep(
                    iteration=iteration,
                    residual=residual,
                    change=_ratio(over.norm(misfit), max(size, over.norm(g))),
                    contraction=contraction,
                    slope=slope,
                    damping=damping,
                    inner_tolerance=inner,
                    path_following=steps,
                    products=A.products - before,
                    krylov=krylov,
                    warm=warm,
                    seconds=time.perf_counter() - began,
                )
            )
            if goal.reached(residual, last.x, last.rigid):
                break
            if last.status is Status.INTERRUPTED:
                status, why = Status.INTERRUPTED, trouble
                break
            if trouble and last.residual > 0.1 * residual:
                status, why = Status.STAGNATED, trouble
                break
            seen = _diagnosis(history, sizes, turns)
            if seen is not None:
                status = seen
                break
            if sum(step.path_following for step in history) >= self.newton_steps:
                break
            old_g, old_image = g, image
            if history[-1].change > _NEAR or (len(history) > 1 and history[-1].change > history[-2].change):
                anderson.restart()
            g = np.maximum(anderson.next(g, misfit, damping), 0.0)
        assert best is not None
        _, last, g = best
        gradient = problem.gradient(last.x, last.rigid)
        residual = problem.residual(last.x, gradient)
        result = SolverResult(
            x=last.x,
            gradient=gradient,
            slip_bound=np.where(problem.known_slip, problem.slip_bound(last.x), g),
            multipliers=last.multipliers,
            status=goal.verdict(residual, last.x, status, last.rigid),
            outer_steps=len(history),
            newton_steps=sum(step.path_following for step in history),
            residual=residual,
            history=tuple(history),
            contraction=_contraction(history),
            rigid=last.rigid,
        )
        return result if result.status is Status.CONVERGED else replace(result, message=_message(goal, result, why))

    def _tresca(
        self,
        problem: FrictionProblem,
        g: FloatArray,
        last: SolverResult | None,
        tolerance: float,
        outer: int,
        progress: ProgressCallback | None,
    ) -> tuple[SolverResult, int, int, str]:
        """A Tresca problem from the last answer and, if that fails, from a cold start.

        Returns:
            Its answer, the steps and Krylov iterations of both, and an error message or nothing.
        """

        def report(p: Progress) -> bool | None:
            return progress is not None and progress(replace(p, outer=outer))

        steps = krylov = 0
        trouble = ""
        for start in (last, None) if last is not None else (None,):
            try:
                result = self.qp_solver.solve(
                    problem.with_slip_bound(g, together=problem.sloped),
                    None if start is None else start.x,
                    gradient=None if start is None else start.gradient,
                    tolerance=tolerance,
                    progress=report,
                )
                trouble = ""
            except NotConverged as failure:
                result, trouble = failure.result, str(failure)
            steps += len(result.history)
            krylov += sum(step.krylov for step in result.history)
            if not trouble or result.status is Status.INTERRUPTED:
                break
        return result, steps, krylov, trouble


def _diagnosis(history: list[OuterStep], sizes: list[float], turns: list[float]) -> Status | None:
    """Failure status from the changes of the slip bound; None while it may converge."""
    changes = [step.change for step in history]
    first = next((size for size in sizes if size > 0.0), math.inf)
    times, multiple = _GROWTH
    grown = len(sizes) > times and sizes[-1] > multiple * first
    if grown and all(new > 1.1 * old for old, new in pairwise(sizes[-times - 1 :])):
        return Status.DIVERGED
    if _not_decreasing(changes, _TURNS) and all(turn < -0.5 for turn in turns[-_TURNS:]):
        return Status.OSCILLATING
    if _not_decreasing(changes, _PATIENCE):
        return Status.STAGNATED
    return None


def _cosine(v: FloatArray, w: FloatArray, over: Reductions) -> float:
    return _ratio(over.dot(v, w), over.norm(v) * over.norm(w))


def _ratio(part: float, whole: float) -> float:
    """part / whole, 0 if whole is 0."""
    return part / whole if whole > 0.0 else 0.0


def _measure(
    g: FloatArray, old_g: FloatArray | None, image: FloatArray, old_image: FloatArray | None, over: Reductions
) -> tuple[float, float]:
    """Contraction and slope of the map between its last two arguments; nan where there are none."""
    if old_g is None or old_image is None:
        return math.nan, math.nan
    dg, change = g - old_g, image - old_image
    size = over.norm(dg)
    if size == 0.0:
        return math.nan, math.nan
    return over.norm(change) / size, over.dot(dg / size, change / size)


def _not_decreasing(changes: list[float], count: int) -> bool:
    """Whether none of the last `count` changes is significantly smaller than those before."""
    return len(changes) > count and min(changes[-count:]) > 0.9 * min(changes[:-count])


def _message(goal: Goal, result: SolverResult, why: str) -> str:
    """Diagnosis and advice."""
    residuals = ", ".join(f"{step.residual:.1e}" for step in result.history[-4:])
    advice = {
        Status.OSCILLATING: "the slip bound oscillates between two states; use damping=None or memory > 0",
        Status.DIVERGED: "the slip bound diverges: friction locks the body, or there is no equilibrium nearby",
        Status.STAGNATED: "the slip bound does not converge; try InteriorPoint, in a case file method = interior-point",
        Status.INTERRUPTED: "",
        Status.MAX_ITERATIONS: "more Tresca problems (max_iterations), or InteriorPoint (method = interior-point)",
    }[result.status]
    return (
        f"successive Tresca ended with a residual of {result.residual:.1e} after {result.outer_steps} Tresca "
        f"problems ({result.status.value}), {goal.missed(result.residual)}; the map from slip bound to "
        f"r(x_n) has the factor {result.contraction:.2g}; last residuals {residuals}; {why or advice}"
    )


def _contraction(history: list[OuterStep]) -> float:
    """Geometric mean of the last three measured factors; nan if there is none."""
    rates = [step.contraction for step in history if step.contraction > 0.0][-3:]
    return math.exp(sum(map(math.log, rates)) / len(rates)) if rates else math.nan
