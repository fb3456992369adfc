"""Data that follow from displacement and contact forces in the files of a run: fields, numbers, certificate,
strains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ...contact_fields import CONTACT_FIELDS
from ...fem import compat
from ...fem.bodies import EXPANSION, ISOTROPIC, ORTHOTROPIC, ORTHOTROPIC_EXPANSION, TEMPERATURE, TIE_STRESSES, range_of
from ...fem.contact import Overlap, face_samples
from ...fem.geometry import RigidFoundation, Spin
from ...fem.meshes import SEPARATOR
from ...linalg.reductions import Reductions
from ...model.certificate import Certificate, Evidence, judge, rounding_forces
from ...model.certificate_scales import at_all_points
from ...model.held_nodes import OtherNodes
from ...model.load_step import Forces
from ...model.nodal_answer import NodalAnswer
from ...model.pair_checks import PairFindings
from ...model.probes import LocatedProbes, Part, Probe
from ...model.resultants import resultant_of_ground
from ...model.small_strain import MEASURES, SmallStrain, small_strain
from ..field_files import OPPOSITE
from ..result_grids import ON_CELLS, ROUNDING, TIE_FORCE
from ..run_bodies import WrittenBody, midpoints
from ..run_directory import CONTACT, OLD, SOLUTION
from ..run_files import WrittenFace, WrittenRun
from ..summary import derived
from .case_reference import CaseForces, CaseReference, CaseTies, Perturbed
from .comparison import RELATIVE, Comparison, Rounding
from .contact_nodes import ContactNodes, opposite_fields
from .overlaps import WrittenSurface

THERMAL = {EXPANSION, ORTHOTROPIC_EXPANSION}
"""Constants of cells that have a thermal strain."""

_DIRECTION: Final = 1e-13
"""Accepted difference of the components of normals and tangents, and of gaps over the largest coordinate."""


@dataclass(frozen=True)
class Variant:
    """Data recomputed from displacement and contact forces, as written or perturbed.

    Attributes:
        at: Displacement and forces at the nodes of the body.
        forces: Contact forces on the body at the contact points among the nodes of the written face, shape (q, 3).
        fields: By file and name the fields: of the contact points and of the faces opposite, and the stresses.
        numbers: Entries of summary.json.
        certificate: Certificate with all nodes of the contact face.
        outside: Violations of the theory of small strains, unless they were accepted.
        sums: Force and moment of all loads together, and of all supports and springs.
    """

    at: Forces
    forces: FloatArray
    fields: dict[str, FloatArray]
    numbers: dict[str, Any]
    certificate: Certificate
    outside: tuple[str, ...]
    sums: dict[str, dict[str, list[float]]]


@dataclass(frozen=True)
class Recomputation:
    """What the data of a run are recomputed from.

    Attributes:
        run: The files.
        nodes: The contact nodes.
        foundations: Those of the contact faces; None if they are unknown.
        spins: Rotation of the foundation of each contact face; None where it does not rotate.
        supported: Loads and supports; None if they are unknown.
        probes: The probes, found in the mesh of the files.
        faces: Each contact face with its facets.
        surface: That of the bodies.
        accepted: Whether violations of the theory of small strains are accepted.
        ties: Those of the case; None if there are none or they are unknown.
        pairs: What is off in the pairs of faces.
        others: Nodes of the contact faces that are no contact points.
    """

    run: WrittenRun
    nodes: ContactNodes
    foundations: list[RigidFoundation | None] | None
    spins: tuple[Spin | None, ...]
    supported: CaseForces | None
    probes: LocatedProbes
    faces: Sequence[tuple[WrittenFace, npt.NDArray[np.int32]]]
    surface: WrittenSurface
    accepted: bool
    ties: CaseTies | None = None
    pairs: tuple[PairFindings, ...] = ()
    others: Sequence[OtherNodes] = ()

    def variant(self, rounding: Rounding | None) -> Variant:
        """Data recomputed from the written numbers, or from perturbed ones."""

        def taken(values: FloatArray, scale: float = 0.0) -> FloatArray:
            return values if rounding is None else rounding.of(values, scale)

        run, body, held = self.run, self.run.body, self.run.held
        gap = taken(self.nodes.gap, float(np.max(np.abs(body.x))))
        nodes = replace(self.nodes, gap=gap, origin=taken(self.nodes.origin))
        load, spring, u = run.on_body["load"], taken(run.on_body["spring_force"]), taken(run.on_body["displacement"])
        x, on_face = taken(run.on_face["x"]), taken(np.where(run.touching[:, None], run.on_face["contact_force"], 0.0))
        on_body, internal, rounded = nodes.nodal_forces(run, on_face), body.internal_force(u), rounding_forces(body, u)
        for part in body.parts:
            if part.elastic is None:
                internal[part.nodes] = taken(internal[part.nodes])
                rounded[part.nodes] = run.on_body[ROUNDING][part.nodes]
        imbalance = internal - spring - load - on_body
        of_ties = taken(run.on_body[TIE_FORCE]) if TIE_FORCE in run.on_body else np.zeros_like(u)
        tied = None if self.ties is None else self.ties.found(u, imbalance)
        of_ties = of_ties if tied is None else tied.forces
        only_written = nodes.only(nodes.written)
        judged, written = (some.answer(run, u, on_face, x, self.spins) for some in (nodes, only_written))
        heated = {TEMPERATURE: taken(run.on_body[TEMPERATURE])} if TEMPERATURE in run.on_body else {}
        beside = np.concatenate([np.zeros(0, dtype=np.int32), *(one.nodes for one in self.others)])
        certificate = judge(
            Evidence(
                comm=MPI.COMM_SELF,
                x=body.x,
                displacement=u,
                internal=internal,
                load=load,
                spring=spring,
                held=held,
                prescribed=run.on_body["prescribed"],
                on_body=on_body + of_ties,
                force=judged.force,
                relative_displacement=judged.relative_displacement,
                gap=judged.gap,
                bound=judged.bound,
                rounding=rounded,
                compliance=at_all_points(judged.compliance, written.compliance, Reductions(MPI.COMM_SELF)),
                blocked=_blocked(run, heated),
                ground=run.ground,
                averaged=nodes.averaged,
                component=body.component,
                bodies=tuple(body.slices.values()),
                actions=nodes.actions(run, on_face),
                jump=None if tied is None else tied.jump,
                pairs=self.pairs,
                held_gap=np.concatenate([np.zeros(0), *(one.remaining(u) for one in self.others)]),
                held_owner=body.component[beside],
                held_part=np.full(len(beside), -1),
                owner=body.component[run.node[nodes.index]],
                place=judged.x,
                part=nodes.part,
                faces=tuple(run.face_names),
                opposite=_opposite(run),
            )
        )
        body_x, reactions = taken(body.x), held.held_part(imbalance - of_ties)
        found = {f"{CONTACT}: {name}": values for name, values in written.fields().items()}
        found[f"{CONTACT}: slip_bound"] = written.bound
        if tied is not None:
            found |= {f"{SOLUTION}: {TIE_FORCE}": of_ties}
            found |= {f"{SOLUTION}: {name}": values for name, values in tied.stresses.items()}
        for part in body.parts:
            found |= _stresses(part, u, heated)
        for one in run.opposite:
            carried = opposite_fields(run, only_written, written, one)
            found |= {f"{CONTACT}: {name} of {one.face.name}": values for name, values in carried.items()}
        shares, motions, bolts = ((), (), ()) if tied is None else (tied.shares, tied.motions, tied.bolts)
        acting = None
        if self.supported is not None:
            acting = self.supported.force_balance(u, reactions, on_body, taken, of_ties, shares, motions, bolts)
        probed = _probe_entries(self.probes, u, written, run.node[only_written.index], taken)
        numbers = derived(written, certificate, u, spring, held, acting)
        inside = self.surface.overlap(u, internal)
        if self.foundations is None:
            recorded, overlap = _recorded_strain(run), 0.0 if inside is None else inside.depth / inside.approach
            strain: dict[str, Any] = {"gradient": body.largest_gradient(u)}
            if overlap >= (1.0 - RELATIVE) * recorded.overlap:  # else it may be that of a foundation, which is unknown
                strain["overlap"] = overlap
            outside = replace(recorded, **strain).violations
        else:
            blocked = max(_blocked(run, heated))
            samples = [face_samples(face.part.body, facets, u[face.part.nodes]) for face, facets in self.faces]
            measured = small_strain(written, self.foundations, body, u, samples, blocked, inside)
            outside = measured.violations
            strain = measured.entry()
        if acting is None:
            numbers |= _contact_on_bodies(run, on_body, body_x)
        for check in certificate.checks:
            del numbers["certificate"][check.name.replace(" ", "_")]["meaning"]
        numbers |= {name: range_of(change, MPI.COMM_SELF) for name, change in heated.items()}
        valid = certificate.passed and (self.accepted or not outside)
        return Variant(
            at=Forces(u, load, internal - spring, on_body + of_ties, of_ties),
            forces=on_face,
            fields=found,
            numbers={**numbers, "probes": probed, "small_strain": strain, "valid": valid},
            certificate=certificate,
            outside=() if self.accepted else outside,
            sums={"loads": _sums(taken(load), body_x, None, u), "reactions": _sums(reactions, body_x, run.ground, u)},
        )


class Compared(NamedTuple):
    """A field in the files: its values, the points where it is, what it follows from, the difference that is accepted
    besides, and whether rounding is not."""

    values: FloatArray
    x: FloatArray
    source: str
    floor: float = 0.0
    exact: bool = False


def written_fields(run: WrittenRun, nodes: ContactNodes, variant: Variant) -> dict[str, Compared]:
    """The fields in the files that follow from the answer, the meshes and the case, named as in a variant."""
    at, x, size = nodes.index, run.on_face["x"][nodes.index], float(np.max(np.abs(run.body.x)))
    found = {}
    for field in CONTACT_FIELDS:
        if field.follows and field.name != "slip_origin":  # which is compared where it is known
            directed = field.vector and not field.unit
            floor = _DIRECTION * (directed + size * (field.unit == "m")) if field.given else 0.0
            exact = field.given or field.name == "status"
            found[f"{CONTACT}: {field.name}"] = Compared(run.on_face[field.name][at], x, field.follows, floor, exact)
    for name in (TIE_FORCE, *TIE_STRESSES):
        if f"{SOLUTION}: {name}" in variant.fields:
            floor = 1e-12 * float(np.max(np.abs(run.on_body[name])))
            found[f"{SOLUTION}: {name}"] = Compared(run.on_body[name], run.body.x, "displacement and forces", floor)
    for part in run.body.parts:
        labels = {in_body(name, part): name for name in ON_CELLS if in_body(name, part) in variant.fields}
        largest = max((float(np.max(np.abs(variant.fields[one]), initial=0.0)) for one in labels), default=0.0)
        for label, name in labels.items():
            floor, middle = run.evaluation * largest, midpoints(part.body.domain)
            found[label] = Compared(part.on_cells[name], middle, "displacement", floor)
    for other in run.opposite:
        for name, values in other.fields.items():
            label = f"{CONTACT}: {name} of {other.face.name}"
            if name != "x":
                largest = float(np.max(np.abs(variant.fields[label]), initial=0.0))
                floor = _DIRECTION if name == "normal" else 1e-12 * largest
                exact = name in ("status", OPPOSITE)
                source = "the contact points opposite"
                found[label] = Compared(values, other.fields["x"], source, floor, exact)
    return found


def in_body(name: str, body: WrittenBody) -> str:
    """A field of solution.xdmf in messages, with the name of its body if there are several."""
    return f"{SOLUTION}: {name}{f' of {body.name}' if body.name else ''}"


def _stresses(part: WrittenBody, u: FloatArray, heated: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """The stresses of the cells of a body in pascals; none of a body of the user's forms."""
    if part.elastic is None:
        return {}
    warm = THERMAL & part.on_cells.keys() and TEMPERATURE in heated
    found = part.elastic.stresses(
        part.elastic.function(u[part.nodes]), heated[TEMPERATURE][part.nodes] if warm else None
    )
    return {in_body(one.name, part): one.x.array[compat.cell_dofs(one.function_space)[:, 0]] for one in found}


def _sums(forces: FloatArray, x: FloatArray, ground: FloatArray | None, u: FloatArray) -> dict[str, list[float]]:
    """Force and moment of nodal forces (k, 3) at nodes x, and of springs and elastic foundations."""
    force, moment = forces.sum(axis=0), np.cross(x, forces).sum(axis=0)
    if ground is not None:
        terms = resultant_of_ground(ground, u, x, Reductions(MPI.COMM_SELF))
        force, moment = force + terms.force, moment + terms.moment
    return {"force": force.tolist(), "moment": moment.tolist()}


def _contact_on_bodies(run: WrittenRun, on_body: FloatArray, x: FloatArray) -> dict[str, Any]:
    """Force and moment of the contact on each of several bodies, as in summary.json, with the balance there."""
    found, recorded = [], run.summary.get("bodies")
    for number, (name, nodes) in enumerate(run.body.slices.items()):
        sums = _sums(on_body[nodes], x[nodes], None, on_body)
        entry = {"name": name, "contact_force": sums["force"], "contact_moment": sums["moment"]}
        found.append({**entry, "balance": recorded[number]["balance"] if recorded else math.nan})
    return {"bodies": found} if found else {}


def _blocked(run: WrittenRun, heated: Mapping[str, FloatArray]) -> tuple[float, ...]:
    """`Deformable.blocked_displacements`; where bodies are of the user's forms as recorded."""
    if not run.body.elastic:
        return tuple(map(float, run.summary["blocked_displacement"]))
    load, found = run.held.free_part(run.on_body["load"]), list[float]()
    for part in run.body.parts:
        own = [0.0]
        if part.elastic is not None:
            own.append(part.elastic.nodal_displacement(load[part.nodes]))
            if THERMAL & part.on_cells.keys():
                own += [part.elastic.thermal_displacement(change[part.nodes]) for change in heated.values()]
        found.append(max(own))
    return tuple(found)


def _opposite(run: WrittenRun) -> tuple[tuple[int, ...], ...]:
    """`Evidence.opposite`."""
    found: list[tuple[int, ...]] = [()] * len(run.face_names)
    for one in run.opposite:
        found[one.contact] = tuple(map(int, np.unique(run.body.component[one.face.node])))
    return tuple(found)


def _recorded_strain(run: WrittenRun) -> SmallStrain:
    """The measures of small_strain in summary.json; null becomes nan."""
    given = run.summary.get("small_strain")
    try:
        values = {name: given[name] for name in MEASURES}  # type: ignore[index]
        inside = given["inside"]  # type: ignore[index]
        numbers = {name: math.nan if value is None else float(value) for name, value in values.items()}
        return SmallStrain(**numbers, inside=None if inside is None else Overlap(**inside))
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{run.files.summary}: has no 'small_strain' with all its measures") from None


def located_probes(
    run: WrittenRun, case: CaseReference | None, faces: Sequence[tuple[WrittenFace, npt.NDArray[np.int32]]]
) -> LocatedProbes:
    """The probes of the case, or without one of summary.json, found in the mesh of the files; `faces` are of every
    contact face its grid and its facets."""
    try:
        given = [] if case is not None else run.summary.get("probes", [])
        probes = [Probe(one["name"], one["point"], one.get("body")) for one in given]
    except (KeyError, TypeError):
        raise ValueError(f"{run.files.summary}: probes: {OLD}") from None
    probes += [] if case is None else [table.probe() for table in case.settings.probe]
    parts = [Part(part.name, part.body, part.nodes) for part in run.body.parts]
    return LocatedProbes(probes, parts, [(face.part.name, facets) for face, facets in faces])


def _probe_entries(
    probes: LocatedProbes, u: FloatArray, answer: NodalAnswer, nodes: npt.NDArray[np.int64], taken: Perturbed
) -> list[dict[str, Any]]:
    """The probes in summary.json.  The weights by which nodal values are interpolated are rounded: where a value nearly
    vanishes, those around decide how accurate it is."""
    moved, slid, pressed = (float(np.max(np.abs(v), initial=0.0)) for v in (u, answer.slip, answer.pressure))
    return [
        replace(
            value,
            found_at=taken(value.found_at),
            displacement=taken(value.displacement, moved),
            slip=None if value.slip is None else taken(value.slip, slid),
            pressure=None if value.pressure is None else float(taken(np.array(value.pressure), pressed)),
        ).entry()
        for value in probes.values(u, answer, nodes)
    ]


def compare_materials(run: WrittenRun, found: Comparison) -> None:
    """Check that the materials in summary.json are those of the cells; bodies of the user's forms have none."""
    given = run.summary.get("material")
    listed: list[Any] = given if isinstance(given, list) else []
    for body in run.body.parts:
        named = [(one, one.get("cells") if isinstance(one, Mapping) else None) for one in listed]
        mine = [one for one, cells in named if isinstance(cells, str) and cells.partition(SEPARATOR)[0] == body.name]
        if body.elastic is not None and not _are_of_cells(mine if body.name else listed, body):
            found.fault(f"summary.json.material: is not that of the cells in {SOLUTION}")
            return


def _are_of_cells(listed: list[Any], body: WrittenBody) -> bool:
    """Whether the constants of the cells of a body are those listed."""
    names = [*(ORTHOTROPIC[:3] if ORTHOTROPIC[0] in body.on_cells else ISOTROPIC)]
    names += [name for name in (EXPANSION, ORTHOTROPIC_EXPANSION) if name in body.on_cells]
    cells = np.column_stack([body.on_cells[name] for name in names])
    try:
        rows = np.array([_constants(entry, names) for entry in listed]).reshape(-1, cells.shape[1])
    except (KeyError, TypeError, ValueError):
        return False
    kinds = np.unique(np.round(cells / np.maximum(np.abs(cells).max(axis=0), 1e-300), 12), axis=0, return_index=True)[1]

    def among(one: FloatArray, others: FloatArray) -> bool:
        return bool(np.any(np.all(np.abs(others - one) <= 1e-9 * np.abs(one), axis=1)))

    return bool(len(rows)) and all(among(cells[k], rows) for k in kinds) and all(among(row, cells) for row in rows)


def _constants(entry: Mapping[str, Any], names: Sequence[str]) -> list[float]:
    """The constants of a material as in a row of the cells."""
    young, poisson, last = entry["young"], entry["poisson"], [entry["expansion"]] if THERMAL & {*names} else []
    if names[0] != ORTHOTROPIC[0]:
        return [float(value) for value in (young, poisson, *last)]
    shear = entry["shear"] if "shear" in entry else young / (2.0 * (1.0 + poisson))
    return [value for part in (young, poisson, shear, *last) for value in np.broadcast_to(part, 3).astype(float)]
