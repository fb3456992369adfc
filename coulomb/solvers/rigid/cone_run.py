"""The run of the cone method on one problem: its parts in turn, work counted, each answer judged afresh."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...linalg.compliance import MatrixCompliance
from ..anderson import Anderson
from ..friction_problem import FrictionProblem
from ..results import Goal, InteriorPointStep, NotConverged, Progress, ProgressCallback, SolverResult, Status
from .cone_curve import ConeCurve
from .cone_path import ConePath, ConeStep
from .cone_problem import ConeProblem, Scales, answer
from .cones import radius
from .gauss_seidel import Sweeps, swept
from .impenetrability import contradiction

_SHORT = 0.4  # shortest step of the nonsmooth Newton method, ...
_SHORTEST = 1e-3  # ... and where it is patient
_LEAST, _LARGEST = 1e-11, 1e-3  # proximal term
_FULL = 1e-9  # and of steps of full length
_NEAR = 1e-2  # size of the natural map at which the path is left for Newton steps, ...
_NEARER = 0.1  # and factor by which it decreases before they are tried again
_STALLED = 15  # steps of the path without progress after which it ends
_PER_MICROSECOND = 1e4  # operations of factorisations
_PARTS = 20  # of the last sweeps, so that they can be interrupted


class Ended(Exception):
    """The end of a run: a small residual, an interruption, or all work spent.

    Attributes:
        status: Of an answer whose residual is not small enough.
    """

    def __init__(self, status: Status = Status.STAGNATED):
        super().__init__(status.value)
        self.status = status


class Limits(NamedTuple):
    """What bounds a run; see `ConeInteriorPoint`.

    Attributes:
        name: The method's, for results and messages.
        newton: Nonsmooth Newton steps in a row.
        path: Steps of the interior-point path.
        curve: Steps along a curve of smoothed problems, half as many before the convex problems, all after them.
        convex: Convex problems with given slip.
        proximal: Proximal term of the nonsmooth Newton matrix.
        work: Floating-point operations of all factorisations, and what takes as long.
        systems: Their number.
    """

    name: str
    newton: int
    path: int
    curve: int
    convex: int
    proximal: float
    work: float
    systems: int


class ConeRun:
    """The solution of one problem."""

    def __init__(
        self,
        limits: Limits,
        problem: FrictionProblem,
        cones: ConeProblem,
        scales: Scales,
        goal: Goal,
        progress: ProgressCallback | None,
    ):
        self._limits, self._problem, self._cones, self._scales = limits, problem, cones, scales
        self._goal, self._sweeps = goal, 0
        cones.matrix.limit = limits.work
        self._progress, self._products = progress, problem.A.products
        self._history: list[InteriorPointStep] = []
        self._best: tuple[float, FloatArray] = (math.inf, np.zeros(3 * cones.contacts))
        self._convex = 0

    def follow(self, start: FloatArray | None, first: Sweeps | None) -> SolverResult:
        """The methods in turn, from the sweeps' end if there were any."""
        status, why = Status.STAGNATED, ""
        if first is not None:
            start, self._sweeps = first.x, first.made
        self._X = np.zeros_like(self._cones.q) if start is None else self._cones.scaled(start)
        try:
            if first is not None:
                self._reported(first)
            self._newton(self._X, self._limits.newton)
            self._follow_path()
            why = contradiction(self._problem, self._cones.W)
            if why:
                status = Status.NO_EQUILIBRIUM
            else:
                self._follow_curve(0.1, self._limits.curve // 2, self._half_of_the_rest())
                self._successive_slips(self._half_of_the_rest())
                self._follow_curve(1.0, self._limits.curve, math.inf)
                if first is not None:
                    self._sweep_on(first)
                if self._cones.matrix.operations > self._limits.work:
                    status = Status.MAX_ITERATIONS
        except Ended as end:
            status = end.status
        if self._best[0] == math.inf:
            status = self._last_chance(status)
        return self._result(status, why)

    def _last_chance(self, status: Status) -> Status:
        """The status after the last point has been judged, of a run that ended before any was."""
        try:
            self._judged(self._X)
        except Ended as end:
            return end.status
        return status

    def _reported(self, sweeps: Sweeps) -> None:
        if self._progress is not None and self._progress(Progress(self._convex, len(self._history), sweeps.residual)):
            raise Ended(Status.INTERRUPTED)

    def _sweep_on(self, at: Sweeps | None) -> None:
        """Sweeps from the end of the first ones, with half of the work that is left: in some problems of which nothing
        else comes to an end the contacts change their states for 100 000 sweeps.
        """
        problem, left = self._problem, self._limits.work - self._cones.matrix.operations
        assert isinstance(problem.A, MatrixCompliance)
        A, work, made = problem.A.sparse(), 0.5 * left / (_PER_MICROSECOND * _PARTS), 0
        while at is not None and work > 0.0 and made < _PARTS:
            at, made = swept(A, problem.b, problem.law.friction, self._goal.residual, at.x, work), made + 1
            if at is not None:
                self._sweeps += at.made
                self._judged(self._cones.scaled(at.x))
                self._reported(at)

    def _judged(self, X: FloatArray) -> float:
        """The residual of an answer; ends the run if it is small enough."""
        x = self._problem.completed(self._cones.forces(X))
        residual = self._scales.residual(self._problem, x, self._problem.gradient(x))
        if residual < self._best[0]:
            self._best = (residual, x)
        if self._goal.reached(residual, x):
            self._best = (residual, x)
            raise Ended
        return residual

    def _recorded(self, X: FloatArray, size: float, step: ConeStep | None = None, alpha: float = 1.0) -> None:
        """Record a step; ends the run if it is interrupted, or if all work has been spent."""
        self._X = X
        number, matrix = len(self._history) + 1, self._cones.matrix
        theta, sigma, gradient = (0.0, 0.0, 0.0) if step is None else (step.theta, step.sigma, step.infeasibility)
        alpha = alpha if step is None else step.alpha
        self._history.append(InteriorPointStep(number, size, 0, theta, sigma, alpha, gradient, 0.0))
        if self._progress is not None and self._progress(Progress(self._convex, number, size)):
            raise Ended(Status.INTERRUPTED)
        if matrix.operations > self._limits.work or matrix.factorisations >= self._limits.systems:
            raise Ended(Status.MAX_ITERATIONS)

    def _newton(self, X: FloatArray, limit: int, patient: bool = False) -> FloatArray:
        """Nonsmooth Newton steps from X as long as they make the natural map smaller, an impatient run much smaller;
        the last X.
        """
        at = self._cones.natural_map(X)
        sizes = [float(np.linalg.norm(at.value))]
        near = self._goal.residual
        for _ in range(limit):
            if at.size <= near:
                self._judged(X)
                near = 0.1 * at.size
            step = self._cones.newton_step(at, min(max(self._limits.proximal * at.size, _LEAST), _LARGEST))
            if step is None:
                break
            alpha, new = 1.0, self._cones.natural_map(X + step)
            while not np.linalg.norm(new.value) < (1.0 - 1e-4 * alpha) * sizes[-1] and alpha > (
                _SHORTEST if patient else _SHORT
            ):
                alpha *= 0.5
                new = self._cones.natural_map(X + alpha * step)
            size = float(np.linalg.norm(new.value))
            self._recorded(X + alpha * step, new.size, alpha=alpha)
            if not size < sizes[-1]:
                break
            X, at = X + alpha * step, new
            sizes.append(size)
            if not patient and len(sizes) > 4 and size > 0.5 * sizes[-4]:
                break
        if at.size <= 10.0 * self._goal.residual:
            self._judged(X)
        return X

    def _follow_path(self) -> None:
        """The interior-point path, with Newton steps where it has come near a solution."""
        path = ConePath(self._cones)
        at: ConeStep | None = path.start()
        near, best, best_at, last = _NEAR, math.inf, 0, None
        for number in range(self._limits.path):
            at = path.step(at) if at is not None else None
            if at is None:
                break
            last, size = at, self._cones.natural_map(at.X).size
            self._recorded(at.X, size, at)
            if size <= near:
                near = _NEARER * size
                self._newton(at.X, self._limits.newton // 2)
            if at.theta + at.infeasibility < 0.9 * best:
                best, best_at = at.theta + at.infeasibility, number
            if number - best_at > _STALLED:
                break
        if last is not None:
            self._newton(last.X, 2 * self._limits.newton, patient=True)
            self._judged(last.X)

    def _half_of_the_rest(self) -> float:
        """Operations at which a method that begins now has spent half of what is left, so that another one follows."""
        return 0.5 * (self._cones.matrix.operations + self._limits.work)

    def _follow_curve(self, weight: float, limit: int, enough: float) -> None:
        """The curve of smoothed problems, with Newton steps where it has come near a solution, until this many
        operations have been spent.
        """
        curve, near = ConeCurve(self._cones, weight), _NEAR
        at = curve.start()
        for _ in range(limit):
            at = curve.step(at) if at is not None else None
            if at is None or self._cones.matrix.operations > enough:
                break
            size = self._cones.natural_map(at.X).size
            self._recorded(at.X, size, ConeStep(at.X, at.Z, at.tau**2, float(np.linalg.norm(at.G)), 0.0, curve.h))
            if size <= near:
                near = _NEARER * size
                self._newton(at.X, self._limits.newton // 2)
                self._full_newton(at.X)

    def _full_newton(self, X: FloatArray) -> None:
        """A few nonsmooth Newton steps of full length: near a solution at which contacts are between two states the
        first may increase the natural map.
        """
        for _ in range(self._limits.newton // 2):
            at = self._cones.natural_map(X)
            step = self._cones.newton_step(at, _FULL)
            if step is None:
                return
            X = X + step
            size = self._cones.natural_map(X).size
            self._recorded(X, size)
            if size <= self._goal.residual:
                self._judged(X)

    def _successive_slips(self, enough: float) -> None:
        """Convex problems with given slip until it repeats itself, or this many operations have been spent."""
        slip: FloatArray = np.zeros(self._cones.contacts)
        anderson, change = Anderson(5, self._problem.reductions), 1.0
        for number in range(1, self._limits.convex + 1):
            if self._cones.matrix.operations > enough:
                return
            self._convex = number
            at = self._solved(slip, max(1e-2 * change**2, 1e-9))
            if at is None:
                return
            found = radius(at.Z)
            change = float(np.linalg.norm(found - slip) / (np.linalg.norm(found) or 1.0))
            self._newton(at.X, 2 * self._limits.newton, patient=True)
            self._judged(at.X)
            slip = np.maximum(anderson.next(slip, found - slip, 1.0), 0.0)

    def _solved(self, slip: FloatArray, tolerance: float) -> ConeStep | None:
        """The convex problem with given slip; None where its path ends before."""
        path = ConePath(self._cones, slip)
        at = path.start()
        for _ in range(self._limits.path):
            new = path.step(at)
            if new is None:
                return at if at.theta + at.infeasibility < 1e-3 else None
            at = new
            self._recorded(at.X, self._cones.natural_map(at.X).size, at)
            if at.theta < tolerance and at.infeasibility < tolerance:
                break
        return at

    def _result(self, status: Status, why: str) -> SolverResult:
        """The best answer, judged afresh."""
        problem, x = self._problem, self._best[1]
        gradient = problem.gradient(x)
        residual = self._scales.residual(problem, x, gradient)
        products = self._sweeps + problem.A.products - self._products + self._cones.products
        result = answer(self._limits.name, problem, self._goal, x, gradient, residual, status, products)
        result = replace(
            result, outer_steps=self._convex, newton_steps=len(self._history), history=tuple(self._history)
        )
        if result.status is Status.CONVERGED:
            return result
        matrix = self._cones.matrix
        message = why or (
            f"the {self._limits.name} method ended with a residual of {residual:.1e} after {len(self._history)} "
            f"Newton steps, {self._sweeps} sweeps and {self._convex} convex problems ({result.status.value}), "
            f"{self._goal.missed(residual)}; "
            f"{matrix.factorisations} factorisations, {matrix.operations:.1e} of at most "
            f"{self._limits.work:.1e} operations"
        )
        raise NotConverged(message, replace(result, message=message))
