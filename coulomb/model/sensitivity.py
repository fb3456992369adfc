"""Exact derivatives of an answer of small strains, or of a history of them, along its inputs, by the sets of its
contact points.

At an answer u = K^-1 (f - B^T x), and contact points are open, stick or slip.  While none of them changes its state,
forces follow from the derivative of the equations of contact (`solvers.semismooth_newton.derivatives`): one linear
system per input, with the K^-1 and A of the answer.  What an input does to the displacement without new contact forces
is that of loads: of friction none, of a load itself, of Young's modulus E minus the internal forces K_E u.  In a
history slip counts from the displacement after the step before, whose derivative is carried along.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Elasticity, End, Loading, ThermalLoad
from ..fem.geometry import Plane
from ..linalg.reductions import Reductions
from ..solvers.semismooth_newton import Change, derivatives
from ..solvers.semismooth_newton import gradient as adjoint
from .contact import SlipRateFriction, VariableFriction
from .discrete_problem import DiscreteProblem
from .force_balance import force_balance
from .nodal_answer import NodalAnswer
from .resultants import resultants


@dataclass(frozen=True)
class Sensitivity:
    """What an answer owes to one input.

    Attributes:
        name: "friction of 'bottom'", "pressure on 'top'", "young of 'upper'", "gap of 'bore'", "prescribed
            displacements", "pretension", "motion of the foundation of 'bottom'".
        contact_force: Derivative of x along the logarithm of the input, newtons, shape (3 m,): a hundredth of it is
            what 1 % more of the input does.
        displacement: Likewise of u, metres, this rank's nodes, shape (k, 3).
        totals: Of each contact by its name derivatives of "force" and "moment" on the body, "normal_force" and
            "friction_force", newtons and newton metres.
        others: Likewise of "reactions" of supports, "rigid_faces" and "bolts", and of "probes", by their names, as the
            answer has them; what is empty is left out.
        step: Relative change of the input up to which no contact point opens, closes, sticks or slips anew, to first
            order: so far the answer is linear in it.  In a history, the least of its load steps.
        border: Number of contact points on the border of two states.  If there are any, or were in a load step before,
            the derivatives are those as the input grows,
        falling: and these are those as it falls; else None.
    """

    name: str
    contact_force: FloatArray
    displacement: FloatArray
    totals: dict[str, dict[str, Any]]
    others: dict[str, dict[str, Any]]
    step: float
    border: int = 0
    falling: Sensitivity | None = None


@dataclass(frozen=True)
class Gradient:
    """What a function J of an answer owes to fields of the problem; this rank's part.

    Attributes:
        friction: Along the coefficient of friction of every contact point, where the bound is F x_n; shape (m,).
        bound: Along the bound of friction of every point, per newton, shape (m,).
        gap: Along the given gap of every point, per metre, shape (m,).
        load: Along nodal forces, per newton, shape (k, 3).
        prescribed: Along prescribed displacements, 0 where none is, per metre, shape (k, 3); a held node of a tie moves
            its followers in `Sensitivity`, and here does not.
        young: Of each body of built-in materials by its name, along the logarithm of Young's modulus of every cell of
            this rank, shape (c,).
    """

    friction: FloatArray
    bound: FloatArray
    gap: FloatArray
    load: FloatArray
    prescribed: FloatArray
    young: dict[str, FloatArray]


def gradient(
    problem: DiscreteProblem, x: FloatArray, u: FloatArray, of_force: FloatArray | None, of_u: FloatArray | None
) -> Gradient:
    """Of a function J of an answer, by the adjoint equations: one linear system of the contact and two solves with K,
    however many inputs there are (`solvers.semismooth_newton.gradient`); collective.

    Args:
        problem: The problem,
        x: with the contact forces of its answer, newtons, shape (3 m,),
        u: and the displacement, metres, shape (k, 3).
        of_force: dJ/dx, per newton, shape (3 m,),
        of_u: and dJ/du, per metre, shape (k, 3); None is 0.

    Raises:
        ValueError: In large motions, with heat, or after a load step.
    """
    _refuse(problem)
    if problem.before is not None and Reductions(problem.comm).any(bool(np.any(problem.before.displacement))):
        raise ValueError("gradients of a load history are not known: sensitivities(earlier) follow it step by step")
    surface, still = problem.surface, _unloaded(problem.loading)
    of_u = np.zeros_like(u) if of_u is None else of_u
    of_x = np.zeros_like(x) if of_force is None else of_force

    def response(load: FloatArray) -> tuple[FloatArray, FloatArray]:
        """K^-1 of nodal forces (k, 3), and the forces along rigid motions."""
        loaded = _with_loading(problem, replace(still, load=load))
        along = np.zeros(0) if loaded.state.rigid is None else loaded.state.rigid.e
        return loaded.linear.free_displacement, along

    free, along = response(of_u)
    owed = adjoint(problem.friction_problem, x, of_x - surface.rows(free).ravel(), along)
    whole = of_u + surface.at_nodes(owed.b)
    v, body = response(whole)[0], problem.elasticity
    reaction = whole - body.internal_force(v) + body.spring_force(v)
    v = problem.moved(v, owed.e)
    return Gradient(
        friction=owed.bound * np.maximum(x[0::3], 0.0),
        bound=owed.bound,
        gap=-owed.b[0::3],
        load=v,
        prescribed=body.held.held_part(reaction),
        young={
            member.name: -member.body.work_in_cells(
                u[member.nodes], v[member.nodes], None if part.temperature is None else part.temperature.change
            )
            for member, part in zip(body.members, problem.loading.parts or [problem.loading], strict=True)
            if isinstance(member.body, Elasticity)
        },
    )


def _refuse(problem: DiscreteProblem) -> None:
    if problem.body.undeformed is not None or problem.body.heat is not None:
        raise ValueError("sensitivities are known of small strains without heat, where a problem is one linear system")
    if problem.state.loaded:
        raise ValueError("sensitivities are not known of foundations under load: give their motion")


@dataclass(frozen=True)
class _Input:
    """The change of a problem along the logarithm of an input: bounds of friction in newtons (m,), gaps and the
    displacements from which slip counts in metres (m, 3), and loads and prescribed displacements, where they change;
    of the stiffness of a spring its number, beside its forces as loads."""

    bound: FloatArray | float = 0.0
    c: FloatArray | float = 0.0
    loading: Loading | None = None
    spring: int | None = None


def sensitivities(
    problem: DiscreteProblem, x: FloatArray, u: FloatArray, answer: NodalAnswer, earlier: Sequence[Sensitivity] = ()
) -> list[Sensitivity]:
    """Of an answer of small strains to friction, given gaps, loads, prescribed displacements and Young's moduli;
    collective.

    Args:
        problem: The problem,
        x: with the contact forces of its answer, newtons, shape (3 m,),
        u: and the displacement, metres, shape (k, 3).
        answer: The same at the contact points.
        earlier: Those of the load step before: slip counts from its displacement.

    Raises:
        ValueError: In large motions, or with heat, or friction that depends on the slip rate; in a later load step
            without those of the step before.
    """
    _refuse(problem)
    before = problem.before
    if before is not None:
        if not earlier and Reductions(problem.comm).any(bool(np.any(before.displacement))):
            raise ValueError("the sensitivities of a load step follow from those of the step before: give these")
        if any(isinstance(one.friction, SlipRateFriction | VariableFriction) for one in problem.contacts):
            raise ValueError("the sensitivities of a history are not known where friction depends on the slip rate")
    inputs = _inputs(problem, x, u, answer.given_gap)
    inputs |= {one.name: _Input() for one in earlier if one.name not in inputs}
    rising = _along(problem, inputs, x, answer, {one.name: one for one in earlier}, 1.0)
    if not rising or not (rising[0].border or any(one.falling for one in earlier)):
        return rising
    falling = _along(problem, inputs, x, answer, {one.name: one.falling or one for one in earlier}, -1.0)
    return [replace(up, falling=down) for up, down in zip(rising, falling, strict=True)]


def _along(
    problem: DiscreteProblem,
    inputs: Mapping[str, _Input],
    x: FloatArray,
    answer: NodalAnswer,
    earlier: Mapping[str, Sensitivity],
    sign: float,
) -> list[Sensitivity]:
    """Of each of the inputs as it grows (sign 1) or falls (-1); collective."""
    surface, still = problem.surface, _unloaded(problem.loading)
    without = _with_loading(problem, still)
    posed, changes, origins = [], [], []
    for name, one in inputs.items():
        loading, origin = one.loading, np.zeros((len(surface.nodes), 3)) + one.c
        if name in earlier:
            loading = _continued(problem, loading or still, earlier[name].displacement)
            origin[:, 1:] += surface.rows(earlier[name].displacement)[:, 1:]
        changed = without if loading is None else _with_loading(problem, loading)
        e = [np.zeros(0) if each.state.rigid is None else each.state.rigid.e for each in (changed, without)]
        closing = (changed.b - without.b).reshape(-1, 3) - origin
        bound = np.zeros(len(origin)) + one.bound
        changes.append(Change(sign * closing.ravel(), sign * bound, sign * (e[0] - e[1])))
        posed.append(changed)
        origins.append(origin)
    found = []
    for (name, one), changed, origin, owed in zip(
        inputs.items(), posed, origins, derivatives(problem.friction_problem, x, changes), strict=True
    ):
        dx = sign * owed.x
        du = changed.moved(changed.displacement(dx), sign * owed.alpha)
        others = _others(changed, one, dx, du, answer, origin)
        step = min(owed.step, earlier[name].step if name in earlier else np.inf)
        found.append(Sensitivity(name, dx, du, _totals(problem, x, dx, sign), others, step, owed.border))
    return found


def _others(
    changed: DiscreteProblem, given: _Input, dx: FloatArray, du: FloatArray, answer: NodalAnswer, origin: FloatArray
) -> dict[str, dict[str, Any]]:
    """As the attribute of `Sensitivity`, of the derivative of forces (3 m,) and displacements (k, 3) along an input, of
    which `origin` (m, 3) is what slip counts from; collective."""
    body, on_points, time, surface = changed.elasticity, dx.reshape(-1, 3), changed.time, changed.surface
    imbalance = body.internal_force(du) - body.spring_force(du) - changed.loading.load + surface.at_nodes(dx)
    none, constraints, over = np.zeros_like(du), body.constraints, Reductions(changed.comm, body.copies)
    of_ties = constraints.forces(imbalance, time)
    pulled, moved = (  # forces of bolts and motions are given, but where they are the input
        over.any(of is not None and bool(np.any(of)))
        for of in ((None, None) if given.loading is None else (given.loading.tension, given.loading.apart))
    )
    if not pulled:
        of_ties = of_ties - constraints.forces(none, time)
    reaction = body.held.held_part(imbalance - of_ties)
    springs = list(body.spring_forces(du))
    if given.spring is not None:
        springs[given.spring] = replace(
            springs[given.spring], forces=springs[given.spring].forces + changed.loading.load
        )
    of = resultants(chain(body.shares(reaction), springs), body.x, over)
    here = replace(answer, force=on_points, displacement=surface.rows(du), slip_origin=origin)
    probes = changed.body.probes.values(du, here, surface.nodes)
    entries: dict[str, dict[str, dict[str, Any]]] = {
        "reactions": {one.name: {"force": one.force, "moment": one.moment} for one in of},
        "probes": {
            one.name: {"displacement": one.displacement, "slip": one.slip, "pressure": one.pressure} for one in probes
        },
    }
    if constraints.ties:
        tied, still = (force_balance(changed, of, none, left, none) for of, left in ((du, imbalance), (none, none)))
        entries["bolts"] = {
            one.face: {"force": one.force - (0.0 if pulled else at.force), "shortening": one.shortening}
            for one, at in zip(tied.bolts, still.bolts, strict=True)
        }
        entries["rigid_faces"] = {
            one.face: {
                name: getattr(one, name) - (0.0 if moved else getattr(at, name))
                for name in ("translation", "rotation", "force", "moment")
            }
            for one, at in zip(tied.rigid_faces, still.rigid_faces, strict=True)
        }
    return {kind: {name: _plain(one) for name, one in of_kind.items()} for kind, of_kind in entries.items() if of_kind}


def _entry(one: Sensitivity) -> dict[str, Any]:
    step = one.step if np.isfinite(one.step) else None
    return {"input": one.name, "totals": one.totals, **one.others, "step": step, "border": one.border}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """With lists in place of arrays."""
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def sensitivity_entries(found: Sequence[Sensitivity], tolerances: bool | Mapping[str, float]) -> dict[str, Any]:
    """Of summary.json: `sensitivity`, where a step without end is null; with relative tolerances of inputs by their
    names also `input_bars`, the root of the sum of the squares of what each does to the totals, and `unknown_inputs`,
    names of no input that has not been 0 so far."""
    entries: dict[str, Any] = {
        "sensitivity": [
            {**_entry(one), "falling": _entry(one.falling)} if one.falling else _entry(one) for one in found
        ]
    }
    if isinstance(tolerances, bool):
        return entries
    names = {one.name: one for one in found}
    entries["unknown_inputs"] = [name for name in tolerances if name not in names]
    entries["input_bars"] = {
        face: {
            total: np.linalg.norm(
                [tolerances.get(name, 0.0) * np.asarray(one.totals[face][total]) for name, one in names.items()], axis=0
            ).tolist()
            for total in totals
        }
        for face, totals in found[0].totals.items()
    }
    return entries


def _unloaded(loading: Loading) -> Loading:
    none = None if loading.tension is None else np.zeros_like(loading.tension)
    still = np.zeros_like(loading.load)
    return replace(loading, load=still, prescribed=still, tension=none, apart=0.0)


def _with_loading(problem: DiscreteProblem, loading: Loading) -> DiscreteProblem:
    return problem.in_state(replace(problem.state, loading=loading), None, problem.before)


def _continued(problem: DiscreteProblem, loading: Loading, u: FloatArray) -> Loading:
    """Loads and prescribed displacements with what supports hold of the displacement (k, 3) after the step before."""
    before, body = problem.before, problem.elasticity
    assert before is not None
    held, none = (body.after(problem.time, End(before.time, end)) for end in (u, np.zeros_like(u)))
    return replace(
        loading,
        prescribed=loading.prescribed + held.prescribed - none.prescribed,
        apart=loading.apart + held.apart - none.apart,
    )


def _inputs(problem: DiscreteProblem, x: FloatArray, u: FloatArray, gap: FloatArray) -> dict[str, _Input]:
    """Every input with the change of the problem along its logarithm; a name that occurs again has a number."""
    surface, loading, body, over = problem.surface, problem.loading, problem.elasticity, Reductions(problem.comm)
    found: dict[str, _Input] = {}

    def put(name: str, one: _Input) -> None:
        there = sum(known == name or known.startswith(f"{name} (") for known in found)
        found[f"{name} ({there + 1})" if there else name] = one

    parts, bound = [surface.part == part for part in range(len(surface.faces))], problem.slip_bound(x)
    for face, here in zip(surface.faces, parts, strict=True):
        if over.any(bool(np.any(bound[here] > 0.0))):
            put(f"friction of {face!r}", _Input(bound=np.where(here, bound, 0.0)))
    for face, here in zip(surface.faces, parts, strict=True):
        if over.any(bool(np.any(gap[here] != 0.0))):
            put(f"gap of {face!r}", _Input(c=np.where(here, gap, 0.0)[:, None] * [1.0, 0.0, 0.0]))
    for number, (face, here) in enumerate(zip(surface.faces, parts, strict=True)):
        moved = _moved(problem, number)
        if over.any(bool(np.any(moved != 0.0))):
            put(f"motion of the foundation of {face!r}", _Input(c=np.where(here[:, None], moved, 0.0)))
    still = _unloaded(loading)
    for load in body.loads_in(loading):
        where = "" if load.face is None else f" on {load.face!r}"
        put(f"{load.kind.replace('_', ' ')}{where}", _Input(loading=replace(still, load=load.forces)))
    if over.any(bool(np.any(problem.prescribed) or np.any(loading.apart))):
        put("prescribed displacements", _Input(loading=replace(loading, load=still.load, tension=still.tension)))
    if loading.tension is not None and np.any(loading.tension):
        put("pretension", _Input(loading=replace(still, tension=loading.tension)))
    for number, spring in enumerate(body.spring_forces(u)):
        place = "" if spring.face is None else f" on {spring.face!r}"
        put(f"stiffness of the spring{place}", _Input(loading=replace(still, load=spring.forces), spring=number))
    for member, part in zip(body.members, loading.parts or [loading], strict=True):
        if member.body.materials is None:
            continue
        forces = np.zeros_like(body.x)
        strained = (one.forces for one in member.body.loads_in(part) if one.kind == ThermalLoad.kind)
        forces[member.nodes] = sum(strained) - member.body.internal_force(u[member.nodes])
        put("young" + (f" of {member.name!r}" if member.name else ""), _Input(loading=replace(still, load=forces)))
    return found


def _moved(problem: DiscreteProblem, part: int) -> FloatArray:
    """What a plane has moved that is the foundation of a face, along n altogether, along the tangents since the step
    before, metres, shape (m, 3); 0 of curved and turning foundations, whose normals change as well."""
    surface, body, before = problem.surface, problem.body, problem.before
    way, motion = np.zeros((len(surface.nodes), 3)), problem.state.foundation_motions[part]
    if not isinstance(body.foundations[part], Plane) or motion.turn is not None:
        return way
    way[:, 0] = surface.components(np.broadcast_to(motion.translation, way.shape))[:, 0]
    if before is not None:
        then = body.foundation_motions(before.time)[part].translation
        way[:, 1:] = surface.components(np.broadcast_to(motion.translation - then, way.shape))[:, 1:]
    return way


def _totals(problem: DiscreteProblem, x: FloatArray, dx: FloatArray, sign: float) -> dict[str, dict[str, Any]]:
    """Derivatives of the totals of every contact for a derivative of the forces, both (3 m,), as an input grows (1) or
    falls (-1); collective."""
    surface, found = problem.surface, dict[str, dict[str, Any]]()
    over = Reductions(problem.comm, problem.elasticity.copies)
    on_body = -surface.vectors(dx.reshape(-1, 3))
    both = x.reshape(-1, 3), dx.reshape(-1, 3)
    tangential = [-surface.vectors(of * [0.0, 1.0, 1.0]) for of in both]
    for part, face in enumerate(surface.faces):
        here = surface.part == part
        friction, change = (over.total(of[here].sum(axis=0)) for of in tangential)
        size = float(np.linalg.norm(friction))
        found[face] = {
            "force": over.total(on_body[here].sum(axis=0)).tolist(),
            "moment": over.total(np.cross(surface.x[here], on_body[here]).sum(axis=0)).tolist(),
            "normal_force": over.sum(dx[0::3][here]),
            "friction_force": float(friction @ change) / size if size > 0.0 else sign * float(np.linalg.norm(change)),
        }
    return found
