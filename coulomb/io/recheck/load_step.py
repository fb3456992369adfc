"""The beginning of a load step: the displacement, the slip and the foundations from which it is measured.

They are taken from the files of the step before and from the case, not from the records of the step itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import FloatArray
from ...fem.geometry import Spin, since_at, spin
from ...model.nodal_answer import ACCUMULATED
from ..run_directory import CONTACT
from ..run_files import OF_LARGEST, WrittenRun
from .case_reference import CaseReference
from .comparison import Comparison
from .contact_nodes import ContactNodes, face_names

Spins = tuple[Spin | None, ...]
"""Rotations of the foundations of the faces."""

_NO_CASE = "taken as written, without a case.json: slip_origin, friction"
_NO_STEP_BEFORE = "taken as written, without the load step before: slip_origin, friction, " + ", ".join(ACCUMULATED)
_NO_MOTION = (
    "taken as written, without a case.json: the foundation's displacement, the same at all nodes of a face but for its "
    "rotation, whose axis and angle are those of summary.json"
)


@dataclass(frozen=True)
class Start:
    """Start of a load step.

    Attributes:
        time: Its time.
        run: The step before; None before the first: a body without displacement.
        began: Time at which the step before began.
    """

    time: float
    run: WrittenRun | None
    began: float = 0.0

    def on_face(self, run: WrittenRun, values: FloatArray) -> FloatArray:
        """Values of the step before at the nodes of this step's contact faces, shape (q, ...); ValueError if it has
        another mesh."""
        assert self.run is not None
        here: FloatArray = values[run.on_faces_of(self.run)]
        return here

    def slip_rate(self, run: WrittenRun) -> FloatArray:
        """Slip of the step before over its duration at the nodes of this step's contact faces, m/s, shape (q,)."""
        if self.run is None:
            return np.zeros(len(run.node))
        rate = np.linalg.norm(self.run.on_face["slip"], axis=1) / max(self.time - self.began, 1e-300)
        return self.on_face(run, rate)

    def displacement(self, run: WrittenRun) -> FloatArray:
        """Of the nodes of this step's bodies, metres, shape (k, 3)."""
        if self.run is None:
            return np.zeros_like(run.body.x)
        values = self.run.on_body["displacement"]
        return values if run.body.has_meshes_of(self.run.body) else values[run.in_bodies_of(self.run)]

    def given_gap(self, run: WrittenRun, nodes: ContactNodes, case: CaseReference | None) -> FloatArray:
        """The gaps given with the contacts at the start, by the case or as the step before wrote them, at nodes of this
        step, metres, shape (m,)."""
        given: FloatArray = np.zeros(len(nodes.index))
        if self.run is not None:
            given = self.on_face(run, self.run.on_face["given_gap"])[nodes.index]
        x = run.on_face["x"]
        for part in range(len(case.contacts) if case is not None else 0):
            if case is not None and not case.lacks_gap(part):
                here, field = nodes.only(nodes.part == part), np.zeros(len(x))
                if np.any(here.paired):
                    given[nodes.part == part] = case.given_gap(part, self.time, here.weights @ x)
                    continue
                near = np.unique(here.weights.indices)
                field[near] = case.given_gap(part, self.time, x[near])
                given[nodes.part == part] = here.weights @ field
        return given


def spins_of(run: WrittenRun, case: CaseReference | None, time: float, started: float | None) -> Spins:
    """Rotations of the foundations in the step from `started`, None without one, to a time, by the case, which may be
    another one with fewer faces; without a case those in summary.json."""
    count = len(face_names(run))
    if case is None:
        faces = run.summary.get("faces")
        if not isinstance(faces, list) or len(faces) != count:
            return (None,) * count
        return tuple(_written(run, entry) if isinstance(entry, dict) and "torque" in entry else None for entry in faces)
    now = case.rigid_motions(time)
    if started is None:
        spins = [spin(motion, None, 1.0) for motion in now]
    else:
        pairs = zip(now, case.rigid_motions(started), strict=True)
        spins = [spin(motion, before, time - started) for motion, before in pairs]
    return (*spins, *[None] * (count - len(spins)))


def _written(run: WrittenRun, entry: dict[str, object]) -> Spin:
    try:
        axis = entry["axis"]
        point, direction = (np.array(axis[name], dtype=np.float64) for name in ("point", "direction"))  # type: ignore[index]
        angle, velocity = entry["angle"], entry["angular_velocity"]
        if point.shape != (3,) or direction.shape != (3,):
            raise ValueError
        return Spin(point, direction, float(angle), None if velocity is None else float(velocity))  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{run.files.summary}: a face with a torque has no axis, angle and angular_velocity") from None


def from_start(
    run: WrittenRun,
    nodes: ContactNodes,
    spins: Spins,
    case: CaseReference | None,
    time: float,
    start: Start | None,
    found: Comparison,
) -> tuple[ContactNodes, list[str]]:
    """The nodes with slip origin, displacement of the foundation and what has accumulated before, and what is unknown.

    Without a start the slip origin is that of a single run, or as written.
    """
    here, x, origin = nodes.written, nodes.place(run.on_face["x"]), nodes.origin
    worn = np.column_stack([run.on_face[name] for name in ACCUMULATED])[nodes.index]
    if start is None:
        if "step" not in run.summary and case is not None:
            still, source = np.zeros_like(origin), "a run without steps before it"
            found.field(f"{CONTACT}: slip_origin", origin[here], still[here], x[here], source)
            return replace(nodes, origin=still), []
        if "step" in run.summary or np.any(origin):  # from Python it may be a step of a history
            u, on_body = run.on_body["displacement"], run.on_face["contact_force"]
            own = nodes.answer(run, u, on_body, run.on_face["x"], spins).accumulated
            worn[:, :2] -= np.column_stack([own.slip, own.friction_work])
            nodes = replace(nodes, earlier=worn)
        return nodes, [_NO_STEP_BEFORE if "step" in run.summary else _NO_CASE]
    displacement = start.displacement(run)
    before = nodes.displacement(run, displacement)
    if case is not None:
        moved, say = since_at(case.rigid_motions(time), case.rigid_motions(start.time), nodes.part, x), []
    else:
        moved, say = _foundation_displacement(nodes, spins, x, before, time - start.time), [_NO_MOTION]
    source = "the step before, and the foundation's displacement"
    floor = run.evaluation * float(np.max(np.abs(before), initial=0.0))
    floor = max(floor, OF_LARGEST * float(np.max(np.abs(displacement), initial=0.0)))  # a difference of both faces
    found.field(f"{CONTACT}: slip_origin", origin[here], (before + moved)[here], x[here], source, floor=floor)
    nodes = replace(nodes, origin=before + moved)
    if start.run is not None or case is not None:  # the foundation's surface moves with a changing gap
        closed = nodes.given_gap - start.given_gap(run, nodes, case)
        moved = moved + closed[:, None] * nodes.frames[:, 0]
    if start.run is not None:
        earlier = np.column_stack([start.run.on_face[name] for name in ACCUMULATED])
        nodes = replace(nodes, earlier=start.on_face(run, earlier)[nodes.index])
    return replace(nodes, moved=moved), say


def _foundation_displacement(
    nodes: ContactNodes, spins: Spins, x: FloatArray, before: FloatArray, duration: float
) -> FloatArray:
    """Displacement of the foundations in a step at the nodes without a case, metres, shape (m, 3): recorded rotation,
    and mean translation by the slip origin as written; `before` is the nodes' displacement after the step before."""
    moved = np.zeros_like(x)
    for part, turning in enumerate(spins):
        on = nodes.part == part
        if turning is not None and turning.angular_velocity is not None:
            moved[on] = duration * turning.angular_velocity * np.cross(turning.axis, x[on] - turning.centre)
        known = on & nodes.written
        if np.any(known):
            moved[on] += np.mean((nodes.origin - before - moved)[known], axis=0)
    moved[nodes.paired] = 0.0  # what moves there is in the displacement
    return moved
