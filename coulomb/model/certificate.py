"""The certificate: an independent check of an answer, from `Evidence` alone, not from the solver.

The slip and the remaining gap come from the displacement, the equilibrium from a new assembly of the internal forces.
Neither the matrix K nor products by A are used; the mean diagonal of A is the scale of the natural residual.

Every measure is relative to a natural scale of the problem, so that the result does not depend on
units and materials.  Forces: the largest component of a nodal contact force.  Displacements: twice the
elastic energy over half the sum of all nodal forces, the mean displacement along which forces do work.  A rigid motion
does not change it: a clamp that moves the body by a metre does not loosen any limit.  A heated body between walls does
not move: there it is the mean displacement along which the thermal forces would do the energy of the thermal strain,
and with forms of the user that of every node alone under its load.

Values that are not finite, overflow or vanish fail.  Rounding errors of displacements and their nodal forces bound
every scale from below: in a body without contact and loads there are no other forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..fem.rigid_modes import rigid_modes
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw
from .evidence import Evidence

LIMIT = 1e-6
"""Limit of every relative measure."""

ANGLE_LIMIT = 0.1
"""Limit in degrees of the angle between slip and friction, where the slip is at least 1e-3 of the scale of
displacements and the friction 1e-2 of its largest: there an error of LIMIT rotates the slip by less."""

EPSILON = 2.0**-52
"""Rounding unit of double precision."""

ROUNDING = 1e8
"""No scale is less than this multiple of the rounding error, so that a hundred rounding errors are within LIMIT."""

SMALLEST = 1e-290
"""Scales below this, or above its inverse, have lost digits to underflow, or are near to overflow."""


@dataclass(frozen=True)
class Check:
    """One condition: its value and its limit."""

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
        penetration: Largest penetration in metres.
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


def judge(e: Evidence) -> Certificate:
    """Check an answer by its evidence alone; collective."""
    with np.errstate(all="ignore"):  # overflow is reported in the certificate
        return _judge(e, Reductions(e.comm))


def _judge(e: Evidence, over: Reductions) -> Certificate:
    spring = -e.spring * e.displacement
    imbalance = e.internal - e.load - spring - e.on_body
    outer = (e.load, spring, e.held.held_part(imbalance), e.on_body)  # the third: reactions
    scales = _scales(e, spring, outer, over)
    faults = _faults(e, scales, over)

    # In units of the scales, so that no product of two of them overflows or vanishes.
    unit = scales.force or 1.0  # 0 only where all forces are
    force, g = e.force / unit, e.bound / unit
    gap, slip = (e.gap - e.closure[:, 0]) / scales.length, e.closure[:, 1:] / scales.length
    pressing, friction, sliding = force[:, 0], np.hypot(force[:, 1], force[:, 2]), np.hypot(slip[:, 0], slip[:, 1])
    g_scale = over.max(g)
    early_slip = over.max(sliding * np.maximum(g - friction, 0.0))
    # Where no friction is allowed, friction is a rounding error or a violation of the cone.
    compared = (sliding > 1e-3) & (friction > 1e-2 * over.max(friction)) & (g > 0.0)
    across = np.abs(force[:, 1] * slip[:, 1] - force[:, 2] * slip[:, 0])[compared]
    along = (force[:, 1] * slip[:, 0] + force[:, 2] * slip[:, 1])[compared]
    angle = over.max(np.degrees(np.arctan2(across, along)))
    held = e.held.held_part(e.displacement - e.prescribed) / scales.length
    balance, drift = _rigid_motions(e, spring, np.sum(outer, axis=0), scales, over)
    sums = f"loads, springs, reactions, contact: forces and moments add to zero{', of every body' if e.bodies else ''}"
    remaining = np.column_stack([e.gap - e.closure[:, 0], -e.closure[:, 1:]])  # A x - b
    residual = FrictionLaw.tresca(e.bound).natural_residual(e.force.ravel(), remaining.ravel(), e.compliance, over)
    mean = f"; means around {'contact points' if e.actions is not None else 'vertices'}" if e.averaged else ""
    deepest = _worst(over.max(e.closure[:, 0] - e.gap), 0.0)

    def relative(name: str, value: float, meaning: str) -> Check:
        return Check(name, _worst(value, 0.0), LIMIT, "", meaning)

    checks = (
        relative("finite", float(len(faults)), "; ".join(faults) or "no number overflows or vanishes"),
        relative(
            "equilibrium",
            _ratio(over.norm(e.held.free_part(imbalance)), scales.nodal),
            "forces in balance at free nodes",
        ),
        relative("clamps", over.max(np.abs(held)), "prescribed displacements held"),
        relative("force balance", balance, sums),
        relative("rigid motion", drift, "the springs carry what the clamps do not"),
        *_actions(e, over),
        relative("penetration", over.max(-gap), f"{deepest:.1e} m, over {scales.length:.1e} m{mean}"),
        relative("adhesion", over.max(-pressing), "no node is pulled, nor has a force off the contact faces"),
        relative("complementarity", over.max(np.abs(pressing * gap)), "no force across a gap"),
        relative("friction cone", over.max(friction - g) / _worst(g_scale, 1e-3), "friction within its bound"),
        relative("slip inside the cone", _ratio(early_slip, g_scale), f"no slip before friction is at its bound{mean}"),
        Check("slip angle", _worst(angle, 0.0), ANGLE_LIMIT, "deg", "friction opposes slip"),
        relative("natural residual", residual, "of the whole problem"),
    )
    return Certificate(checks, deepest)


@dataclass(frozen=True)
class _Scales:
    """Scales of the measures.

    Attributes:
        force: Largest component of the contact force of a node, newtons; 0 without contact forces.
        length: Mean displacement of the forces that deform the body, metres.
        nodal: Norm of the largest of internal forces, loads, springs and contact forces, newtons.
        turnover: Sum of the outer forces of all nodes, newtons.
    """

    force: float
    length: float
    nodal: float
    turnover: float


def _scales(e: Evidence, spring: FloatArray, outer: tuple[FloatArray, ...], over: Reductions) -> _Scales:
    """The scales, at least the effect of rounding: a body without contact and loads has no other forces."""
    noise = ROUNDING * over.norm(e.rounding)
    nodal = _worst(*(over.norm(part) for part in (e.internal, e.load, spring, e.on_body)), noise)
    turnover = _worst(sum(over.sum(_lengths(part)) for part in outer), ROUNDING * over.sum(_lengths(e.rounding)))
    motion = over.max(np.abs(e.displacement))
    energy = over.dot(e.displacement / (motion or 1.0), e.internal / (nodal or 1.0))
    way = 2.0 * energy * motion * _ratio(nodal, turnover)
    at_least = motion if motion != 0.0 else max(over.max(axis) + over.max(-axis) for axis in e.x.T)
    peak = over.max(np.abs(e.force))
    return _Scales(
        force=_worst(peak, ROUNDING * over.max(np.abs(e.rounding))) if peak != 0.0 else 0.0,
        length=_worst(way, e.blocked, ROUNDING * EPSILON * at_least),
        nodal=nodal,
        turnover=turnover,
    )


def _faults(e: Evidence, scales: _Scales, over: Reductions) -> list[str]:
    """Values that are not finite, or so large or small that products overflow or vanish; collective."""
    given = {
        "coordinates": e.x,
        "displacement": e.displacement,
        "internal forces": e.internal,
        "loads": e.load,
        "springs": e.spring,
        "prescribed displacements": e.prescribed,
        "contact forces on the body": e.on_body,
        "contact forces": e.force,
        "closure": e.closure,
        "gaps": e.gap,
        "slip bounds": e.bound,
        "rounding": e.rounding,
        "forces of rigid motions": np.zeros(0) if e.ground is None else e.ground,
        "blocked displacement": np.array([e.blocked]),
    }
    faults = [f"{name} not finite" for name, values in given.items() if not over.all(bool(np.all(np.isfinite(values))))]
    needed = {"compliance": e.compliance, "scale of displacements": scales.length}
    forces = {"scale of contact forces": scales.force, "scale of nodal forces": scales.nodal}
    for name, value in {**needed, **forces, "sum of forces": scales.turnover}.items():
        vanished = value == 0.0 and name not in needed
        if not (vanished or SMALLEST < value < 1.0 / SMALLEST):
            faults.append(f"{name} is {value:.1e}")
    return faults


def _rigid_motions(
    e: Evidence, spring: FloatArray, outer: FloatArray, scales: _Scales, over: Reductions
) -> tuple[float, float]:
    """Imbalance of three forces and three moments; for free rigid motions, relative to the springs.

    A rigid motion causes no internal force, except in an elastic foundation that is part of the internal forces.  If no
    prescribed displacement prevents it, only the springs do, and such foundations, and their forces may be a millionth
    of the internal forces.  So the forces along such a motion are compared with those of the springs, or with those
    that they would have for a motion by the scale of displacements.

    Returns:
        Of all bodies the largest of six sums over the sum of all forces, and the largest imbalance of a free motion
        over its spring forces.
    """
    found = [_motions_of(e, nodes, spring, outer, scales, over) for nodes in e.bodies or (slice(None),)]
    return _worst(*(balance for balance, _ in found)), _worst(*(drift for _, drift in found))


def _motions_of(
    e: Evidence, nodes: slice, spring: FloatArray, outer: FloatArray, scales: _Scales, over: Reductions
) -> tuple[float, float]:
    """The same of one body."""
    count, modes, held = over.sum(float(len(e.x[nodes]))), rigid_modes(e.x[nodes], e.comm), e.held.of(nodes)
    ground = np.zeros_like(modes) if e.ground is None else _of_its_motions(e, nodes, modes, over)
    borne = np.einsum("kcj,kc->kj", ground, e.displacement[nodes])  # work of internal forces on the motions, by node
    sums = over.total(np.einsum("kcj,kc->j", modes, outer[nodes]) - borne.sum(axis=0))
    balance = _ratio(_worst(*np.abs(sums)), scales.turnover)

    weights = over.total(np.einsum("kci,kcj->ij", modes, held.held_part(modes)))
    stiffness = over.total(np.einsum("kci,kc,kcj->ij", modes, e.spring[nodes], modes))
    stiffness += over.total(np.einsum("kci,kcj->ij", modes, ground))
    if not (np.all(np.isfinite(sums)) and np.all(np.isfinite(weights)) and np.all(np.isfinite(stiffness))):
        return balance, math.nan
    weight, vectors = np.linalg.eigh(weights)
    free = vectors[:, weight <= 1e-13 * count]
    stiff, vectors = np.linalg.eigh(free.T @ stiffness @ free)
    free = free @ vectors  # motions that the springs hold independently of each other
    carried = over.total(np.einsum("kcj,kc->j", np.abs(modes @ free), np.abs(spring[nodes])))
    carried += over.total(np.abs(np.einsum("kcj,kc->kj", ground @ free, e.displacement[nodes])).sum(axis=0))
    drifts = [
        _ratio(force, _worst(carries, k * scales.length) or scales.turnover)
        for force, carries, k in zip(np.abs(free.T @ sums), carried, stiff, strict=True)
    ]
    return balance, _worst(0.0, *drifts)


def _of_its_motions(e: Evidence, nodes: slice, modes: FloatArray, over: Reductions) -> FloatArray:
    """`Evidence.ground` of one body for its own rigid modes: those of all bodies are motions of it, too."""
    assert e.ground is not None
    if not e.bodies:
        return e.ground
    whole = rigid_modes(e.x, e.comm)[nodes]
    gram, right = over.total(np.einsum("kci,kcj->ij", whole, whole)), over.total(np.einsum("kci,kcj->ij", whole, modes))
    own: FloatArray = e.ground[nodes] @ np.linalg.lstsq(gram, right, rcond=None)[0]
    return own


def _actions(e: Evidence, over: Reductions) -> tuple[Check, ...]:
    """Whether the forces on both faces of every pair, and their moments, are opposite; no check without pairs.

    The moments may differ by the couples of forces that act across the gaps of the undeformed bodies.
    """
    if e.actions is None:
        return ()
    size = max(over.max(axis) + over.max(-axis) for axis in e.x.T) or 1.0
    slave, master, couples = np.moveaxis(over.total(e.actions.ravel()).reshape(e.actions.shape), 1, 0)
    left = (slave + master - couples)[:, :6] / np.array([1.0] * 3 + [size] * 3)
    worst = _worst(*(_ratio(_worst(*np.abs(one)), scale) for one, scale in zip(left, slave[:, 6], strict=True)))
    meaning = "forces and moments on the two faces of every pair are opposite"
    return (Check("action and reaction", worst, LIMIT, "", meaning),)


def _lengths(vectors: FloatArray) -> FloatArray:
    """Norms of vectors (k, 3) without overflow or underflow of squares."""
    lengths: FloatArray = np.hypot(np.hypot(vectors[:, 0], vectors[:, 1]), vectors[:, 2])
    return lengths


def _worst(*values: float) -> float:
    """The largest, nan if one is nan."""
    return float(np.max(values))


def _ratio(value: float, scale: float) -> float:
    """A measure over its scale, which is 0 only if the measure is."""
    return value / (scale or 1.0)
