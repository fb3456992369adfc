"""Recheck of a load history: each step relative to the written step before, and the files of the whole history.

Slip is measured from the displacement after the step before plus the foundation's displacement: both are taken from
that step and from the case, not from the records of the step itself.  Energies are summed again; history.csv,
summary.json and the time series must follow from the steps.

Of large motions the case is posed anew, and the answer of every step, displacement and contact forces as written, is
judged in it: residual, gaps, normals, slip from the state of the step before, certificate, energies and all fields are
computed again from the case and these two, by the room that has computed them, but without its solver.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ...case.case import Case
from ...contact_fields import COMPLIANCES
from ...kinematics.large_motions import LargeMotions, LargeSolution
from ...linalg.reductions import Reductions
from ...model.load_step import Energy, Forces, LoadStep, Moment, State, coefficients_work, row
from ..case_record import written_case
from ..field_files import NODE, data_of, grids_of, read_fields
from ..grid_file import GridFields
from ..history_files import HistoryFiles, at_points, points_in_files, read_step, whole
from ..output import Series
from ..result_grids import body_grids, contact_grids
from ..run_bodies import nodes_in, places
from ..run_directory import CONTACT, FIELDS, HISTORY, SOLUTION, SUMMARY, RunDirectory, step_place
from ..run_files import WrittenRun
from ..summary import summary as summary_of
from .case_reference import CaseReference, CaseTies
from .comparison import Comparison, Rounding, unjudged
from .contact_nodes import Start
from .recomputation import Variant
from .run import Findings, as_recorded, check_run, step_of, unread, verdict

_TIMES = ("pending", "halvings")  # of a step: `check_times`


@dataclass(frozen=True)
class HistoryFindings:
    """Result of the check of a load history: of its steps, data that do not follow from these, and data that could not
    be compared or are missing, a line each."""

    steps: tuple[StepFindings, ...]
    faults: tuple[str, ...]
    trusted: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether all steps are certified and all data agree."""
        return all(step.passed for step in self.steps) and not self.faults

    @property
    def recorded(self) -> bool:
        """Whether the run itself recorded that all certificates had passed."""
        return all(step.recorded for step in self.steps)

    @property
    def ending(self) -> str:
        """The lines after those of the steps."""
        good = sum(step.passed for step in self.steps)
        before = f"recorded by the run: certificates {'had passed' if self.recorded else 'had FAILED'}"
        besides = ", but the files of the whole FAILED" if self.faults else ""
        last = f"{good} of {len(self.steps)} load steps passed{besides}"
        return "\n".join([before, *verdict(self.faults), *self.trusted, last])

    def __str__(self) -> str:
        return "\n".join([*map(str, self.steps), self.ending])


@dataclass(frozen=True)
class StepFindings:
    """Result of the check of a load step that ended at a time, as in `Findings`; `details` are printed if it failed."""

    number: int
    time: float
    passed: bool
    recorded: bool
    faults: tuple[str, ...]
    details: str

    def __str__(self) -> str:
        line = f"step {self.number:3d}  time {self.time:<8.4g}"
        return f"{line} certificate passed, files agree" if self.passed else f"{line} FAILED\n{self.details}"


def check_step(folder: Path) -> Findings:
    """Check one load step in its history, relative to the step before, which must be there."""
    files = RunDirectory(folder)
    history, number = files.of_history, files.step_number
    assert number is not None
    case = CaseReference.of(history.path)
    if number == 1:
        return check_run(folder, case, start=Start(0.0, None))
    before = check_run(history.step(number - 1).path, None).run
    began = 0.0 if number == 2 else history.step(number - 2).read_summary(("step",))["step"]["time"]
    return check_run(folder, case, before, Start(step_of(before)[1], before, began))


def check_history(folder: Path, say: Callable[[str], None] = lambda line: None) -> HistoryFindings:
    """Check a load history, step by step (`check`)."""
    case, files = CaseReference.of(folder), RunDirectory(folder)
    complete, trusted = complete_steps(files)
    found, summaries, steps, named = Comparison(), [], [], list[str]()
    chain = _Chain(case)
    for number in range(1, complete + 1):
        findings = check_run(files.step(number).path, case, chain.start.run, chain.start)
        chain.follow(findings, number)
        trusted += [line for line in findings.taken if line not in trusted]
        named += findings.unjudged
        failed = [] if findings.certificate.passed else str(findings.certificate).splitlines()
        failed += [f"outside small-strain theory: {text}" for text in findings.outside]
        details = "\n".join(f"  {line}" for line in [*failed, *verdict(findings.faults)])
        time = chain.start.time
        steps.append(StepFindings(number, time, findings.passed, findings.recorded, findings.faults, details))
        say(str(steps[-1]))
        summaries.append(findings.run.summary)
    named += check_series(files, summaries, found)
    trusted += check_times(None if case is None else case.settings, summaries, found)
    if case is None or case.absent:
        trusted.append("taken as written, without the load at the start: the energies of the first step")
    trusted.append(as_recorded(list(dict.fromkeys(named))))
    return HistoryFindings(tuple(steps), tuple(found.faults), tuple(trusted))


def complete_steps(files: RunDirectory) -> tuple[int, list[str]]:
    """Number of complete steps, and messages on an incomplete last one; ValueError if one before is missing."""
    begun = files.begun_steps
    complete = [number for number in begun if files.step(number).summary.is_file()]
    if not complete:
        raise ValueError(f"{files.step(1).path.parent}: holds no load step")
    for expected, number in enumerate(complete, start=1):
        if number != expected:
            raise ValueError(f"{files.step(expected).path}: is incomplete or missing, but there is a step {number:04d}")
    unfinished = [f"{files.step(number).path}: is incomplete and was not checked" for number in begun[len(complete) :]]
    return len(complete), unfinished


class _Chain:
    """Data passed from step to step, and the expected records.

    Attributes:
        last: The findings of the last step; None before the first.
        start: Start of the next step.
    """

    def __init__(self, case: CaseReference | None) -> None:
        self.case = case
        self.last: Findings | None = None
        self.start = Start(0.0, None)
        self._energies: list[Energy] = []

    def follow(self, now: Findings, number: int) -> None:
        """Compare the records of the next step."""
        run, found = now.run, now.found
        time = step_of(run)[1]
        if self.last is not None and not time > self.start.time:
            found.fault(f"summary.json.step.time: {time:g} is not after {self.start.time:g}, that of the step before")
        self._energies = self._energies_after(now)
        if self.last is not None and self.case is None:
            _check_gaps(self.last, now, found)
        expected, *others = (
            _record(now, variant, Moment(number, time, energy))
            for variant, energy in zip(now.variants, self._energies, strict=True)
        )
        found.judged |= {f"summary.json.step.{name}" for name in _TIMES[: 1 + (self.case is not None or number > 1)]}
        found.tree("summary.json.step", run.summary["step"], expected, others, "the steps so far")
        self.last, self.start = now, Start(time, run, self.start.time)

    def _energies_after(self, now: Findings) -> list[Energy]:
        """The energies at the end of the next step, of every variant; those of a first step without a case, and so
        without the load at the start, as recorded."""
        run, last, over = now.run, self.last, Reductions(MPI.COMM_SELF)
        zero, moved = np.zeros_like(run.body.x), np.zeros((len(run.node), 3))
        moved[now.nodes.index] = now.nodes.moved
        first, on_face = Forces(zero, zero, zero, zero, zero), np.zeros_like(run.on_face["x"])
        if last is None and (self.case is None or self.case.absent):
            return [_recorded_energy(run)] * len(now.variants)
        if last is None and self.case is not None:
            load = np.concatenate([body.at(0.0).load for body in self.case.bodies.values()])
            load, of_ties = load[self.case.nodes_of(run)], zero
            if self.case.tied:
                of_ties = CaseTies(self.case, 0.0, run).found(zero, -load).forces
            first = Forces(zero, load, zero, of_ties, of_ties)
        found = []
        for k, variant in enumerate(now.variants):
            then = first if last is None else last.variants[k].at
            if last is not None:
                on_face = last.variants[k].forces[run.on_faces_of(last.run)]
                if not run.body.has_meshes_of(last.run.body):
                    order = run.in_bodies_of(last.run)
                    then = Forces(*(values[order] for values in vars(then).values()))
            foundation = 0.5 * over.dot(on_face + variant.forces, moved)
            dissipated = variant.numbers["totals"]["dissipated_energy"]
            stiffened = 0.0 if run.body.elastic else coefficients_work(then, variant.at, over)
            before = self._energies[k] if self._energies else Energy()
            found.append(before.after(then, variant.at, run.held, foundation, dissipated, over, stiffened))
        return found


def _record(findings: Findings, variant: Variant, at: Moment) -> dict[str, Any]:
    """Data of the history in summary.json of a step."""
    summary, derived = findings.run.summary, variant.numbers
    try:
        steps, residual = summary["iterations"]["path_following"], summary["residual"]
    except (KeyError, TypeError):
        raise ValueError(f"{findings.run.files.summary}: has no iterations of its solver") from None
    recorded = {name: summary.get(name, []) for name in ("reactions", "ties", "rigid_faces", "bolts")}
    recorded |= {"heat": summary["heat"]} if "heat" in summary else {}
    figures = {**recorded, **derived}
    line = row(figures, at, steps, residual, derived["certificate"]["passed"], derived["valid"])
    return {"number": at.number, "time": at.time, "energy": asdict(at.energy), "row": line}


def _recorded_energy(run: WrittenRun) -> Energy:
    try:
        return Energy(**{name: float(run.summary["step"]["energy"][name]) for name in asdict(Energy())})
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{run.files.summary}: step has no energy") from None


def _check_gaps(before: Findings, now: Findings, found: Comparison) -> None:
    """Compare the displacement of a plane foundation in the step with the change of the gaps."""
    on_faces = now.run.on_faces_of(before.run)
    for part in range(int(np.max(now.nodes.part)) + 1):
        mine, then_there = (np.flatnonzero(one.nodes.part == part) for one in (now, before))
        point = np.full(len(before.run.node), -1)
        point[before.nodes.index[then_there]] = then_there
        same = np.full(len(now.nodes.part), -1)
        same[mine] = point[on_faces[now.nodes.index[mine]]]
        here = same >= 0
        if not np.any(here) or np.any(now.nodes.paired[here]):
            continue
        n, then = now.nodes.frames[here, 0], before.nodes.only(same[here])
        if np.max(np.abs(n - n[0])) > 1e-9 or np.max(np.abs(then.frames[:, 0] - n[0])) > 1e-9:
            continue
        floor = 1e-13 * float(np.max(np.abs(now.run.body.x)))
        expected = then.gap + np.einsum("ki,ki->k", n, now.nodes.moved[here])
        x = now.run.on_face["x"][now.nodes.index[here]]
        source = "the step before, the foundation's displacement in slip_origin, and given_gap"
        found.field("contact.xdmf: initial_gap", now.nodes.gap[here], expected, x, source, floor=floor)


def check_times(settings: Case | None, summaries: Sequence[dict[str, Any]], found: Comparison) -> list[str]:
    """Check the last time; returns messages on steps still to be taken."""
    history = settings.history if settings is not None else None
    if settings is not None and history is None:
        found.fault("case.json: has no [history], but there are load steps")
    left = None if history is None else set(history.ends)
    for summary in summaries:
        record, where = summary["step"], f"{step_place(summary['step']['number'])}/{SUMMARY}"
        time, pending = record["time"], record.get("pending")
        if not isinstance(pending, list) or not all(isinstance(t, float | int) for t in pending):
            raise ValueError(f"{where}: step has no list of pending times")
        ahead = [time, *reversed(pending)]
        if any(after <= before for before, after in pairwise(ahead)):
            found.fault(f"{where}: the times still to be reached, {ahead[1:]}, do not increase from {time:g}")
        if left is not None:
            lost, new = sorted(left - {*ahead}), sorted({*ahead} - left)
            if lost:
                found.fault(f"{where}: goes to time {time:g} and then {ahead[1:]}, but leaves out {lost}")
            if len(new) != record.get("halvings"):
                found.fault(f"{where}: halved {record.get('halvings')} times, but the times {new} are new")
        left = set(pending)
    return [f"not finished: {len(left)} load steps are still to be taken"] if left else []


def check_series(files: RunDirectory, summaries: Sequence[dict[str, Any]], found: Comparison) -> list[str]:
    """Compare history.csv, summary.json and the time series with the steps; names what could not be compared."""
    rows = [summary["step"]["row"] for summary in summaries]
    lines = files.read_history()
    if len(lines) != len(rows):
        found.fault(f"history.csv: has {len(lines)} lines, but there are {len(rows)} load steps")
    if extra := {str(name) for line in lines for name in line} - {name for row_ in rows for name in row_}:
        found.fault(f"history.csv: has columns that no load step has: {', '.join(sorted(extra))}")
    for number, (line, row_) in enumerate(zip(lines, rows, strict=False), start=1):
        found.tree(f"history.csv: line {number}", line, row_, source=f"step {number}")
    summary = files.read_summary(("steps", "time", "certificate", "last"))
    expected = {
        "steps": len(summaries),
        "time": summaries[-1]["step"]["time"],
        "certificate": {"passed": all(one["certificate"]["passed"] for one in summaries)},
        "valid": all(one["valid"] for one in summaries),
        "history": whole(summaries),
        "last": summaries[-1],
    }
    found.tree(SUMMARY, summary, expected, source="the steps")
    for name in FIELDS:
        series = Series(files.path, name).text([step_place(number) for number in range(1, len(summaries) + 1)])
        if not (files.path / name).is_file() or (files.path / name).read_bytes() != series.encode():
            found.fault(f"{name}: is not the time series of the {len(summaries)} load steps")
    repeated = [f"path_following and residual of {HISTORY}"]  # from iterations and residual of the steps
    return unjudged(SUMMARY, summary, found.judged) + repeated + unread(files.path, (SUMMARY, HISTORY, *FIELDS))


_SEEDS = (1, 2)
"""Seeds of the perturbations."""

_ROUNDING: Final = 1e-12
"""Value of a check below which it is a rounding error."""

_OF_SOLVER = ("method", "iterations", "residual", "contraction", "status", "seconds", "peak_memory_bytes", "versions")
"""Entries of a summary that do not follow from the answer."""


def is_large(files: RunDirectory) -> bool:
    """Whether the first step of a history is one of large motions."""
    method: Any = files.step(1).read_summary().get("method") if files.complete_steps else None
    return isinstance(method, Mapping) and method.get("kinematics") == "large"


def check_large(folder: Path, say: Callable[[str], None]) -> HistoryFindings:
    """Check a load history of large motions (`check`); ValueError also if there is no case.

    The case is posed anew, and displacement and contact forces of every step, as written, are judged in it: residual,
    gaps, normals, slip from the step before, certificate, energies and all fields follow from these, by the room that
    has computed them, but without its solver.
    """
    files = RunDirectory(folder)
    if not files.case.exists():
        raise ValueError(
            f"{folder}: large motions are checked by their case, and there is no case.json: run a case file"
        )
    settings = written_case(folder)
    problem, history = settings.problem(MPI.COMM_SELF), settings.load_history()
    if not isinstance(problem, LargeMotions):
        raise ValueError(f"{folder}: was computed with large motions, but case.json is of small strains")
    complete, trusted = complete_steps(files)
    steps, summaries, written = list[StepFindings](), list[dict[str, Any]](), HistoryFiles(folder, resume=True)
    beginning = history.beginning(problem)
    before = [beginning] * (1 + len(_SEEDS))
    for number in range(1, complete + 1):
        found = Comparison(1e-12)
        path, then = files.step(number).path, written.state_after(problem, number)
        record = read_step(path, MPI.COMM_SELF)
        contents = files.step(number).read_summary()
        _, on_faces = points_in_files(files.step(number), problem)
        diagonal = [at_points(files.step(number).contact, name, on_faces, MPI.COMM_SELF)[:, 0] for name in COMPLIANCES]
        compliances = np.column_stack(diagonal)
        answers = [
            _answer(problem, state, then, compliances, seed) for state, seed in zip(before, (0, *_SEEDS), strict=True)
        ]
        before = [problem.after(state, answer) for state, answer in zip(before, answers, strict=True)]
        numbers_of = [_numbers(answer, state, record, contents) for answer, state in zip(answers, before, strict=True)]
        source = "the case, displacement and contact forces"
        found.tree(SUMMARY, _rounded(contents), _rounded(numbers_of[0]), [*map(_rounded, numbers_of[1:])], source)
        _compare_fields(path, answers, found)
        certificate, outside = answers[0].certificate, answers[0].outside
        failed = [] if certificate.passed else str(certificate).splitlines()
        failed += list(outside)
        passed = certificate.passed and not outside and not found.faults
        details = "\n".join(f"  {line}" for line in [*failed, *verdict(tuple(found.faults))])
        recorded = bool(contents["certificate"]["passed"])
        steps.append(StepFindings(number, then.time, passed, recorded, tuple(found.faults), details))
        say(str(steps[-1]))
        summaries.append(contents)
        before = [replace(state, displacement=then.displacement, force_on_body=then.force_on_body) for state in before]
    whole = Comparison()
    named = check_series(files, summaries, whole)
    trusted += check_times(settings, summaries, whole)
    trusted.append(
        f"as recorded by the run, nothing to compare with: {', '.join(dict.fromkeys([*_OF_SOLVER, *named]))}"
    )
    return HistoryFindings(tuple(steps), tuple(whole.faults), tuple(trusted))


def _answer(problem: LargeMotions, before: State, then: State, compliances: FloatArray, seed: int) -> LargeSolution:
    """The answer of a step as written, or with its numbers perturbed."""
    u, f = then.displacement, then.force_on_body
    if seed:
        rounding = Rounding((seed,), 1e-14)
        u, f = rounding.of(u), rounding.of(f)
    return problem.at(then.time, before).recomputed(u, f, compliances)


def _numbers(
    answer: LargeSolution, state: State, record: Mapping[str, Any], contents: Mapping[str, Any]
) -> dict[str, Any]:
    """The summary of a step, without what is of the solver."""
    found = {name: value for name, value in summary_of(answer).items() if name not in _OF_SOLVER}
    row = LoadStep(answer, state, 0).row
    row |= {"path_following": contents["iterations"]["path_following"], "residual": contents["residual"]}
    step = {"number": record["number"], "time": record["time"], "energy": asdict(state.energy), "row": row}
    return {**found, "step": step}


def _rounded(contents: Mapping[str, Any]) -> dict[str, Any]:
    """A summary in which values of the certificate that are rounding errors are 0."""

    def of(check: Any) -> Any:
        small = isinstance(check, Mapping) and isinstance(check.get("value"), float) and check["value"] < _ROUNDING
        return {**check, "value": 0.0} if small else check

    return {**contents, "certificate": {name: of(check) for name, check in contents["certificate"].items()}}


def _compare_fields(path: Path, answers: list[LargeSolution], found: Comparison) -> None:
    files = RunDirectory(path)
    for name, file, grids in (
        (SOLUTION, files.solution, [body_grids(one, {}) for one in answers]),
        (CONTACT, files.contact, [contact_grids(one) for one in answers]),
    ):
        for first, *others in zip(*grids, strict=True):
            _compare_grid(name, file, first, others, found)


def _compare_grid(name: str, file: Path, first: GridFields, others: list[GridFields], found: Comparison) -> None:
    group = grids_of(file)[first.name]
    points, cells, fields = read_fields(data_of(file), (*first.on_points, *first.on_cells), (), group)
    source = "the case, displacement and contact forces"
    order = nodes_in(first.grid.points, first.grid.cells, points, cells)
    middle = first.grid.points[first.grid.cells].mean(axis=1)
    of_cells = places(points[cells].mean(axis=1), middle) if first.on_cells else np.arange(0)
    if np.any(order < 0) or np.any(of_cells < 0):
        raise ValueError(f"{file}: has another mesh than the case")
    of = f" of {first.name}" if first.name else ""
    for given, node, x in (("on_points", order, first.grid.points), ("on_cells", of_cells, middle)):
        for field, expected in getattr(first, given).items():
            if field == NODE:  # has been used to read the file
                continue
            rounded = [np.asarray(getattr(other, given)[field]) for other in others]
            found.field(f"{name}: {field}{of}", fields[field][node], expected, x, source, rounded)
