"""Algorithm PF: the path-following interior-point method for Tresca problems.

R. Kucera, J. Machalova, H. Netuka, P. Zencak: An interior-point algorithm for the minimization arising from 3D contact
problems with friction, Optimization Methods and Software.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from .friction_problem import FrictionProblem, refuse_slope
from .newton_systems import NewtonStep, NewtonSystem, RecyclingSystem
from .results import (
    Goal,
    NotConverged,
    PathFollowingStep,
    Progress,
    ProgressCallback,
    QPResult,
    Status,
    check_constants,
    check_path_constants,
)
from .scaling import ScaledQP

_TO_BOUNDARY = 0.99  # fraction of the way to the boundary a step may go
_BACKTRACK = 0.9  # the grid on which the largest step length is sought
_BLOCKED = 0.1  # a step this short, three times in a row, ends a start that is not the last
_COLD_THETA = (0.1, 1e3, 1e6)  # theta of one cold start after another, over rms(A x - b) there
_FAR = 0.1  # from this distance, in nominal nodal forces, a warm start is no better than a cold one
_FRESH = 0.1  # accuracy of A x at a new iterate, as a part of its change, where products are inexact


@dataclass(frozen=True)
class Iterate:
    """v = (x, nu, z) with A x, in scaled variables; z = -c(x) always, so that the iterates stay strictly inside.

    Attributes:
        x: Forces, shape (m, 3).
        nu: Multipliers of the bound and of the disc, shape (m, 2); 0 where there is no disc.
        z: Slacks -c(x), shape (m, 2); 0 where there is no disc.
        A_x: A x, shape (m, 3).
    """

    x: FloatArray
    nu: FloatArray
    z: FloatArray
    A_x: FloatArray


@dataclass(frozen=True)
class PathFollowing:
    """Algorithm PF(r_tol, c_fact) as a value: its fields are the paper's constants.

    Every constant has a default that serves all problems (the solver scales forces, compliance and discs itself);
    none needs tuning.

    Attributes:
        tolerance: Natural residual of the QP at which to stop (`FrictionProblem.residual`).
        r_tol: Inner precision: CG stops at |residual| <= tol_k |right-hand side| with
            tol_k = min(r_tol err_(k-1), c_fact tol_(k-1)), err the relative change of v in the last step.
        c_fact: The factor by which tol_k decreases at least.
        gamma: Centrality, nu_i z_i >= gamma theta, in (0, 1).
        beta: Dual feasibility, rms(grad_x L) <= beta theta, > 0.  Widened where the start lies outside.
        omega: Sufficient decrease, theta_new <= (1 - alpha omega (1 - sigma)) theta, in (0, 1).
        sigma_min: Centring after an ordinary step, 0 < sigma_min <= sigma_max.
        sigma_max: Centring after a blocked step, at most 1/2.
        max_iterations: Steps before the solver gives up.
        newton: The linear system of a step: RecyclingSystem (J_AM, P_AM with what was learnt of A), AugmentedSystem
            (J_AM, P_AM), SchurComplementSystem (J_SC, P_SC), CondensedSystem (K stiffened by springs in place of A) or
            DenseSystem (J_AM by LU).

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    tolerance: float = 1e-8
    r_tol: float = 0.1
    c_fact: float = 0.9
    gamma: float = 1e-3
    beta: float = 1e4
    omega: float = 1e-2
    sigma_min: float = 0.1
    sigma_max: float = 0.5
    max_iterations: int = 100
    newton: type[NewtonSystem] = RecyclingSystem

    def __post_init__(self) -> None:
        check_path_constants(self)
        check_constants(self, (("omega", 0.0 < self.omega < 1.0, "in (0, 1)"),))

    def solve(
        self,
        qp: FrictionProblem,
        start: QPResult | None = None,
        *,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> QPResult:
        """Solve a Tresca problem.

        Args:
            qp: The problem.
            start: Answer of a nearby problem to start from; given up for a cold start if the steps get blocked.
            tolerance: In place of the field.
            progress: Called after every step.

        Returns:
            The answer, its residual at most the tolerance.

        Raises:
            NotConverged: With the best answer so far, if the residual stays above the tolerance.
            ValueError: If friction grows with pressure.
        """
        refuse_slope(qp, "PathFollowing", "OneLoop()")
        tolerance = self.tolerance if tolerance is None else tolerance
        products = qp.A.products
        goal = Goal(tolerance, qp.accept)
        result = self._trivial(qp, goal) or self._follow(qp, start, goal, progress)
        result = replace(result, products=qp.A.products - products)
        if result.status is not Status.CONVERGED:
            raise NotConverged(
                f"PF ended with a residual of {result.residual:.1e} after {result.iterations} steps "
                f"({result.status.value}), {goal.missed(result.residual)}",
                result,
            )
        return result

    def _trivial(self, qp: FrictionProblem, goal: Goal) -> QPResult | None:
        """The answer, if it is the smallest force the bounds allow: an open contact has nothing to follow a path to."""
        x = qp.project(np.zeros_like(qp.b))
        gradient = qp.gradient(x) if qp.reductions.max(np.abs(x)) > 0.0 else -qp.b
        residual = qp.residual(x, gradient)
        if not goal.reached(residual, x):
            return None
        status = goal.verdict(residual, x, Status.MAX_ITERATIONS)
        return QPResult(x, gradient, np.zeros((qp.A.nodes, 2)), status, 0, 0, residual, ())

    def _follow(
        self, qp: FrictionProblem, start: QPResult | None, goal: Goal, progress: ProgressCallback | None
    ) -> QPResult:
        """Follow the path from one start after another, each farther from the boundary, until the steps do not block.

        A start too near the boundary for how far it is from equilibrium has its steps blocked, and cures itself slowly
        or never; a start far inside costs a few steps more.
        """
        problem = ScaledQP(qp)
        newton = self.newton(problem.A)
        history: list[PathFollowingStep] = []
        results: list[QPResult] = []
        v = None if start is None else self._warm_start(problem, newton, start, goal.tolerance)
        thetas = list(_COLD_THETA)
        try:
            while v is not None or thetas:
                v = v or self._cold_start(problem, newton, thetas.pop(0))
                results.append(self._steps(problem, newton, v, goal, progress, history, patient=not thetas))
                status = results[-1].status
                if status in (Status.CONVERGED, Status.INTERRUPTED) or results[-1].residual <= goal.tolerance:
                    break
                v = None
        finally:
            newton.destroy()
        best = min(results, key=lambda result: result.residual)
        return replace(best, iterations=len(history), history=tuple(history))

    def _steps(
        self,
        problem: ScaledQP,
        newton: NewtonSystem,
        v: Iterate,
        goal: Goal,
        progress: ProgressCallback | None,
        history: list[PathFollowingStep],
        patient: bool,
    ) -> QPResult:
        """Steps from v until the residual agrees; an impatient run ends when blocked.

        Appends to the history, and leaves history and counts of the result to the callers.
        """
        first = len(history)
        theta = problem.theta(v.nu, v.z)
        gradient = self._infeasibility(problem, v)
        beta = max(self.beta, 10.0 * gradient / theta)
        err, krylov_tolerance, alpha = 1.0, self.r_tol / self.c_fact, 1.0
        best, best_at, blocked, residual, reached = math.inf, first, 0, math.inf, False
        status = Status.MAX_ITERATIONS
        for iteration in range(first + 1, first + self.max_iterations + 1):
            # (1) the centring
            sigma = self.sigma_min if alpha > _BLOCKED else self.sigma_max
            # (2) J dv = -F + (0, 0, sigma theta e), solved as precisely as the last step asks
            krylov_tolerance = min(self.r_tol * err, self.c_fact * krylov_tolerance)
            at = problem.linearize(v.x, v.nu, v.z)
            r1 = -problem.gradient(v.x, v.nu, v.A_x)
            r2 = problem.on_constraints(v.z - sigma * theta / problem.safe(v.nu))
            step = newton.solve(at, r1, r2, krylov_tolerance, problem.from_rms(beta * sigma * theta))
            # (3) the largest step that stays in N(gamma, beta) and decreases theta
            alpha, new = self._step_length(problem, v, step, beta, theta, sigma)
            if new is None:
                status = Status.STAGNATED
                break
            err = problem.relative_change((v.x, v.nu, v.z), (new.x, new.nu, new.z))
            v, theta = new, problem.theta(new.nu, new.z)
            A_x = newton.carry(v.x, v.A_x, alpha, _FRESH)  # A x may add up what the products of CG leave out
            v = replace(v, A_x=A_x)
            gradient = self._infeasibility(problem, v)
            # (4) stop by the problem's own residual: err is proportional to alpha, a blocked step looks like the end
            residual = problem.residual(v.x, v.A_x)
            if residual <= goal.residual:
                judged = newton.judge(v.x)  # A x was accumulated: judge by a fresh product
                residual = problem.residual(v.x, judged)
                reached = goal.reached(residual, problem.unscaled(v.x, v.nu, judged)[0])
            history.append(
                PathFollowingStep(iteration, residual, step.iterations, theta, sigma, alpha, gradient, krylov_tolerance)
            )
            stop = progress is not None and progress(Progress(0, iteration, residual))
            if reached:
                break
            if stop:
                status = Status.INTERRUPTED
                break
            if residual < 0.9 * best:
                best, best_at = residual, iteration
            blocked = blocked + 1 if alpha < _BLOCKED else 0
            if iteration - best_at >= goal.patience or (blocked == 3 and not patient):
                status = Status.STAGNATED
                break
        if not reached:
            judged = newton.judge(v.x)
            residual = problem.residual(v.x, judged)
        x, force_gradient, multipliers = problem.unscaled(v.x, v.nu, judged)
        return QPResult(
            x=x,
            gradient=force_gradient,
            multipliers=multipliers,
            status=goal.verdict(residual, x, status),
            iterations=0,
            products=0,
            residual=residual,
            history=(),
        )

    def _step_length(
        self, problem: ScaledQP, v: Iterate, step: NewtonStep, beta: float, theta: float, sigma: float
    ) -> tuple[float, Iterate | None]:
        """Step (3); None if no step longer than 1e-10 will do.  Costs no product: A dx came with the step."""
        alpha = min(1.0, _TO_BOUNDARY * problem.distance_to_boundary(v.x, step.dx, v.nu, step.dnu))
        while alpha > 1e-10:
            x = v.x + alpha * step.dx
            new = Iterate(x, v.nu + alpha * step.dnu, problem.slack(x), v.A_x + alpha * step.A_dx)
            theta_new = problem.theta(new.nu, new.z)
            in_neighbourhood = (
                problem.smallest_product(new.nu, new.z) >= self.gamma * theta_new
                and self._infeasibility(problem, new) <= beta * theta_new
            )
            if in_neighbourhood and theta_new <= (1.0 - alpha * self.omega * (1.0 - sigma)) * theta:
                return alpha, new
            alpha *= _BACKTRACK
        return alpha, None

    def _infeasibility(self, problem: ScaledQP, v: Iterate) -> float:
        return problem.rms(problem.gradient(v.x, v.nu, v.A_x))

    def _cold_start(self, problem: ScaledQP, newton: NewtonSystem, relative_theta: float) -> Iterate:
        """Equal pressure everywhere, no friction, and centred multipliers with theta so many times rms(A x - b)."""
        x = np.zeros((problem.nodes, 3))
        x[:, 0] = problem.lower + 1.0
        v = Iterate(x, np.zeros((problem.nodes, 2)), problem.slack(x), newton.start(x, 0.0))
        theta = relative_theta * max(problem.rms(problem.gradient(x, v.nu, v.A_x)), 1e-3)
        return replace(v, nu=problem.on_constraints(theta / problem.safe(v.z)))

    def _warm_start(self, problem: ScaledQP, newton: NewtonSystem, start: QPResult, tolerance: float) -> Iterate | None:
        """The last answer, pushed back inside: its projection step x - w/d, projected smoothly with nu_i z_i = theta.

        theta follows how far that answer is from solving the present problem, and is not smaller than the tolerance
        makes sense of.  None if it is so far that a cold start is as good.
        """
        x, w = problem.scaled(start.x, start.gradient)
        q = problem.projection_step(x, w)
        distance = problem.distance_from_solution(x, q)
        if distance > _FAR:
            return None
        x, nu = problem.smoothed_projection(q, max(distance**1.5, 0.1 * tolerance))
        return Iterate(x, nu, problem.slack(x), newton.start(x, 0.0))
