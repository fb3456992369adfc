"""A step of path following: its Newton system, and how far it goes."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..arrays import FloatArray
from .linearization import Linearization
from .newton_systems import NewtonEquations, NewtonStep, NewtonSystem
from .scaled_problem import Iterate, ScaledProblem, Step


class StepSettings(Protocol):
    """What a step needs of the settings, `InteriorPoint`, where they are explained."""

    @property
    def gamma(self) -> float: ...

    @property
    def omega(self) -> float: ...

    @property
    def to_boundary(self) -> float: ...

    @property
    def backtrack(self) -> float: ...

    @property
    def gradient_share(self) -> float: ...

    @property
    def solved_share(self) -> float: ...


def newton_step(
    settings: StepSettings,
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
        A = scaled.A.A
        solved = A.matrix_free is not None and not A.exact
        cap = min(cap, (settings.solved_share if solved else settings.gradient_share) * scaled.infeasibility(v))
    weight, r3 = scaled.weight(v.x_n), scaled.out_of_balance(v)
    step = newton.solve(NewtonEquations(at, r1, r2, weight, tolerance, scaled.from_rms(cap), r3))
    return along_curve(scaled, newton, v, at, step)


def along_curve(scaled: ScaledProblem, newton: NewtonSystem, v: Iterate, at: Linearization, step: NewtonStep) -> Step:
    """The step from v along its curve."""
    dx, dy = step.dx, at.dy(step.dx)
    A_bend: FloatArray | float = 0.0
    if scaled.sloped:
        A_bend = newton.estimate(np.column_stack([np.zeros(scaled.nodes), (at.slope * dx[:, 0])[:, None] * dy]))
    return Step(v, dx[:, 0], dy, step.dnu, step.A_dx, A_bend, step.iterations, step.dalpha)


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
