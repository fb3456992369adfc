"""Is this answer right?  Judged from the problem and the answer alone, not from what the solver says.

The slip and the remaining gap come from the displacement, the equilibrium from a new assembly of the internal forces.
Neither the matrix K nor products by A take part; of A, its mean diagonal is the scale of the natural residual.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .arrays import FloatArray
from .solvers.reductions import Reductions

if TYPE_CHECKING:
    from .problem import ContactProblem

LIMIT = 1e-6
"""Limit of every relative measure."""

ANGLE_LIMIT = 0.1
"""Limit in degrees of the angle between slip and friction, where the slip is at least 1e-3 of the greatest displacement
and the friction 1e-2 of its greatest: there an error of LIMIT turns the slip by less."""


@dataclass(frozen=True)
class Check:
    """One condition: how far the answer is from it, and how far it may be."""

    name: str
    value: float
    limit: float
    unit: str
    meaning: str

    @property
    def passed(self) -> bool:
        return bool(self.value <= self.limit)  # False for nan


@dataclass(frozen=True)
class Certificate:
    """All conditions of the frictional contact problem, each with its limit.

    Attributes:
        checks: The conditions.
        penetration: Greatest penetration in metres.
    """

    checks: tuple[Check, ...]
    penetration: float

    @property
    def passed(self) -> bool:
        return all(check.passed for check in self.checks)

    def __getitem__(self, name: str) -> Check:
        return next(check for check in self.checks if check.name == name)

    def __str__(self) -> str:
        lines = [
            f"{check.name:<22} {check.value:9.2e} {check.unit:<4} limit {check.limit:.0e}  "
            f"{'ok    ' if check.passed else 'FAILED'}  {check.meaning}"
            for check in self.checks
        ]
        return "\n".join([*lines, f"certificate {'passed' if self.passed else 'FAILED'}"])


def certify(problem: ContactProblem, x: FloatArray, u: FloatArray, slip_bound: FloatArray) -> Certificate:
    """Check an answer.

    Args:
        problem: The contact problem.
        x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        slip_bound: The g in newtons that the solver used, shape (m,).
    """
    over, elasticity, surface = Reductions(problem.comm), problem.elasticity, problem.surface
    force, g = x.reshape(-1, 3), problem.slip_bound(x)
    closure = surface.components(u[surface.nodes])  # u_n, u_t1, u_t2
    gap, slip = surface.gap - closure[:, 0], closure[:, 1:]
    pressing, friction = force[:, 0], np.hypot(force[:, 1], force[:, 2])
    sliding = np.hypot(slip[:, 0], slip[:, 1])
    u_scale, force_scale, g_scale = (_or_one(over.max(np.abs(v))) for v in (u, x, g))

    internal, contact = elasticity.internal_force(u), problem.nodal_contact_force(x)
    imbalance = internal - elasticity.load + contact
    internal_scale = _or_one(_worst(over.norm(internal), over.norm(elasticity.load), over.norm(contact)))
    equilibrium = over.norm(imbalance[~elasticity.fixed]) / internal_scale
    clamps = over.max(np.abs((u - elasticity.prescribed)[elasticity.fixed])) / u_scale

    reaction = np.where(elasticity.fixed, imbalance, 0.0)
    total = math.hypot(*(over.sum((elasticity.load + reaction - contact)[:, k]) for k in range(3)))
    turnover = _or_one(sum(over.sum(np.abs(part)) for part in (elasticity.load, reaction, contact)))

    penetration = _worst(over.max(-gap), 0.0)
    early_slip = over.max(sliding * np.maximum(g - friction, 0.0))
    compared = (sliding > 1e-3 * u_scale) & (friction > 1e-2 * _or_one(over.max(friction)))
    across = np.abs(force[:, 1] * slip[:, 1] - force[:, 2] * slip[:, 0])[compared]
    along = (force[:, 1] * slip[:, 0] + force[:, 2] * slip[:, 1])[compared]
    angle = over.max(np.degrees(np.arctan2(across, along)))
    remaining = np.column_stack([gap, -slip]).ravel()  # what A x - b must be
    finite = over.all(bool(np.all(np.isfinite(g))))
    residual = problem.tresca(g).residual(x, remaining) if finite else math.nan

    def relative(name: str, value: float, meaning: str) -> Check:
        return Check(name, _worst(value, 0.0), LIMIT, "", meaning)

    checks = (
        relative("equilibrium", equilibrium, "forces in balance at every free node"),
        relative("clamps", clamps, "prescribed displacements held"),
        relative("force balance", total / turnover, "loads, reactions and contact forces add to zero"),
        relative("penetration", penetration / u_scale, f"{penetration:.1e} m, over the greatest displacement"),
        relative("adhesion", over.max(-pressing) / force_scale, "no node is pulled"),
        relative(
            "complementarity", over.max(np.abs(pressing * gap)) / (force_scale * u_scale), "no force across a gap"
        ),
        relative(
            "friction cone", over.max(friction - g) / _worst(g_scale, 1e-3 * force_scale), "friction within its bound"
        ),
        relative("slip inside the cone", early_slip / (g_scale * u_scale), "no slip before friction is at its bound"),
        Check("slip angle", _worst(angle, 0.0), ANGLE_LIMIT, "deg", "friction opposes slip"),
        relative("slip bound", over.norm(slip_bound - g) / _or_one(over.norm(g)), "the solver's g is the law's"),
        relative("natural residual", residual, "of the whole problem"),
    )
    return Certificate(checks, penetration)


def _worst(*values: float) -> float:
    """The greatest, nan if one is nan."""
    return float(np.max(values))


def _or_one(scale: float) -> float:
    """A scale to divide by: 1 where there is nothing to measure against."""
    return scale if scale > 0.0 or math.isnan(scale) else 1.0
