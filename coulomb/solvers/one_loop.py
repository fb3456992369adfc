"""Friction in one path-following loop: the bound of friction g = c + F x_n is an unknown like the others.

Algorithm PF for the Tresca problem follows, from theta > 0 down to 0, the solutions of

    w_n - nu1 = 0,   w_t + nu2 x_t/g = 0,   nu1 x_n = theta,   nu2 (g^2 - |x_t|^2)/(2 g) = theta        (w = A x - b)

A law with a slope puts g = c + F x_n there.  In y = x_t/g the cone |x_t| < g is the unit disc (cone.py):

    w_n - nu1 = 0,   w_t + nu2 y = 0,   nu1 x_n = theta,   nu2 g (1 - |y|^2)/2 = theta,   x = (x_n, g y)

Differentiated, with dx_t = g dy + F y dx_n as the unknown in place of dy, h = nu2/g, k = F (1 + |y|^2)/2, D22 = z/nu,
and d the change of the constraints, d1 = -dx_n, d2 = y dx_t - k dx_n:

    row n:   (A dx)_n - dnu1 = r_n              dnu1 = (d1 - r2_1)/D22_1
    row t:   (A dx)_t + h (dx_t - F y dx_n) + y dnu2 = r_t              dnu2 = (d2 - r2_2)/D22_2

With the multipliers eliminated, (A + C) dx = rhs: C is nodal, as in Tresca's J_SC, and unsymmetric by the two terms
that dx_n sends to row t, -h F y and -y k/D22_2.  With g frozen in a step and updated after it the iteration stalls.

The step is taken along the curve x_n + alpha dx_n, y + alpha dy, not along the straight line in x_t, so that friction
stays in proportion to pressure at a node that opens.  On the straight line y is lost there by division: steps block,
or need a predictor solve and are twice as many.  The gradient along the curve, A x + alpha A dx + alpha^2 A (0, F dx_n
dy), only serves to choose alpha: its last term is estimated from what is known of A.

Where a product is a solve with K, none of them needs to be exact.  Those of the Krylov method are as exact as the step
asks, those of the iterates correct K^-1 B^T x to 3 % of its change, without adding up (Compliance.follow).  Only
the residual that decides is computed with a product as exact as can be.

In the neighbourhood N(gamma, beta) and in the Krylov tolerance the slip of a node is weighted by its friction bound
(ScaledCoulomb.weight): open nodes get no weight.

Proved: for F = 0 this is PF for a convex problem.  The preconditioner of `cone_systems.py` is exact when its stand-in
for A is.  CONVERGED means that the Coulomb residual, computed afresh, is below the tolerance, whatever the way there.
Observed (`coulomb benchmark friction --p 6 --p 10 --p 16`): 16 to 23 steps from a cold start to 1e-8 for F = 0.1
to 1.5, 2 to 5 FGMRES iterations a step.  Not proved: that A + C is never singular, that a path leads from the start to
theta = 0, or which of several solutions it finds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray
from .cone import ConeIterate, ScaledCoulomb
from .cone_systems import ConeSystem, KrylovConeSystem
from .friction_problem import FrictionProblem
from .results import (
    CoulombResult,
    Goal,
    NotConverged,
    PathFollowingStep,
    Progress,
    ProgressCallback,
    Status,
    check_path_constants,
)

_TO_BOUNDARY = 0.99  # fraction of the way to the boundary a step may go
_BACKTRACK = 0.9  # the grid on which the largest step length is sought
_WAIT = 3.0  # sigma over the part of N(gamma, beta) that the gradient takes up
_SLOWEST = 0.9  # the largest sigma, taken where theta must wait for the gradient
_BLOCKED = 1e-2  # a step this short, three times in a row, ends a start that is not the last
_STARTS = ((0.1, 1.0), (0.1, 1e-3), (10.0, 1e-3), (1e3, 1e-3))  # theta over rms(A x - b) there, and r_tol, as parts
_FLOOR, _INSIDE = 0.1, 0.9  # a warm start: x_n at least so many nominal forces, |y| at most so much
_GRADIENT = 0.3  # the residual of a step's linear system, over the gradient that it is to take away
_FRESH = 0.03  # accuracy of A x at a new iterate, as a part of its change


class _Step(NamedTuple):
    """A step on its curve: v(alpha), and the Krylov iterations it took to find."""

    v: ConeIterate
    dx_n: FloatArray
    dy: FloatArray
    dnu: FloatArray
    A_dx: FloatArray
    A_bend: FloatArray
    iterations: int

    def at(self, alpha: float) -> ConeIterate:
        return ConeIterate(
            self.v.x_n + alpha * self.dx_n,
            self.v.y + alpha * self.dy,
            self.v.nu + alpha * self.dnu,
            self.v.A_x + alpha * self.A_dx + alpha**2 * self.A_bend,
        )


@dataclass(frozen=True)
class OneLoop:
    """Coulomb friction by one path-following loop, as a value.

    Attributes:
        tolerance: Coulomb residual at which to stop (`FrictionProblem.residual`).
        r_tol: Inner precision as in PathFollowing: tol_k = min(r_tol err_(k-1), c_fact tol_(k-1)).
        c_fact: The factor by which tol_k decreases at least.
        gamma: Centrality, nu_i z_i >= gamma theta, in (0, 1).
        beta: Dual feasibility, rms(W gradient) <= beta theta, > 0.  Widened where the start lies outside.
        sigma_min: Centring after an ordinary step, 0 < sigma_min <= sigma_max.
        sigma_max: Centring after a short step, at most 1/2.
        max_iterations: Newton steps of a start before the solver gives up.
        newton: The linear system of a step: KrylovConeSystem, CondensedConeSystem, which works with K stiffened by
            springs in place of A, or DenseConeSystem for small problems.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    tolerance: float = 1e-8
    r_tol: float = 0.3
    c_fact: float = 0.99
    gamma: float = 1e-3
    beta: float = 1e4
    sigma_min: float = 0.1
    sigma_max: float = 0.5
    max_iterations: int = 100
    newton: type[ConeSystem] = KrylovConeSystem

    name = "one loop"

    def __post_init__(self) -> None:
        check_path_constants(self)

    def solve(
        self,
        problem: FrictionProblem,
        *,
        start: FloatArray | None = None,
        progress: ProgressCallback | None = None,
    ) -> CoulombResult:
        """Solve a Coulomb problem.

        Args:
            problem: The problem.
            start: Forces in newtons, shape (3 m,), of a nearby problem, such as the load step before or a coarser mesh.
                Taken well inside the cones, they save about a quarter of the steps; where steps get blocked from
                there, the cold starts follow.
            progress: Called after every step.

        Returns:
            The answer, its Coulomb residual at most the tolerance; `history` has a PathFollowingStep a Newton step.

        Raises:
            NotConverged: With the best answer so far, if the residual stays above the tolerance.
        """
        products = problem.A.products
        goal = Goal(self.tolerance, problem.accept)
        result = self._open(problem, goal) or self._follow(problem, goal, start, progress)
        result = replace(result, products=problem.A.products - products)
        if result.status is not Status.CONVERGED:
            residuals = ", ".join(f"{step.residual:.1e}" for step in result.history[-3:])
            message = (
                f"one loop ended with a Coulomb residual of {result.residual:.1e} after {result.path_following} Newton "
                f"steps ({result.status.value}), {goal.missed(result.residual)}; last residuals {residuals}"
            )
            raise NotConverged(message, replace(result, message=message))
        return result

    def _open(self, problem: FrictionProblem, goal: Goal) -> CoulombResult | None:
        """The answer, if it is the smallest force the bounds allow: there is no path to follow then."""
        x = problem.project(np.zeros_like(problem.b))
        gradient = problem.gradient(x) if problem.reductions.max(np.abs(x)) > 0.0 else -problem.b
        residual = problem.residual(x, gradient)
        if not goal.reached(residual, x):
            return None
        status = goal.verdict(residual, x, Status.MAX_ITERATIONS)
        return CoulombResult(x, gradient, problem.slip_bound(x), status, math.nan, 0, 0, 0, residual, (), self.name)

    def _follow(
        self, problem: FrictionProblem, goal: Goal, start: FloatArray | None, progress: ProgressCallback | None
    ) -> CoulombResult:
        """One start after another, solved more precisely, then farther inside, until the steps do not block."""
        scaled = ScaledCoulomb(problem)
        newton = self.newton(scaled.A)
        history: list[PathFollowingStep] = []
        results: list[CoulombResult] = []
        cold: tuple[FloatArray, FloatArray] = (scaled.lower + 1.0, np.zeros((scaled.nodes, 2)))
        starts = [(*cold, theta, precision) for theta, precision in _STARTS]
        if start is not None:
            starts.insert(0, (*scaled.inside(start, _FLOOR, _INSIDE), *_STARTS[0]))
        try:
            for x_n, y, theta, precision in starts:
                run = replace(self, r_tol=precision * self.r_tol)
                v = run._start(scaled, newton, x_n, y, theta)
                patient = len(results) == len(starts) - 1
                results.append(run._steps(scaled, newton, goal, v, progress, history, patient))
                status = results[-1].status
                if status in (Status.CONVERGED, Status.INTERRUPTED) or results[-1].residual <= self.tolerance:
                    break
        finally:
            newton.destroy()
        best = min(results, key=lambda result: result.residual)
        return replace(best, path_following=len(history), history=tuple(history))

    def _start(
        self, scaled: ScaledCoulomb, newton: ConeSystem, x_n: FloatArray, y: FloatArray, relative_theta: float
    ) -> ConeIterate:
        """These forces, and centred multipliers with theta so many times rms(A x - b).

        A cold start has equal pressure everywhere and no friction.
        """
        v = ConeIterate(x_n, y, np.zeros((scaled.nodes, 2)), newton.start(scaled.forces(x_n, y), _FRESH))
        theta = relative_theta * max(scaled.rms(scaled.gradient(v)), 1e-3)
        return v._replace(nu=theta / scaled.safe(scaled.slack(x_n, y)))

    def _steps(
        self,
        scaled: ScaledCoulomb,
        newton: ConeSystem,
        goal: Goal,
        v: ConeIterate,
        progress: ProgressCallback | None,
        history: list[PathFollowingStep],
        patient: bool,
    ) -> CoulombResult:
        """Newton steps from v until the residual agrees, noted in the history; an impatient run ends when blocked."""
        problem, first = scaled.problem, len(history)
        z = scaled.slack(v.x_n, v.y)
        theta = scaled.theta(v.nu, z)
        beta = max(self.beta, 10.0 * self._infeasibility(scaled, v) / theta)
        err, krylov_tolerance, alpha = 1.0, self.r_tol / self.c_fact, 1.0
        best, best_at, blocked, residual, reached = math.inf, first, 0, math.inf, False
        status = Status.MAX_ITERATIONS
        for iteration in range(first + 1, first + self.max_iterations + 1):
            sigma = self._centring(alpha, self._infeasibility(scaled, v) / (beta * theta))
            krylov_tolerance = min(self.r_tol * err, self.c_fact * krylov_tolerance)
            step = self._newton_step(scaled, newton, v, z, sigma * theta, krylov_tolerance, beta)
            alpha, new = self._step_length(scaled, step, beta)
            if new is None:
                status = Status.STAGNATED
                break
            err = self._change(scaled, v, new)
            A_x = newton.carry(scaled.forces(new.x_n, new.y), None, alpha, _FRESH)
            v = new._replace(A_x=A_x)
            z = scaled.slack(v.x_n, v.y)
            theta = scaled.theta(v.nu, z)
            residual = problem.residual(*scaled.unscaled(v))
            if residual <= goal.residual:  # judge by a product as exact as can be
                x, gradient_of_x = scaled.unscaled(self._judged(scaled, newton, v))
                residual = problem.residual(x, gradient_of_x)
                reached = goal.reached(residual, x)
            gradient = self._infeasibility(scaled, v)
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
            x, gradient_of_x = scaled.unscaled(self._judged(scaled, newton, v))
            residual = problem.residual(x, gradient_of_x)
        return CoulombResult(
            x=x,
            gradient=gradient_of_x,
            slip_bound=problem.slip_bound(x),
            status=goal.verdict(residual, x, status),
            contraction=math.nan,
            iterations=0,
            path_following=0,
            products=0,
            residual=residual,
            history=(),
            method=self.name,
        )

    def _newton_step(
        self,
        scaled: ScaledCoulomb,
        newton: ConeSystem,
        v: ConeIterate,
        z: FloatArray,
        target: float,
        tolerance: float,
        beta: float,
    ) -> _Step:
        """(A + C) dx = rhs, then the multipliers, dy, and the bend of the curve."""
        at = scaled.linearize(v)
        r1 = -scaled.gradient(v)
        r2 = np.where(z > 0.0, z - target / scaled.safe(v.nu), 0.0)
        dnu_0 = -r2 / at.D22
        rhs = r1.copy()
        rhs[:, 0] += dnu_0[:, 0]
        rhs[:, 1:] -= dnu_0[:, 1:] * v.y
        step = newton.solve(
            at,
            rhs,
            scaled.weight(v.x_n),
            tolerance,
            scaled.from_rms(min(beta * target, _GRADIENT * self._infeasibility(scaled, v))),
        )
        dy = at.dy(step.dx)
        bend = np.column_stack([np.zeros(scaled.nodes), (at.F * step.dx[:, 0])[:, None] * dy])
        dnu = (at.constraints(step.dx) - r2) / at.D22
        return _Step(v, step.dx[:, 0], dy, dnu, step.A_dx, newton.estimate(bend), step.iterations)

    def _step_length(self, scaled: ScaledCoulomb, step: _Step, beta: float) -> tuple[float, ConeIterate | None]:
        """The largest step that stays in N(gamma, beta); None if none longer than 1e-10 will do."""
        infeasibility = self._infeasibility(scaled, step.v)
        alpha = min(1.0, _TO_BOUNDARY * scaled.distance_to_boundary(step.v, step.dx_n, step.dy, step.dnu))
        while alpha > 1e-10:
            v = step.at(alpha)
            z = scaled.slack(v.x_n, v.y)
            theta_new = scaled.theta(v.nu, z)
            allowed = max(beta * theta_new, (1.0 - 0.1 * alpha) * infeasibility)
            central = scaled.smallest_product(v.nu, z) >= self.gamma * theta_new
            if central and self._infeasibility(scaled, v) <= allowed:
                return alpha, v
            alpha *= _BACKTRACK
        return alpha, None

    def _centring(self, alpha: float, used: float) -> float:
        """sigma after a step of length alpha, where `used` of the room that N(gamma, beta) gives the gradient is taken.

        theta must not run ahead of a gradient that inexact products keep from falling as fast.
        """
        sigma = min(max((1.0 - alpha) ** 2, self.sigma_min), self.sigma_max)
        return max(sigma, min(_WAIT * used, _SLOWEST))

    def _infeasibility(self, scaled: ScaledCoulomb, v: ConeIterate) -> float:
        return scaled.rms(scaled.weight(v.x_n) * scaled.gradient(v))

    def _judged(self, scaled: ScaledCoulomb, newton: ConeSystem, v: ConeIterate) -> ConeIterate:
        return v._replace(A_x=newton.judge(scaled.forces(v.x_n, v.y)))

    def _change(self, scaled: ScaledCoulomb, old: ConeIterate, new: ConeIterate) -> float:
        """err = |v_new - v| / |v_new| of v = (x, nu, z)."""

        def triple(v: ConeIterate) -> tuple[FloatArray, ...]:
            return scaled.forces(v.x_n, v.y), v.nu, scaled.slack(v.x_n, v.y)

        return scaled.relative_change(triple(old), triple(new))
