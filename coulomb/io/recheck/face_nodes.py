"""The nodes of a contact face in the files: those to check, with normal, gap, area and law.

All nodes of the written facets are checked, except those whose displacement along the normal is prescribed according to
solution.h5; the status in contact.h5 is not used.  On faces of 10-node tetrahedra these are the vertices, with averages
over the facets around them, whose weights are integrated anew on the written mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...fem.contact_frames import held_length, inverse_frames, supported_frames
from ...fem.contact_points import contact_points
from ...fem.rigid_motion import Spin
from ...model.accumulated import ACCUMULATED, Accumulated
from ...model.evidence import HELD_BEYOND
from ...model.nodal_answer import NodalAnswer
from ...solvers.laws import FrictionLaw
from ..run_directory import CONTACT
from ..run_files import WrittenRun
from .case_reference import CaseReference
from .comparison import Comparison

_LAW = ("friction", "cohesion")
"""Fields of contact.xdmf with the law of friction."""

_TANGENTS = ("tangent_1", "tangent_2")
"""Fields of contact.xdmf that are the rows t1 and t2."""

_GAPS = ("initial_gap", "given_gap")
"""Fields of contact.xdmf with the gap before deformation, and the part of it that the contact gives."""

_NEARLY_HELD = 0.9
"""Without a case, the normal of a held node is that of its facets, which is only near the foundation's."""


@dataclass(frozen=True)
class FaceNodes:
    """Nodes of contact faces, m of them; a node on two faces may be here twice.

    Attributes:
        index: Their numbers among the q nodes of the written face, shape (m,).
        weights: By which displacements, gaps and places of the q nodes are averaged, shape (m, q).
        part: Which face they are on, shape (m,).
        written: Whether they are written as contact nodes of this face, shape (m,).
        frames: Rows n, t1, t2, as `ContactSurface.frames`, shape (m, 3, 3).
        gap: Before deformation in metres, shape (m,).
        given_gap: The part of it that is given beside the distance to the foundation, metres, shape (m,).
        area: In m^2, shape (m,).
        friction: Coefficient of friction, shape (m,).
        cohesion: In pascals, shape (m,).
        origin: Displacement from which slip is measured, shape (m, 3).
        moved: Displacement of the foundation in the load step, metres, shape (m, 3); 0 as long as it is unknown.
        earlier: Accumulated slip, friction work and largest pressure before, shape (m, 3).
    """

    index: npt.NDArray[np.int64]
    weights: scipy.sparse.csr_matrix
    part: npt.NDArray[np.int64]
    written: npt.NDArray[np.bool_]
    frames: FloatArray
    gap: FloatArray
    given_gap: FloatArray
    area: FloatArray
    friction: FloatArray
    cohesion: FloatArray
    origin: FloatArray
    moved: FloatArray
    earlier: FloatArray

    def only(self, which: npt.NDArray[np.bool_]) -> FaceNodes:
        """A subset of the nodes."""
        return FaceNodes(**{name: values[which] for name, values in vars(self).items()})

    @property
    def averaged(self) -> bool:
        """Whether they stand for averages over the facets around them."""
        return bool(self.weights.nnz != len(self.index))

    def average(self, values: FloatArray) -> FloatArray:
        """Averages of values at the nodes of the written face (q,) or (q, 3), shape (m,) or (m, 3)."""
        averages: FloatArray = self.weights @ values
        return averages

    def nodal_forces(self, forces: FloatArray) -> FloatArray:
        """Forces at the nodes of the written face in newtons that act there by the weights, shapes (q, 3)."""
        if not self.averaged:
            return forces
        mine = self.only(self.written)
        others = forces.copy()
        others[mine.index] = 0.0
        nodal: FloatArray = others + mine.weights.T @ forces[mine.index]
        return nodal

    def answer(
        self,
        run: WrittenRun,
        displacement: FloatArray,
        on_body: FloatArray,
        x: FloatArray,
        spins: tuple[Spin | None, ...],
    ) -> NodalAnswer:
        """The answer at the nodes.

        Args:
            run: The files.
            displacement: Displacement of the nodes of the body in metres, shape (k, 3).
            on_body: Contact forces on the body at the nodes of the written face in newtons, shape (q, 3).
            x: Coordinates of these, shape (q, 3).
            spins: Rotations of the foundations of the faces.
        """
        frames = self.frames
        return NodalAnswer(
            comm=MPI.COMM_SELF,
            law=FrictionLaw(self.cohesion * self.area, self.friction),
            faces=tuple(face_names(run)),
            part=self.part,
            x=self.average(x),
            frames=frames,
            gap=self.gap,
            given_gap=self.given_gap,
            area=self.area,
            slip_origin=np.einsum("kij,kj->ki", frames, self.origin),
            displacement=np.einsum("kij,kj->ki", frames, self.average(displacement[run.node])),
            force=-np.einsum("kij,kj->ki", inverse_frames(frames), on_body[self.index]),
            slip_bound=run.on_face["slip_bound"][self.index],
            spins=spins,
            earlier=Accumulated(*self.earlier.T),
        )


def face_names(run: WrittenRun) -> list[str]:
    """Names of the contact faces in summary.json.

    Raises:
        ValueError: If it has none.
    """
    try:
        names = run.summary["totals"]["faces"]
        if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
            return list(names)
    except (KeyError, TypeError):
        pass
    raise ValueError(f"{run.files.summary}: totals.faces does not name the contact faces")


def face_nodes(
    run: WrittenRun,
    case: CaseReference | None,
    time: float,
    slip_rate: FloatArray | None,
    facet_part: npt.NDArray[np.int64] | None,
    found: Comparison,
) -> FaceNodes:
    """The nodes to check; their written data are compared with the case and the facets.

    Args:
        run: The files.
        case: The case, if there is one.
        time: The time of the run.
        slip_rate: In the load step before at the nodes of the face, m/s, shape (q,); None if it is unknown.
        facet_part: Number of the face of each written facet, if there is a case.
        found: Collects the differences.

    Raises:
        ValueError: If no node is left.
    """
    count = len(case.contacts) if case is not None else len(face_names(run))
    said = np.round(run.on_face["face"]).astype(np.int64)
    found.field("contact.xdmf: face", run.on_face["face"], said.astype(float), run.on_face["x"], "whole numbers")
    part = facet_parts(run, count) if facet_part is None else facet_part
    faces = [
        _face(run, case, time, slip_rate, number, part == number, said == number, found) for number in range(count)
    ]
    parts = {name: [vars(face)[name] for face in faces] for name in vars(faces[0])}
    weights = scipy.sparse.vstack(parts.pop("weights"), format="csr")
    judged = FaceNodes(weights=weights, **{name: np.concatenate(values) for name, values in parts.items()})
    stray = run.touching.copy()
    stray[judged.index[judged.written]] = False
    if np.any(stray):
        _report(found, run, stray, "are written as contact nodes, but are prescribed along their normal, or on no face")
    if not np.any(judged.written):
        raise ValueError(f"{run.folder}: contact.h5 has no contact node to check")
    return judged


def _face(
    run: WrittenRun,
    case: CaseReference | None,
    time: float,
    slip_rate: FloatArray | None,
    number: int,
    facets: npt.NDArray[np.bool_],
    said: npt.NDArray[np.bool_],
    found: Comparison,
) -> FaceNodes:
    """The nodes of one face."""
    around, outward = (values[run.node] for values in run.body.positive_weights(run.number[facets]))
    on = around > 0.0
    points = contact_points(run.body, run.number[facets])
    in_file = np.zeros(len(run.body.x), dtype=np.int64)
    in_file[run.node] = np.arange(len(run.node))
    index, weights, area = in_file[points.nodes], points.weights[:, run.node], points.area
    x, H = weights @ run.on_face["x"], run.held.projector_at(points.nodes)
    written = (run.touching & said)[index]
    data = {name: run.on_face[name][index] for name in ("normal", *_TANGENTS, *_GAPS, *_LAW, "slip_origin")}
    unit = outward[index] / np.linalg.norm(outward[index], axis=1)[:, None]
    if case is None:
        n = np.where(written[:, None], data["normal"], unit)
        gap, given = (data[name] for name in _GAPS)
        law = FrictionLaw(data["cohesion"] * area, data["friction"])
        beyond = np.where(written, HELD_BEYOND, _NEARLY_HELD)
    else:
        place = run.on_face["x"][on]
        distance = case.distances(number, time, place, around[on], outward[on])
        n = unit if case.contacts[number].normals == "body" else case.normals(number, time, x)
        on_nodes = np.zeros((len(on), 2))
        on_nodes[on, 0] = distance
        if not case.lacks_gap(number):
            on_nodes[on, 1] = case.given_gap(number, time, place)
        distance, given = (weights @ on_nodes).T
        given = data["given_gap"] if case.lacks_gap(number) else given
        gap = distance + given
        law = case.law(number, x, area, time, np.zeros(len(x)) if slip_rate is None else slip_rate[index])
        if slip_rate is None:
            law = replace(law, friction=data["friction"])
        beyond = np.full(len(x), HELD_BEYOND)
    free: npt.NDArray[np.bool_] = held_length(n, points.held(run.held)) <= beyond
    frames = supported_frames(n, H)
    if case is None:
        frames[written] = np.stack([data[name][written] for name in ("normal", *_TANGENTS)], axis=1)
    else:
        frames[free] = case.frames(number, n[free], H[free], x[free])

    here = written & free
    size, file = float(np.max(np.abs(run.points))), CONTACT
    found.field(f"{file}: area", run.on_face["area"][index][here], area[here], x[here], "the facets")
    if case is None:
        length, none = np.linalg.norm(frames, axis=2)[here], np.zeros(int(np.sum(here)))
        found.field(f"{file}: length of normal", length[:, 0], none + 1.0, x[here], "its direction")
        longer = np.max(length[:, 1:], axis=1)
        found.field(f"{file}: length of the longer tangent", longer, none + 1.0, x[here], "its direction")
        for name, i, j in (("tangent_1", 0, 1), ("tangent_2", 0, 2), ("tangent_2", 1, 2)):
            along = np.einsum("kj,kj->k", frames[here, i], frames[here, j])
            found.field(f"{file}: {name} along the other axes", along, none, x[here], "right angles", floor=1e-14)
        away = here & ~(np.einsum("ki,ki->k", data["normal"], unit) > 0.0)
        if np.any(away):
            _report(found, run, _everywhere(run, index[away]), "have a normal that points into the body")
    else:
        found.field(f"{file}: normal", data["normal"][here], n[here], x[here], "the foundation of the case")
        for name, expected, source in zip(_GAPS, (gap, given), ("the foundation of the case", "the case"), strict=True):
            found.field(f"{file}: {name}", data[name][here], expected[here], x[here], source, floor=1e-13 * size)
        for k, name in enumerate(_TANGENTS, start=1):
            found.field(f"{file}: {name}", data[name][here], frames[here, k], x[here], "normal and case", floor=1e-13)
        for name, expected in zip(_LAW, (law.friction, law.cohesion / area), strict=True):
            found.field(f"{file}: {name}", data[name][here], expected[here], x[here], "the case")
    left_out = free & ~written
    if np.any(left_out):
        _report(found, run, _everywhere(run, index[left_out]), "are left out, but are not prescribed in solution.h5")
    part = np.full(len(index), number)
    cohesion = law.cohesion / area
    origin, still, earlier = data["slip_origin"], np.zeros_like(x), np.zeros((len(index), len(ACCUMULATED)))
    return FaceNodes(
        index, weights, part, written, frames, gap, given, area, law.friction, cohesion, origin, still, earlier
    ).only(free)


def facet_parts(run: WrittenRun, count: int) -> npt.NDArray[np.int64]:
    """The face of every written facet: that of its contact nodes; if they are on two, the one to which the facet is
    more parallel."""
    said = np.round(run.on_face["face"]).astype(np.int64)
    best = np.full(len(run.facets), -np.inf)
    part: npt.NDArray[np.int64] = np.zeros(len(run.facets), dtype=np.int64)
    x = run.on_face["x"][run.facets]
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    for number in range(count if count > 1 else 0):
        here = (run.touching & (said == number))[run.facets]
        mean = np.sum(np.where(here[..., None], run.on_face["normal"][run.facets], 0.0), axis=1)
        parallel = np.abs(np.einsum("ki,ki->k", mean, across)) / np.maximum(np.sum(here, axis=1), 1)
        parallel[~np.any(here, axis=1)] = -1.0
        part, best = np.where(parallel > best, number, part), np.maximum(best, parallel)
    return part


def _everywhere(run: WrittenRun, index: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    which = np.zeros(len(run.node), dtype=bool)
    which[index] = True
    return which


def _report(found: Comparison, run: WrittenRun, which: npt.NDArray[np.bool_], fault: str) -> None:
    place = ", ".join(f"{c:.6g}" for c in run.on_face["x"][np.argmax(which)])
    found.fault(f"contact.xdmf: status: {np.count_nonzero(which)} nodes {fault} (first seen at x = {place})")
