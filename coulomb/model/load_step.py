"""A load step: the state after it, and its figures as one row."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..contact_fields import named_faces
from ..linalg.reductions import Reductions
from .nodal_answer import OPEN, OPEN_BELOW, Accumulated, NodalAnswer
from .solution import Solution
from .state import Earlier, Forces, State, coefficients_work


def along_axes(name: str, vector: Sequence[float] | None) -> dict[str, float]:
    """The columns name_x, name_y, name_z of a vector; nan without one."""
    return {f"{name}_{axis}": value for axis, value in zip("xyz", vector or [math.nan] * 3, strict=True)}


def _columns(
    name: str, entry: Mapping[str, Any], vectors: Sequence[str] = (), numbers: Sequence[str] = ()
) -> dict[str, Any]:
    """The columns of some entries of a dictionary in summary.json, after a name."""
    columns: dict[str, Any] = {}
    for what in vectors:
        columns |= along_axes(f"{name}_{what}", entry[what])
    return columns | {f"{name}_{what}": entry[what] for what in numbers}


def face_columns(name: str, face: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of one of several contact faces, or of a pair, with its name in files (`side_names`), from its entry
    in summary.json."""
    opposite = ("opposite_force", "opposite_moment") if "against" in face else ()
    forces = _columns(name, face, ("force", "moment", *opposite), ("normal_force", "friction_force", "contact_area"))
    return forces | _columns(name, face, ("centre_of_pressure",))


def _rotation_columns(face: Mapping[str, Any]) -> dict[str, float]:
    """The columns of a contact face whose foundation rotates; none of other faces."""
    names = ("angle", "torque", "power") if "torque" in face else ()
    return {f"{face['faces'][0]}_{name}": math.nan if face[name] is None else face[name] for name in names}


def _probe_columns(probe: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of a probe; those of a contact are None elsewhere."""
    name, slip = f"probe_{probe['name']}", probe["slip"]
    slips = dict.fromkeys(along_axes(f"{name}_slip", None)) if slip is None else along_axes(f"{name}_slip", slip)
    return {**_columns(name, probe, ("displacement",)), **slips, f"{name}_pressure": probe["pressure"]}


def _reaction_columns(reaction: Mapping[str, Any]) -> dict[str, Any]:
    return _columns(reaction["name"], reaction, ("force", "moment"))


_OF_MOTION: Final = ("translation", "rotation", "force", "moment")

_COLUMNS: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "bodies": lambda of: _columns(f"body_{of['name']}", of, ("contact_force", "contact_moment"), ("balance",)),
    "rigid_faces": lambda of: _columns(f"rigid_face_{of['face']}", of, _OF_MOTION),
    "loaded_foundations": lambda of: _columns(f"foundation_{of['face']}", of, _OF_MOTION),
    "bolts": lambda of: _columns(f"bolt_{of['face']}", of, (), ("force", "shear", "bending", "shortening")),
    "ties": _reaction_columns,
    "reactions": _reaction_columns,
    "probes": _probe_columns,
}
"""Of each entry of a list in summary.json."""


def _heat_columns(heat: Mapping[str, Any]) -> dict[str, float]:
    """The columns of temperatures and heat flows, from the entry in summary.json (`Heat.entry`)."""
    ends = {f"temperature_{name}": value for name, value in heat["temperature"].items()}
    return {**ends, **{flow["name"]: flow["power"] for flow in heat["flows"]}, "heat_imbalance": heat["imbalance"]}


def state_after(state: State, solution: Solution) -> State:
    """The state at the end of the step that follows one, with updated energies; collective."""
    problem, surface, e = solution.problem, solution.problem.surface, solution.evidence
    body, u = problem.elasticity, state.displacement
    places = problem.body.places(surface)

    if state.forces is not None:
        then = state.forces
    else:
        before = body.at_time(state.time)
        there = problem.body.surface_of(before, state.time, state.poses)
        of_contact = state.force_on_body[problem.body.places(there)]
        loading = before.at(state.time)
        if state.temperature_change is not None:
            loading = before.heated(loading, state.temperature_change)
        kept = before.internal_force(u) - before.spring_force(u)
        then = Forces.at(before, there, u, kept, loading.load, of_contact, state.time)
        body.at_time(problem.time)  # the user's coefficients are those of the present again
    kept = e.internal - body.spring_force(solution.displacement)
    now = Forces.at(body, surface, solution.displacement, kept, e.load, solution.force_on_body, problem.time)
    # 0 where K stays: then u0 . K u1 = u1 . K u0
    stiffened = coefficients_work(then, now, Reductions(problem.comm, body.copies)) if body.forms() is not None else 0.0
    return ended(state, solution, then, now, places, stiffened)


def ended(
    state: State,
    solution: Solution,
    then: Forces,
    now: Forces,
    nodes: IntArray,
    stiffened: float = 0.0,
    elastic: float | None = None,
) -> State:
    """The state at the end of the step that follows one, from the forces at its beginning and end; collective.

    Args:
        state: At its beginning.
        solution: The answer, with its contact points `at` these numbers of those of states.
        stiffened: Work of changes of the stiffness, joules.
        elastic: Elastic energy at the end, where it is not half the work of the forces.
    """
    problem, answer, on_body = solution.problem, solution.at_nodes, solution.force_on_body
    over, heat = Reductions(problem.comm, problem.elasticity.copies), problem.state.heat

    def put(values: FloatArray, into: FloatArray) -> FloatArray:
        whole = into.copy()
        whole[nodes] = values
        return whole

    surface, large = problem.surface, problem.body.undeformed is not None
    change = now.displacement - then.displacement
    x_then = surface.x - surface.points.average(change) if large else surface.x
    moved_then, moved = (problem.body.foundation_displacement(problem.state, state, x) for x in (x_then, surface.x))
    widened = answer.given_gap - problem.body.given_gap(surface, state.time)
    approach = surface.rows(change)[:, 0] - surface.components(0.5 * (moved_then + moved))[:, 0]
    strength = np.linalg.norm(state.force_on_body[nodes], axis=1)
    opened = strength <= OPEN_BELOW * over.max(strength)
    also = _by_given_gaps(widened, approach, answer, opened)
    foundation = 0.5 * (over.dot(state.force_on_body[nodes], moved_then + also) + over.dot(on_body, moved + also))
    dissipated = over.sum(answer.friction_work)
    energy = state.energy.after(then, now, foundation, dissipated, over, stiffened)
    rate = np.linalg.norm(answer.slip, axis=1) / (problem.time - state.time)
    worn = map(put, vars(answer.accumulated).values(), vars(state.accumulated).values())
    return State(
        number=state.number + 1,
        time=problem.time,
        energy=energy if elastic is None else replace(energy, elastic=elastic),
        displacement=now.displacement,
        force_on_body=put(on_body, np.zeros_like(state.force_on_body)),
        slip_rate=put(rate, np.zeros_like(state.slip_rate)),
        accumulated=Accumulated(*worn),
        pending=state.pending[:-1],
        forces=now,
        before=Earlier(state.time, state.force_on_body, state.displacement),
        temperature_change=None if heat is None else heat.change,
        poses=problem.state.poses,
        turns=problem.elasticity.constraints.turns,
        friction_error=None
        if state.friction_error is None
        else (1.0 - state.new_part(nodes, answer)) * state.friction_error,
    )


def _by_given_gaps(widened: FloatArray, approach: FloatArray, answer: NodalAnswer, opened: BoolArray) -> FloatArray:
    """What changes of given gaps add to the displacement of what the body touches, along which contact forces do work,
    metres, shape (m, 3).

    Where a given gap becomes wider than the body follows, as of a pair that is taken out, it works along the way of the
    body alone, while the force falls to 0; where one from afar is closed, after it touches.

    Args:
        widened: By how much given gaps have grown in the step, metres, shape (m,).
        approach: By how much contact points have come nearer to what they may touch but for these, shape (m,).
        answer: At the end.
        opened: Points without a force at the beginning, shape (m,); of the others the gap there is a rounding error.
    """
    after = answer.gap - answer.displacement[:, 0]
    before = after + approach - widened
    away = (answer.status == OPEN) & (after > 0.0) & (widened >= after)
    towards = opened & (before > 0.0) & (widened <= -before)
    way = np.where(away | towards, widened + before - after, widened)[:, None] * answer.frames[:, 0]
    return np.where(away[:, None], way + answer.slip, way)


@dataclass(frozen=True)
class LoadStep:
    """A completed load step.

    Attributes:
        solution: The solution at its end; `solution.problem` has the loads at that time.
        state: The state after it.
        halvings: How often its interval was halved.
        why_halved: Why the last attempt failed; empty without one.
    """

    solution: Solution
    state: State
    halvings: int
    why_halved: str = ""

    @property
    def row(self) -> dict[str, Any]:
        """Its figures, in the order of the columns of history.csv; collective."""
        numbers, solution, state = self.solution.at_nodes.numbers(), self.solution, self.state
        numbers |= solution.force_balance.entries()
        numbers |= {"probes": [value.entry() for value in solution.probes]}
        face, faces = numbers["totals"], named_faces(numbers["faces"])
        several = faces if len(faces) > 1 or "against" in faces[0][1] else []
        parts = [face_columns(*one) for one in several] + [_rotation_columns(part) for part in numbers["faces"]]
        parts += [columns(of) for entry, columns in _COLUMNS.items() for of in numbers.get(entry, ())]
        return {
            "step": state.number,
            "time": state.time,
            **(along_axes("force", face["force"]) if "force" in face else {}),
            **(along_axes("moment", face["moment"]) if "moment" in face else {}),
            **{name: face[name] for name in ("normal_force", "friction_force") if name in face},
            "contact_area": face["contact_area"],
            **(along_axes("centre_of_pressure", face["centre_of_pressure"]) if "centre_of_pressure" in face else {}),
            "greatest_slip": face["greatest_slip"],
            "greatest_pressure": face["greatest_pressure"],
            **{name: numbers["nodes"][name] for name in ("open", "stick", "slip")},
            **{name: value for part in parts for name, value in part.items()},
            **({} if solution.heat is None else _heat_columns(solution.heat.entry())),
            **{f"energy_{name}": value for name, value in asdict(state.energy).items()},
            "energy_imbalance": state.energy.imbalance,
            **({} if state.friction_error is None else {"friction_error": state.friction_error}),
            "path_following": solution.result.newton_steps,
            "residual": solution.result.residual,
            "certified": solution.certificate.passed,
            "valid": solution.valid,
        }


def friction_change(coarse: NodalAnswer, fine: NodalAnswer) -> float:
    """By how much friction differs between two answers at one time, over the sum of the sizes of friction forces at
    contact points: of each face the resultants, and the resultant moments about its middle over the distance of its
    points from there; collective."""
    over, change, whole = Reductions(fine.comm), 0.0, 0.0
    for part in range(len(fine.faces)):
        middle: FloatArray = np.zeros(3)
        radius = 0.0
        resultants = list[FloatArray]()
        for answer in (fine, coarse):
            here = answer.part == part
            x, friction = answer.x[here], (answer.friction_traction * answer.area[:, None])[here]
            if not resultants:
                count = max(over.sum(float(len(x))), 1.0)
                middle = over.total(x.sum(axis=0)) / count
                radius = math.sqrt(over.sum(np.sum((x - middle) ** 2, axis=1)) / count) or 1.0
                whole += over.sum(np.linalg.norm(friction, axis=1))
            moment = np.cross(x - middle, friction).sum(axis=0) / radius
            resultants.append(over.total(np.concatenate([friction.sum(axis=0), moment])))
        change += float(np.linalg.norm(resultants[0] - resultants[1]))
    return change / whole if whole > 0.0 else 0.0
