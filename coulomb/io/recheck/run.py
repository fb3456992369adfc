"""Recheck of one run or load step: certificate, and comparison of all files with recomputed data and the case."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...contact_fields import ANSWER, COMPLIANCES, names
from ...fem.bodies import TEMPERATURE
from ...model.certificate import Certificate
from ...solvers.successive_tresca import SuccessiveTresca
from ..answer import totals_in
from ..field_files import data_of
from ..result_grids import BETWEEN, OURS, middle
from ..run_directory import CASE, CONTACT, FIELDS, SOLUTION, SUMMARY
from ..run_files import WrittenFace, WrittenRun, read_run
from .case_reference import CaseForces, CaseReference, CaseTies
from .comparison import Comparison, Rounding, unjudged
from .contact_nodes import ContactNodes, Start, from_start, spins_of
from .face_geometry import contact_nodes
from .judged_pairs import judged_pairs
from .overlaps import WrittenSurface
from .recomputation import Recomputation, Variant, compare_materials, located_probes, written_fields

SLIP_BOUND_LIMIT: Final = 1e-6
"""Accepted relative difference between g of the last Tresca problem and the law at its forces, plus ten times the
natural residual; for other solvers g is that of the law."""

_SEEDS = (1, 2, 3)
"""Seeds of the perturbations: the probability that all change a sum by less than a hundredth of their size is 1e-6."""

_MOST: Final = 12
"""Maximum number of faults listed; one wrong number causes many."""

_FORMS = (
    "taken as recorded, since the user's forms are not in the files: displacements off the contact faces and internal "
    "forces, and with them the equilibrium of the forms and the forces of their supports"
)

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
    nodes: ContactNodes
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
        named += [f"{name} of {CONTACT}" for name in dict.fromkeys(COMPLIANCES)]  # of the solver's matrix A
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
    def ending(self) -> str:
        """All lines."""
        return str(self)

    def __str__(self) -> str:
        before = f"recorded by the run: certificate {'had passed' if self.recorded else 'had FAILED'}"
        outside = [f"outside small-strain theory: {text}" for text in self.outside]
        return "\n".join([str(self.certificate), *outside, before, *verdict(self.faults), *self.trusted])


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
    """Check the files of a single run, or of a load step, by the case if there is one.

    The mesh of another run, `like`, is reused if it is identical.  Without the start of a load step the slip origin is
    taken as written.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    run = read_run(folder, like)
    found = Comparison(run.evaluation)
    number, time = step_of(run) if "step" in run.summary else (0, 0.0)
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
            part = case.compare_bodies(run, time, found)
    count = len(run.face_names) if case is None else len(case.contacts)
    faces = _facets_of_faces(run, part, count)
    alone = start is None and "step" in run.summary
    slip_rate = None if alone else np.zeros(len(run.node)) if start is None else start.slip_rate(run)
    tied = case is not None and part is not None and case.tied
    nodes, others = contact_nodes(run, case, time, slip_rate, faces, found, tied)
    spins = spins_of(run, case, time, start.time if start else None)
    nodes, unknown = from_start(run, nodes, spins, case, time, start, found)
    strain = run.summary.get("small_strain") or {}
    data = Recomputation(
        run,
        nodes,
        None if case is None else case.foundations(time),
        spins,
        None if case is None or part is None else CaseForces(case, time, run),
        located_probes(run, case, faces),
        faces,
        WrittenSurface(run, None if part is None else case, time, faces, nodes),
        bool(strain.get("accepted")) if case is None else case.accepts(run.summary),
        CaseTies(case, time, run) if case is not None and tied else None,
        judged_pairs(run, nodes, case, faces),
        others,
    )
    roundings = (None, *(Rounding((seed, abs(number)), run.evaluation) for seed in _SEEDS))
    variants = tuple(data.variant(rounding) for rounding in roundings)
    if case is not None:
        found.tree(f"{SUMMARY}.small_strain", strain, {"accepted": data.accepted}, source=CASE)
    written = nodes.only(nodes.written)
    _compare(run, written, variants, found)
    if data.supported is None:  # the parts of the sums of loads and of reactions are unknown
        sums, *rounded = (variant.sums for variant in variants)
        said = {
            name: {k: np.sum([one[k] for one in run.summary[name]] or [np.zeros(3)], axis=0).tolist() for k in of}
            for name, of in sums.items()
        }
        found.tree(f"{SUMMARY}: sum", said, sums, rounded, ANSWER)
    if case is not None and part is not None and case.settings.heat:
        if alone:
            trusted.append("taken as recorded, without the step before: the heat of friction")
        else:
            compare_heat(case, run, time, None if start is None else time - start.time, found)
    _compare_error_bars(run, found)
    trusted += [*unknown, *([] if run.body.elastic else [_FORMS])]
    recorded = bool(run.summary["certificate"]["passed"])
    return Findings(variants[0].certificate, found, tuple(trusted), recorded, run, written, variants)


def _compare_error_bars(run: WrittenRun, found: Comparison) -> None:
    """Compare the values that have error bars with the totals of the summary, and the bars with the sums of their
    parts, which are those of the run."""
    bars = (run.summary.get("error") or {}).get("bars", ())
    if not bars:
        return
    said = {bar["quantity"]: np.atleast_1d(bar["value"]).tolist() for bar in bars}
    totals = {name: value.tolist() for name, value, _ in totals_in(run.summary) if name in said}
    found.tree(f"{SUMMARY}: error", {name: said[name] for name in totals}, totals, source=ANSWER)
    whole, parts = dict[str, Any](), dict[str, Any]()
    for bar in bars:
        if "parts" in bar:  # runs of earlier versions have none
            whole[bar["quantity"]] = np.atleast_1d(bar["error"]).tolist()
            parts[bar["quantity"]] = np.sum([np.atleast_1d(part) for part in bar["parts"].values()], axis=0).tolist()
    found.tree(f"{SUMMARY}: error bar", whole, parts, source="its parts")


def _facets_of_faces(
    run: WrittenRun, part: npt.NDArray[np.int64] | None, count: int
) -> list[tuple[WrittenFace, npt.NDArray[np.int32]]]:
    """Of every contact face its grid, and its facets there: by the case, the number of the face of every facet `part`;
    without one by the contact nodes."""
    if run.faces[0].name:  # every face has a grid of its own
        return [(run.faces[number], run.faces[number].number) for number in range(count)]
    part = _facet_parts(run, count) if part is None else part
    return [(run.faces[0], run.faces[0].number[part == number]) for number in range(count)]


def _facet_parts(run: WrittenRun, count: int) -> npt.NDArray[np.int64]:
    """The face of every facet of the only grid: that of its contact nodes; if they are on two, the one to which the
    facet is more parallel."""
    (face,) = run.faces
    said = np.round(run.on_face["face"]).astype(np.int64)
    best = np.full(len(face.facets), -np.inf)
    part: npt.NDArray[np.int64] = np.zeros(len(face.facets), dtype=np.int64)
    x = run.on_face["x"][face.facets]
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    for number in range(count if count > 1 else 0):
        here = (run.touching & (said == number))[face.facets]
        mean = np.sum(np.where(here[..., None], run.on_face["normal"][face.facets], 0.0), axis=1)
        parallel = np.abs(np.einsum("ki,ki->k", mean, across)) / np.maximum(np.sum(here, axis=1), 1)
        parallel[~np.any(here, axis=1)] = -1.0
        part, best = np.where(parallel > best, number, part), np.maximum(best, parallel)
    return part


def step_of(run: WrittenRun) -> tuple[int, float]:
    """Number and time of a load step; ValueError if its summary has none."""
    try:
        record = run.summary["step"]
        number, time = record["number"], record["time"]
        if isinstance(number, int) and isinstance(time, float | int) and math.isfinite(time):
            return number, float(time)
    except (KeyError, TypeError):
        pass
    raise ValueError(f"{run.files.summary}: step has no number and time")


def _compare(run: WrittenRun, nodes: ContactNodes, variants: tuple[Variant, ...], found: Comparison) -> None:
    """Compare all data that follow from displacement and contact forces, meshes and case with the files."""
    first, *others = variants
    x = run.on_face["x"]
    for name in (*names(between="least"), *names(between="most")):
        found.field(f"{CONTACT}: {name}", run.on_face[name], np.round(run.on_face[name]), x, "whole numbers")
    for name, expected in run.held.fields.items():
        written = run.on_body.get(name, np.zeros_like(expected))
        found.field(f"{SOLUTION}: {name}", written, expected, run.body.x, "the nearest projectors", floor=1e-9)
    for label, one in written_fields(run, nodes, first).items():
        expected = first.fields[label]
        if label == f"{CONTACT}: slip_bound" and SuccessiveTresca.name in str(run.summary.get("method")):
            limit = SLIP_BOUND_LIMIT + 10.0 * first.certificate["natural residual"].value
            off = float(np.linalg.norm(one.values - expected))
            if not off <= limit * float(np.linalg.norm(expected)):
                found.fault(f"{label}: differs from the law at the contact forces by {off:.3g} N")
            continue
        rounded = [] if one.exact else [other.fields[label] for other in others]
        found.field(label, one.values, expected, one.x, one.source, rounded, one.floor)
    between, *ends = run.between
    none = ~run.touching
    none[between] = False
    for name in names():
        values = run.on_face[name]
        if len(between):
            expected = BETWEEN.get(name, middle)(values[ends[0]], values[ends[1]])
            label = f"{CONTACT}: {name} between vertices"
            found.field(label, values[between], expected, x[between], "its two vertices")
        if name not in BETWEEN:
            floor = run.evaluation * float(np.max(np.abs(values)))
            zero = np.zeros_like(values[none])
            found.field(f"{CONTACT}: {name} of held nodes", values[none], zero, x[none], "their status", floor=floor)
    compare_materials(run, found)
    found.tree(SUMMARY, run.summary, first.numbers, [other.numbers for other in others], ANSWER)


_AGREEMENT: Final = 1e-7
"""Difference of temperatures from those of conduction with the contact forces and slip of the files, over the largest
change: contact and conduction were solved in turn until they agreed to less."""


def compare_heat(case: CaseReference, run: WrittenRun, time: float, duration: float | None, found: Comparison) -> None:
    """Compare the temperature and the heat flows with those that follow from pressure and friction in the files, of a
    load step of some duration in seconds; None without load steps."""
    if TEMPERATURE not in run.on_body or not isinstance(run.summary.get("heat"), dict):
        found.fault(f"{SOLUTION}: has no {TEMPERATURE}, or {SUMMARY} no heat, but the case has heat")
        return
    problem = case.problem.at(time)
    heat, surface = problem.body.heat, problem.surface
    assert heat is not None
    unfit = f"{run.folder}: has another mesh than the case"
    node = run.body.numbers_in([member.body for member in problem.elasticity.members], unfit)
    change, pressure, friction = np.zeros(len(node)), *np.zeros((2, len(surface.nodes)))
    change[node] = run.on_body[TEMPERATURE]
    for part in range(len(problem.contacts)):
        here, points = surface.part == part, run.faces[part].points if run.faces[0].name else slice(None)

        def at_points(values: FloatArray, points: slice = points, here: Any = here) -> FloatArray:
            everywhere = np.zeros(len(node))
            everywhere[node[run.node[points]]] = values[points]
            found_here: FloatArray = everywhere[surface.nodes[here]]
            return found_here

        pressure[here] = at_points(run.on_face["pressure"])
        if duration is not None:
            against = -np.einsum("qi,qi->q", run.on_face["friction_traction"], run.on_face["slip"])
            friction[here] = at_points(against * run.on_face["area"]) / duration
    expected = heat.solve(surface, time, pressure, friction, change)
    floor = _AGREEMENT * float(np.max(np.abs(change), initial=0.0))
    source = "conduction, contact forces and slip"
    found.field(f"{SOLUTION}: {TEMPERATURE}", change, expected, problem.elasticity.x, source, floor=floor)
    flows = heat.flows(surface, time, pressure, friction, change)
    if not flows.balanced:
        found.fault(f"{SUMMARY}.heat: {flows.imbalance:.3g} W of {flows.power_in:.6g} W are missing")
    entry, written = flows.entry(), run.summary["heat"]
    said = {name: written.get(name) for name in ("rounds", "agreement")}  # of the run
    around = [_moved(entry, flows.limit), _moved(entry, -flows.limit)]
    found.tree(f"{SUMMARY}.heat", written, {**entry, **said}, around, source)


def _moved(entry: Any, by: float) -> Any:
    """All numbers of an entry, moved by so much."""
    if isinstance(entry, dict):
        return {name: _moved(value, by) for name, value in entry.items()}
    if isinstance(entry, list):
        return [_moved(value, by) for value in entry]
    return entry + by if isinstance(entry, float) else entry
