"""Coulomb friction where A is a matrix without full rank: stacks of rigid bodies, redundant contacts, large friction.

Sweeps of Gauss-Seidel's method first, as many as promise to be quicker than what follows (gauss_seidel.py).  Then five
methods in turn, on the same Newton matrices W + nodal blocks (newton_matrix.py), in the variables of
cones.py:

1. nonsmooth Newton steps on the natural map from there, for as long as each of them helps; where few contacts change
   their state this is all;
2. the interior-point path (cone_paths.py) until the natural map is small, then nonsmooth Newton steps from there: they
   end in a solution to rounding accuracy, also where forces are not unique or contacts are at the edge between two
   states, where the path alone would come no nearer than the square root of rounding errors;
3. proximal steps from the path's end (R. T. Rockafellar, SIAM Journal on Control and Optimization 14, 1976),

       X_new = P(X - rho/c (w + |w_t| e)),   w = W X_new + q,

   each by Newton's method, whose matrix is 1 + rho/c G E W: regular for large c whatever the rank of W, and forces that
   W leaves undetermined stay where they were.  c decreases where few Newton steps are enough, and increases where they
   fail;
4. the curve of smoothed problems (cone_paths.py), with Newton steps as after the path; it turns where the path is
   blocked.  And more proximal steps, from where they were or from the sweeps' forces, whichever is nearer a solution;
5. curves that begin with open contacts, each with other gaps: where bodies jam at large friction.

Which of the last three leads to a solution, and after how many steps, is not known: they take turns, each twice as long
as the one before.  Curve and proximal steps go on where they were, curves from open contacts begin anew.

Without friction proximal steps converge; with it, they are the implicit Euler method of a flow that may wander before
it comes to rest, or for ever.  The curve has a solution at its end, in general position and if forces stay bounded; its
length is not known.  CONVERGED means that the natural residual, computed afresh, is below the tolerance, and the
collection's own as well (cones.cone_residual).

Work is limited by counts, not by time, so that a result can be repeated: floating-point operations of the
factorisations with an estimate for the rest, and their number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any, Final

import numpy as np
import scipy.sparse

from ...arrays import FloatArray
from ...linalg.compliance import MatrixCompliance
from ..driver import Answer, result_of
from ..friction_problem import FrictionProblem, SolverSettings, Task
from ..results import InteriorPointStep, Progress, SolverResult, Status
from ..settings import within
from .cone_paths import ConeCurve, ConePath, ConeStep
from .cones import ConeProblem, Scales
from .gauss_seidel import Sweeps, sweep

_CLEAR: Final = 1e-7  # least penetration that is called a contradiction, over the largest |b|
_EXACT: Final = 1e-15  # d^T A d over its size by single contacts that rounding errors of A may cause
_MOST_ENTRIES: Final = 3_000_000  # entries of A beyond which the question is not asked
_NAMED: Final = 4  # contacts that are named


def contradiction(problem: FrictionProblem, W: Any) -> str:
    """Why no contact forces x, of any sign and without any law of friction, make all gaps w_n >= 0; empty if some do.

    A linear programme, max t with (A x - b)_n >= t: if t < 0, its multipliers are normal forces d >= 0 with A d = 0 and
    b.d > 0, which no displacements w = A x - b with w_n >= 0 allow: w.d = -b.d < 0.  They are checked before they are
    believed.  W is the compliance on one rank, sparse, its columns in any scaling; 0 along the tangents of contacts
    without friction.
    """
    from scipy.optimize import linprog  # takes time to load, and few problems have no solution

    m, size = problem.A.nodes, float(np.abs(problem.b).max()) or 1.0
    if W.nnz > _MOST_ENTRIES:
        return ""
    b_n, rows = problem.b[0::3] / size, W[0::3]
    n = rows.shape[1]
    constraints = scipy.sparse.hstack([-rows, np.ones((m, 1))]).tocsr()
    bounds = [(None, None)] * n + [(None, 1.0)]
    costs = np.append(np.zeros(n), -1.0)
    programme = linprog(costs, A_ub=constraints, b_ub=-b_n, bounds=bounds, options={"maxiter": 50 * n})
    if programme.x is None or programme.x[-1] > -_CLEAR:
        return ""
    d = np.maximum(-np.asarray(programme.ineqlin.marginals), 0.0)
    against = float(b_n @ d)
    work, own = abs(float(d @ (rows[:, 0::3] @ d))), float(np.sqrt(np.maximum(W.diagonal()[0::3], 0.0)) @ d)
    if not (against > 0.0 and work <= _EXACT * own**2):  # masses decades apart, the light ones alone balance d
        return ""
    worst = np.argsort(-d)[: min(_NAMED, int(np.count_nonzero(d > 1e-6 * d.max())))]
    names = ", ".join(str(k) for k in np.sort(worst))
    short = against * size / float(d.sum())
    return (
        f"no contact forces keep all contacts from penetrating: normal forces on contacts {names} (numbered from 0) "
        f"balance each other and move nothing, but the gaps along them are {short:.1e} too small in the mean"
    )


_SHORT: Final = 0.4  # shortest step of the nonsmooth Newton method, ...
_SHORTEST: Final = 0.05  # ... and of a proximal step's
_REGULAR: Final = 0.1  # proximal term of its matrix, over the mean diagonal of A and the size of the natural map, ...
_LEAST, _LARGEST = 1e-11, 1e-3  # ... and its bounds
_NEAR: Final = 1e-2  # size of the natural map at which the path is left for Newton steps, ...
_NEARER: Final = 0.1  # and factor by which it decreases before they are tried again
_STALLED: Final = 15  # steps of the path without progress after which it ends
_FIRST, _MOST = 0.1, 10.0  # c of the first proximal step, and beyond which they end
_NEWTON: Final = 12  # Newton steps of a proximal step after which it has failed, ...
_FEW, _MANY = 4, 8  # ... up to which the next one has a smaller c, and beyond which a larger one
_SMALLER, _LARGER, _AFTER_FAILURE = 0.3, 1.5, 4.0  # by these factors
_FROM_END: Final = 24  # proximal steps from the path's end
_TURN: Final = 1.0 / 64.0  # of the work, the first turn of each of the last three methods
_CLOSE: Final = 1e-2  # what a proximal step may leave over, over its length


class _Ended(Exception):
    """The end of a run: a small residual, an interruption, or all work spent.

    Attributes:
        status: Of an answer whose residual is not small enough.
    """

    def __init__(self, status: Status = Status.STAGNATED):
        super().__init__(status.value)
        self.status = status


class _ConeRun:
    """The solution of one problem."""

    def __init__(self, settings: ConeInteriorPoint, problem: FrictionProblem, task: Task):
        assert isinstance(problem.A, MatrixCompliance)
        self._settings, self._problem, self._goal, self._progress = settings, problem, task.goal, task.progress
        self._A, self._scales = problem.A.sparse(), Scales.of(problem)
        self._cones = ConeProblem(problem, self._A, self._scales)
        self._cones.matrix.limit = settings.work
        self._history: list[InteriorPointStep] = []
        self._best: tuple[float, FloatArray] = (math.inf, np.zeros(3 * self._cones.contacts))
        self._sweeps = 0

    def follow(self, start: FloatArray | None, first: Sweeps | None) -> SolverResult:
        """The methods in turn, from the sweeps' end if there were any."""
        status, why = Status.STAGNATED, ""
        if first is not None:
            start, self._sweeps = first.x, first.made
        self._X = np.zeros_like(self._cones.q) if start is None else self._cones.scaled(start)
        try:
            if first is not None:
                self._reported(first)
            begun = self._newton(self._X, self._settings.newton)
            ended = self._follow_path()
            why = contradiction(self._problem, self._cones.W)
            if why:
                status = Status.NO_EQUILIBRIUM
            else:
                self._take_turns(min(begun, ended, key=self._distance))
                status = Status.MAX_ITERATIONS
        except _Ended as end:
            status = end.status
        if self._best[0] == math.inf:  # it ended before any point was judged
            try:
                self._judged(self._X)
            except _Ended as end:
                status = end.status
        return self._result(status, why)

    def _take_turns(self, X: FloatArray) -> None:
        """The curve, proximal steps from X and curves from open contacts in turn, until all work has been spent."""
        curve, steps, turn, number = self._curve(), self._proximal_steps(X), _TURN, 0
        while self._spent < 1.0:
            for method in (curve, steps, self._curve(number)):
                enough = self._spent + turn
                for _ in method:
                    if self._spent >= enough:
                        break
                self._judged(self._X)
            turn, number = 2.0 * turn, number + 1

    @property
    def _spent(self) -> float:
        """The part of all work that has been spent."""
        matrix, settings = self._cones.matrix, self._settings
        return max(matrix.operations / settings.work, matrix.factorisations / settings.systems)

    def _distance(self, X: FloatArray) -> float:
        """The natural map of X times its size: where bodies jam, forces that move nothing grow along the path."""
        return self._cones.natural_map(X).size * (1.0 + float(np.linalg.norm(X)))

    def _reported(self, sweeps: Sweeps) -> None:
        if self._progress is not None and self._progress(Progress(0, len(self._history), sweeps.residual)):
            raise _Ended(Status.INTERRUPTED)

    def _judged(self, X: FloatArray) -> float:
        """The residual of an answer; ends the run if it is small enough."""
        x = self._problem.completed(self._cones.forces(X))
        residual = self._scales.residual(self._problem, x, self._problem.gradient(x))
        if residual < self._best[0]:
            self._best = (residual, x)
        if self._goal.reached(residual, x):
            self._best = (residual, x)
            raise _Ended
        return residual

    def _recorded(self, X: FloatArray, size: float, step: ConeStep | None = None, alpha: float = 1.0) -> None:
        """Record a step; ends the run if it is interrupted, or if all work has been spent."""
        self._X = X
        number = len(self._history) + 1
        theta, sigma, gradient = (0.0, 0.0, 0.0) if step is None else (step.theta, step.sigma, step.infeasibility)
        alpha = alpha if step is None else step.alpha
        self._history.append(InteriorPointStep(number, size, 0, theta, sigma, alpha, gradient, 0.0))
        if self._progress is not None and self._progress(Progress(0, number, size)):
            raise _Ended(Status.INTERRUPTED)
        if self._spent >= 1.0:
            raise _Ended(Status.MAX_ITERATIONS)

    def _newton(self, X: FloatArray, limit: int) -> FloatArray:
        """Nonsmooth Newton steps from X as long as they make the natural map much smaller; the last X."""
        natural_map = self._cones.natural_map(X)
        sizes = [float(np.linalg.norm(natural_map.value))]
        near = self._goal.residual
        for _ in range(limit):
            if natural_map.size <= near:
                self._judged(X)
                near = 0.1 * natural_map.size
            step = self._cones.newton_step(natural_map, min(max(_REGULAR * natural_map.size, _LEAST), _LARGEST))
            if step is None:
                break
            alpha, new = 1.0, self._cones.natural_map(X + step)
            while not np.linalg.norm(new.value) < (1.0 - 1e-4 * alpha) * sizes[-1] and alpha > _SHORT:
                alpha *= 0.5
                new = self._cones.natural_map(X + alpha * step)
            size = float(np.linalg.norm(new.value))
            self._recorded(X + alpha * step, new.size, alpha=alpha)
            if not size < sizes[-1]:
                break
            X, natural_map = X + alpha * step, new
            sizes.append(size)
            if len(sizes) > 4 and size > 0.5 * sizes[-4]:
                break
        if natural_map.size <= 10.0 * self._goal.residual:
            self._judged(X)
        return X

    def _follow_path(self) -> FloatArray:
        """The interior-point path, with Newton steps where it has come near a solution, and proximal steps from its
        end; their last X.
        """
        path = ConePath(self._cones)
        step: ConeStep | None = path.start()
        near, best, best_at, last = _NEAR, math.inf, 0, self._X
        for number in range(self._settings.path):
            step = path.step(step) if step is not None else None
            if step is None:
                break
            last, size = step.X, self._cones.natural_map(step.X).size
            self._recorded(step.X, size, step)
            if size <= near:
                near = _NEARER * size
                self._newton(step.X, self._settings.newton // 2)
            if step.theta + step.infeasibility < 0.9 * best:
                best, best_at = step.theta + step.infeasibility, number
            if number - best_at > _STALLED:
                break
        ended = [last, *islice(self._proximal_steps(last), _FROM_END)][-1]
        self._judged(ended)
        return ended

    def _proximal_steps(self, X: FloatArray) -> Iterator[FloatArray]:
        """Where proximal steps from X lead, one after the other."""
        c, failed = _FIRST, False
        while c <= _MOST:
            new, tries = self._proximal_step(X, c)
            if new is None:
                c, failed = _AFTER_FAILURE * c, True
            else:
                X = new
                if self._cones.natural_map(X).size <= self._goal.residual:
                    self._judged(X)
                if tries <= _FEW and not failed:
                    c *= _SMALLER
                elif tries > _MANY:
                    c *= _LARGER
                failed = False
            yield X

    def _proximal_step(self, centre: FloatArray, c: float) -> tuple[FloatArray | None, int]:
        """The step from the centre, by Newton's method, and its number of systems; None where it fails."""
        cones, X = self._cones, centre
        natural_map = cones.natural_map(X, centre, c)
        for number in range(_NEWTON):
            step = cones.proximal_step(natural_map, c)
            if step is None:
                return None, number
            size, alpha, new = np.linalg.norm(natural_map.value), 1.0, cones.natural_map(X + step, centre, c)
            while not np.linalg.norm(new.value) < (1.0 - 1e-4 * alpha) * size:
                alpha *= 0.5
                if alpha < _SHORTEST:
                    return None, number
                new = cones.natural_map(X + alpha * step, centre, c)
            X, natural_map = X + alpha * step, new
            self._recorded(natural_map.projection.point, new.size, alpha=alpha)
            if np.linalg.norm(natural_map.value) <= _CLOSE * np.linalg.norm(natural_map.projection.point - centre):
                return natural_map.projection.point, number + 1
        return None, _NEWTON

    def _curve(self, opened: int | None = None) -> Iterator[None]:
        """The points of the curve of smoothed problems, or of one from open contacts by its number, with Newton steps
        where it has come near a solution and at its end.
        """
        curve, near = ConeCurve(self._cones, opened), _NEAR
        at = curve.start()
        while at is not None:
            size = self._cones.natural_map(at.X).size
            self._recorded(at.X, size, ConeStep(at.X, at.Z, at.tau**2, float(np.linalg.norm(at.G)), 0.0, curve.h))
            if size <= near:
                near = _NEARER * size
                self._newton(at.X, self._settings.newton // 2)
            yield
            last, at = at.X, curve.step(at)
            if at is None:
                self._newton(last, 2 * self._settings.newton)

    def _result(self, status: Status, why: str) -> SolverResult:
        """The best answer, judged afresh."""
        problem, x, residual = self._problem, self._best[1], partial(self._scales.residual, self._problem)
        answer = Answer(x, problem.without_motion(x))
        result = result_of(problem, self._goal, answer, None, status, self._history, residual)
        result = replace(result, products=self._sweeps + self._cones.products)
        matrix = self._cones.matrix
        message = why or (
            f"the {self._settings.name} method ended with a residual of {result.residual:.1e} after "
            f"{len(self._history)} Newton steps and {self._sweeps} sweeps ({result.status.value}), "
            f"{self._goal.missed(result.residual)}; "
            f"{matrix.factorisations} factorisations, {matrix.operations:.1e} of at most "
            f"{self._settings.work:.1e} operations"
        )
        return result if result.status is Status.CONVERGED else replace(result, message=message)


@dataclass(frozen=True)
class ConeInteriorPoint(SolverSettings):
    """The method as a value; for Coulomb's law without cohesion, A given as a matrix, and one rank (`suits`).

    `solve` raises NotConverged with the status NO_EQUILIBRIUM if no forces keep the contacts from penetrating.

    Attributes:
        tolerance: Residual at which to stop, the larger of `FrictionProblem.residual` and `cones.cone_residual`.
        sweeps: Whether Gauss-Seidel sweeps come first, or those that have been made for the problem.
        newton: Nonsmooth Newton steps in a row.
        path: Steps of the interior-point path.
        work: Floating-point operations of all factorisations, and of what takes as long; an estimate.
        systems: Their number.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    sweeps: bool | Sweeps = True
    newton: int = within("[1, inf)", 12)
    path: int = within("[1, inf)", 80)
    work: float = within("(0, inf)", 2e11)
    systems: int = within("[1, inf)", 6000)

    name = "cone interior point"

    def suits(self, problem: FrictionProblem) -> bool:
        """Whether it can solve the problem: Coulomb's law on one rank, A a matrix."""
        law, lower = problem.law, np.asarray(problem.lower)
        return (
            isinstance(problem.A, MatrixCompliance)
            and problem.A.comm.size == 1
            and problem.rigid is None
            and law.proportional
            and not np.any(lower)
        )

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        if not (self.suits(problem) and isinstance(problem.A, MatrixCompliance)):
            raise ValueError(
                f"the {self.name} method is for Coulomb's law with constant coefficients, without cohesion, lower "
                "bounds and rigid motions, with A as a matrix on one rank; use Automatic()"
            )
        start, sweeps = task.start, self.sweeps if isinstance(self.sweeps, Sweeps) else None
        if self.sweeps is True:
            first = None if start is None else np.ascontiguousarray(start, dtype=np.float64)
            sweeps = sweep(problem.A.sparse(), problem.b, problem.law.friction, task.goal.tolerance, first)
        if sweeps is not None and task.goal.reached(sweeps.residual, sweeps.x):
            return sweeps.result(self.name, task.goal)
        return _ConeRun(self, problem, task).follow(start, sweeps)
