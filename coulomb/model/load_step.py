"""A load step: its initial and final state, energies, and its figures as one row."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..contact_fields import named_faces
from ..fem.bodies import Deformable
from ..fem.contact import ContactSurface
from ..linalg.reductions import Reductions
from ..units import amount
from .nodal_answer import Accumulated, NodalAnswer
from .solution import Solution


def along_axes(name: str, vector: Sequence[float] | None) -> dict[str, float]:
    """The columns name_x, name_y, name_z of a vector; nan without one."""
    return {f"{name}_{axis}": value for axis, value in zip("xyz", vector or [math.nan] * 3, strict=True)}


def _columns(
    name: str, entry: Mapping[str, Any], vectors: Sequence[str] = (), numbers: Sequence[str] = ()
) -> dict[str, Any]:
    """The columns of some entries of a dictionary in summary.json, after a name."""
    found: dict[str, Any] = {}
    for what in vectors:
        found |= along_axes(f"{name}_{what}", entry[what])
    return found | {f"{name}_{what}": entry[what] for what in numbers}


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


_IMBALANCE: Final = 0.25  # of the energy dissipated by friction
_OF_ALL: Final = 1e-3  # of all energy


@dataclass(frozen=True)
class Energy:
    """Energies in joules since the start of the history.

    Attributes:
        loads: Work of tractions and body force, and of changes of the stiffness of a `Body` with time.
        prescribed: Work of the reactions at prescribed displacements, and of bolts that are tightened.
        foundation: Work that the moving foundation does on the body.
        elastic: Elastic energy of the body and its springs.
        dissipated: Energy dissipated by friction.
    """

    loads: float = 0.0
    prescribed: float = 0.0
    foundation: float = 0.0
    elastic: float = 0.0
    dissipated: float = 0.0

    @property
    def imbalance(self) -> float:
        """Work minus elastic energy and dissipation: the error of the time discretisation."""
        return self.loads + self.prescribed + self.foundation - self.elastic - self.dissipated

    def warning(self, rounding: float = 0.0, overlap: float = 0.0) -> str:
        """A warning if the imbalance exceeds `rounding` in joules, a quarter of the dissipation, and a thousandth of
        the largest energy, else empty; it names the cause if bodies overlap by `overlap` metres before deformation."""
        work = self.loads + self.prescribed + self.foundation
        turned_over = max(abs(work), self.elastic, self.dissipated)
        small = max(_IMBALANCE * abs(self.dissipated), _OF_ALL * turned_over, rounding)
        if abs(self.imbalance) <= small:  # False for nan
            return ""
        friction = amount(self.dissipated, "J", 2)
        words = f"the energies do not add up, by {amount(self.imbalance, 'J', 2)} against {friction} of friction"
        if overlap > 0.0:
            return (
                f"{words}: the bodies overlap by {amount(overlap)} before deformation, and the first load step presses "
                "them apart at once; an overlap that is meant goes into gap, with gap_amplitude; one of the meshes of "
                "curved faces is removed by finer or second-order meshes, smooth, surface or adjust"
            )
        return f"{words}: use more load steps, and ramp loads, prescribed displacements and motions from 0 (amplitude)"

    def after(
        self,
        then: Forces,
        now: Forces,
        foundation: float,
        dissipated: float,
        over: Reductions,
        coefficients: float = 0.0,
    ) -> Energy:
        """The energy at the end of a step, from the forces at its beginning and end; and the work of the foundation,
        the energy dissipated, and the work of changes of the stiffness (`coefficients`) in it, joules; collective."""
        change = now.displacement - then.displacement
        return Energy(
            loads=self.loads + 0.5 * over.dot(now.load + then.load, change) + coefficients,
            prescribed=self.prescribed + 0.5 * over.dot(then.reaction + now.reaction, change),
            foundation=self.foundation + foundation,
            elastic=0.5 * over.dot(now.displacement, now.kept),
            dissipated=self.dissipated + dissipated,
        )


@dataclass(frozen=True)
class Forces:
    """Displacement and forces at this rank's k nodes at one time, shapes (k, 3); metres and newtons.

    Attributes:
        displacement: Displacement.
        load: Load of tractions and body force.
        kept: Internal forces of the stress, and minus the forces of the springs.
        on_body: Forces of contact and ties on the body.
        reaction: Forces of supports, and of ties and rigid faces: those where the motion is prescribed do work.  Those
            of a support that ends become 0 linearly in the load step that follows.
    """

    displacement: FloatArray
    load: FloatArray
    kept: FloatArray
    on_body: FloatArray
    reaction: FloatArray

    @classmethod
    def at(
        cls,
        body: Deformable,
        surface: ContactSurface,
        u: FloatArray,
        kept: FloatArray,
        load: FloatArray,
        on_body: FloatArray,
        time: float,
    ) -> Forces:
        """Those at a time, with the forces of contact `on_body` at the points of a surface (m, 3); collective."""
        of_contact = surface.at_nodes(surface.force_components(on_body))
        of_ties = body.constraints.forces(kept - load - of_contact, time)
        outer = of_contact + of_ties
        return cls(u, load, kept, outer, body.held_at(time).held_part(kept - load - outer) + of_ties)


def coefficients_work(then: Forces, now: Forces, over: Reductions) -> float:
    """Work in joules of a change of the stiffness from K0 to K1 in a step: (u0 . K1 u1 - u1 . K0 u0) / 2;
    collective."""
    return 0.5 * (over.dot(then.displacement, now.kept) - over.dot(now.displacement, then.kept))


@dataclass(frozen=True)
class Moment:
    """The end of a load step.

    Attributes:
        number: Number of the step, from 1; 0 before the first.
        time: Its time.
        energy: Energies since the start of the history.
    """

    number: int
    time: float
    energy: Energy


@dataclass(frozen=True)
class Earlier:
    """Time and `State.force_on_body` of the step before the last one, from which forces are extrapolated."""

    time: float
    force_on_body: FloatArray


@dataclass(frozen=True)
class State(Moment):
    """The state after a step, from which the next begins; this rank's part.  Number, time and energy as in `Moment`.

    Attributes:
        displacement: Metres, shape (k, 3).
        force_on_body: Contact forces on the body at the contact points, space vectors in newtons, shape (m, 3).
        slip_rate: Slip of the step over its duration at the contact points, metres per second, shape (m,).
        accumulated: Slip, friction work and largest pressure at the contact points since the start of the history.
        pending: Ends of the remaining steps, the next one last.
        forces: Displacement and forces at its end; None at the start and where a history was continued from files.
        before: The end of the step before; None at the start.
        temperature_change: Of a problem with heat, from the reference, kelvin, shape (k,); None at the start.
        poses: Of foundations under load (`ContactState.poses`); None at the start, and without any.
        turns: In large motions the rotation vectors of rigid faces, radians, shape (faces, 3); None at the start, and
            without any.
        friction_error: Estimated error of friction by the size of the steps, over the sum of the sizes of the friction
            forces at contact points: the sum of what halving each step has changed (`friction_change`), less the part
            of each step of what has come to touch in it.  None if it was not asked for.
    """

    displacement: FloatArray
    force_on_body: FloatArray
    slip_rate: FloatArray
    accumulated: Accumulated
    pending: tuple[float, ...]
    forces: Forces | None = None
    before: Earlier | None = None
    temperature_change: FloatArray | None = None
    poses: FloatArray | None = None
    turns: FloatArray | None = None
    friction_error: float | None = None

    @classmethod
    def beginning(cls, time: float, nodes: int, points: int, pending: tuple[float, ...] = ()) -> State:
        """At rest, of so many nodes and contact points."""
        still, none, worn = np.zeros((nodes, 3)), np.zeros((points, 3)), Accumulated.none(points)
        return cls(0, time, Energy(), still, none, np.zeros(points), worn, pending)

    def after(self, solution: Solution) -> State:
        """The state at the end of the next step, with updated energies; collective."""
        problem, surface, e = solution.problem, solution.problem.surface, solution.evidence
        body, u = problem.elasticity, self.displacement
        at = problem.body.places(surface)

        if self.forces is not None:
            then = self.forces
        else:
            before = body.at_time(self.time)
            there = problem.body.surface_of(before, self.time, self.poses)
            of_contact = self.force_on_body[problem.body.places(there)]
            loading = before.at(self.time)
            if self.temperature_change is not None:
                loading = before.heated(loading, self.temperature_change)
            kept = before.internal_force(u) - before.spring_force(u)
            then = Forces.at(before, there, u, kept, loading.load, of_contact, self.time)
            body.at_time(problem.time)  # the user's coefficients are those of the present again
        kept = e.internal - body.spring_force(solution.displacement)
        now = Forces.at(body, surface, solution.displacement, kept, e.load, solution.force_on_body, problem.time)
        # 0 where K stays: then u0 . K u1 = u1 . K u0
        stiffened = (
            coefficients_work(then, now, Reductions(problem.comm, body.copies)) if body.forms() is not None else 0.0
        )
        return self.ended(solution, then, now, at, stiffened)

    def ended(
        self,
        solution: Solution,
        then: Forces,
        now: Forces,
        at: npt.NDArray[np.int64],
        stiffened: float = 0.0,
        elastic: float | None = None,
    ) -> State:
        """The state at the end of the next step, from the forces at its beginning and end; collective.

        Args:
            solution: The answer, with its contact points `at` these numbers of those of states.
            then, now: The forces.
            stiffened: Work of changes of the stiffness, joules.
            elastic: Elastic energy at the end, where it is not half the work of the forces.
        """
        problem, answer, on_body = solution.problem, solution.at_nodes, solution.force_on_body
        over, heat = Reductions(problem.comm, problem.elasticity.copies), problem.state.heat

        def put(values: FloatArray, into: FloatArray) -> FloatArray:
            whole = into.copy()
            whole[at] = values
            return whole

        moved = problem.body.foundation_displacement(problem.state, self)
        widened = answer.given_gap - problem.body.given_gap(problem.surface, self.time)
        moved = _while_touching(moved, widened, answer)
        foundation = 0.5 * over.dot(self.force_on_body[at] + on_body, moved)
        dissipated = answer.dissipated_energy
        energy = self.energy.after(then, now, foundation, dissipated, over, stiffened)
        rate = np.linalg.norm(answer.slip, axis=1) / (problem.time - self.time)
        worn = map(put, vars(answer.accumulated).values(), vars(self.accumulated).values())
        return State(
            number=self.number + 1,
            time=problem.time,
            energy=energy if elastic is None else replace(energy, elastic=elastic),
            displacement=now.displacement,
            force_on_body=put(on_body, np.zeros_like(self.force_on_body)),
            slip_rate=put(rate, np.zeros_like(self.slip_rate)),
            accumulated=Accumulated(*worn),
            pending=self.pending[:-1],
            forces=now,
            before=Earlier(self.time, self.force_on_body),
            temperature_change=None if heat is None else heat.change,
            poses=problem.state.poses,
            turns=problem.elasticity.constraints.turns,
            friction_error=None
            if self.friction_error is None
            else (1.0 - self.new_part(at, answer)) * self.friction_error,
        )

    def new_part(self, at: npt.NDArray[np.int64], answer: NodalAnswer) -> float:
        """The part of the normal forces of an answer at the end of the next step, with its contact points `at` these
        numbers of those of states, that is at points which are open at its start; collective."""
        over, normal, new = Reductions(answer.comm), answer.force[:, 0], ~np.any(self.force_on_body[at], axis=1)
        whole = over.sum(normal)
        return over.sum(normal[new]) / whole if whole > 0.0 else 0.0


def _while_touching(moved: FloatArray, widened: FloatArray, answer: NodalAnswer) -> FloatArray:
    """Of the displacement of what the body touches (m, 3) the part along which contact forces do work.

    Where a given gap becomes wider than the body follows, as of a pair that is taken out, it works along the way of the
    body alone, while the force falls to 0; where one from afar is closed, after it touches.

    Args:
        moved: The displacement, metres, shape (m, 3).
        widened: The part of it along n that changes of given gaps are, shape (m,).
        answer: At the end.
    """
    normal = answer.frames[:, 0]
    after = answer.gap - answer.displacement[:, 0]
    before = after + answer.displacement[:, 0] - answer.slip_origin[:, 0] - widened
    away = (after > 0.0) & (widened >= after)
    towards = (before > 0.0) & (widened <= -before)
    way = np.where((away | towards)[:, None], moved + (before - after)[:, None] * normal, moved)
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
        result, certificate = self.solution.result, self.solution.certificate
        probes, heat = [value.entry() for value in self.solution.probes], self.solution.heat
        of_heat = {} if heat is None else {"heat": heat.entry()}
        return row(
            {**self.solution.at_nodes.numbers(), **self.solution.force_balance.entries(), "probes": probes, **of_heat},
            self.state,
            steps=result.newton_steps,
            residual=result.residual,
            certified=certificate.passed,
            valid=self.solution.valid,
            friction_error=self.state.friction_error,
        )


def row(
    numbers: Mapping[str, Any],
    at: Moment,
    steps: int,
    residual: float,
    certified: bool,
    valid: bool,
    friction_error: float | None = None,
) -> dict[str, Any]:
    """The figures of a step by name, from those of its contact nodes (`NodalAnswer.numbers`), reactions, bodies and
    probes; path-following `steps`, the residual of its problem, and `State.friction_error`."""
    face, faces = numbers["totals"], named_faces(numbers["faces"])
    several = faces if len(faces) > 1 or "against" in faces[0][1] else []
    parts = [face_columns(*one) for one in several] + [_rotation_columns(part) for part in numbers["faces"]]
    parts += [columns(of) for entry, columns in _COLUMNS.items() for of in numbers.get(entry, ())]
    return {
        "step": at.number,
        "time": at.time,
        **(along_axes("force", face["force"]) if "force" in face else {}),
        **(along_axes("moment", face["moment"]) if "moment" in face else {}),
        **{name: face[name] for name in ("normal_force", "friction_force") if name in face},
        "contact_area": face["contact_area"],
        **(along_axes("centre_of_pressure", face["centre_of_pressure"]) if "centre_of_pressure" in face else {}),
        "greatest_slip": face["greatest_slip"],
        "greatest_pressure": face["greatest_pressure"],
        **{name: numbers["nodes"][name] for name in ("open", "stick", "slip")},
        **{name: value for part in parts for name, value in part.items()},
        **(_heat_columns(numbers["heat"]) if "heat" in numbers else {}),
        **{f"energy_{name}": value for name, value in asdict(at.energy).items()},
        "energy_imbalance": at.energy.imbalance,
        **({} if friction_error is None else {"friction_error": friction_error}),
        "path_following": steps,
        "residual": residual,
        "certified": certified,
        "valid": valid,
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
