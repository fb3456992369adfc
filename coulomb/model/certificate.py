"""The certificate: an independent check of an answer, from `Evidence` alone, not from the solver.

The evidence is gathered from a problem, or read from the files of a run.

The slip and the remaining gap come from the displacement, the equilibrium from a new assembly of the internal forces.
Neither the matrix K nor products by A are used; the diagonal of A scales the natural residual.

Every measure is relative to a natural scale of its body (certificate_scales.py), so that the result does not depend on
units and materials.  Forces: the largest component of a nodal contact force on the body.  Displacements: twice the
elastic energy over half the sum of all nodal forces, the mean displacement along which forces do work.  A rigid motion
does not change it: a clamp that moves the body by a metre does not loosen any limit.  A body that loads press onto what
holds it does not move, nor does a heated one between walls: the scale is at least the mean displacement of every node
alone under its load, and that along which the thermal forces would do the energy of the thermal strain.

Values that are not finite, overflow or vanish fail.  Rounding errors of displacements and their nodal forces bound
every scale from below: in a body without contact and loads there are no other forces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from mpi4py import MPI

from ..arrays import BoolArray, FloatArray, IntArray
from ..fem.bodies import HeldDirections, null_space, of_part, rigid_modes
from ..fem.meshes import Slice
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw
from ..units import amount
from . import notebook
from .certificate_scales import (
    FAR_GONE,
    OF_ALL,
    ROUNDING,
    Scales,
    lengths,
    natural_residuals,
    place_of_largest,
    ratio,
    rounding_of_gaps,
    scales_of,
    worst,
)
from .pair_checks import PairFindings, pair_lines

RESOLVED: Final = 1e-2
"""Limit of what may be undetermined of forces, which is less than what meshes leave."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The data of a certificate: this rank's part, k nodes of which m are contact nodes; newtons, metres.

    These m are all nodes of the contact faces except those of `held_gap`; and any other node with a contact force,
    which then counts as tensile.

    Attributes:
        x: Coordinates, shape (k, 3).
        displacement: Shape (k, 3).
        internal: Nodal forces of its stress, assembled anew, shape (k, 3).
        load: Shape (k, 3).
        spring: Forces of the springs, shape (k, 3).
        ground: Nodal forces of the `rigid_modes` in newtons, shape (k, 3, 6): those of springs, and of elastic
            foundations among the internal forces; None if there are none.
        held: The directions along which displacements are prescribed.
        prescribed: The displacement along them, shape (k, 3).
        on_body: Contact forces on the body, and those of ties, shape (k, 3).
        force: The same at the contact nodes along n, t1, t2, with x_n >= 0 pressing, shape (m, 3).
        relative_displacement: Displacement of the contact nodes along n, and their slip along t1, t2, shape (m, 3).
        gap: Before deformation, shape (m,).
        bound: Slip bound of the law at these forces, shape (m,).
        rounding: Nodal forces due to rounding of the displacement (`rounding_forces`), shape (k, 3).
        stiffness: Of the nodes of the contact points with all others at rest, newtons per metre, shape (m,).
        compliance: Diagonal of A at the contact points, of both tangents the mean, metres per newton, shape (m, 3).
        blocked: Scale of the displacements that loads would cause where nothing can move, metres
            (`Deformable.blocked_displacement`), of each body.
        component: Component of the meshes of each node, from 0, shape (k,).
        averaged: Whether gaps and slips are averages over the facets around vertices, as on 10-node tetrahedra, or
            over parts of the two faces of a pair.
        bodies: The nodes of each body; empty for one.
        owner: Number of the component of every contact point, shape (m,).
        place: Where they are, undeformed, shape (m, 3).
        part: Number of the contact of each, shape (m,), among
        unsettled: Largest change of a force in a Newton step of the solver from the answer, over the largest on its
            body: the one number that is the solver's; without such a step RESOLVED, which nothing fails.
        faces: the names of the contact faces, and
        opposite: for every contact the components of the face opposite; empty without pairs.
        jump: How far tied nodes are from where they should be, shape (k, 3); None without ties.
        actions: Of every pair of faces, what acts on both: `pair_actions`, this rank's part, shape (pairs, 3, 7).
        pairs: Of every pair, what is off in its gaps, normals and averages.
        on_foundations: Of every free motion of a foundation under load the work of the contact forces on it per metre,
            their size, and its load, newtons, shape (q, 3); the first two are this rank's part.
        held_gap: What is left of the gap at nodes of the contact faces that are no contact points, since their
            displacement along the normal is prescribed, or they face away from the foundation, metres, shape (q,).
        held_owner: Number of the component of each of these nodes, shape (q,).
        held_part: That of its contact if it is on a pair, else any, shape (q,).
        layer: Of what plane or axisymmetric body the meshes are one layer; None of others.
    """

    comm: MPI.Comm
    x: FloatArray
    displacement: FloatArray
    internal: FloatArray
    load: FloatArray
    spring: FloatArray
    held: HeldDirections
    prescribed: FloatArray
    on_body: FloatArray
    force: FloatArray
    relative_displacement: FloatArray
    gap: FloatArray
    bound: FloatArray
    rounding: FloatArray
    stiffness: FloatArray
    compliance: FloatArray
    component: IntArray
    owner: IntArray
    place: FloatArray
    part: IntArray
    blocked: tuple[float, ...] = (0.0,)
    averaged: bool = False
    ground: FloatArray | None = None
    bodies: tuple[slice, ...] = ()
    actions: FloatArray | None = None
    jump: FloatArray | None = None
    pairs: tuple[PairFindings, ...] = ()
    on_foundations: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    held_gap: FloatArray = field(default_factory=lambda: np.zeros(0))
    held_owner: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    held_part: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    faces: tuple[str, ...] = ()
    opposite: tuple[tuple[int, ...], ...] = ()
    unsettled: float = RESOLVED
    layer: Slice | None = None

    @property
    def deforming(self) -> FloatArray:
        """The internal forces, of a layer those along its section, newtons, shape (k, 3)."""
        return self.internal if self.layer is None else self.layer.along_section(self.x, self.internal)


def rigid_balance(e: Evidence, outer: FloatArray, lengths_: FloatArray, turnover: float) -> tuple[float, float, int]:
    """Imbalance of three forces and three moments of every component; for free rigid motions, relative to the springs.

    A rigid motion causes no internal force, except in an elastic foundation that is part of the internal forces.  If no
    prescribed displacement prevents it, only springs and such foundations do (`Evidence.ground`), and their forces may
    be a millionth of the internal forces.  So the forces along such a motion are compared with those of the springs, or
    with those that they would have for a motion by the scale of displacements; if contact alone resists, with all
    forces.

    Args:
        e: Evidence; of the contact only the forces at the nodes are used.
        outer: Loads, forces of springs, reactions, contact forces on the body in newtons, shape (4, k, 3).
        lengths_: Scale of displacements of every component, metres, shape (n,).
        turnover: Sum of the magnitudes of the outer forces of all nodes, at least the effect of rounding, newtons.

    Returns:
        Largest of six sums over the sum of all forces, and the largest imbalance of a free motion over its spring
        forces, of all components; and their number; collective.
    """
    of_parts = [_of_part(e, e.component == number, outer, length, turnover) for number, length in enumerate(lengths_)]
    return worst(*(balance for balance, _ in of_parts)), worst(*(drift for _, drift in of_parts)), len(of_parts)


def _of_part(e: Evidence, here: BoolArray, outer: FloatArray, length: float, turnover: float) -> tuple[float, float]:
    """The same of one component: no forces of its own judge it that are less than a part of `turnover`."""
    over = Reductions(e.comm)
    if over.all(bool(np.all(here))):
        x, u, spring, held = e.x, e.displacement, e.spring, e.held
    else:
        x, u, spring, outer, held = e.x[here], e.displacement[here], e.spring[here], outer[:, here], e.held.of(here)
        own = worst(sum(over.sum(lengths(part)) for part in outer), ROUNDING * over.sum(lengths(e.rounding[here])))
        turnover = worst(own, OF_ALL * turnover)
    count, modes = over.sum(float(len(x))), rigid_modes(x, e.comm)
    rows = modes.reshape(-1, modes.shape[2])  # products of matrices take a tenth of the time of sums over nodes
    sums = rows.T @ outer.sum(axis=0).ravel()
    ground = None if e.ground is None else of_part(e.ground, e.x, here, e.comm)
    if ground is not None:  # in place of the springs' forces, and as the work of the internal forces on the motions
        sums -= rows.T @ spring.ravel() + ground.reshape(rows.shape).T @ u.ravel()
    sums = over.total(sums)
    balance = ratio(worst(*np.abs(sums)), turnover)

    prevented = modes[held.nodes].reshape(-1, modes.shape[2])
    weights = over.total(prevented.T @ held.held_part(modes)[held.nodes].reshape(prevented.shape))
    stiffness, resisted = _resistance(over, rows, ground)
    if not (np.all(np.isfinite(sums)) and np.all(np.isfinite(weights)) and np.all(np.isfinite(stiffness))):
        return balance, math.nan
    free = null_space(weights, 1e-13 * count)
    if not free.shape[1]:
        return balance, 0.0
    loose = free @ null_space(free.T @ resisted @ free, 1e-10 * worst(float(np.trace(resisted)), 1.0))
    free = np.linalg.svd(free - loose @ (loose.T @ free), full_matrices=False)[0][:, : free.shape[1] - loose.shape[1]]
    stiff, vectors = np.linalg.eigh(free.T @ stiffness @ free)
    free = free @ vectors  # motions that the springs hold independently of each other
    carried = np.zeros(free.shape[1])
    if ground is not None:
        carried = over.total(np.einsum("kcj,kc->j", np.abs(ground @ free), np.abs(u)))
    drifts = [
        ratio(force, worst(carries, k * length) or turnover)
        for force, carries, k in zip(np.abs(free.T @ sums), carried, stiff, strict=True)
    ]
    if over.any(bool(np.any(outer[0]))):
        turnover = min(turnover, FAR_GONE * over.sum(lengths(outer.reshape(-1, 3))))
    return balance, worst(0.0, *drifts, *(ratio(force, turnover) for force in np.abs(loose.T @ sums)))


def _resistance(over: Reductions, rows: FloatArray, ground: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Stiffness against the motions (3 k, 6) by their `ground` forces (k, 3, 6), and the same over the largest of
    these, shapes (6, 6); collective."""
    stiffness, resisted = np.zeros((2, rows.shape[1], rows.shape[1]))
    if ground is not None:
        forces = ground.reshape(rows.shape)
        stiffness = rows.T @ forces
        resisted = rows.T @ (forces / (over.max(np.abs(ground)) or 1.0))
    return over.total(stiffness), over.total(resisted)


LIMIT: Final = 1e-6
"""Limit of every relative measure."""

_ROUNDINGS: Final = 16.0
"""Rounding errors of a nodal force in the sum that it is.  Forces of sheets of 0.1 to 0.5 mm differ by up to 28 of them
from mesh to mesh, turned in their plane, and by 0.4 to 11 from K u = f solved in 220 bits (of 50 um by 1 and more)."""

RESOLUTION: Final = "resolution"
"""Name of the condition that says to what part contact forces are known: above LIMIT they are unresolved."""


ANGLE_LIMIT: Final = 0.1
"""Limit in degrees of the angle between slip and friction, where the slip is at least 1e-3 of the scale of
displacements and the friction 1e-2 of its largest: there an error of LIMIT rotates the slip by less."""

SMALLEST: Final = 1e-290
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

    @property
    def mark(self) -> str:
        """ok, FAILED, or unresolved: within the limit, but contact forces are not known to LIMIT."""
        if self.name == RESOLUTION and self.passed and self.value > LIMIT:
            return "unresolved"
        return "ok" if self.passed else "FAILED"


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

    @property
    def verdict(self) -> str:
        """Whether it has passed, and how well contact forces are known if that is less than LIMIT."""
        known = (f", contact forces known to {c.value:.1e} only" for c in self.checks if c.mark == "unresolved")
        return f"certificate passed{''.join(known)}" if self.passed else "certificate FAILED"

    def __getitem__(self, name: str) -> Check:
        return next(check for check in self.checks if check.name == name)

    def __repr__(self) -> str:
        failing = ", ".join(f"{c.name} {c.value:.1e} (limit {c.limit:.0e})" for c in self.checks if not c.passed)
        passed = self.verdict.removeprefix("certificate ").replace("passed", f"passed, {len(self.checks)} conditions")
        return f"Certificate({f'FAILED: {failing}' if failing else passed})"

    def _repr_html_(self) -> str:
        rows = [(c.name, f"{c.value:.2e} {c.unit}", f"{c.limit:.0e}", c.mark, c.meaning) for c in self.checks]
        good = all(check.mark == "ok" for check in self.checks)
        return notebook.verdict(good, self.verdict) + notebook.table(
            ("condition", "value", "limit", "", "meaning"), rows
        )

    def __str__(self) -> str:
        lines = [
            f"{check.name:<22} {check.value:9.2e} {check.unit:<4} limit {check.limit:.0e}  "
            f"{check.mark:<6}  {check.meaning}"
            for check in self.checks
        ]
        return "\n".join([*lines, self.verdict])


def settled_to(e: Evidence, certificate: Certificate, unsettled: float | None) -> tuple[Evidence, Certificate]:
    """Evidence and certificate with `Evidence.unsettled` of the solver, if a Newton step was taken; collective."""
    if unsettled is None:
        return e, certificate
    e = replace(e, unsettled=unsettled)
    return e, certificate if certificate[RESOLUTION].mark == "ok" else judge(e)


def judge(e: Evidence) -> Certificate:
    """Check an answer by its evidence alone; collective."""
    with np.errstate(all="ignore"):  # overflow is reported in the certificate
        return _judge(e, Reductions(e.comm))


def _judge(e: Evidence, over: Reductions) -> Certificate:
    imbalance = e.internal - e.load - e.spring - e.on_body
    outer = (e.load, e.spring, e.held.held_part(imbalance), e.on_body)  # the third: reactions
    scales = scales_of(e, outer, over)
    faults = _faults(e, scales, over)

    # In units of the scales, so that no product of two of them overflows or vanishes.
    unit = np.where(scales.forces > 0.0, scales.forces, 1.0)[scales.owner]  # 0 only where all forces on a body are
    force, g, length = e.force / unit[:, None], e.bound / unit, scales.at_points
    left_open = e.gap - e.relative_displacement[:, 0]
    place = scales.of_points(np.abs(e.place).max(axis=1, initial=0.0), over)[scales.owner]
    error = rounding_of_gaps(e.gap, e.relative_displacement[:, 0], place)
    left_open[(e.force[:, 0] == 0.0) & (np.abs(left_open) <= error)] = 0.0  # points that just touch
    gap, slip = left_open / length, e.relative_displacement[:, 1:] / length[:, None]
    pressing, friction, sliding = force[:, 0], np.hypot(force[:, 1], force[:, 2]), np.hypot(slip[:, 0], slip[:, 1])
    most_bound, most_friction = (scales.of_points(values, over)[scales.owner] for values in (g, friction))
    early = sliding * np.maximum(g - friction, 0.0) / np.where(most_bound > 0.0, most_bound, 1.0)
    # Where no friction is allowed, friction is a rounding error or a violation of the cone.
    compared = (sliding > 1e-3) & (friction > 1e-2 * most_friction) & (g > 0.0)
    across = np.abs(force[:, 1] * slip[:, 1] - force[:, 2] * slip[:, 0])
    along = force[:, 1] * slip[:, 0] + force[:, 2] * slip[:, 1]
    angle = np.where(compared, np.degrees(np.arctan2(across, along)), 0.0)
    held = e.held.held_part(e.displacement - e.prescribed) / scales.lengths[scales.body][:, None]
    balance, drift, parts = rigid_balance(e, np.array(outer), scales.lengths, scales.turnover)
    each = ", of every body" if e.bodies else f", of each of {parts} components" if parts > 1 else ""
    sums = f"loads, springs, reactions, contact: forces and moments add to zero{each}"
    remaining = np.column_stack([left_open, -e.relative_displacement[:, 1:]])  # A x - b
    mean = f"; means around {'contact points' if e.actions is not None else 'vertices'}" if e.averaged else ""
    held_in = over.max(-e.held_gap)
    deepest = worst(over.max(-left_open), held_in, 1e-12 * over.max(length), 0.0)  # below: rounding errors
    if deepest == held_in > 0.0:
        mean = ", at a node that supports hold, or that faces away"
    left = scales.norms(lengths(e.held.free_part(imbalance)), over) / np.where(scales.nodals > 0.0, scales.nodals, 1.0)

    def relative(name: str, value: float, meaning: str) -> Check:
        return Check(name, worst(value, 0.0), LIMIT, "", meaning)

    def at_points(name: str, values: FloatArray, meaning: str, limit: float = LIMIT, unit: str = "") -> Check:
        check = Check(name, worst(over.max(values), 0.0), limit, unit, meaning)
        return check if check.passed else replace(check, meaning=f"{meaning}{_place(e, values, over)}")

    depth_in_words = f"{amount(deepest, digits=2)}, over {_range(length, over)}{mean}"
    inside = at_points("penetration", -gap, depth_in_words)
    if (beside := over.max(-e.held_gap / scales.at_held)) > inside.value:
        inside = relative("penetration", beside, depth_in_words)
    checks = (
        relative("finite", float(len(faults)), "; ".join(faults) or "no number overflows or vanishes"),
        relative("equilibrium", worst(*left), f"forces in balance at free nodes{each}"),
        relative("clamps", over.max(np.abs(held)), "prescribed displacements held"),
        *_ties(e, scales, over),
        _resolution(e, remaining, scales, over),
        relative("force balance", balance, sums),
        relative("rigid motion", drift, "springs and contact carry what the clamps do not"),
        *_actions(e, over),
        *_foundations(e, over),
        *(
            Check(name, worst(value, 0.0), ANGLE_LIMIT if unit else LIMIT, unit, meaning)
            for name, value, unit, meaning in pair_lines(e.pairs, _of_pairs(e, scales, over), over)
        ),
        inside,
        at_points("adhesion", -pressing, "no node is pulled, nor has a force off the contact faces"),
        at_points("complementarity", np.abs(pressing * gap), "no force across a gap"),
        at_points("friction cone", (friction - g) / np.maximum(most_bound, 1e-3), "friction within its bound"),
        at_points("slip inside the cone", early, f"no slip before friction is at its bound{mean}"),
        at_points("slip angle", angle, "friction opposes slip", ANGLE_LIMIT, "deg"),
        at_points("natural residual", natural_residuals(e, remaining, scales), "of every contact point, by its force"),
    )
    return Certificate(checks, deepest)


def _range(lengths: FloatArray, over: Reductions) -> str:
    """A length, or the smallest and the largest of these; collective."""
    least, most = over.min(lengths), over.max(lengths)
    return amount(most, digits=2) if not least < most else f"{amount(least, digits=2)} to {amount(most, digits=2)}"


def _place(e: Evidence, values: FloatArray, over: Reductions) -> str:
    """Where the largest of the values (m,) is, in words; collective."""
    return f"; worst {place_of_largest(values, e.place, e.part, e.faces, over)}"


def _faults(e: Evidence, scales: Scales, over: Reductions) -> list[str]:
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
        "relative displacements": e.relative_displacement,
        "gaps": e.gap,
        "gaps of held nodes": e.held_gap,
        "work on foundations": e.on_foundations,
        "slip bounds": e.bound,
        "compliances": e.compliance,
        "stiffness of nodes": e.stiffness,
        "unsettled forces": np.array(e.unsettled),
        "rounding": e.rounding,
        "forces of rigid motions": np.zeros(0) if e.ground is None else e.ground,
        "blocked displacement": np.array(e.blocked),
        "jump of ties": np.zeros(0) if e.jump is None else e.jump,
    }
    faults = [f"{name} not finite" for name, values in given.items() if not over.all(bool(np.all(np.isfinite(values))))]
    needed = {"scale of displacements": scales.length}
    if over.sum(float(len(e.compliance))) > 0.0:
        needed |= {"smallest compliance": over.min(e.compliance), "compliance": over.max(e.compliance)}
    forces = {"scale of contact forces": scales.force, "scale of nodal forces": scales.nodal}
    for name, value in {**needed, **forces, "sum of forces": scales.turnover}.items():
        vanished = value == 0.0 and name not in needed
        if not (vanished or SMALLEST < value < 1.0 / SMALLEST):
            faults.append(f"{name} is {value:.1e}")
    return faults


def _of_pairs(e: Evidence, scales: Scales, over: Reductions) -> FloatArray:
    """Displacement scale of every pair, metres: that of its contact points; of all where it has none."""
    numbers = [k for k, others in enumerate(e.opposite) if others]
    own = over.largest(np.array([np.max(scales.at_points[e.part == k], initial=0.0) for k in numbers]))
    known = len(numbers) == len(e.pairs)
    return np.where(own > 0.0, own, scales.length) if known else np.full(len(e.pairs), scales.length)


def _ties(e: Evidence, scales: Scales, over: Reductions) -> tuple[Check, ...]:
    if e.jump is None:
        return ()
    apart = over.max(np.abs(e.jump) / scales.lengths[scales.body][:, None])
    return (Check("ties", worst(apart, 0.0), LIMIT, "", "tied faces neither open nor slip"),)


def _resolution(e: Evidence, remaining: FloatArray, scales: Scales, over: Reductions) -> Check:
    """To what part of the largest on its body every contact force is known; collective.

    Rounding errors of the displacement leave some of it.  The rest is what the contact conditions leave, gap and slip
    that remain (m, 3): forces of steel on rubber that cancel within a facet move the steel alone, by far less than
    diag(A) says.  The stiffness of the nodes bounds these forces, of thin sheets by far too much, which bend with a
    force of many nodes: no more is left than a further Newton step changes, if one was taken.
    """
    force = np.max(np.abs(e.force), axis=1)
    largest, noise = scales.of_points(force, over), scales.of_nodes(np.max(np.abs(e.rounding), axis=1), over)
    unit = np.where(largest > 0.0, largest, 1.0)
    rounding = _ROUNDINGS * (force / unit[e.owner]) * (noise / unit)[e.owner]  # largest at the largest force
    moved = (remaining * e.stiffness[:, None]).ravel()
    left = lengths(FrictionLaw.tresca(e.bound).left_over(e.force.ravel(), moved, 0.0).reshape(-1, 3)) / unit[e.owner]
    own = np.where(largest[e.owner] > 0.0, np.maximum(rounding, np.minimum(left, e.unsettled)), 0.0)
    check = Check(RESOLUTION, worst(over.max(own), 0.0), RESOLVED, "", "of the largest contact force of its body")
    if check.mark == "ok":
        return replace(check, meaning=f"every contact force is known to this part {check.meaning}")
    why = "rounding" if over.max(rounding) > 0.1 * check.value else "the solver"
    meaning = f"forces are unresolved: {why} may leave so much {check.meaning} undetermined"
    return replace(check, meaning=f"{meaning}{_place(e, own, over)}")


def _actions(e: Evidence, over: Reductions) -> tuple[Check, ...]:
    """Whether forces and moments on both faces of every pair are opposite, but for couples across undeformed gaps."""
    if e.actions is None:
        return ()
    size = float(np.max(over.extent(e.x))) or 1.0
    slave, master, couples = np.moveaxis(over.total(e.actions.ravel()).reshape(e.actions.shape), 1, 0)
    left = (slave + master - couples)[:, :6] / np.array([1.0] * 3 + [size] * 3)
    most = worst(0.0, *(ratio(worst(*np.abs(one)), scale) for one, scale in zip(left, slave[:, 6], strict=True)))
    meaning = "forces and moments on the two faces of every pair are opposite"
    return (Check("action and reaction", most, LIMIT, "", meaning),)


def _foundations(e: Evidence, over: Reductions) -> tuple[Check, ...]:
    """Whether contact and the loads given balance every foundation under load."""
    if not len(e.on_foundations):
        return ()
    (work, size), load = over.total(e.on_foundations[:, :2]).T, e.on_foundations[:, 2]
    left = worst(*(ratio(*pair) for pair in zip(np.abs(work + load), np.maximum(size, np.abs(load)), strict=True)))
    meaning = "contact and the forces and moments given add to zero on every foundation under load"
    return (Check("foundation balance", left, LIMIT, "", meaning),)
