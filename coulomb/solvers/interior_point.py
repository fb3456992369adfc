"""The path-following interior-point method for contact with friction, |x_t| <= r(x_n) = c + F x_n.

It follows, from theta > 0 down to 0, the solutions of (scaled_problem.py)

    w_n - nu1 = 0,   w_t + nu2 y = 0,   nu1 z1 = theta,   nu2 z2 = theta        w = A x - b,   x = (x_n, r(x_n) y)

with z1 = x_n - lower, z2 = r (1 - |y|^2)/2.  Without slope, F = 0, these are the optimality conditions of a convex
quadratic programme, and with J_AM and P_AM this is Algorithm PF of R. Kucera, J. Machalova, H. Netuka, P. Zencak: An
interior-point algorithm for the minimization arising from 3D contact problems with friction, Optimization Methods and
Software.  With slope the bound is differentiated like the other unknowns (linearization.py).  With r frozen in a step
and updated after it the iteration stalls.

The step is taken along the curve x_n + alpha dx_n, y + alpha dy, not along the straight line in x_t, so that friction
stays proportional to pressure at a node that opens.  On the straight line y becomes inaccurate there by division: steps
block, or need a predictor solve and are twice as many.  The gradient at a step length, with A x + alpha A dx, is then
correct to first order; it is only used to choose alpha.  Without slope it is exact.

If a product is a solve with K, it need not be exact.  Products of the Krylov method have the accuracy that the step
needs; those of the iterates correct K^-1 B^T x to a fraction of its change, and errors do not accumulate
(Compliance.mult_incremental).  Only the final residual is computed with the most accurate product.

With rigid motions of bodies that contact alone holds, w = A x - b - G^T alpha, and G x = e are further equations
(rigid_motions.py).  As x is not linear along a step, G x - e is computed anew at every iterate; it counts with the
gradient.

Proved: for F = 0 and exact products this is PF for a convex problem.  Not proved for F > 0: that the Newton system is
regular, that a path leads to theta = 0, or which of several solutions it finds.

A step ends where the first constraint is reached, often after a tenth of its length because of a few of thousands of
nodes.  Correctors for products nu z that would be too small or too large at a longer step (J. Gondzio: Multiple
centrality corrections in a primal-dual method for linear programming, Comput. Optim. Appl. 6, 1996) are computed with
the approximation of A from the products so far, without a product by A.  The boundary is where it is for any direction,
so that the length of a corrected step is known; only its gradient is estimated, and that of the next iterate is
computed with a product in any case.  A corrector is used only if it lengthens the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ..arrays import FloatArray
from .driver import Answer, drive, result_of
from .equilibrium import balanced_forces, push, sliding
from .friction_problem import FrictionProblem, Solver, SolverSettings, Task
from .frictionless_start import frictionless_start
from .linearization import Linearization
from .newton_systems import (
    AugmentedSystem,
    NewtonChoice,
    NewtonEquations,
    NewtonStep,
    NewtonSystem,
    SchurComplementSystem,
)
from .results import Goal, InteriorPointStep, NotConverged, Progress, QPStep, SolverResult, Status
from .scaled_problem import Iterate, ScaledProblem, Step
from .settings import within

_OFF: Final = 1e-3  # residual above which an iteration has not found anything near a solution
_WIDENING: Final = 10.0  # beta is at least this times what the start needs
_BLOCKED: Final = 0.05  # a step shorter than this, three times in a row, ends a start that is not the last
_ITERATE: Final = 0.01  # accuracy of an inexact A x at a new iterate, relative to its change

_GROWTH: Final = 0.5
"""Inexact products become ten times as accurate after a step of length alpha from which the gradient is more than 1 +
this alpha times as large: their errors outweigh it, as where dx is large and A dx small."""

_WAIT: Final = 3.0
"""With slope or inexact products sigma is at least this times the gradient over its bound in N(gamma, beta): theta does
not decrease faster than the gradient."""

_WARM_PRESSURE, _WARM_FRICTION, _WARM_THETA = 0.3, 0.9, 0.03
"""With slope, a start from given forces has x_n at least this many nominal forces inside, |y| at most this, and this
theta over rms(A x - b)."""

_FINISH_FROM: Final = 3e-3
"""Residual of an iterate from which `InteriorPoint.finish` is tried."""


@dataclass(frozen=True)
class InteriorPoint(SolverSettings):
    """The interior-point method as a value; the defaults suit all problems measured (docs/methods.md).

    Attributes:
        tolerance: Natural residual at which to stop (`FrictionProblem.residual`).
        gamma: Centrality, nu_i z_i >= gamma theta, in (0, 1).
        omega: Sufficient decrease, theta_new <= (1 - alpha omega (1 - sigma)) theta, in (0, 1).
        to_boundary: Largest fraction of the distance to the boundary for a step, in (0, 1).
        backtrack: The ratio of the step lengths tried, in (0, 1).
        r_tol: Inner precision: the Krylov method stops at |residual| <= tol_k |right-hand side| with
            tol_k = min(r_tol err_(k-1), c_fact tol_(k-1)), err the relative change of v = (x, nu, z) in the last step.
        c_fact: The factor by which tol_k decreases at least.
        beta: Dual feasibility, rms(W gradient) <= beta theta, > 0; at least ten times what the start needs.
        sigma_min: Centring after an ordinary step, > 0; at most that after a short one, sigma_max, at most 1/2.
        max_iterations: Newton steps of a start before the solver gives up.
        newton: The linear system of a step: SchurComplementSystem (J_SC, P_SC), AugmentedSystem (J_AM, P_AM; without
            slope), CondensedSystem (K with springs in place of A) or DenseSystem (LU, for small problems).
        start_products: Largest number of products that a cold start spends on the problem without friction
            (frictionless_start.py); 0: it is left out.
        starts: If steps block, cold starts from equal pressure follow, with this theta over rms(A x - b) there.
        finish: A method that is tried once from an iterate near the answer; if it fails, the path is followed further
            from that iterate.

    If steps from a given start block, the cold starts follow.  `history` has an InteriorPointStep per Newton step.
    `solve` raises NotConverged with the status NO_EQUILIBRIUM before the first step, if no contact forces balance the
    loads of a body that contact alone holds; if it slides away in the last iterate, the message says along what.

    Raises:
        ValueError: If a number is outside its bounds.
    """

    gamma: float = within("(0, 1)", 1e-3)
    omega: float = within("(0, 1)", 1e-2)
    to_boundary: float = within("(0, 1)", 0.95)
    backtrack: float = within("(0, 1)", 0.9)
    r_tol: float = within("(0, 1)", 0.3)
    c_fact: float = within("(0, 1)", 0.99)
    beta: float = within("(0, inf)", 1e4)
    sigma_max: float = within("(0, 0.5]", 0.5)
    sigma_min: float = within("(0, sigma_max]", 0.1)
    max_iterations: int = within("[1, inf)", 100)
    newton: NewtonChoice = field(default_factory=SchurComplementSystem)
    start_products: int = within("[0, inf)", 12)
    starts: tuple[float, ...] = within("(0, inf)", (1e3, 1e6))
    finish: Solver | None = None

    name = "interior point"

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        balanced_forces(problem, self.name)
        least, start = smallest_force(problem, task.goal), task.start
        pressed = problem.rigid is not None and start is not None and problem.reductions.any(bool(np.any(start)))
        result = least if least and not pressed else _Path(self, problem, task).follow()
        result = least if least and result.status not in (Status.CONVERGED, Status.INTERRUPTED) else result
        residuals = ", ".join(f"{step.residual:.1e}" for step in result.history[-3:])
        message = (
            f"the interior-point method ended with a residual of {result.residual:.1e} after {result.newton_steps} "
            f"Newton steps ({result.status.value}), {task.goal.missed(result.residual)}; last residuals {residuals}"
        )
        if result.equilibrium is not None and problem.rigid is not None:
            message += f"; {push(problem.rigid, result.equilibrium)}"
        return result if result.status is Status.CONVERGED else replace(result, message=message)

    def centring(self, alpha: float, used: float = 0.0) -> float:
        """sigma after a step of length alpha, with the gradient at a fraction `used` of its bound in N(gamma, beta)."""
        return min(max((1.0 - alpha) ** 2, self.sigma_min, _WAIT * used), self.sigma_max)


class _Path:
    """The solution of a problem from one start after another."""

    def __init__(self, settings: InteriorPoint, problem: FrictionProblem, task: Task):
        self.settings, self.problem, self.task, self.goal = settings, problem, task, task.goal
        self.scaled = ScaledProblem(problem)
        weighted = self.scaled.mixed and not isinstance(settings.newton, AugmentedSystem)
        self.newton = settings.newton.system(self.scaled.A, self.scaled.sloped or weighted)
        self.history: list[QPStep] = []
        self.tried = self._finished = False

    def follow(self) -> SolverResult:
        """One start after another, each farther inside: near the boundary steps may block, far inside they are more.

        Where steps end near an answer, as by inexact products, they go on from there with sharper ones, as long as that
        halves the residual, before a start from anew: 37 steps in place of 96 and more on soft springs.
        """
        results: list[SolverResult] = []
        start, gradient = self.task.start, self.task.gradient
        near = math.inf
        starts, v = list(self.settings.starts), None if start is None else self._warm(start, gradient)
        products = self.settings.start_products
        try:
            while v is not None or products > 0 or starts:
                if v is None and products > 0:
                    v, products = frictionless_start(self.scaled, self.newton, products, _ITERATE), 0
                if v is None:  # equal pressure everywhere, no friction
                    x_n, y = self.scaled.lower + 1.0, np.zeros((self.scaled.nodes, 2))
                    v = self._centred(x_n, y, starts.pop(0))
                results.append(self._steps(v, patient=not starts))
                v, last = None, results[-1]
                if last.status in (Status.CONVERGED, Status.INTERRUPTED) or last.residual <= self.goal.tolerance:
                    break
                near_answer = last.status is Status.STAGNATED and last.residual <= min(_OFF, 0.5 * near)
                if near_answer and self._last is not None:
                    near, v = last.residual, self._centred_again(self._last)
        finally:
            if not self._finished:
                self.newton.keep()
            self.newton.destroy()
        best = min(results, key=lambda result: result.residual)
        if best.residual > _OFF and best.status is not Status.INTERRUPTED:
            best = next(filter(None, map(self._sliding_away, results)), best)
        return replace(best, newton_steps=len(self.history), history=tuple(self.history))

    def _sliding_away(self, result: SolverResult) -> SolverResult | None:
        """A result whose bodies slide away, with the motion."""
        away = sliding(self.problem, result.x, result.gradient, result.rigid)
        return None if away is None else replace(result, equilibrium=away)

    def _centred(self, x_n: FloatArray, y: FloatArray, relative_theta: float) -> Iterate:
        """These forces, and centred multipliers with a multiple of rms(A x - b) as theta."""
        scaled = self.scaled
        A_x = self.newton.products.first(scaled.forces(x_n, y), _ITERATE)
        v = scaled.closing(Iterate(x_n, y, np.zeros((scaled.nodes, 2)), A_x))
        theta = relative_theta * max(scaled.rms(scaled.gradient(v) / scaled.energy), 1e-3)
        return v._replace(nu=scaled.over_constraints(scaled.target(theta), scaled.slack(x_n, y)))

    def _warm(self, start: FloatArray, gradient: FloatArray | None) -> Iterate:
        """An iterate near the forces `start`; without slope on the central path of their projection."""
        scaled = self.scaled
        if scaled.sloped:
            x_n, y = scaled.inside(start, _WARM_PRESSURE, _WARM_FRICTION)
            return self._centred(x_n, y, _WARM_THETA)
        gradient = self.problem.gradient(start) if gradient is None else gradient
        x = scaled.scaled(start)
        q = scaled.projection_step(x, scaled.scaled_gradient(gradient))
        distance = scaled.distance_from_solution(x, q)
        x_n, y, nu = scaled.smoothed_projection(q, max(distance**1.5, 0.1 * self.goal.tolerance))
        return scaled.closing(Iterate(x_n, y, nu, self.newton.products.first(scaled.forces(x_n, y), _ITERATE)))

    def _centred_again(self, v: Iterate) -> Iterate:
        """An iterate near the answer from which steps have ended, with its most accurate A x, sharper products from now
        on, and no product nu z far from the others."""
        scaled = self.scaled
        self.newton.tighten()
        z = scaled.slack(v.x_n, v.y)
        middle = scaled.target(scaled.theta(v.nu, z))
        nu = scaled.over_constraints(np.clip(v.nu * z, _WITHIN[0] * middle, _WITHIN[1] * middle), z)
        return v._replace(A_x=self.newton.products.exact(scaled.forces(v.x_n, v.y)), w=None, nu=nu)

    def _steps(self, v: Iterate, patient: bool) -> SolverResult:
        """Newton steps from v until the residual is small enough; an impatient run ends when blocked."""
        steps = _Steps(self, v, patient)
        status = drive(steps, self.goal, self.history, self.settings.max_iterations, self.task.progress)
        self._last = steps.v if steps.inside else None
        if steps.finished is not None:
            return steps.finished
        exact = steps.exact()
        *_, multipliers = self.scaled.unscaled(exact)
        return result_of(self.problem, self.goal, steps.answer(), multipliers, status, self.history)

    def by_another(self, answer: Answer) -> SolverResult | None:
        """The result of `InteriorPoint.finish` from an answer near the right one, if it converges or is interrupted;
        collective.

        Path following converges slowly where a node is at the edge of its disc without slip: the residual falls like
        the square root of theta.  The semismooth Newton method does not need theta.
        """
        method, first, report, self.tried = self.settings.finish, len(self.history), self.task.progress, True
        assert method is not None

        def reported(state: Progress) -> bool | None:
            return report is not None and report(Progress(state.outer, first + state.path_following, state.residual))

        x, gradient, tolerance = answer.x, answer.without, self.goal.tolerance
        try:
            result = method.solve(self.problem, x, gradient=gradient, tolerance=tolerance, progress=reported)
        except NotConverged as failure:
            result = failure.result
        steps = (step for step in result.history if isinstance(step, QPStep))
        self.history += [replace(step, iteration=first + step.iteration) for step in steps]
        self._finished = result.status is Status.CONVERGED
        ended = self._finished or result.status is Status.INTERRUPTED
        return replace(result, products=0, method="") if ended else None  # it is a part of this method


class _Steps:
    """Path following from one start: an `Iteration`.

    Attributes:
        v: The iterate.
        finished: The result of another method, once one has brought it to the end.
    """

    finished: SolverResult | None = None

    def __init__(self, path: _Path, v: Iterate, patient: bool):
        self._path, self._patient, self.v, scaled = path, patient, v, path.scaled
        self._theta, self._gradient = scaled.theta(v.nu, scaled.slack(v.x_n, v.y)), scaled.infeasibility(v)
        self._beta = max(path.settings.beta, _WIDENING * self._gradient / self._theta)
        self._change, self._krylov_tolerance, self._length = 1.0, path.settings.r_tol / path.settings.c_fact, 1.0
        self._waits = scaled.sloped or not path.problem.A.exact  # then A x of an iterate is computed anew
        self._best, self._least, self._since, self._blocked = math.inf, self._theta, 0, 0
        self._exact: Iterate | None = None

    @property
    def inside(self) -> bool:
        """Whether there is room to the bounds, which rounding errors may have taken from a start."""
        return math.isfinite(self._theta)

    def step(self) -> InteriorPointStep | None:
        path, scaled = self._path, self._path.scaled
        if not self.inside:
            return None
        sigma = path.settings.centring(
            self._length, self._gradient / (self._beta * self._theta) if self._waits else 0.0
        )
        direction = self._direction(sigma)
        self._length, new = step_length(path.settings, scaled, direction, self._beta, sigma)
        if new is None:
            return None
        self._change = scaled.relative_change(self.v, new)  # in proportion to the length: the residual decides
        self._advance(new)
        residual = self._residual()
        return InteriorPointStep(
            iteration=len(path.history) + 1,
            residual=residual,
            krylov=direction.iterations,
            theta=self._theta,
            sigma=sigma,
            alpha=self._length,
            gradient=self._gradient,
            krylov_tolerance=self._krylov_tolerance,
        )

    def _direction(self, sigma: float) -> Step:
        """The Newton step to nu_i z_i = sigma theta, with correctors where A x is computed anew in any case."""
        path = self._path
        settings, scaled, newton, target = path.settings, path.scaled, path.newton, sigma * self._theta
        self._krylov_tolerance = min(settings.r_tol * self._change, settings.c_fact * self._krylov_tolerance)
        step = newton_step(scaled, newton, self.v, target, self._krylov_tolerance, self._beta)
        return correct_step(settings, scaled, newton, step, target, self._beta) if self._waits else step

    def _advance(self, new: Iterate) -> None:
        """To an iterate, with its A x; sharper products from then on where the gradient grows more than it should."""
        scaled, newton, before = self._path.scaled, self._path.newton, self._gradient
        x, predicted = scaled.forces(new.x_n, new.y), None if scaled.sloped else new.A_x
        self.v = new._replace(A_x=newton.products.advance(x, predicted, self._length, _ITERATE))
        self._theta = scaled.theta(self.v.nu, scaled.slack(self.v.x_n, self.v.y))
        self._gradient, self._exact = scaled.infeasibility(self.v), None
        if self._gradient > (1.0 + _GROWTH * self._length) * before:
            newton.tighten()

    def _residual(self) -> float:
        """Of the iterate; with its most accurate A x where that decides, and once a certificate has refused."""
        path, scaled = self._path, self._path.scaled
        residual = path.problem.residual(*scaled.unscaled(self.v)[:2])
        if not (residual <= path.goal.residual or path.goal.refused):
            return residual
        exact = self.exact()
        if path.goal.refused:
            self.v = exact if path.newton.products.corrects else self.v
            self._gradient = scaled.infeasibility(self.v)
            self._beta = max(self._beta, _WIDENING * self._gradient / self._theta)
        return path.problem.residual(*scaled.unscaled(exact)[:2])

    def exact(self) -> Iterate:
        """The iterate with its most accurate A x: once a certificate has failed, that of the balanced displacement."""
        if self._exact is None:
            scaled, balanced, v = self._path.scaled, self._path.problem.balanced, self.v
            if balanced is None or not self._path.goal.refused:
                A_x = self._path.newton.products.exact(scaled.forces(v.x_n, v.y))
                self._exact = v._replace(A_x=A_x, w=None)
            else:
                self._exact = scaled.with_gradient(v, balanced(scaled.unscaled(v)[0]))
        return self._exact

    def answer(self) -> Answer:
        """With the most accurate A x, if it is known."""
        scaled, v = self._path.scaled, self.v if self._exact is None else self._exact
        return Answer(scaled.unscaled(v)[0], scaled.displaced(v), scaled.rigid_motion(v))

    def stop(self) -> Status | None:
        path, goal, scaled = self._path, self._path.goal, self._path.scaled
        whole = path.problem.residual_of_bodies(
            *scaled.unscaled(self.v)[:2]
        )  # falls more evenly than that of the worst
        # if the certificate has refused an answer, only path following has products of the accuracy that it needs
        if path.settings.finish is not None and not path.tried and not goal.refused and whole <= _FINISH_FROM:
            path.newton.keep()
            self.finished = path.by_another(self.answer())
            if self.finished is not None:
                return self.finished.status
            self.v = self.v._replace(A_x=path.newton.products.exact(scaled.forces(self.v.x_n, self.v.y)))
        self._since += 1
        if whole < 0.9 * self._best or self._theta < 0.5 * self._least:  # where bodies slide far, both stay near 1
            self._best, self._least, self._since = min(whole, self._best), min(self._theta, self._least), 0
        self._blocked = self._blocked + 1 if self._length < _BLOCKED else 0
        stalled = self._since >= goal.patience or (self._blocked == 3 and not self._patient)
        return Status.STAGNATED if stalled else None


def smallest_force(problem: FrictionProblem, goal: Goal) -> SolverResult | None:
    """The smallest feasible force, if it is the answer: then there is no path to follow."""
    x = problem.completed(problem.project(np.zeros_like(problem.b)))
    w = problem.without_motion(x) if problem.reductions.max(np.abs(x)) > 0.0 else -problem.b
    alpha = problem.rigid_motion(x, w)
    gradient = w if problem.rigid is None else w - problem.rigid.displacement(alpha)
    residual = problem.residual(x, gradient)
    if residual != 0.0 and not goal.reached(residual, x, alpha):  # with 0 there is no other answer, accepted or not
        return None
    status, nothing = goal.verdict(residual, x, Status.MAX_ITERATIONS, alpha), np.zeros((problem.A.nodes, 2))
    return SolverResult(x, gradient, problem.slip_bound(x), nothing, status, residual, rigid=alpha)


_GRADIENT_SHARE: Final = 0.3
"""With slope, the residual of a Newton system is at most this part of the gradient."""

_CORRECTORS: Final = 3

_LONG: Final = 0.9
"""Length of a step from which on there are no correctors."""

_AHEAD = (1.08, 0.3)
"""The length at which products are looked at: this times that of the step, and this more; at most 1 (Gondzio)."""

_WITHIN = (0.1, 10.0)
"""Bounds of products at that length over their target (Gondzio)."""

_GAIN: Final = 0.1
"""Part of the way to that length that a corrector has to gain (Gondzio)."""


def newton_step(
    scaled: ScaledProblem, newton: NewtonSystem, v: Iterate, target: float, tolerance: float, beta: float
) -> Step:
    """The Newton step to nu_i z_i = target: J dv = -F + (0, 0, target e), solved to a relative tolerance."""
    nodal, r1 = scaled.linearize(v), -scaled.gradient(v)
    r2 = scaled.on_constraints(scaled.slack(v.x_n, v.y) - scaled.over_constraints(scaled.target(target), v.nu))
    cap = beta * target
    if scaled.sloped:
        cap = min(cap, _GRADIENT_SHARE * scaled.infeasibility(v))
    weight, r3 = scaled.weight(v.x_n), scaled.out_of_balance(v)
    step = newton.solve(NewtonEquations(nodal, r1, r2, weight, tolerance, scaled.from_rms(cap), r3))
    return along_curve(v, nodal, step)


def along_curve(v: Iterate, nodal: Linearization, step: NewtonStep) -> Step:
    """The step from v along its curve."""
    dx = step.dx
    return Step(v, dx[:, 0], nodal.dy(dx), step.dnu, step.A_dx, step.iterations, step.dalpha)


def step_length(
    settings: InteriorPoint, scaled: ScaledProblem, step: Step, beta: float, sigma: float
) -> tuple[float, Iterate | None]:
    """The largest step that stays in N(gamma, beta) and decreases theta; None if it is below 1e-10."""
    v = step.v
    theta = scaled.theta(v.nu, scaled.slack(v.x_n, v.y))
    alpha = min(1.0, settings.to_boundary * scaled.distance_to_boundary(v, step.dx_n, step.dy, step.dnu))
    while alpha > 1e-10:
        new = step.at(alpha)
        z = scaled.slack(new.x_n, new.y)
        theta_new = scaled.theta(new.nu, z)
        if (
            scaled.smallest_product(new.nu, z) >= settings.gamma * theta_new
            and theta_new <= (1.0 - alpha * settings.omega * (1.0 - sigma)) * theta
            and scaled.infeasibility(new) <= beta * theta_new
        ):
            return alpha, new
        alpha *= settings.backtrack
    return alpha, None


def correct_step(
    settings: InteriorPoint, scaled: ScaledProblem, newton: NewtonSystem, step: Step, target: float, beta: float
) -> Step:
    """The step to nu_i z_i = target, with correctors as long as they lengthen it; collective.

    The last of the Newton systems gave the step; without an approximation of A nothing is changed.
    """
    v, nodal = step.v, scaled.linearize(step.v)
    sigma = target / scaled.theta(v.nu, scaled.slack(v.x_n, v.y))

    def length(step: Step) -> float:
        alpha, new = step_length(settings, scaled, step, beta, sigma)
        return 0.0 if new is None else alpha

    alpha, (low, high) = length(step), (bound * scaled.target(target) for bound in _WITHIN)
    for _ in range(_CORRECTORS):
        if alpha > _LONG:
            break
        ahead = min(1.0, _AHEAD[0] * alpha + _AHEAD[1])
        new = step.at(ahead)
        products = new.nu * scaled.slack(new.x_n, new.y)
        change = scaled.on_constraints(np.maximum(np.clip(products, low, high) - products, -high))
        correction = newton.correction(-scaled.over_constraints(change, v.nu))
        if correction is None:
            break
        trial = along_curve(v, nodal, _sum(step, correction, nodal))
        longer = length(trial)
        if longer < alpha + _GAIN * (ahead - alpha):
            break
        step, alpha = trial, longer
    return step


def _sum(step: Step, correction: NewtonStep, nodal: Linearization) -> NewtonStep:
    """A step with a change of its direction, A dx to the accuracy of the approximation of A."""
    dx_t = nodal.r[:, None] * step.dy + (nodal.slope * step.dx_n)[:, None] * step.v.y
    return NewtonStep(
        np.column_stack([step.dx_n, dx_t]) + correction.dx,
        step.dnu + correction.dnu,
        step.A_dx + correction.A_dx,
        step.iterations,
        step.dalpha + correction.dalpha,
    )
