"""Is this answer right?  Judged from the problem and the answer alone, not from what the solver says.

The slip and the remaining gap come from the displacement, the equilibrium from a new assembly of the internal forces.
Neither the matrix K nor products by A take part; of A, its mean diagonal is the scale of the natural residual.

Every measure is relative to a natural scale of the problem, so that steel in newtons and metres and rubber in newtons
and millimetres are judged alike.  Forces: the greatest contact force of a node.  Displacements: twice the elastic
energy over half the sum of all nodal forces, the mean way on which forces do their work.  It does not see a motion of
the body as a whole: a clamp that moves it by a metre makes nothing more lenient.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .arrays import FloatArray
from .evidence import Before, evidence
from .evidence import Evidence as Evidence
from .solvers.reductions import Reductions
from .solvers.tresca import natural_residual

if TYPE_CHECKING:
    from .problem import ContactProblem

LIMIT = 1e-6
"""Limit of every relative measure."""

ANGLE_LIMIT = 0.1
"""Limit in degrees of the angle between slip and friction, where the slip is at least 1e-3 of the scale of
displacements and the friction 1e-2 of its greatest: there an error of LIMIT turns the slip by less."""


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
        """Whether the answer is within the limit; nan is not."""
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
        """Whether every condition holds."""
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


def certify(problem: ContactProblem, x: FloatArray, u: FloatArray, before: Before | None = None) -> Certificate:
    """Check an answer; collective.

    Args:
        problem: The contact problem.
        x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        before: What the load step before has left, such as a `State`: slip counts from there, and from where the
            foundation was then; without, from the problem's `slip_origin`.
    """
    return judge(evidence(problem, x, u, before))


def judge(e: Evidence) -> Certificate:
    """Check an answer by its evidence alone; collective."""
    over, g, slip = Reductions(e.comm), e.bound, e.closure[:, 1:]
    gap = e.gap - e.closure[:, 0]
    pressing, friction = e.force[:, 0], np.hypot(e.force[:, 1], e.force[:, 2])
    sliding = np.hypot(slip[:, 0], slip[:, 1])

    imbalance = e.internal - e.load - e.spring - e.on_body
    internal_scale = _or_one(_worst(*(over.norm(part) for part in (e.internal, e.load, e.spring, e.on_body))))
    equilibrium = over.norm(imbalance[~e.fixed]) / internal_scale
    reaction = np.where(e.fixed, imbalance, 0.0)
    outer = (e.load, e.spring, reaction, e.on_body)
    total = math.hypot(*(over.sum(np.sum(outer, axis=0)[:, k]) for k in range(3)))
    turnover = _or_one(sum(over.sum(np.linalg.norm(part, axis=1)) for part in outer))

    force_scale, g_scale = (_or_one(over.max(np.abs(v))) for v in (e.force, g))
    u_scale = _or_one(2.0 * over.dot(e.displacement, e.internal) / turnover)
    clamps = over.max(np.abs((e.displacement - e.prescribed)[e.fixed])) / u_scale
    penetration = _worst(over.max(-gap), 0.0)
    early_slip = over.max(sliding * np.maximum(g - friction, 0.0))
    compared = (sliding > 1e-3 * u_scale) & (friction > 1e-2 * _or_one(over.max(friction)))
    across = np.abs(e.force[:, 1] * slip[:, 1] - e.force[:, 2] * slip[:, 0])[compared]
    along = (e.force[:, 1] * slip[:, 0] + e.force[:, 2] * slip[:, 1])[compared]
    angle = over.max(np.degrees(np.arctan2(across, along)))

    remaining = np.column_stack([gap, -slip])  # what A x - b must be
    residual = natural_residual(e.force.ravel(), remaining.ravel(), g, e.compliance, over)

    def relative(name: str, value: float, meaning: str) -> Check:
        return Check(name, _worst(value, 0.0), LIMIT, "", meaning)

    checks = (
        relative("equilibrium", equilibrium, "forces in balance at every free node"),
        relative("clamps", clamps, "prescribed displacements held"),
        relative("force balance", total / turnover, "loads, springs, reactions and contact forces add to zero"),
        relative("penetration", penetration / u_scale, f"{penetration:.1e} m, over {u_scale:.1e} m"),
        relative("adhesion", over.max(-pressing) / force_scale, "no node is pulled"),
        relative(
            "complementarity", over.max(np.abs(pressing * gap)) / (force_scale * u_scale), "no force across a gap"
        ),
        relative(
            "friction cone", over.max(friction - g) / _worst(g_scale, 1e-3 * force_scale), "friction within its bound"
        ),
        relative("slip inside the cone", early_slip / (g_scale * u_scale), "no slip before friction is at its bound"),
        Check("slip angle", _worst(angle, 0.0), ANGLE_LIMIT, "deg", "friction opposes slip"),
        relative("natural residual", residual, "of the whole problem"),
    )
    return Certificate(checks, penetration)


def _worst(*values: float) -> float:
    """The greatest, nan if one is nan."""
    return float(np.max(values))


def _or_one(scale: float) -> float:
    """A scale to divide by: 1 where there is nothing to measure against."""
    return scale if scale > 0.0 or math.isnan(scale) else 1.0
