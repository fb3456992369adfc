"""Check of a load history: each step from the one before, and the files of the whole.

The answer of a step is judged in the problem that the state after the step before poses, with displacement and contact
forces as they are written there; what has accumulated and energies are summed up again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from ..case.case import Case
from ..io.atomic_output import in_use
from ..io.history_files import summary_of, whole
from ..io.output import Series
from ..io.run_directory import FIELDS, HISTORY, SUMMARY, RunDirectory, read_table, step_place
from ..ranks import on_rank_0
from .comparison import Comparison, named
from .findings import Findings, unread
from .posed import SEEDS, Posed
from .run import beginning, judged


def check_history(files: RunDirectory, posed: Posed | str, say: Callable[[str], None]) -> Findings:
    """Check a load history, step by step (`check`)."""
    comm = None if isinstance(posed, str) else posed.problem.comm
    complete, trusted, running = *complete_steps(files), on_rank_0(comm, lambda: in_use(files.path))
    compared, steps, left = Comparison(), list[Findings](), list[str]()
    before = [] if isinstance(posed, str) else [beginning(files, posed)] * len(SEEDS)
    for number in range(1, complete + 1):
        findings, states = judged(files.step(number), posed, before)
        before = [  # by the numbers as written: rounding errors of a step are not those of the next
            replace(one, displacement=states[0].displacement, force_on_body=states[0].force_on_body) for one in states
        ]
        trusted += [line for line in findings.taken if line not in trusted]
        left += findings.unjudged
        steps.append(findings)
        say(findings.of_step)
    summaries = [dict(step.contents) for step in steps]
    if running:
        trusted.append(f"a run is at work: {SUMMARY}, {HISTORY} and the series, which go on with it, were not compared")
    else:
        check_series(files, summaries, compared)
    trusted += check_times(None if isinstance(posed, str) else posed.settings, summaries, compared)
    left += [*named(compared.left), f"path_following and residual of {HISTORY}", *unread(files)]
    return Findings(files.read_summary(), None, (), compared.faults, trusted, list(dict.fromkeys(left)), steps)


def complete_steps(files: RunDirectory) -> tuple[int, list[str]]:
    """Number of complete steps, and messages on an incomplete last one; ValueError if one before is missing."""
    complete = len(files.complete_steps)
    later = [files.step(number) for number in files.begun_steps if number > complete]
    if any(step.summary.is_file() for step in later):
        raise ValueError(f"{files.step(complete + 1).path}: is incomplete or missing, but there are later load steps")
    if not complete:
        raise ValueError(f"{files.step(1).path.parent}: holds no load step")
    return complete, [f"{step.path}: is incomplete and was not checked" for step in later]


def check_times(settings: Case | None, summaries: Sequence[dict[str, Any]], found: Comparison) -> list[str]:
    """Check the last time; returns messages on steps still to be taken."""
    history = settings.history if settings is not None else None
    left = None if history is None else set(history.ends)
    for number, summary in enumerate(summaries, 1):
        record, where = summary["step"], f"{step_place(number)}/{SUMMARY}"
        time, pending = record["time"], record.get("pending")
        if not isinstance(pending, list) or not all(isinstance(t, float | int) for t in pending):
            raise ValueError(f"{where}: step has no list of pending times")
        ahead = [time, *reversed(pending)]
        if any(after <= before for before, after in pairwise(ahead)):
            found.faults.append(f"{where}: the times still to be reached, {ahead[1:]}, do not increase from {time:g}")
        if left is not None:
            lost, new = sorted(left - {*ahead}), sorted({*ahead} - left)
            if lost:
                found.faults.append(f"{where}: goes to time {time:g} and then {ahead[1:]}, but leaves out {lost}")
            if len(new) != record.get("halvings"):
                found.faults.append(f"{where}: halved {record.get('halvings')} times, but the times {new} are new")
        left = set(pending)
    return [f"not finished: {len(left)} load steps are still to be taken"] if left else []


def check_series(files: RunDirectory, summaries: Sequence[dict[str, Any]], compared: Comparison) -> None:
    """Compare history.csv, summary.json and the time series with the steps."""
    rows, lines = [summary["step"]["row"] for summary in summaries], read_table(files.history)
    if len(lines) != len(rows):
        compared.faults.append(f"{HISTORY}: has {len(lines)} lines, but there are {len(rows)} load steps")
    if extra := {str(name) for line in lines for name in line} - {name for row_ in rows for name in row_}:
        compared.faults.append(f"{HISTORY}: has columns that no load step has: {', '.join(sorted(extra))}")
    for number, (line, row_) in enumerate(zip(lines, rows, strict=False), start=1):
        one = {name: value for name, value in line.items() if name in row_}
        compared.tree(one, row_, (), (f"{HISTORY}: line {number}",), f"step {number}")
    expected = summary_of(rows, whole(summaries), summaries[-1])
    compared.tree(files.read_summary(tuple(expected)), expected, (), (SUMMARY,), "the steps")
    for name in FIELDS:
        series = Series(files.path, name).text([step_place(number) for number in range(1, len(summaries) + 1)])
        if not (files.path / name).is_file() or (files.path / name).read_bytes() != series.encode():
            compared.faults.append(f"{name}: is not the time series of the {len(summaries)} load steps")
