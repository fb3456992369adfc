"""Recheck of a load history of large motions: the case is posed anew, and the answer of every step, displacement and
contact forces as written, is judged in it.

So residual, gaps, normals, slip from the state of the step before, certificate, energies and all fields are computed
again from the case and these two, by the room that has computed them, but without its solver.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ...kinematics.large_motions import LargeMotions, LargeSolution
from ...model.load_step import LoadStep, State
from ..case_record import written_case
from ..field_files import data_of, grids_of, read_fields
from ..grid_file import GridFields
from ..history_files import HistoryFiles, read_step
from ..result_grids import body_grids, contact_grids
from ..run_bodies import numbers
from ..run_directory import CONTACT, SOLUTION, SUMMARY, RunDirectory
from ..summary import summary
from .comparison import Comparison, Rounding
from .history import HistoryFindings, StepFindings, check_series, check_times, complete_steps
from .run import verdict

_SEEDS = (1, 2)
"""Seeds of the perturbations."""

_ROUNDING = 1e-12
"""Value of a check below which it is a rounding error."""

_OF_SOLVER = ("method", "iterations", "residual", "contraction", "status", "seconds", "peak_memory_bytes", "versions")
"""Entries of a summary that do not follow from the answer."""


def is_large(files: RunDirectory) -> bool:
    """Whether the first step of a history is one of large motions."""
    method: Any = files.step(1).read_summary().get("method") if files.complete_steps else None
    return isinstance(method, Mapping) and method.get("kinematics") == "large"


def check_large(folder: Path, say: Callable[[str], None]) -> HistoryFindings:
    """Check a load history of large motions (`check`); ValueError also if there is no case."""
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
        answers = [
            _answer(problem, state, then, contents, seed) for state, seed in zip(before, (0, *_SEEDS), strict=True)
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


def _answer(problem: LargeMotions, before: State, then: State, contents: Mapping[str, Any], seed: int) -> LargeSolution:
    """The answer of a step as written, or with its numbers perturbed."""
    u, f = then.displacement, then.force_on_body
    if seed:
        rounding = Rounding((seed,), 1e-14)
        u, f = rounding.of(u), rounding.of(f)
    compliance = float(contents["mean_compliance"])
    return problem.at(then.time, before).recomputed(u, f, compliance)


def _numbers(
    answer: LargeSolution, state: State, record: Mapping[str, Any], contents: Mapping[str, Any]
) -> dict[str, Any]:
    """The summary of a step, without what is of the solver."""
    found = {name: value for name, value in summary(answer).items() if name not in _OF_SOLVER}
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
    unfit, source = f"{file}: has another mesh than the case", "the case, displacement and contact forces"
    order = numbers(points, first.grid.points, unfit)
    middle = first.grid.points[first.grid.cells].mean(axis=1)
    of_cells = numbers(points[cells].mean(axis=1), middle, unfit) if first.on_cells else np.arange(0)
    of = f" of {first.name}" if first.name else ""
    for given, places, x in (("on_points", order, first.grid.points), ("on_cells", of_cells, middle)):
        for field, expected in getattr(first, given).items():
            rounded = [np.asarray(getattr(other, given)[field]) for other in others]
            found.field(f"{name}: {field}{of}", fields[field][places], expected, x, source, rounded)
