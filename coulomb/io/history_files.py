"""A load history on disk: written step by step, and continued from there, on any number of ranks; and its summary.

The summary of a step is about that step: its iterations, time, largest pressure, and slip since the step before.  In
the entry `history` of that of the whole, iterations and seconds are sums over all steps; pressures, slips, residuals
and the measures of the certificate are the largest of all steps, each with its step and time; energies are accumulated
from the start.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, fields
from functools import partial, reduce
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI

from ..arrays import BoolArray, FloatArray, IntArray
from ..fem.bodies import TEMPERATURE, SingleBody
from ..fem.geometry import on_all_ranks
from ..linalg.reductions import Reductions
from ..model.load_step import LoadStep
from ..model.nodal_answer import ACCUMULATED, Accumulated
from ..model.problem import ContactProblem
from ..model.small_strain import MEASURES, SmallStrain
from ..model.state import Earlier, Energy, State
from ..nearest import same_nodes
from ..ranks import on_rank_0
from ..regular_file import replacing
from . import output
from .atomic_output import locked, refuse_to_replace, set_aside
from .field_files import data_of, grids_of, mesh_at, parts_of_field
from .result_grids import collections, names_of_sides
from .run_directory import FIELDS, STEPS, SUMMARY, RunDirectory, step_place
from .summary import LOOK_AT_GAP, NOT_UNIQUE


class HistoryFiles:
    """Writes the steps of `LoadHistory.run` into a directory, each before the next begins.

    DIRECTORY/steps/0001, 0002, ... have the results of the steps in the format of a single run;
    DIRECTORY/solution.xdmf and contact.xdmf show them as time series; history.csv has a row per step.

    Args:
        directory: Created if necessary.
        resume: Continue from the last step that exists.
        overwrite: Whether results that are there, and not continued, may be replaced: with the first step they are
            kept as DIRECTORY.previous.
        case: Record of the case, stored in the summary of every step under step.case (`case.record`).
        entries: Gives further entries of the summary of a step.
        when_begun: Called when the directory is that of this history.

    Attributes:
        directory: The directory.
        rows: The rows of history.csv so far.
        begun: Whether the directory is that of this history, no longer of earlier results.

    Raises:
        ValueError: When the run begins, on every rank: if the steps to `resume` belong to another problem, if there are
            results and `overwrite` is not set, or if another run uses the directory.
        OSError: On every rank, if a step cannot be written; the steps before are kept.
    """

    def __init__(
        self,
        directory: str | Path,
        *,
        resume: bool = False,
        overwrite: bool = True,
        case: Mapping[str, Any] | None = None,
        entries: Callable[[LoadStep], Mapping[str, Any]] = lambda _: {},
        when_begun: Callable[[], None] = lambda: None,
    ):
        self.directory, self._entries = RunDirectory(Path(directory)), entries
        self.rows: list[dict[str, Any]] = []
        self._resume, self._overwrite, self._case, self._when_begun = resume, overwrite, case, when_begun
        self._continues = self.begun = False
        self._series: list[output.Series] = []
        self._start = 0.0
        self._history: Entries = {}
        self._seconds: Mapping[str, float] = {}

    @contextmanager
    def recording(self, problem: ContactProblem, beginning: State) -> Iterator[State]:
        """Lock the directory for this run; gives the state from which to continue (`Recorder`)."""
        comm = problem.comm
        with locked(self.directory.path, comm):
            complete = on_rank_0(comm, lambda: self.directory.complete_steps if self._resume else [])
            self._continues, self.begun = bool(complete), False
            if complete or not refuse_to_replace(self.directory.path, self._overwrite, comm):
                self.begin(comm)
            summaries = [read_summary(self.directory.step(number).path, comm) for number in complete]
            self.rows, self._history = [summary["step"]["row"] for summary in summaries], whole(summaries)
            self._start, self._seconds = beginning.time, problem.seconds
            self._series = [output.Series(self.directory.path, name) for name in FIELDS]
            yield self.state_after(problem, complete[-1]) if complete else beginning

    def begin(self, comm: MPI.Comm) -> None:
        """Set earlier results aside, unless they are continued, once in a run; collective."""
        if self.begun:
            return
        if not self._continues:
            on_rank_0(comm, lambda: set_aside(self.directory.path))
        self._when_begun()
        self.begun = True

    def record(self, step: LoadStep) -> None:
        """Write a step and the files of all steps so far; collective."""
        comm = step.solution.problem.comm
        self.begin(comm)
        row = step.row
        own = step.solution.problem.seconds
        for name, value in self._seconds.items():  # assembly and factorisation, done once, count in the first step
            own[name] = own.get(name, 0.0) + value
        self._seconds = {}
        extra = {"step": self._record(step, row), **self._entries(step)}
        contents = output.write(step.solution, self.directory.step(step.state.number).path, extra=extra, keep=False)
        self.rows.append(row)
        self._history = added(self._history, contents)
        on_rank_0(comm, lambda: self._write_whole(contents))

    def _record(self, step: LoadStep, row: dict[str, Any]) -> dict[str, Any]:
        """Data in the summary of a step from which the history can be continued."""
        state = step.state
        case = {} if self._case is None else {"case": dict(self._case)}
        return {
            **case,
            "number": state.number,
            "time": state.time,
            "halvings": step.halvings,
            "energy": asdict(state.energy),
            "pending": list(state.pending),
            "row": row,
            **({} if state.friction_error is None else {"friction_error": state.friction_error}),
        }

    def state_after(self, problem: ContactProblem, number: int) -> State:
        """The state after a step in the directory, from its files; collective.

        Raises:
            ValueError: On every rank, if the files cannot be read or belong to another mesh.
        """
        step, comm = self.directory.step(number), problem.comm
        contents = read_summary(step.path, comm)
        refuse_other_forms(problem, contents.get("forms"), step.path)
        record = contents["step"]
        bodies, faces = points_in_files(step, problem)
        force = at_points(step.contact, "contact_force", faces, comm)
        u = at_points(step.solution, "displacement", bodies, comm)
        began, earlier, moved = self._start, np.zeros_like(force), np.zeros_like(u)
        if number > 1:
            one_before = self.directory.step(number - 1)
            began, points = read_summary(one_before.path, comm)["step"]["time"], points_in_files(one_before, problem)
            moved = at_points(one_before.solution, "displacement", points[0], comm)
            earlier = at_points(one_before.contact, "contact_force", points[1], comm)
        slip = at_points(step.contact, "slip", faces, comm)
        worn = [at_points(step.contact, name, faces, comm)[:, 0] for name in ACCUMULATED]
        heated = None if problem.body.heat is None else at_points(step.solution, TEMPERATURE, bodies, comm)[:, 0]
        return State(
            number=number,
            time=record["time"],
            energy=Energy(**record["energy"]),
            displacement=u,
            force_on_body=force,
            slip_rate=np.linalg.norm(slip, axis=1) / (record["time"] - began),
            accumulated=Accumulated(*worn),
            pending=tuple(record["pending"]),
            before=Earlier(began, earlier, moved),
            temperature_change=heated,
            poses=problem.body.recorded_poses(contents),
            turns=problem.body.recorded_turns(contents),
            friction_error=record.get("friction_error"),
        )

    def _write_whole(self, last: dict[str, Any]) -> None:
        """Replace history.csv, the time series of the steps' files, and the summary; on one rank."""
        folder, rows = self.directory, self.rows
        with replacing(folder.history) as partial, partial.open("w", newline="", encoding="utf-8") as file:
            names = dict.fromkeys(name for row in rows for name in row)  # steps of an older version have fewer
            writer = csv.DictWriter(file, list(names))
            writer.writeheader()
            # nan is null in the summary of a step, which a resumed run reads: an empty field in both
            writer.writerows({name: "" if value != value else value for name, value in row.items()} for row in rows)
        for series in self._series:
            series.write([step_place(row["step"]) for row in rows])
        output.write_json(summary_of(rows, {"start": self._start, **self._history}, last), folder.summary)


def refuse_other_forms(problem: ContactProblem, before: Mapping[str, Any] | None, step: Path) -> None:
    """Refuse to continue with other forms than those of a step, as far as they are recorded; collective.

    Raises:
        ValueError: On every rank, if their expressions, the degree of their space or the number of conditions differ.
    """
    now, then = problem.elasticity.forms() or {}, before or {}
    if len(problem.elasticity.members) == 1:
        now, then = {"": now}, {"": then}
    changed = [
        f"{name}{f' of {body!r}' if body else ''}"
        for body in {**now, **then}
        for name in ("a", "L", "degree", "bcs")
        if now.get(body, {}).get(name) != then.get(body, {}).get(name)
    ]
    if changed:
        raise ValueError(
            f"{step}: was computed with other forms or conditions: {', '.join(changed)} of the body differ from those "
            "recorded in its summary.json under forms; continue with the same body, or in another directory"
        )


def steps_on_disk(folder: Path, comm: MPI.Comm) -> int:
    """How many load steps are complete in a directory, the same on every rank; collective."""
    return on_rank_0(comm, lambda: len(RunDirectory(folder).complete_steps))


def steps_left(folder: Path, comm: MPI.Comm) -> int | None:
    """How many load steps of the history in a directory are still to be taken; None if it has none yet; collective.

    Raises:
        ValueError: On every rank, if the last step cannot be read.
    """
    last = steps_on_disk(folder, comm)
    return len(read_summary(RunDirectory(folder).step(last).path, comm)["step"]["pending"]) if last else None


def whole_history(folder: Path, comm: MPI.Comm) -> Entries | None:
    """The entry `history` of the summary of a load history; None if it cannot be read; collective."""
    with suppress(ValueError):
        return on_rank_0(comm, RunDirectory(folder).read_summary).get("history")
    return None


def read_summary(directory: Path, comm: MPI.Comm) -> dict[str, Any]:
    """The summary of a load step, the same on every rank.

    Raises:
        ValueError: On every rank, if it cannot be read, or is not that of a load step.
    """

    def read() -> dict[str, Any]:
        contents = RunDirectory(directory).read_summary()
        if "row" not in contents.get("step", {}):
            raise ValueError(f"{SUMMARY} has no step")
        return contents

    with _offering_whole_steps(directory):
        try:
            return on_rank_0(comm, read)
        except ValueError as error:
            raise ValueError(f"{directory}: is no load step: {error}") from None


@contextmanager
def _offering_whole_steps(step: Path) -> Iterator[None]:
    """Adds to errors in the files of a load step how to continue from the last whole step before."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{error}{_offer(RunDirectory(step))}") from None


def _offer(step: RunDirectory) -> str:
    """How to continue from the last whole step before one that cannot be read; empty if its files can be read."""
    if step.step_number is None:
        return ""
    history, number = step.of_history, 1
    while number <= step.step_number and _is_whole(history.step(number)):
        number += 1
    if number > step.step_number:
        return ""
    if number == 1:
        return f"; no load step before is whole: move {history.path / STEPS} away, and run the case again"
    later = " and those after it" if history.begun_steps[-1] > number else ""
    return (
        f"; the last whole load step is {number - 1}: to continue from there, move {step_place(number)}{later} out of "
        f"{history.path}, then{f': coulomb resume {history.path}' if history.case.exists() else ' resume'}"
    )


def _is_whole(step: RunDirectory) -> bool:
    try:
        step.read_summary(("step",))
        for file in (step.solution, step.contact):
            grids_of(file)
            h5py.File(data_of(file), "r").close()
        return True
    except (OSError, ValueError):
        return False


Points = Sequence[tuple[str, IntArray, bool]]
"""Names of grids, "" for the only one of a file, numbers of this rank's points on each, in solution.xdmf, and whether
all are there: of a face in contact with itself those of the present slave."""


def points_in_files(step: RunDirectory, problem: ContactProblem) -> tuple[Points, Points]:
    """This rank's nodes of every body, and points of every contact face, in the files of a load step, which other ranks
    may have numbered otherwise; collective.

    Raises:
        ValueError: On every rank, if a file cannot be read, or lacks a grid or a point.
    """
    comm, members, parts = problem.comm, problem.elasticity.members, []

    def numbers(group: str, body: SingleBody, near: float) -> IntArray:
        with h5py.File(data_of(step.solution), "r") as file:
            mesh = file[mesh_at(group)]
            number = same_nodes(body.reference, body.in_a_cell(), mesh["geometry"], mesh["topology"], near)
        _refuse(number < 0)
        return number

    with _offering_whole_steps(step.path):
        groups = _groups(step.solution, [member.name for member in members], comm)
        for member in members:
            near = 1e-9 * float(np.max(Reductions(comm).extent(member.body.reference)))
            one = partial(numbers, groups[member.name], member.body, near)
            parts.append((member.name, on_all_ranks(one, str(data_of(step.solution)), comm), True))
    (nodes, part), itself = problem.points_of_states, () if problem.large is None else problem.large.itself
    on_faces = np.concatenate([number for _, number, _ in parts])[nodes]
    sides = [(name, on_faces[part == k], k not in itself) for k, (name, _) in enumerate(names_of_sides(problem))]
    return parts, sides if collections(problem)[1] else [("", on_faces, True)]


def at_points(file: Path, name: str, points: Points, comm: MPI.Comm) -> FloatArray:
    """A vector field of an XDMF file at this rank's points of its grids, shape (k, 3), 0 where not all are there;
    collective.

    Raises:
        ValueError: On every rank, if a file cannot be read, or lacks a grid or a point.
    """

    def read(group: str, wanted: IntArray, whole: bool) -> FloatArray:
        values, order = np.full((len(wanted), 3), np.nan if whole else 0.0), np.argsort(wanted)
        for number, vectors in parts_of_field(data_of(file), name, group):
            if len(wanted):
                place = order[np.minimum(np.searchsorted(wanted, number, sorter=order), len(wanted) - 1)]
                fetched = wanted[place] == number
                values[place[fetched]] = vectors[fetched]
        _refuse(np.isnan(values))
        return values

    with _offering_whole_steps(file.parent):
        groups, name_of = _groups(file, [grid for grid, *_ in points], comm), str(data_of(file))
        fetched = [on_all_ranks(partial(read, groups[grid], of, whole), name_of, comm) for grid, of, whole in points]
        return np.concatenate(fetched)


def _groups(file: Path, grids: Sequence[str], comm: MPI.Comm) -> dict[str, str]:
    """The groups of the grids of a file; collective."""

    def groups() -> dict[str, str]:
        grids_in = grids_of(file)
        missing = [grid for grid in grids if grid not in grids_in]
        if missing:
            raise ValueError(f"has no grid {missing[0]!r}: belongs to another problem, or is incomplete")
        return grids_in

    return on_all_ranks(groups, str(file), comm)


def _refuse(missing: BoolArray) -> None:
    if np.any(missing):
        raise ValueError("belongs to another mesh, or is incomplete")


Entries = dict[str, Any]


def summary_of(rows: Sequence[Mapping[str, Any]], history: Entries, last: Mapping[str, Any]) -> Entries:
    """The summary of a history: by its rows in history.csv, its entry `history`, and the summary of its last step."""
    return {
        "steps": len(rows),
        "time": rows[-1]["time"],
        "certificate": {"passed": all(row["certified"] for row in rows)},
        "valid": all(row["valid"] for row in rows),
        "history": history,
        "last": last,
    }


def whole(steps: Iterable[Mapping[str, Any]]) -> Entries:
    """Summary of the history from those of all steps in order; empty without steps."""
    return reduce(added, steps, {})


def added(before: Entries, step: Mapping[str, Any]) -> Entries:
    """The history, empty before the first step, extended by the summary.json of one step."""
    record = step["step"]
    where = {"step": record["number"], "time": record["time"]}
    most = {**step["maximum"], "slip_in_a_step": step["totals"]["greatest_slip"]}
    most |= {name: value for name, value in record.items() if name == "friction_error"}
    strain = {name: step["small_strain"][name] for name in MEASURES}
    largest_strain = _largest_of(before.get("small_strain", {}), strain, where)
    largest = _largest_of(before.get("maximum", {}), most, where)
    energy = Energy(**{field.name: record["row"][f"energy_{field.name}"] for field in fields(Energy)})
    touching = before.get("steps_in_contact", 0) + (step["totals"]["contact_area"] > 0.0)
    outside = _outside(before.get("outside"), step)
    # of faces with what they touch before deformation, metres, but those under load, which are where they moved to;
    # and the energy in joules of rounding errors: of a fixed node moved by the rounding error of its coordinates
    tried = [one for one in step["understood"]["contacts"] if one["nodes"]]
    contacts = [one for one in tried if not {"force", "moment"} & set(one["moves"].split())]
    overlaps = [min(one["given_gap"]["min"], max(one["gap"]["min"], 0.0)) - one["gap"]["min"] for one in contacts]
    overlap, compliance = float(max(before.get("overlap", 0.0), *overlaps, 0.0)), step["mean_compliance"]
    way = _number(largest["displacement"]["value"])
    rounding = 1e-12 * way**2 / compliance if compliance else 0.0
    now = (f"at {record['time']:g} s: {text}" for text in step["remarks"])
    not_unique = [text for text in (*before.get("remarks", ()), *now) if NOT_UNIQUE in text]
    remarks = [
        energy.warning(rounding, overlap if overlap > 1e-6 * way else 0.0),
        "" if touching or not tried else f"nothing touches in any load step: {LOOK_AT_GAP}",
        *not_unique[:1],
    ]
    measures: dict[str, Any] = {name: _number(entry["value"]) for name, entry in largest_strain.items()}
    warnings = SmallStrain(**measures).warnings
    return {
        "steps": before.get("steps", 0) + 1,
        "certified_steps": before.get("certified_steps", 0) + bool(step["certificate"]["passed"]),
        "valid_steps": before.get("valid_steps", 0) + bool(step["valid"]),
        "steps_in_contact": touching,
        "overlap": overlap,
        "halvings": before.get("halvings", 0) + record["halvings"],
        "iterations": _sum(before.get("iterations", {}), step["iterations"]),
        "accumulated": step["accumulated"],
        "energy": {name: record["row"][f"energy_{name}"] for name in (*record["energy"], "imbalance")},
        "maximum": largest,
        "residual": _larger(before.get("residual"), {"value": step["residual"], **where}),
        "certificate": _certificate(before.get("certificate", {}), step["certificate"], where),
        "small_strain": largest_strain,
        "warnings": list(warnings),
        "outside": outside,
        "violations": _violations(outside, before.get("steps", 0) + 1),
        "remarks": [text for text in remarks if text],
        "seconds": _sum(before.get("seconds", {}), step["seconds"]),
        "peak_memory_bytes": max(before.get("peak_memory_bytes", 0), step["peak_memory_bytes"]),
        "runs": _runs(before.get("runs", []), step["run"], record["number"]),
    }


def _sum(before: Mapping[str, float], step: Mapping[str, float]) -> Entries:
    return {name: before.get(name, 0) + step.get(name, 0) for name in dict.fromkeys([*before, *step])}


def _number(value: float | None) -> float:
    """Infinity for null, which replaces non-finite numbers in files."""
    return math.inf if value is None or math.isnan(value) else value


def _larger(before: Entries | None, now: Entries) -> Entries:
    """The larger value; the earlier one if equal."""
    return now if before is None or _number(now["value"]) > _number(before["value"]) else before


def _largest_of(before: Mapping[str, Entries], now: Mapping[str, float], where: Entries) -> Entries:
    return {name: _larger(before.get(name), {"value": value, **where}) for name, value in now.items()}


def _certificate(before: Mapping[str, Entries], now: Mapping[str, Any], where: Entries) -> Entries:
    """Worst step per condition; a condition has passed if it passed in every step."""
    worst: Entries = {}
    for name, check in now.items():
        if not isinstance(check, Mapping):
            continue
        larger = _larger(before.get(name), {**check, **where})
        worst[name] = {**larger, "passed": bool(check["passed"]) and before.get(name, check)["passed"]}
    return {**worst, "passed": bool(now["passed"]) and before.get("passed", True)}


def _outside(before: Entries | None, step: Mapping[str, Any]) -> Entries | None:
    """Number of steps outside the theory of small strains, the first of them and its violations; null if none.

    Steps for which this was accepted are not counted.
    """
    if step["small_strain"]["accepted"] or not step["small_strain"]["violations"]:
        return before
    if before is None:
        before = {"steps": 0, "first": step["step"]["number"], "violations": step["small_strain"]["violations"]}
    return {**before, "steps": before["steps"] + 1}


def _violations(outside: Entries | None, steps: int) -> list[str]:
    """Description of the steps outside the theory."""
    if outside is None:
        return []
    first, *others = outside["violations"]
    return [f"{outside['steps']} of {steps} load steps, the first is step {outside['first']}: {first}", *others]


def _runs(before: list[Entries], run: Entries, number: int) -> list[Entries]:
    """The run and resumes of the history, each with its first and last step."""
    if before and all(before[-1][key] == run[key] for key in ("started", "hosts", "command")):
        return [*before[:-1], {**before[-1], "ended": run["ended"], "last_step": number}]
    return [*before, {**run, "first_step": number, "last_step": number}]
