"""A step of path following: its Newton system, how far it goes, and correctors that lengthen it.

A step ends where the first constraint is reached, often after a tenth of its length because of a few of thousands of
nodes.  Correctors for products nu z that would be too small or too large at a longer step (J. Gondzio: Multiple
centrality corrections in a primal-dual method for linear programming, Comput. Optim. Appl. 6, 1996) are computed with
the approximation of A from the products so far, without a product by A.  The boundary is where it is for any direction,
so that the length of a corrected step is known; only its gradient is estimated, and that of the next iterate is
computed with a product in any case.  A corrector is used only if it lengthens the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .friction_problem import SolverSettings
from .linearization import Linearization
from .newton_systems import NewtonEquations, NewtonStep, NewtonSystem
from .scaled_problem import Iterate, ScaledProblem, Step
from .settings import within

_GRADIENT_SHARE = 0.3
"""With slope, the residual of a Newton system is at most this part of the gradient."""

_CORRECTORS = 3

_LONG = 0.9
"""Length of a step from which on there are no correctors."""

_AHEAD = (1.08, 0.3)
"""The length at which products are looked at: this times that of the step, and this more; at most 1 (Gondzio)."""

_WITHIN = (0.1, 10.0)
"""Bounds of products at that length over their target (Gondzio)."""

_GAIN = 0.1
"""Part of the way to that length that a corrector has to gain (Gondzio)."""


@dataclass(frozen=True)
class StepSettings(SolverSettings):
    """What a step needs of the settings; see `InteriorPoint`."""

    gamma: float = within("(0, 1)", 1e-3)
    omega: float = within("(0, 1)", 1e-2)
    to_boundary: float = within("(0, 1)", 0.95)
    backtrack: float = within("(0, 1)", 0.9)


def newton_step(
    scaled: ScaledProblem,
    newton: NewtonSystem,
    v: Iterate,
    target: float,
    tolerance: float,
    beta: float,
) -> Step:
    """The Newton step to nu_i z_i = target: J dv = -F + (0, 0, target e), solved to a relative tolerance."""
    at, r1 = scaled.linearize(v), -scaled.gradient(v)
    r2 = scaled.on_constraints(scaled.slack(v.x_n, v.y) - scaled.over_constraints(np.full_like(v.nu, target), v.nu))
    cap = beta * target
    if scaled.sloped:
        cap = min(cap, _GRADIENT_SHARE * scaled.infeasibility(v))
    weight, r3 = scaled.weight(v.x_n), scaled.out_of_balance(v)
    step = newton.solve(NewtonEquations(at, r1, r2, weight, tolerance, scaled.from_rms(cap), r3))
    return along_curve(v, at, step)


def along_curve(v: Iterate, at: Linearization, step: NewtonStep) -> Step:
    """The step from v along its curve."""
    dx = step.dx
    return Step(v, dx[:, 0], at.dy(dx), step.dnu, step.A_dx, step.iterations, step.dalpha)


def step_length(
    settings: StepSettings, scaled: ScaledProblem, step: Step, beta: float, sigma: float
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
    settings: StepSettings, scaled: ScaledProblem, newton: NewtonSystem, step: Step, target: float, beta: float
) -> Step:
    """The step to nu_i z_i = target, with correctors as long as they lengthen it; collective.

    Args:
        settings: Those of `step_length`.
        scaled: The problem.
        newton: The Newton systems, the last of which gave the step; without an approximation of A nothing is changed.
        step: The step.
        target: nu_i z_i at its end.
        beta: Bound of the gradient over theta.
    """
    v, at = step.v, scaled.linearize(step.v)
    sigma = target / scaled.theta(v.nu, scaled.slack(v.x_n, v.y))

    def length(step: Step) -> float:
        alpha, new = step_length(settings, scaled, step, beta, sigma)
        return 0.0 if new is None else alpha

    alpha, (low, high) = length(step), (bound * target for bound in _WITHIN)
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
        trial = along_curve(v, at, _sum(step, correction, at))
        longer = length(trial)
        if longer < alpha + _GAIN * (ahead - alpha):
            break
        step, alpha = trial, longer
    return step


def _sum(step: Step, correction: NewtonStep, at: Linearization) -> NewtonStep:
    """A step with a change of its direction, A dx to the accuracy of the approximation of A."""
    dx_t = at.r[:, None] * step.dy + (at.slope * step.dx_n)[:, None] * step.v.y
    return NewtonStep(
        np.column_stack([step.dx_n, dx_t]) + correction.dx,
        step.dnu + correction.dnu,
        step.A_dx + correction.A_dx,
        step.iterations,
        step.dalpha + correction.dalpha,
    )
