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
from .driver import Answer, drive
from .equilibrium import balanced_forces
from .friction_problem import FrictionProblem, Solver, SolverSettings, Task
from .interior_point import InteriorPoint, smallest_force
from .newton_systems import AugmentedSystem
from .results import Goal, NotConverged, OuterStep, Progress, SolverResult, Status
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
_LEAST_RESIDUAL: Final = 1e-14  # residual of a Tresca problem
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
        steps = _Steps(self, problem, task)
        result = steps.result(drive(steps, task.goal, steps.history, self.max_iterations))
        if result.status in (Status.CONVERGED, Status.INTERRUPTED):
            return result
        # Below self-locking without loads slip bounds decrease, and with them the forces by which they are judged
        least = smallest_force(problem, task.goal)
        if least is None or least.status is not Status.CONVERGED:
            return result
        return replace(least, outer_steps=result.outer_steps, newton_steps=result.newton_steps, history=result.history)


class _Steps:
    """Tresca problems with slip bounds g (m,) in newtons, a `driver.Iteration`."""

    def __init__(self, settings: SuccessiveTresca, problem: FrictionProblem, task: Task):
        self._settings, self._problem, self._task = settings, problem, task
        self.history: list[OuterStep] = []
        self._anderson, self._balanced = (
            Anderson(settings.memory, problem.reductions),
            balanced_forces(problem, settings.name),
        )
        self._g = (
            problem.law.radius(np.zeros(problem.A.nodes)) if task.start is None else problem.slip_bound(task.start)
        )
        self._before: tuple[FloatArray, FloatArray] | None = None  # g and r(x_n) of the problem before
        self._last: SolverResult | None = None
        self._best: tuple[float, SolverResult, FloatArray] | None = None
        self._damping, self._misfit = settings.damping or 1.0, np.zeros_like(self._g)
        self._whole, self._finer = 1.0, 1.0  # residual of the bodies; accuracy for the worst contact where they pass
        self._sizes: list[float] = []  # |r(x_n)|
        self._turns: list[float] = []  # cosines between successive r(x_n) - g
        self._trouble = ""

    def step(self) -> OuterStep:
        settings, problem, goal = self._settings, self._problem, self._task.goal
        began, products, warm = time.perf_counter(), problem.A.products, self._last is not None
        if self.history:
            self._g = self._next()
        least = 0.1 * goal.residual * self._finer
        inner = min(max(settings.inner_precision * self._whole, least, _LEAST_RESIDUAL), 1e-2)
        inner = inner if problem.sloped else goal.residual  # the only Tresca problem
        last, path_following, krylov = self._tresca(inner)
        image, g = problem.slip_bound(last.x), self._g
        residual = problem.residual(last.x, last.gradient)
        self._whole = problem.residual_of_bodies(last.x, last.gradient)
        self._finer = _FINER if self._whole <= goal.residual else 1.0
        if self._best is None or residual < self._best[0]:
            self._best = (residual, last, g)
        change, contraction, slope = self._measured(image)
        if settings.damping is None and not math.isnan(slope):
            self._damping = max(1.0 / (1.0 - min(slope, 0.0)), _LEAST_DAMPING)
        self._last, self._before = last, (g, image)
        return OuterStep(
            iteration=len(self.history) + 1,
            residual=residual,
            change=change,
            contraction=contraction,
            slope=slope,
            damping=self._damping,
            inner_tolerance=inner,
            path_following=path_following,
            products=problem.A.products - products,
            krylov=krylov,
            warm=warm,
            seconds=time.perf_counter() - began,
        )

    def _next(self) -> FloatArray:
        """The next g; accelerated once the map is near to linear."""
        changes = [step.change for step in self.history[-2:]]
        if changes[-1] > _NEAR or (len(changes) > 1 and changes[-1] > changes[0]):
            self._anderson.restart()
        return np.maximum(self._anderson.next(self._g, self._misfit, self._damping), 0.0)

    def _measured(self, image: FloatArray) -> tuple[float, float, float]:
        """How far r(x_n) is from g, and contraction and slope of the map between the last two g; nan for the first."""
        over, g, before = self._problem.reductions, self._g, self._misfit
        size, self._misfit = over.norm(image), image - g
        self._sizes.append(size)
        if self.history:
            self._turns.append(_ratio(over.dot(before, self._misfit), over.norm(before) * over.norm(self._misfit)))
        contraction, slope = _measure(g, image, self._before, over)
        return _ratio(over.norm(self._misfit), max(size, over.norm(g))), contraction, slope

    def answer(self) -> Answer:
        assert self._last is not None
        return Answer(self._last.x, self._last.gradient, self._last.rigid)

    def stop(self) -> Status | None:
        assert self._last is not None
        if self._last.status is Status.INTERRUPTED:
            return Status.INTERRUPTED
        if self._trouble and self._last.residual > 0.1 * self.history[-1].residual:
            return Status.STAGNATED
        self._trouble = ""
        seen = _diagnosis(self.history, self._sizes, self._turns)
        made = sum(step.path_following for step in self.history)
        return Status.MAX_ITERATIONS if seen is None and made >= self._settings.newton_steps else seen

    def result(self, status: Status | None) -> SolverResult:
        """The best answer, with a product of its own."""
        problem, goal, history = self._problem, self._task.goal, self.history
        assert self._best is not None
        _, best, g = self._best
        gradient = problem.gradient(best.x, best.rigid)
        residual = problem.residual(best.x, gradient)
        result = SolverResult(
            x=best.x,
            gradient=gradient,
            slip_bound=np.where(problem.known_slip, problem.slip_bound(best.x), g),
            multipliers=best.multipliers,
            status=goal.verdict(residual, best.x, status or Status.STAGNATED, best.rigid),
            outer_steps=len(history),
            newton_steps=sum(step.path_following for step in history),
            residual=residual,
            history=tuple(history),
            contraction=_contraction(history),
            rigid=best.rigid,
        )
        if result.status is Status.CONVERGED:
            return result
        return replace(result, message=_message(goal, result, self._trouble))

    def _tresca(self, tolerance: float) -> tuple[SolverResult, int, int]:
        """The Tresca problem: its answer, steps and Krylov iterations; with larger bounds where these leave no
        equilibrium."""
        problem, balanced = self._problem, self._balanced
        last, steps, krylov = self._from(self._last, tolerance)
        if balanced is not None and last.equilibrium is not None:
            self._g = np.maximum(self._g, problem.slip_bound(balanced))
            last, steps, krylov = self._from(None, tolerance)
        return replace(last, x=problem.completed(last.x)), steps, krylov  # where the slip is known, with r(x_n)

    def _from(self, last: SolverResult | None, tolerance: float) -> tuple[SolverResult, int, int]:
        """The Tresca problem from the last answer and, if that fails, from a cold start: the answer, steps and Krylov
        iterations of both."""
        progress, outer = self._task.progress, len(self.history) + 1
        problem = self._problem.with_slip_bound(self._g, together=self._problem.sloped)

        def report(p: Progress) -> bool | None:
            return progress is not None and progress(replace(p, outer=outer))

        steps = krylov = 0
        for start in (last, None) if last is not None else (None,):
            x, gradient = (None, None) if start is None else (start.x, start.gradient)
            try:
                qp_solver, self._trouble = self._settings.qp_solver, ""
                result = qp_solver.solve(problem, x, gradient=gradient, tolerance=tolerance, progress=report)
            except NotConverged as failure:
                result, self._trouble = failure.result, str(failure)
            steps += len(result.history)
            krylov += sum(step.krylov for step in result.history)
            if not self._trouble or result.status is Status.INTERRUPTED:
                break
        return result, steps, krylov


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


def _ratio(part: float, whole: float) -> float:
    """part / whole, 0 if whole is 0."""
    return part / whole if whole > 0.0 else 0.0


def _measure(
    g: FloatArray, image: FloatArray, before: tuple[FloatArray, FloatArray] | None, over: Reductions
) -> tuple[float, float]:
    """Contraction and slope of the map between its last two arguments; nan where there are none."""
    if before is None:
        return math.nan, math.nan
    dg, change = g - before[0], image - before[1]
    size = over.norm(dg)
    if size == 0.0:
        return math.nan, math.nan
    return over.norm(change) / size, over.dot(dg / size, change / size)


def _not_decreasing(changes: list[float], count: int) -> bool:
    """Whether none of the last `count` changes is significantly smaller than those before."""
    return len(changes) > count and min(changes[-count:]) > 0.9 * min(changes[:-count])


OTHER_METHOD: Final = "; try InteriorPoint, in a case file method = interior-point"
"""Advice that ends a message."""


def _message(goal: Goal, result: SolverResult, why: str) -> str:
    """Diagnosis and advice."""
    residuals = ", ".join(f"{step.residual:.1e}" for step in result.history[-4:])
    advice = {
        Status.OSCILLATING: "the slip bound oscillates between two states; use damping=None or memory > 0",
        Status.DIVERGED: "the slip bound diverges: friction locks the body, or there is no equilibrium nearby",
        Status.STAGNATED: f"the slip bound does not converge{OTHER_METHOD}",
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
