"""Derivatives of the totals of an answer along an input, from those of its forces, displacements and places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Bolt
from ..fem.contact import Pretension
from ..linalg.reductions import Reductions
from .discrete_problem import DiscreteProblem
from .geometric_terms import Terms
from .nodal_answer import OPEN, NodalAnswer
from .resultants import Resultant, resultants


@dataclass(frozen=True, eq=False)
class Changed:
    """What a change of the problem does at the forces and displacements of the answer.

    Attributes:
        terms: To its equations.
        energies: To the strain energy of every body, joules.
        way: To the places of nodes, metres, shape (k, 3).
    """

    terms: Terms
    energies: tuple[float, ...]
    way: FloatArray


@dataclass(frozen=True, eq=False)
class Derived:
    """The derivative of an answer along an input.

    Attributes:
        problem: The linear problem along the input.
        x: Of contact forces, along frames that turn with the normals alone, newtons, shape (3 m,),
        u: of the displacement, metres, shape (k, 3),
        poses: and of the `ContactState.poses` of foundations under load, shape (faces, 6); None without any.
        c: Of gap and slip origin, with the ways of foundations under load, metres, shape (m, 3).
        terms: The geometric terms; None without any.
        tension: The forces of bolts that are the input, newtons, shape (width,); None of others.
        moved: Whether motions of rigid faces are.
        spring: The number of the spring whose stiffness is the input, and its forces, newtons, (k, 3); None of others.
        energy: Of a modulus or a temperature that is the input the number of the body, and what it does by itself to
            its strain energy, joules; None of others.
        changed: What the input changes in the problem itself; None if it does not.
    """

    problem: DiscreteProblem
    x: FloatArray
    u: FloatArray
    poses: FloatArray | None
    c: FloatArray
    terms: Terms | None
    tension: FloatArray | None
    moved: bool
    spring: tuple[int, FloatArray] | None
    energy: tuple[int, float] | None
    changed: Changed | None


_NOTHING: Final = 1e-8
"""Part of the sizes of what is summed up to which a sum is 0: the accuracy of answers and derivatives."""

_TIED: Final = 1e-6
"""Part of the largest by which a value may be less and still be as large, and rates differ and still be the same."""


def contact_totals(
    answer: NodalAnswer, derived: Derived, sign: float
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Of every contact by its name, as of `Sensitivity.totals`, as an input grows (1) or falls (-1); and on the other
    side, if forces and displacements are those of both: the size of a vector that is 0, and the largest of values that
    are the same, have two derivatives; collective."""
    surface, totals, dx = derived.problem.surface, dict[str, dict[str, Any]](), derived.x.reshape(-1, 3)
    other = dict[str, dict[str, Any]]()
    over, along_surface = Reductions(answer.comm, answer.copies), np.array([0.0, 1.0, 1.0])
    on_body, of_friction = -surface.vectors(dx), -surface.vectors(dx * along_surface)
    places, terms = np.zeros_like(on_body), derived.terms
    if terms is not None:
        on_body, of_friction, places = on_body - terms.vectors, of_friction - terms.tangential, terms.x
    present = -surface.vectors(answer.force * along_surface)
    slip, slipping = answer.relative_displacement, surface.rows(derived.u) - derived.c
    work = np.sum((dx * slip + answer.force * slipping)[:, 1:], axis=1)
    turning = np.cross(answer.x, on_body) + np.cross(places, answer.on_body)
    closed, stretch = answer.status != OPEN, np.zeros(len(places)) if terms is None else terms.area
    levers = dx[:, :1] * answer.x + answer.force[:, :1] * places
    sliding = replace(answer, displacement=surface.rows(derived.u), slip_origin=derived.c).slip
    sliding = sliding if terms is None else sliding + terms.slip
    largest = [over.max(np.abs(of).ravel()) for of in (answer.displacement, sliding)]
    slips = _size_rates(answer.slip, sliding, largest, sign)
    pressures = np.repeat(((dx[:, 0] - answer.pressure * stretch) / answer.area)[:, None], 2, axis=1)
    for part, face in enumerate(answer.faces):
        here = surface.part == part
        friction, change = (over.total(of[here].sum(axis=0)) for of in (present, of_friction))
        pressing, touching = over.sum(dx[here, 0]), here & closed
        sizes = [over.sum(np.linalg.norm(of[here], axis=1)) for of in (present, of_friction)]
        sided: dict[str, Sequence[float]] = {
            "friction_force": list(map(float, _size_rates(friction, change, sizes, sign))),
            "greatest_slip": _largest_rates(np.linalg.norm(answer.slip, axis=1)[touching], slips[touching], sign, over),
            "greatest_pressure": _largest_rates(answer.pressure[here], pressures[here], sign, over),
        }
        normal, area, more = (over.sum(of[here]) for of in (answer.force[:, 0], answer.area * closed, stretch * closed))
        totals[face] = {
            "force": over.total(on_body[here].sum(axis=0)).tolist(),
            "moment": over.total(turning[here].sum(axis=0)).tolist(),
            "normal_force": pressing,
            "contact_area": more,
            "dissipated_energy": over.sum(work[here]),
        }
        if normal > 0.0 and area > 0.0:
            centre = over.total(answer.force[here, 0] @ answer.x[here]) / normal
            moved = over.total(levers[here].sum(axis=0)) - pressing * centre
            totals[face]["centre_of_pressure"] = (moved / normal).tolist()
            totals[face]["mean_pressure"] = (pressing - more * normal / area) / area
        other[face] = totals[face] | {name: float(sides[1]) for name, sides in sided.items()}
        totals[face] |= {name: float(sides[0]) for name, sides in sided.items()}
    return totals, other


def _size_rates(v: FloatArray, change: FloatArray, scales: Sequence[float], sign: float) -> FloatArray:
    """Of the sizes of vectors (..., 3), on the side asked for and on the other, shape (..., 2), from the scales
    of vectors and of their changes."""
    size, rate = np.linalg.norm(v, axis=-1), np.linalg.norm(change, axis=-1)
    there = size > _NOTHING * scales[0]
    along = np.sum(v * change, axis=-1) / np.where(there, size, 1.0)
    rate = np.where(rate > _NOTHING * max(scales), rate, 0.0)
    return np.stack([np.where(there, along, side * rate) for side in (sign, -sign)], axis=-1)


def _largest_rates(values: FloatArray, rates: FloatArray, sign: float, over: Reductions) -> tuple[float, float]:
    """Of the largest of values (m,), from the rates of each on both sides, shape (m, 2); collective."""
    largest, size = over.max(values), over.max(np.abs(rates).ravel())
    if not np.isfinite(largest):
        return 0.0, 0.0
    tied = values >= largest - _TIED * abs(largest)
    here, there = (side * over.max(side * rates[tied, k]) for k, side in enumerate((sign, -sign)))
    same = abs(here - there) <= max(_TIED * size, _NOTHING * abs(largest))
    return here, here if same else there


Section = tuple[Bolt, Resultant]
"""A bolt, and what its section carries."""


def sections_of(problem: DiscreteProblem, left: FloatArray, u: FloatArray) -> list[Section]:
    """Of all bolts, from what supports and constraints hold, newtons, and the displacement, shapes (k, 3);
    collective."""
    body, constraints = problem.elasticity, problem.elasticity.constraints
    shares = resultants(constraints.shares(left, problem.time), body.x, Reductions(problem.comm, body.copies))
    return list(zip(constraints.bolts_at(u), (of for of in shares if of.kind == Pretension.kind), strict=True))


def other_totals(
    answer: NodalAnswer,
    derived: Derived,
    totals: Mapping[str, Mapping[str, Any]],
    left: FloatArray | None,
    u: FloatArray,
    sections: Sequence[Section],
    sign: float,
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    """Of reactions, probes, bodies, ties, bolts, rigid faces and foundations under load, by their names; on both sides,
    as of `contact_totals`; collective.

    Args:
        at: The answer at the contact points.
        derived: Its derivative.
        totals: Of the contacts.
        left: What supports and constraints hold on places that move, newtons, shape (k, 3); None where they do not.
        u: The displacement, metres, shape (k, 3).
        sections: Of the answer.
        sign: As an input grows (1) or falls (-1).
    """
    changed, du = derived.problem, derived.u
    body, time, surface = changed.elasticity, changed.time, changed.surface
    imbalance = body.internal_force(du) - body.spring_force(du) - changed.loading.load + surface.at_nodes(derived.x)
    none, constraints, over = np.zeros_like(du), body.constraints, Reductions(changed.comm, body.copies)
    pulled = constraints.pulling(derived.tension)
    reaction = body.held.held_part(imbalance - pulled.forces(imbalance, time))
    springs = list(body.spring_forces(du))
    if left is not None:  # those of rigid faces are the last ones
        for number, one in enumerate(constraints.sprung, len(springs) - len(constraints.sprung)):
            springs[number] = replace(springs[number], forces=one.pull_rate(body.x, du, changed.comm))
    if derived.spring is not None:
        number, forces = derived.spring
        springs[number] = replace(springs[number], forces=springs[number].forces + forces)
    of = resultants(chain(body.shares(reaction), springs), body.x, over)
    if left is not None:
        held = body.held.held_part(left - constraints.forces(left, time))
        way = du if derived.changed is None else derived.changed.way
        arms = resultants(chain(body.shares(held), body.spring_forces(u)), way, over)
        of = tuple(replace(one, moment=one.moment + arm.moment) for one, arm in zip(of, arms, strict=True))
    cuts = list[_Cut]()
    entries: dict[str, dict[str, dict[str, Any]]] = {
        "reactions": {one.name: _moments(one) for one in of},
        "probes": {} if derived.changed else _probes(answer, derived),
        "bodies": _strained(derived, u, over),
    }
    if constraints.ties and left is not None:
        turned, cuts = _turned(derived, imbalance, left, u, over)
        entries |= turned
    elif constraints.ties:
        tied = resultants(pulled.shares(imbalance, time), body.x, over)
        motions, still = (constraints.motions_of_faces(of, time) for of in (du, none))
        entries["rigid_faces"] = {}
        for (face, point, motion), (_, _, given), force in zip(motions, still, tied, strict=False):
            way = motion if derived.moved else motion - given  # what is given stays, but where it is the input
            moment = force.moment - np.cross(point, force.force)
            entry = {"translation": way[:3], "rotation": way[3:], "force": force.force, "moment": moment}
            entries["rigid_faces"][face] = entry
        entries["ties"] = {one.name: _moments(one) for one in tied[len(entries["rigid_faces"]) :]}
        screwed = [one for one in tied if one.kind == Pretension.kind]
        cuts = [
            _Cut(of.shortening, one.force, one.moment, np.zeros(3), np.zeros(3))
            for of, one in zip(constraints.bolts_at(du), screwed, strict=True)
        ]
    entries["loaded_foundations"] = _foundations(answer, derived, totals)
    bolts = [(bolt.face, _carried(bolt, now, cut, sign)) for (bolt, now), cut in zip(sections, cuts, strict=True)]
    ends = [entries | {"bolts": {face: sides[k] for face, sides in bolts}} for k in (0, 1)]
    here, there = (
        {kind: {name: _plain(one) for name, one in of_kind.items()} for kind, of_kind in end.items() if of_kind}
        for end in ends
    )
    return here, there


class _Cut(NamedTuple):
    """The derivatives of a bolt's shortening, of force and moment about the origin of its section, and of its direction
    and middle, SI units, shapes (3,)."""

    shortening: float
    force: FloatArray
    moment: FloatArray
    direction: FloatArray
    centre: FloatArray


def _carried(bolt: Bolt, now: Resultant, cut: _Cut, sign: float) -> list[dict[str, float]]:
    """Of the numbers of a `BoltForce`, on both sides."""
    n, dn = bolt.direction, cut.direction
    arm, turned = np.cross(bolt.centre, now.force), np.cross(bolt.centre, cut.force)
    moment, change = now.moment - arm, cut.moment - turned - np.cross(cut.centre, now.force)

    def rates(v: FloatArray, dv: FloatArray, *more: FloatArray) -> tuple[float, FloatArray]:
        """Of the part of a vector along the bolt, and of the size of that across it."""
        along, rate = n @ v, float(dn @ v + n @ dv)
        scales = [float(np.linalg.norm(one)) for one in more]
        return rate, _size_rates(v - along * n, dv - rate * n - along * dn, scales, sign)

    force, shear = rates(now.force, cut.force, now.force, cut.force)
    torsion, bending = rates(moment, change, np.append(moment, arm), np.append(change, turned))
    across = zip(map(float, shear), map(float, bending), strict=True)
    return [
        {"force": force, "shear": s, "bending": b, "torsion": torsion, "shortening": cut.shortening} for s, b in across
    ]


_MOMENTS: Final = ("force", "moment")

_DIFFERENCE: Final = 1e-6
"""Displacement of the differences of bolts over the size of the bodies."""


def _turned(
    derived: Derived, imbalance: FloatArray, left: FloatArray, u: FloatArray, over: Reductions
) -> tuple[dict[str, dict[str, dict[str, Any]]], list[_Cut]]:
    """Of ties and rigid faces, and of the sections of bolts, which turn; collective."""
    body, du, time, terms = derived.problem.elasticity, derived.u, derived.problem.time, derived.terms
    assert terms is not None
    constraints, x, totals = body.constraints, body.x, dict[str, dict[str, dict[str, Any]]]()
    forces, changes = list(constraints.shares(left, time)), []
    pulled = constraints.pulling(derived.tension)
    for tie, change_of in zip(constraints.every, pulled.shares(imbalance, time), strict=True):
        change_of.forces[tie.nodes] -= terms.turned[tie.nodes]
        changes.append(change_of)
    present, arms, change = (resultants(of, at, over) for of, at in ((forces, x), (forces, du), (changes, x)))
    each = list(zip(present, change, arms, strict=True))
    totals["rigid_faces"] = {}
    for motion, (now, more, arm) in zip(constraints.motions, each, strict=False):
        point, way = motion.point, over.total(np.einsum("mcp,mc->p", motion.spread, du[motion.nodes]))
        moment = more.moment + arm.moment - np.cross(way[:3], now.force) - np.cross(point, more.force)
        entry = {"translation": way[:3], "rotation": way[3:], "force": more.force, "moment": moment}
        totals["rigid_faces"][motion.given.face] = entry
    size, extent = over.max(np.abs(du).ravel()), float(np.max(over.extent(x)))
    h = _DIFFERENCE * extent / (size or 1.0)
    tied = each[len(constraints.motions) :]
    totals["ties"] = {now.name: {"force": more.force, "moment": more.moment + arm.moment} for now, more, arm in tied}
    sections = [one for one in tied if one[0].kind == Pretension.kind]
    ends = (constraints.bolts_at(u + step * du) for step in (-h, h))
    cuts = [
        _Cut(
            (after.shortening - before.shortening) / (2.0 * h),
            more.force,
            more.moment + arm.moment,
            (after.direction - before.direction) / (2.0 * h),
            (after.centre - before.centre) / (2.0 * h),
        )
        for before, after, (_, more, arm) in zip(*ends, sections, strict=True)
    ]
    return totals, cuts


def _moments(one: Resultant) -> dict[str, Any]:
    return {name: getattr(one, name) for name in _MOMENTS}


def _strained(derived: Derived, u: FloatArray, over: Reductions) -> dict[str, dict[str, Any]]:
    """Strain energy; collective."""
    energies = {}
    by_number = dict(enumerate(derived.changed.energies) if derived.changed else [derived.energy or (-1, 0.0)])
    for number, one in enumerate(derived.problem.elasticity.members):
        if one.body.strain_energy(u[one.nodes]) is not None:
            change = over.dot(one.body.strain_force(u[one.nodes]), derived.u[one.nodes])
            energies[one.name] = {"strain_energy": change + over.copies * by_number.get(number, 0.0)}
    return energies


def _probes(answer: NodalAnswer, derived: Derived) -> dict[str, dict[str, Any]]:
    """Displacement, slip and pressure; collective."""
    surface, terms, body = derived.problem.surface, derived.terms, derived.problem.body
    force = derived.x.reshape(-1, 3)
    here = replace(answer, force=force, displacement=surface.rows(derived.u), slip_origin=derived.c)
    slip = here.slip
    if terms is not None:  # the area of a pressure changes, and the direction of a slip
        here, slip = replace(here, force=force - answer.force * (terms.area / answer.area)[:, None]), slip + terms.slip
    probes = (body.undeformed or body).probes.values(derived.u, here, surface.nodes, slip)
    return {one.name: {"displacement": one.displacement, "slip": one.slip, "pressure": one.pressure} for one in probes}


def _foundations(answer: NodalAnswer, derived: Derived, totals: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Motions of foundations under load, and what contact does on them, about their points; collective."""
    by_name = dict[str, Any]()
    for one in derived.problem.state.loaded:
        assert derived.poses is not None
        way, contact = derived.poses[one.number], totals[answer.faces[one.number]]
        force, moment = (-np.array(contact[name]) for name in ("force", "moment"))
        present = -np.array(answer.totals(one.number)["force"])
        moment = moment - np.cross(way[:3], present) - np.cross(one.point, force)
        by_name[one.name] = {"translation": way[:3], "rotation": way[3:], "force": force, "moment": moment}
    return by_name


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """With lists in place of arrays."""
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
