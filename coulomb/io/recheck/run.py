"""Recheck of one run or load step: certificate, and comparison of all files with recomputed data and the case."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...fem.geometry import Spin, since_at
from ...model.accumulated import ACCUMULATED
from ...model.certificate import Certificate
from ...solvers.successive_tresca import SuccessiveTresca
from ..field_files import data_of
from ..field_names import OURS
from ..matched_points import midpoints
from ..nodal_grids import BETWEEN
from ..run_directory import CASE, FIELDS, SOLUTION, SUMMARY
from ..run_files import WrittenRun, read_run
from .case_reference import CaseReference
from .comparison import OF_LARGEST, Comparison, Rounding, unjudged
from .face_nodes import FaceNodes, face_names
from .nodes_to_check import face_nodes, facet_parts, facets_of
from .recomputed import Variant, recomputed
from .rotation import AS_WRITTEN, case_spins, foundation_displacement, written_spins
from .start import Start, written_accumulated
from .supported_body import SupportedBody
from .written_materials import compare_materials, in_body
from .written_opposite import compare_opposite
from .written_probes import WrittenProbes

SLIP_BOUND_LIMIT = 1e-6
"""Accepted relative difference between g of the last Tresca problem and the law at its forces, plus ten times the
natural residual; for other solvers g is that of the law."""

_SEEDS = (1, 2, 3)
"""Seeds of the perturbations: the probability that all change a sum by less than a hundredth of their size is 1e-6."""

_MOST = 12
"""Maximum number of faults listed; one wrong number causes many."""

_NO_CASE = "taken as written, without a case.json: slip_origin, friction"
_NO_STEP_BEFORE = "taken as written, without the load step before: slip_origin, friction, " + ", ".join(ACCUMULATED)

_FORMS = (
    "taken as recorded, since the user's forms are not in the files: displacements off the contact faces and internal "
    "forces, and with them the equilibrium of the forms and the forces of their supports"
)

_SOURCE = "displacement and contact forces"
_SOURCE_OF_TIME = "the load step, or 0 for a single run"

_READ = (SUMMARY, *(name for of in FIELDS for name in (of, data_of(of).name)))
"""The files of a run that are compared."""


@dataclass(frozen=True)
class Findings:
    """Result of the check of a run or a load step.

    Attributes:
        certificate: Certificate of displacement and contact forces.
        found: Data that do not follow from them or from the case, and what has been compared.
        taken: Input data that could not be compared, a line each.
        recorded: Whether the run itself recorded that its certificate had passed.
        run: The files.
        nodes: The nodes that are written as contact nodes.
        variants: Data recomputed from the numbers as written, and perturbed.
    """

    certificate: Certificate
    found: Comparison
    taken: tuple[str, ...]
    recorded: bool
    run: WrittenRun
    nodes: FaceNodes
    variants: tuple[Variant, ...]

    @property
    def faults(self) -> tuple[str, ...]:
        """Data that do not follow from displacement and contact forces or from the case, a line each."""
        return tuple(self.found.faults)

    @property
    def trusted(self) -> tuple[str, ...]:
        """Data that could not be compared, a line each."""
        return *self.taken, as_recorded(self.unjudged)

    @property
    def unjudged(self) -> list[str]:
        """Names of the data in the files for which there is nothing to compare with."""
        run, times = self.run, (f"{name}: time" for name in FIELDS)
        named = unjudged(SUMMARY, run.summary, self.found.judged)
        named += [f"time of {name}" for name, time in zip(FIELDS, times, strict=True) if time not in self.found.judged]
        named += [f"{name} of {SOLUTION}" for name in run.described[0].fields if name not in OURS]
        step = " of the step" if run.files.step_number is not None else ""
        return named + [f"{name}{step}" for name in unread(run.folder, _READ)]

    @property
    def passed(self) -> bool:
        """Whether the certificate passes, the answer is inside the theory, and all data agree."""
        return self.certificate.passed and not self.outside and not self.faults

    @property
    def outside(self) -> tuple[str, ...]:
        """Violations of the theory of small strains, unless they were accepted."""
        return self.variants[0].outside

    @property
    def verdict(self) -> list[str]:
        """Lines about fields and numbers."""
        return verdict(self.faults)

    @property
    def ending(self) -> str:
        """All lines."""
        return str(self)

    def __str__(self) -> str:
        before = f"recorded by the run: certificate {'had passed' if self.recorded else 'had FAILED'}"
        outside = [f"outside small-strain theory: {text}" for text in self.outside]
        return "\n".join([str(self.certificate), *outside, before, *self.verdict, *self.trusted])


def verdict(faults: tuple[str, ...]) -> list[str]:
    """Lines about the comparison of fields and numbers."""
    if not faults:
        return ["files agree: every field and number that can be computed again"]
    more = [f"  and {len(faults) - _MOST} more"] if len(faults) > _MOST else []
    return ["files FAILED:", *(f"  {fault}" for fault in faults[:_MOST]), *more]


def as_recorded(names: Sequence[str]) -> str:
    """The line about data for which there is nothing to compare with."""
    return f"as recorded by the run, nothing to compare with: {', '.join(names)}"


def unread(folder: Path, read: Sequence[str]) -> list[str]:
    """Names of the files beside those that are `read`, and of what a case has that does not change the answer."""
    found = sorted(path.name for path in folder.iterdir() if path.is_file() and path.name not in (*read, CASE))
    method = ("output", "solver", "halvings") if (folder / CASE).exists() else ()
    return found + [f"{name} of {CASE}" for name in method]


def check_run(
    folder: Path, case: CaseReference | None, like: WrittenRun | None = None, start: Start | None = None
) -> Findings:
    """Check the files of a single run, or of a load step.

    Args:
        folder: Directory with solution.xdmf, contact.xdmf, their .h5 files, and summary.json.
        case: The case, if there is one.
        like: Another run, whose mesh is reused if it is identical.
        start: Start of the load step; without it the slip origin is taken as written.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    run = read_run(folder, like)
    found = Comparison(run.evaluation)
    step, time = step_of(run) if "step" in run.summary else (0, 0.0)
    trusted, part = [], None
    if case is not None or "step" in run.summary:
        for name, described in zip(FIELDS, run.described, strict=True):
            found.tree(f"{name}: time", described.time, time, source=_SOURCE_OF_TIME)
    if case is None:
        trusted.append("taken as written, without a case.json: materials, friction, normals, gaps, loads, supports")
    else:
        if case.settings.history is not None and "step" not in run.summary:
            found.fault("case.json: has a [history], but these are the results of a single run")
        case.orient(run)
        case.compare_numbers(run, found)
        case.compare_record(run, found)
        if case.absent_gaps:
            trusted.append(f"taken as written, since {', '.join(case.absent_gaps)} is not there: given_gap")
        if case.absent:
            absent = ", ".join(case.absent)
            trusted.append(f"taken as written, since {absent} is not there: mesh, material, loads, supports, springs")
        else:
            part = case.compare_body(run, time, found)
    alone = start is None and "step" in run.summary
    slip_rate = None if alone else np.zeros(len(run.node)) if start is None else start.slip_rate(run)
    count = len(face_names(run)) if case is None else len(case.contacts)
    part_of = facet_parts(run, count) if part is None else part
    nodes = face_nodes(run, case, time, slip_rate, part_of, found)
    spins = written_spins(run) if case is None else case_spins(run, case, time, start.time if start else None)
    nodes, say = _from_origin(run, nodes, spins, case, time, start, found)
    nodes = _from_accumulated(run, nodes, spins, case, start)
    trusted += say
    foundations = None if case is None else case.foundations(time)
    roundings = (None, *(Rounding((seed, abs(step)), run.evaluation) for seed in _SEEDS))
    supported = None if case is None or part is None else SupportedBody(case.bodies, time, run)
    grids = [facets_of(run, part_of, number) for number in range(count)]
    probes = WrittenProbes(run, case, grids)
    strain = run.summary.get("small_strain") or {}
    accepted = bool(strain.get("accepted")) if case is None else case.accepts(run.summary)
    variants = tuple(
        recomputed(run, nodes, foundations, spins, rounding, supported, probes, grids, accepted)
        for rounding in roundings
    )
    if case is not None:
        found.tree(f"{SUMMARY}.small_strain", strain, {"accepted": accepted}, source=CASE)
    _compare(run, nodes.only(nodes.written), variants, found)
    if supported is None:
        _compare_sums(run, variants, found)
    certificate = variants[0].certificate
    if not run.body.elastic:
        trusted.append(_FORMS)
    recorded = bool(run.summary["certificate"]["passed"])
    written = nodes.only(nodes.written)
    return Findings(certificate, found, tuple(trusted), recorded, run, written, variants)


def step_of(run: WrittenRun) -> tuple[int, float]:
    """Number and time of a load step.

    Raises:
        ValueError: If its summary has none.
    """
    try:
        record = run.summary["step"]
        number, time = record["number"], record["time"]
        if isinstance(number, int) and isinstance(time, float | int) and math.isfinite(time):
            return number, float(time)
    except (KeyError, TypeError):
        pass
    raise ValueError(f"{run.files.summary}: step has no number and time")


def _from_origin(
    run: WrittenRun,
    nodes: FaceNodes,
    spins: tuple[Spin | None, ...],
    case: CaseReference | None,
    time: float,
    start: Start | None,
    found: Comparison,
) -> tuple[FaceNodes, list[str]]:
    """The nodes with their slip origin and the displacement of the foundation, and what is unknown."""
    here, x = nodes.written, nodes.place(run.on_face["x"])
    if start is None:
        if "step" in run.summary or case is None:
            return nodes, [_NO_STEP_BEFORE if "step" in run.summary else _NO_CASE]
        origin, source = np.zeros_like(nodes.origin), "a run without steps before it"
        found.field("contact.xdmf: slip_origin", nodes.origin[here], origin[here], x[here], source)
        return replace(nodes, origin=origin), []
    displacement = start.at(run)
    before = nodes.displacement(run, displacement)
    say = []
    if case is not None:
        moved = since_at(case.rigid_motions(time), case.rigid_motions(start.time), nodes.part, x)
    else:
        moved, say = foundation_displacement(nodes, spins, x, before, time - start.time), [AS_WRITTEN]
    origin, source = before + moved, "the step before, and the foundation's displacement"
    floor = run.evaluation * float(np.max(np.abs(before), initial=0.0))
    floor = max(floor, OF_LARGEST * float(np.max(np.abs(displacement), initial=0.0)))  # a difference of both faces
    found.field("contact.xdmf: slip_origin", nodes.origin[here], origin[here], x[here], source, floor=floor)
    if start.run is not None or case is not None:  # the foundation's surface moves with a changing gap
        closed = nodes.given_gap - start.given_gap(run, nodes, case)
        moved = moved + closed[:, None] * nodes.frames[:, 0]
    return replace(nodes, origin=origin, moved=moved), say


def _from_accumulated(
    run: WrittenRun,
    nodes: FaceNodes,
    spins: tuple[Spin | None, ...],
    case: CaseReference | None,
    start: Start | None,
) -> FaceNodes:
    """The nodes with what has accumulated in the load steps before; without these as follows from what is written."""
    if start is not None:
        return replace(nodes, earlier=start.accumulated(run)[nodes.index])
    if "step" not in run.summary and not (case is None and np.any(nodes.origin)):
        return nodes  # a single run; from Python it may be a step of a history
    displacement, on_body = run.on_body["displacement"], run.on_face["contact_force"]
    own = nodes.answer(run, displacement, on_body, run.on_face["x"], spins).accumulated
    earlier = written_accumulated(run)[nodes.index]
    earlier[:, 0] -= own.slip
    earlier[:, 1] -= own.friction_work
    return replace(nodes, earlier=earlier)


def _compare(run: WrittenRun, nodes: FaceNodes, variants: tuple[Variant, ...], found: Comparison) -> None:
    """Compare all data that follow from displacement and contact forces with the files."""
    first, *others = variants
    at, x = nodes.index, run.on_face["x"]
    found.field("contact.xdmf: status", run.on_face["status"], np.round(run.on_face["status"]), x, "whole numbers")
    for name, expected in run.held.fields.items():
        written = run.on_body.get(name, np.zeros_like(expected))
        found.field(f"solution.xdmf: {name}", written, expected, run.body.x, "the nearest projectors", floor=1e-9)
    for name, expected in first.fields.items():
        if name == "slip_bound" and SuccessiveTresca.name in str(run.summary.get("method")):
            limit = SLIP_BOUND_LIMIT + 10.0 * first.certificate["natural residual"].value
            off = float(np.linalg.norm(run.on_face["slip_bound"][at] - expected))
            if not off <= limit * float(np.linalg.norm(expected)):
                found.fault(f"contact.xdmf: slip_bound: differs from the law at the contact forces by {off:.3g} N")
            continue
        rounded = [other.fields[name] for other in others]
        if name == "status":  # exact: rounding errors are not accepted
            rounded = []
        found.field(f"contact.xdmf: {name}", run.on_face[name][at], expected, x[at], _SOURCE, rounded)
    middle, *ends = run.between
    for name, values in run.on_face.items():
        if name != "x" and len(middle):
            one, other = values[ends[0]], values[ends[1]]
            expected = BETWEEN[name](one, other) if name in BETWEEN else 0.5 * (one + other)
            source = "its two vertices"
            found.field(f"contact.xdmf: {name} between vertices", values[middle], expected, x[middle], source)
    none = ~run.touching
    none[middle] = False
    for name, values in run.on_face.items():
        if name not in ("x", "status", "face"):
            floor = run.evaluation * float(np.max(np.abs(values)))
            zero = np.zeros_like(values[none])
            found.field(f"contact.xdmf: {name} of held nodes", values[none], zero, x[none], "their status", floor=floor)
    for number, body in enumerate(run.body.parts):
        largest = max((float(np.max(np.abs(s), initial=0.0)) for s in first.stress[number].values()), default=0.0)
        for name, expected in first.stress[number].items():
            rounded, places = [other.stress[number][name] for other in others], midpoints(body.body.domain)
            written, floor = body.on_cells[name], run.evaluation * largest
            found.field(in_body(name, body), written, expected, places, "displacement", rounded, floor)
    compare_materials(run, found)
    for number, opposite in enumerate(run.opposite):
        compare_opposite(opposite, [variant.opposite[number] for variant in variants], found)

    numbers = [other.numbers for other in others]
    found.tree(SUMMARY, run.summary, first.numbers, numbers, _SOURCE)


def _compare_sums(run: WrittenRun, variants: tuple[Variant, ...], found: Comparison) -> None:
    """Compare the sums of loads and of reactions in summary.json, of which without a case the parts are unknown."""
    written = {
        name: {
            what: np.sum([part[what] for part in run.summary[name]] or [np.zeros(3)], axis=0).tolist() for what in sums
        }
        for name, sums in variants[0].sums.items()
    }
    first, *others = (variant.sums for variant in variants)
    found.tree(f"{SUMMARY}: sum", written, first, others, _SOURCE)
