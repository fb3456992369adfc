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
block, or need a predictor solve and are twice as many.  The gradient along the curve, A x + alpha A dx + alpha^2 A (0,
F dx_n dy), is only used to choose alpha: its last term is computed with the low-rank approximation of A.  Without slope
curve and line coincide, and the gradient is exact.

If a product is a solve with K, it need not be exact.  Products of the Krylov method have the accuracy that the step
needs; those of the iterates correct K^-1 B^T x to a fraction of its change, and errors do not accumulate
(Compliance.mult_incremental).  Only the final residual is computed with the most accurate product.

With rigid motions of bodies that contact alone holds, w = A x - b - G^T alpha, and G x = e are further equations
(rigid_motions.py).  As x is not linear along a step, G x - e is computed anew at every iterate; it counts with the
gradient.

Proved: for F = 0 and exact products this is PF for a convex problem.  Not proved for F > 0: that the Newton system is
regular, that a path leads to theta = 0, or which of several solutions it finds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import FloatArray
from .equilibrium import balanced_forces, no_equilibrium, sliding
from .free_start import free_start
from .friction_problem import FrictionProblem, Solver
from .longer_steps import longer
from .newton_systems import NewtonChoice, SchurComplementSystem
from .path_ends import Finish, smallest
from .results import (
    Goal,
    InteriorPointStep,
    NotConverged,
    Progress,
    ProgressCallback,
    QPStep,
    SolverResult,
    Status,
    check_constants,
)
from .rigid_motions import Equilibrium
from .scaled_problem import Iterate, ScaledProblem
from .steps import newton_step, step_length

_OFF = 1e-3  # residual above which an iteration has not found anything near a solution


@dataclass(frozen=True)
class InteriorPoint:
    """The interior-point method as a value: its fields are all its settings; the defaults suit all problems measured.

    Attributes:
        tolerance: Natural residual at which to stop (`FrictionProblem.residual`).
        r_tol: Inner precision: the Krylov method stops at |residual| <= tol_k |right-hand side| with
            tol_k = min(r_tol err_(k-1), c_fact tol_(k-1)), err the relative change of v = (x, nu, z) in the last step.
        c_fact: The factor by which tol_k decreases at least.
        gamma: Centrality, nu_i z_i >= gamma theta, in (0, 1).
        beta: Dual feasibility, rms(W gradient) <= beta theta, > 0.
        widening: beta is at least this times what the start needs.
        omega: Sufficient decrease, theta_new <= (1 - alpha omega (1 - sigma)) theta, in (0, 1).
        sigma_min: Centring after an ordinary step, > 0; at most that after a short one, sigma_max, at most 1/2.
        max_iterations: Newton steps of a start before the solver gives up.
        newton: The linear system of a step: SchurComplementSystem (J_SC, P_SC), AugmentedSystem (J_AM, P_AM; without
            slope), CondensedSystem (K with springs in place of A) or DenseSystem (LU, for small problems).
        free: Largest number of products that a cold start spends on the problem without friction (free_start.py); 0:
            it is left out.
        starts: If its steps block, cold starts from equal pressure follow, with this theta over rms(A x - b) there.
        blocked: A step shorter than this, three times in a row, ends a start that is not the last.
        to_boundary: Largest fraction of the distance to the boundary for a step.
        backtrack: The ratio of the step lengths tried.
        gradient_share: With slope, the residual of a Newton system is at most this part of the gradient, and
        solved_share: this one where a product is a solve by multigrid.
        fresh: If products are inexact, accuracy of A x at a new iterate relative to its change.
        growth: Inexact products become ten times as accurate after a step of length alpha from which the gradient is
            more than 1 + growth alpha times as large: their errors outweigh it, as where dx is large and A dx small.
        wait: With slope or inexact products, sigma is at least this times the gradient over its bound in N(gamma,
            beta), so that theta does not decrease faster than the gradient; but at most `wait_max` for that reason.
        warm_floor: With slope, a start from given forces has x_n at least this many nominal forces inside,
        warm_inside: |y| at most this,
        warm_theta: and this theta, over rms(A x - b) there.
        finish: A method that is tried from an iterate with a residual of at most `finish_from`; if it fails, the path
            is followed further from that iterate, and it is tried once more at a hundredth of the residual.
        far: Without slope, a start from given forces begins on the central path of their projection; at larger
            distances from the solution, in nominal forces, a cold start is used.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    tolerance: float = 1e-8
    r_tol: float = 0.3
    c_fact: float = 0.99
    gamma: float = 1e-3
    beta: float = 1e4
    widening: float = 10.0
    omega: float = 1e-2
    sigma_min: float = 0.1
    sigma_max: float = 0.5
    max_iterations: int = 100
    newton: NewtonChoice = field(default_factory=SchurComplementSystem)
    free: int = 12
    starts: tuple[float, ...] = (1e3, 1e6)
    blocked: float = 0.05
    to_boundary: float = 0.95
    backtrack: float = 0.9
    gradient_share: float = 0.3
    solved_share: float = 0.1
    fresh: float = 0.01
    growth: float = 0.5
    wait: float = 3.0
    wait_max: float = 0.9
    warm_floor: float = 0.3
    warm_inside: float = 0.9
    warm_theta: float = 0.03
    far: float = 0.1
    finish: Solver | None = None
    finish_from: float = 3e-4

    name = "interior point"

    def __post_init__(self) -> None:
        bounds = (
            ("tolerance", self.tolerance > 0.0, "> 0"),
            ("r_tol", 0.0 < self.r_tol < 1.0, "in (0, 1)"),
            ("c_fact", 0.0 < self.c_fact < 1.0, "in (0, 1)"),
            ("gamma", 0.0 < self.gamma < 1.0, "in (0, 1)"),
            ("beta", self.beta > 0.0, "> 0"),
            ("omega", 0.0 < self.omega < 1.0, "in (0, 1)"),
            ("sigma_min", 0.0 < self.sigma_min <= self.sigma_max, "in (0, sigma_max]"),
            ("sigma_max", self.sigma_max <= 0.5, "at most 1/2"),
            ("free", self.free >= 0, "at least 0"),
            ("max_iterations", self.max_iterations >= 1, "at least 1"),
            ("starts", len(self.starts) >= 1, "at least one"),
        )
        check_constants(self, bounds)

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """Solve a problem with friction; arguments and errors as those of `Solver.solve`.

        If steps from `start` block, the cold starts follow.  `history` has an InteriorPointStep per Newton step.

        Raises:
            NotConverged: With the status NO_EQUILIBRIUM before the first step, if no contact forces balance the loads
                of a body that contact alone holds, or after some steps, if it slides away.
        """
        products = problem.A.products
        balanced_forces(problem, self.name)
        goal = Goal(self.tolerance if tolerance is None else tolerance, problem.accept)
        result = smallest(problem, goal, self.name) or _Path(self, problem, goal, progress).follow(start, gradient)
        result = replace(result, products=problem.A.products - products)
        if result.equilibrium is not None and problem.rigid is not None and result.status is Status.NO_EQUILIBRIUM:
            message = f"{no_equilibrium(problem.rigid, result.equilibrium)}, after {result.newton_steps} Newton steps"
            raise NotConverged(message, replace(result, message=message))
        if result.status is not Status.CONVERGED:
            residuals = ", ".join(f"{step.residual:.1e}" for step in result.history[-3:])
            message = (
                f"the interior-point method ended with a residual of {result.residual:.1e} after {result.newton_steps} "
                f"Newton steps ({result.status.value}), {goal.missed(result.residual)}; last residuals {residuals}"
            )
            raise NotConverged(message, replace(result, message=message))
        return result

    def centring(self, alpha: float, used: float = 0.0) -> float:
        """sigma after a step of length alpha, with the gradient at a fraction `used` of its bound in N(gamma, beta)."""
        sigma = min(max((1.0 - alpha) ** 2, self.sigma_min), self.sigma_max)
        return max(sigma, min(self.wait * used, self.wait_max))


class _Path:
    """The solution of a problem from one start after another."""

    def __init__(
        self, settings: InteriorPoint, problem: FrictionProblem, goal: Goal, progress: ProgressCallback | None
    ):
        self._settings, self._problem, self._goal, self._progress = settings, problem, goal, progress
        self._scaled = ScaledProblem(problem)
        self._newton = settings.newton.system(self._scaled.A, self._scaled.sloped)
        self._history: list[QPStep] = []
        self._finish = Finish(settings.finish, settings.finish_from, problem, goal, progress, self._history)

    def follow(self, start: FloatArray | None, gradient: FloatArray | None) -> SolverResult:
        """One start after another, each farther inside: near the boundary steps may block, far inside they are more."""
        results: list[SolverResult] = []
        starts, v = list(self._settings.starts), None if start is None else self._warm(start, gradient)
        free = self._settings.free
        try:
            while v is not None or free > 0 or starts:
                if v is None and free > 0:
                    v, free = free_start(self._scaled, self._newton, free, self._settings.fresh), 0
                if v is None:  # equal pressure everywhere, no friction
                    x_n, y = self._scaled.lower + 1.0, np.zeros((self._scaled.nodes, 2))
                    v = self._centred(x_n, y, starts.pop(0))
                results.append(self._steps(v, patient=not starts))
                v, last = None, results[-1]
                gone = last.equilibrium is not None
                if (
                    gone
                    or last.status in (Status.CONVERGED, Status.INTERRUPTED)
                    or last.residual <= self._goal.tolerance
                ):
                    break
        finally:
            if not self._finish.converged:
                self._newton.keep()
            self._newton.destroy()
        best = last if gone else min(results, key=lambda result: result.residual)
        if not gone and best.residual > _OFF and best.status is not Status.INTERRUPTED:
            best = next(filter(None, map(self._slid, results)), best)
        return replace(best, newton_steps=len(self._history), history=tuple(self._history))

    def _slid(self, result: SolverResult) -> SolverResult | None:
        """A result without solution, if its bodies slide away."""
        away = sliding(self._problem, result.x, result.gradient, result.rigid, ended=True)
        return None if away is None else replace(result, status=Status.NO_EQUILIBRIUM, equilibrium=away)

    def _centred(self, x_n: FloatArray, y: FloatArray, relative_theta: float) -> Iterate:
        """These forces, and centred multipliers with a multiple of rms(A x - b) as theta."""
        scaled = self._scaled
        A_x = self._newton.start(scaled.forces(x_n, y), self._settings.fresh)
        v = scaled.closing(Iterate(x_n, y, np.zeros((scaled.nodes, 2)), A_x))
        theta = relative_theta * max(scaled.rms(scaled.gradient(v)), 1e-3)
        return v._replace(nu=scaled.over_constraints(np.full_like(v.nu, theta), scaled.slack(x_n, y)))

    def _warm(self, start: FloatArray, gradient: FloatArray | None) -> Iterate | None:
        """An iterate near the forces `start`, strictly inside; None if a cold start is preferable."""
        settings, scaled = self._settings, self._scaled
        if scaled.sloped:
            x_n, y = scaled.inside(start, settings.warm_floor, settings.warm_inside)
            return self._centred(x_n, y, settings.warm_theta)
        gradient = self._problem.gradient(start) if gradient is None else gradient
        x = scaled.scaled(start)
        q = scaled.projection_step(x, scaled.scaled_gradient(gradient))
        distance = scaled.distance_from_solution(x, q)
        if distance > settings.far:
            return None
        x_n, y, nu = scaled.smoothed_projection(q, max(distance**1.5, 0.1 * self._goal.tolerance))
        return scaled.closing(Iterate(x_n, y, nu, self._newton.start(scaled.forces(x_n, y), settings.fresh)))

    def _exact(self, v: Iterate) -> Iterate:
        """The iterate with its most accurate A x: once a certificate has failed, that of the balanced displacement."""
        scaled, balanced = self._scaled, self._problem.balanced
        if balanced is None or not self._goal.refused:
            return v._replace(A_x=self._newton.exact_product(scaled.forces(v.x_n, v.y)), w=None)
        return scaled.with_gradient(v, balanced(scaled.unscaled(v)[0]))

    def _steps(self, v: Iterate, patient: bool) -> SolverResult:
        """Newton steps from v until the residual is small enough; an impatient run ends when blocked."""
        settings, scaled, newton, goal, history = self._settings, self._scaled, self._newton, self._goal, self._history
        problem, first = self._problem, len(history)
        theta, gradient = scaled.theta(v.nu, scaled.slack(v.x_n, v.y)), scaled.infeasibility(v)
        beta = max(settings.beta, settings.widening * gradient / theta)
        err, krylov_tolerance, alpha = 1.0, settings.r_tol / settings.c_fact, 1.0
        waits = scaled.sloped or not problem.A.exact  # then A x of an iterate is computed anew
        best, best_at, blocked, reached, status = math.inf, first, 0, False, Status.MAX_ITERATIONS
        away: Equilibrium | None = None
        for iteration in range(first + 1, first + settings.max_iterations + 1):
            sigma = settings.centring(alpha, gradient / (beta * theta) if waits else 0.0)
            krylov_tolerance = min(settings.r_tol * err, settings.c_fact * krylov_tolerance)
            step = newton_step(settings, scaled, newton, v, sigma * theta, krylov_tolerance, beta)
            step = longer(settings, scaled, newton, step, sigma * theta, beta) if waits else step
            alpha, new = step_length(settings, scaled, step, beta, sigma)
            if new is None:
                status = Status.STAGNATED
                break
            err = scaled.relative_change(v, new)
            x = scaled.forces(new.x_n, new.y)
            v = new._replace(A_x=newton.advance(x, None if scaled.sloped else new.A_x, alpha, settings.fresh))
            theta, before, gradient = scaled.theta(v.nu, scaled.slack(v.x_n, v.y)), gradient, scaled.infeasibility(v)
            if gradient > (1.0 + settings.growth * alpha) * before:
                newton.tighten()
            # err is proportional to alpha, so a blocked step would look like convergence: the residual decides
            residual = problem.residual(*scaled.unscaled(v)[:2])
            if residual <= goal.residual or goal.refused:  # A x may be inexact: decide with the most accurate product
                exact = self._exact(v)
                forces, force_gradient, multipliers = scaled.unscaled(exact)
                if goal.refused:
                    A_x = newton.corrected(v.A_x, exact.A_x)
                    v = exact if A_x is exact.A_x else v._replace(A_x=A_x)
                    gradient = scaled.infeasibility(v)
                    beta = max(beta, settings.widening * gradient / theta)
                residual = problem.residual(forces, force_gradient)
                reached = goal.reached(residual, forces, scaled.rigid_motion(exact))
            count = len(history) + 1
            history.append(
                InteriorPointStep(count, residual, step.iterations, theta, sigma, alpha, gradient, krylov_tolerance)
            )
            stop = self._progress is not None and self._progress(Progress(0, count, residual))
            if reached:
                break
            if stop:
                status = Status.INTERRUPTED
                break
            if self._finish.wanted(residual):
                newton.keep()
                finished = self._finish.tried(scaled.unscaled(v)[0], scaled.displaced(v), settings.name)
                if finished is not None:
                    return finished
                v = v._replace(A_x=newton.exact_product(x))
            if residual < 0.9 * best:
                best, best_at = residual, iteration
            blocked = blocked + 1 if alpha < settings.blocked else 0
            if blocked == 3:
                away = sliding(problem, *scaled.unscaled(v)[:2], scaled.rigid_motion(v))
                if away is not None:
                    status = Status.NO_EQUILIBRIUM
                    break
            if iteration - best_at >= goal.patience or (blocked == 3 and not patient):
                status = Status.STAGNATED
                break
        if not reached:
            exact = self._exact(v)
            forces, force_gradient, multipliers = scaled.unscaled(exact)
            residual = problem.residual(forces, force_gradient)
        motion = scaled.rigid_motion(exact)
        if problem.rigid is not None:
            motion = problem.shortest_motion(forces, scaled.displaced(exact), motion)
            force_gradient = scaled.displaced(exact) - problem.rigid.displacement(motion)
        return SolverResult(
            x=forces,
            gradient=force_gradient,
            slip_bound=problem.slip_bound(forces),
            multipliers=multipliers,
            status=goal.verdict(residual, forces, status, motion),
            outer_steps=0,
            newton_steps=0,
            products=0,
            residual=residual,
            history=(),
            method=settings.name,
            rigid=motion,
            equilibrium=away,
        )
