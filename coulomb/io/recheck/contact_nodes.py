"""The nodes of the contact faces in the files as data of the check, and the beginning of a load step: displacement,
slip and foundations by the files of the step before and by the case, not by records of the step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...contact_fields import COMPLIANCES
from ...fem.geometry import Spin, inverse_frames, since_at, spin
from ...model.certificate import pair_actions
from ...model.nodal_answer import ACCUMULATED, Accumulated, NodalAnswer, carried, carrying
from ...solvers.laws import FrictionLaw
from ..field_files import OPPOSITE
from ..run_directory import CONTACT
from ..run_files import OF_LARGEST, WrittenOpposite, WrittenRun
from .case_reference import CaseReference
from .comparison import Comparison


@dataclass(frozen=True)
class ContactNodes:
    """Nodes of contact faces, m of them; a node on two faces may be here twice.

    Attributes:
        index: Their numbers among the q nodes of the written faces, shape (m,).
        weights: By which displacements, gaps and places of the q nodes are averaged, shape (m, q).
        opposite: In pairs, by which those of the k nodes of the bodies are averaged over the face opposite, shape
            (m, k); empty rows against foundations.
        mirrored: In pairs, projectors on the directions across planes of symmetry, shape (m, 3, 3); else 0.
        part: Which face they are on, shape (m,).
        written: Whether they are written as contact nodes of this face, shape (m,).
        frames: Rows n, t1, t2, as `ContactSurface.frames`, shape (m, 3, 3).
        gap: Before deformation in metres, shape (m,).
        given_gap: The part of it that is given beside the distance to the foundation, metres, shape (m,).
        chord: As `ContactSurface.chord`, shape (m,); 0 as long as it is unknown.
        area: In m^2, shape (m,).
        friction: Coefficient of friction, shape (m,).
        cohesion: In pascals, shape (m,).
        origin: Displacement from which slip is measured, shape (m, 3).
        moved: Displacement of the foundation in the load step, metres, shape (m, 3); 0 as long as it is unknown.
        earlier: Accumulated slip, friction work and largest pressure before, shape (m, 3).
    """

    index: npt.NDArray[np.int64]
    weights: scipy.sparse.csr_matrix
    opposite: scipy.sparse.csr_matrix
    mirrored: FloatArray
    part: npt.NDArray[np.int64]
    written: npt.NDArray[np.bool_]
    frames: FloatArray
    gap: FloatArray
    given_gap: FloatArray
    chord: FloatArray
    area: FloatArray
    friction: FloatArray
    cohesion: FloatArray
    origin: FloatArray
    moved: FloatArray
    earlier: FloatArray

    @staticmethod
    def joined(faces: Sequence[ContactNodes]) -> ContactNodes:
        """Those of several faces."""
        parts = {name: [vars(face)[name] for face in faces] for name in vars(faces[0])}
        rows = {name: scipy.sparse.vstack(parts.pop(name), format="csr") for name in ("weights", "opposite")}
        return ContactNodes(**rows, **{name: np.concatenate(values) for name, values in parts.items()})

    def only(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> ContactNodes:
        """A subset of the nodes."""
        return ContactNodes(**{name: values[which] for name, values in vars(self).items()})

    @property
    def averaged(self) -> bool:
        """Whether they stand for averages over the facets around them."""
        return bool(self.weights.nnz != len(self.index))

    @property
    def paired(self) -> npt.NDArray[np.bool_]:
        """Which of them are in pairs of faces, shape (m,)."""
        return np.asarray(np.diff(self.opposite.indptr) > 0)

    def displacement(self, run: WrittenRun, u: FloatArray) -> FloatArray:
        """Their displacements of u (k, 3); in pairs against the face opposite; shape (m, 3)."""
        displacement: FloatArray = self.weights @ u[run.node] - self.opposite @ u
        displacement -= np.einsum("mij,mj->mi", self.mirrored, displacement)
        return displacement

    def place(self, x: FloatArray) -> FloatArray:
        """Where their forces act, of coordinates x (q, 3) of the nodes of the written faces, shape (m, 3)."""
        mean = self.weights @ x
        place: FloatArray = mean + np.einsum("mij,mj->mi", self.mirrored, x[self.index] - mean)
        return place

    def nodal_forces(self, run: WrittenRun, forces: FloatArray) -> FloatArray:
        """Forces at the nodes of all bodies in newtons, shape (k, 3), of forces at those of the written faces, shape
        (q, 3): those of contact points act by the weights, in pairs the opposite ones on the face opposite."""
        mine, nodal = self.only(self.written), forces
        if self.averaged:
            nodal = forces.copy()
            nodal[mine.index] = 0.0
            nodal = nodal + mine.weights.T @ forces[mine.index]
        at_nodes = np.zeros((len(run.body.x), 3))
        np.add.at(at_nodes, run.node, nodal)
        on_bodies: FloatArray = at_nodes - mine.opposite.T @ forces[mine.index]
        return on_bodies

    def actions(self, run: WrittenRun, forces: FloatArray) -> FloatArray | None:
        """What acts on both sides of every pair, with the forces opposite as written (`Evidence.actions`), of forces at
        the nodes of the written faces in newtons, shape (q, 3)."""
        x, found = run.body.x - run.body.x.mean(axis=0), []
        for other in run.opposite:
            mine = self.only(self.written & (self.part == other.contact))
            on_points, (slave, master) = forces[mine.index], np.zeros((2, *x.shape))
            np.add.at(slave, run.node, mine.weights.T @ on_points)
            np.add.at(master, other.face.node, other.fields["contact_force"])
            at, there = mine.weights @ run.on_face["x"], mine.opposite @ run.body.x
            found.append(pair_actions(x, slave, master, at, there, on_points))
        return np.array(found) if found else None

    def answer(
        self, run: WrittenRun, u: FloatArray, on_body: FloatArray, x: FloatArray, spins: tuple[Spin | None, ...]
    ) -> NodalAnswer:
        """The answer at the nodes, with displacements u (k, 3) of the nodes of the bodies, and contact forces on the
        body at the nodes x of the written faces, shapes (q, 3)."""
        against: list[str | None] = [None] * len(run.face_names)
        for one in run.opposite:
            against[one.contact] = one.against
        return NodalAnswer(
            comm=MPI.COMM_SELF,
            law=FrictionLaw(self.cohesion * self.area, self.friction),
            faces=tuple(run.face_names),
            part=self.part,
            x=self.place(x),
            frames=self.frames,
            gap=self.gap,
            given_gap=self.given_gap,
            chord=self.chord,
            area=self.area,
            slip_origin=np.einsum("kij,kj->ki", self.frames, self.origin),
            displacement=np.einsum("kij,kj->ki", self.frames, self.displacement(run, u)),
            force=-np.einsum("kij,kj->ki", inverse_frames(self.frames), on_body[self.index]),
            slip_bound=run.on_face["slip_bound"][self.index],
            compliance=np.column_stack([run.on_face[name][self.index] for name in COMPLIANCES]),
            spins=spins,
            earlier=Accumulated(*self.earlier.T),
            against=tuple(against),
            opposite_x=self.opposite @ run.body.x if run.opposite else None,
            several=len(run.body.parts) > 1,
        )


def opposite_fields(
    run: WrittenRun, nodes: ContactNodes, answer: NodalAnswer, other: WrittenOpposite
) -> dict[str, FloatArray]:
    """The fields of a face opposite, carried over from the written contact nodes with the answer there."""
    here = nodes.part == other.contact
    rows = nodes.opposite[here]
    weights = carrying(rows, nodes.area[here])
    fields = {name: values[here] for name, values in answer.fields().items()}
    at_nodes = carried(fields, lambda values: np.asarray(weights.T @ values))
    at_nodes[OPPOSITE] = np.full(len(at_nodes["status"]), float(other.contact))
    at_nodes["contact_force"] = -(rows.T @ fields["contact_force"])
    body, local = other.face.part.body, other.face.node - other.face.part.nodes.start
    area, outward = (values[local] for values in body.positive_weights(other.face.number))
    length = np.linalg.norm(outward, axis=1)[:, None]
    found = {name: values[other.face.node] for name, values in at_nodes.items()}
    return found | {"normal": outward / np.where(length > 0.0, length, 1.0), "area": area}


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
    count = len(run.face_names)
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
