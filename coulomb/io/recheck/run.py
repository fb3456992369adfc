"""Check of one run or load step: judged in the problem posed anew, and its files compared with those written anew."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from mpi4py import MPI
from pydantic import ValidationError

from ...case.case import Case
from ...contact_fields import ANSWER
from ...fem.bodies import TEMPERATURE
from ...fem.geometry import on_all_ranks
from ...model.certificate import Certificate
from ...model.load_history import LoadHistory
from ...model.load_step import State
from ...model.solution import Solution
from ...solvers.successive_tresca import SuccessiveTresca
from ...version import __version__
from ..answer import totals_in
from ..case_record import lasting_part
from ..history_files import HistoryFiles
from ..run_directory import CASE, CONTACT, SOLUTION, SUMMARY, RunDirectory
from .comparison import Comparison, unjudged
from .fields import SLIP_BOUND_LIMIT, compare_fields, sound
from .files_alone import check_alone
from .findings import Findings, unread
from .posed import SEEDS, Posed, WrittenAnswer, written

_SOURCE: Final = f"the case and {ANSWER}"

_ROUNDING: Final = 1e-12
"""Value of a check below which it is a rounding error."""

_AGREEMENT: Final = 1e-7
"""Difference of temperatures from those of conduction with the contact forces and slip of the files, over the largest
change: contact and conduction were solved in turn until they agreed to less."""


def check_run(files: RunDirectory, posed: Posed | str) -> Findings:
    """Check the files of a single run (`check`)."""
    if isinstance(posed, str):
        return check_alone(files, posed)
    findings, _ = judged(files, posed, None)
    if posed.settings is None or posed.settings.history is None:
        return findings
    raise ValueError(f"{files.case}: has a [history], but these are the results of a single run")


def check_step(files: RunDirectory, posed: Posed | str) -> Findings:
    """Check one load step in its history, relative to the step before, which must be there."""
    number = files.step_number
    assert number is not None
    if isinstance(posed, str):
        return check_alone(files, posed)
    before = beginning(files.of_history, posed)
    if number > 1:
        before = HistoryFiles(files.of_history.path, resume=True).state_after(posed.problem, number - 1)
    return judged(files, posed, [before] * len(SEEDS))[0]


def beginning(history: RunDirectory, posed: Posed) -> State:
    """The state from which a load history begins; of a script at the time that its summary has."""
    if posed.settings is not None and posed.settings.history is not None:
        return posed.settings.load_history().beginning(posed.problem)
    if posed.settings is not None:
        raise ValueError(f"{history.case}: has no [history], but there are load steps")
    start = history.read_summary(("history",))["history"]["start"]
    return LoadHistory([start + 1.0], start=start).beginning(posed.problem)


def judged(files: RunDirectory, posed: Posed, before: Sequence[State] | None) -> tuple[Findings, list[State]]:
    """Judge the answer in the files, of a load step from the states `before`, which follow from the numbers as written
    and from perturbed ones; gives the states after it as well; collective.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others or the problem.
    """
    comm = posed.problem.comm
    contents = _on_rank_0(partial(sound, files), files, comm)
    record: Mapping[str, Any] = contents.get("step") or {}
    posed.problem.small_strain = "warn" if posed.accepts(record) else "enforce"
    problems, answers, states = [posed.problem] * len(SEEDS), list[Solution](), list[State]()
    if before is not None:
        (number, time), then = step_of(files, contents), before[0]
        if number != then.number + 1 or not time > then.time:
            raise ValueError(
                f"{files.summary}: is of step {number} to {time:g} s, but the step before, {then.number}, ends at "
                f"{then.time:g} s"
            )
        problems = [posed.problem.at(time, state) for state in before]
    answer = WrittenAnswer(files, posed.problem)
    for number, seed in enumerate(SEEDS):
        answers.append(answer.judged(problems[number], seed))
        if before is not None:
            states.append(posed.problem.after(before[number], answers[-1]))
    found, numbers = Comparison(1e-12), list[dict[str, Any]]()
    with _shared_directory(comm) as beside:
        for number, one in enumerate(answers):
            folder = beside / str(number)
            if comm.rank == 0:
                folder.mkdir()
            numbers.append(written(one, folder, contents, states[number] if states else None))
        limit = _compare_temperature(answer, answers[0], found)
        compare = partial(_compare, files, contents, posed, answers[0].certificate, numbers, beside, limit, found)
        faults, named = _on_rank_0(compare, files, comm)
    taken = [] if contents.get("coulomb") == __version__ else [f"written by coulomb {contents.get('coulomb')}"]
    first = answers[0]
    findings = Findings(
        contents, first.certificate, first.outside, tuple(faults), tuple(taken), tuple(named), tuple(numbers)
    )
    return findings, states


@contextmanager
def _shared_directory(comm: MPI.Comm) -> Iterator[Path]:
    """A temporary directory of rank 0, by its name on all ranks; collective."""
    with tempfile.TemporaryDirectory(prefix="coulomb-check-") as own:
        yield Path(comm.bcast(own))
        comm.barrier()


def _on_rank_0(call: Callable[[], Any], files: RunDirectory, comm: MPI.Comm) -> Any:
    """What a call gives on rank 0, on all ranks; or its ValueError; collective."""

    def guarded() -> Any:
        try:
            return call() if comm.rank == 0 else None
        except (KeyError, TypeError, IndexError, AttributeError) as error:  # entries of wrong type or structure
            raise ValueError(
                f"{files.path}: is incomplete, or written by another version of coulomb: {error!r}"
            ) from None

    return comm.bcast(on_all_ranks(guarded, "", comm))


def _compare(
    files: RunDirectory,
    contents: Mapping[str, Any],
    posed: Posed,
    certificate: Certificate,
    numbers: list[dict[str, Any]],
    beside: Path,
    imbalance: float,
    found: Comparison,
) -> tuple[list[str], list[str]]:
    """Compare the files with those written anew into directories `beside`; gives the faults, and the names of what was
    not compared."""
    first, *others = (_without_rounding(one) for one in numbers)
    said = _without_rounding(contents)
    if "heat" in first:
        entry = first.pop("heat")
        around = [_moved(entry, imbalance), _moved(entry, -imbalance)]
        found.tree(f"{SUMMARY}.heat", said.get("heat"), entry, around, "conduction, contact forces and slip")
    found.tree(SUMMARY, said, first, others, _SOURCE)
    limit = None
    if SuccessiveTresca.name in str(contents.get("method")):
        limit = SLIP_BOUND_LIMIT + 10.0 * certificate["natural residual"].value
    left = compare_fields(files.path, [beside / str(k) for k in range(len(numbers))], found, limit)
    compare_error_bars(contents, found)
    if posed.settings is not None:
        _compare_record(contents, posed.settings, found)
    if "step" in contents:
        found.judged |= {f"{SUMMARY}.step.{name}" for name in ("pending", "halvings")}  # `check_times`
    order = {CONTACT: 0, SOLUTION: 1}  # in a list that is cut
    faults = sorted(found.faults, key=lambda fault: order.get(fault.partition(":")[0], 2))
    return faults, unjudged(SUMMARY, contents, found.judged) + left + unread(files)


def _compare_temperature(answer: WrittenAnswer, judged: Solution, found: Comparison) -> float:
    """Compare the temperature with that of conduction; gives the largest sum of heat flows that is none; collective."""
    heat = judged.heat
    if heat is None:
        return 0.0
    try:
        expected = answer.conducted(judged)
    except ValueError as error:  # on all ranks
        found.fault(f"{SOLUTION}: {TEMPERATURE}: {error}")
        return heat.limit
    scale = float(np.max(np.abs(heat.change), initial=0.0))
    source, x = "conduction, contact forces and slip", judged.problem.elasticity.x
    found.field(f"{SOLUTION}: {TEMPERATURE}", heat.change, expected, x, source, floor=_AGREEMENT * scale)
    if not heat.balanced:
        found.fault(f"{SUMMARY}.heat: {heat.imbalance:.3g} W of {heat.power_in:.6g} W are missing")
    found.share(judged.problem.comm)
    return heat.limit


def _moved(entry: Any, by: float) -> Any:
    """All numbers of an entry, moved by so much."""
    if isinstance(entry, dict):
        return {name: _moved(value, by) for name, value in entry.items()}
    if isinstance(entry, list):
        return [_moved(value, by) for value in entry]
    return entry + by if isinstance(entry, float) else entry


def _without_rounding(contents: Mapping[str, Any]) -> dict[str, Any]:
    """A summary in which values of the certificate that are rounding errors are 0."""

    def of(check: Any) -> Any:
        small = isinstance(check, Mapping) and isinstance(check.get("value"), float) and check["value"] < _ROUNDING
        return {**check, "value": 0.0} if small else check

    return {**contents, "certificate": {name: of(check) for name, check in contents["certificate"].items()}}


def _compare_record(contents: Mapping[str, Any], settings: Case, found: Comparison) -> None:
    """Compare the case from which a load step was computed, if it is recorded, but for what may change between
    steps."""
    record = (contents.get("step") or {}).get("case")
    if record is None:
        return
    what = f"{SUMMARY}.step.case"
    try:
        then, _ = lasting_part(Case.model_validate(record["tables"]))
    except ValidationError:
        found.fault(f"{what}.tables: is no case")
        return
    tables, digests = lasting_part(settings)
    found.tree(f"{what}.tables", then, tables, source=CASE)
    found.tree(f"{what}.files", record["files"], digests, source=f"the files of {CASE}")


def compare_error_bars(contents: Mapping[str, Any], found: Comparison) -> None:
    """Compare the values that have error bars with the totals of the summary, and the bars with the sums of their
    parts, which are those of the run."""
    bars = (contents.get("error") or {}).get("bars", ())
    if not bars:
        return
    said = {bar["quantity"]: np.atleast_1d(bar["value"]).tolist() for bar in bars}
    totals = {name: value.tolist() for name, value, _ in totals_in(contents) if name in said}
    found.tree(f"{SUMMARY}: error", {name: said[name] for name in totals}, totals, source=ANSWER)
    whole, parts = dict[str, Any](), dict[str, Any]()
    for bar in bars:
        if "parts" in bar:  # runs of earlier versions have none
            whole[bar["quantity"]] = np.atleast_1d(bar["error"]).tolist()
            parts[bar["quantity"]] = np.sum([np.atleast_1d(part) for part in bar["parts"].values()], axis=0).tolist()
    found.tree(f"{SUMMARY}: error bar", whole, parts, source="its parts")


def step_of(files: RunDirectory, contents: Mapping[str, Any]) -> tuple[int, float]:
    """Number and time of a load step; ValueError if its summary has none."""
    try:
        number, time = contents["step"]["number"], contents["step"]["time"]
        if isinstance(number, int) and isinstance(time, float | int) and math.isfinite(time):
            return number, float(time)
    except (KeyError, TypeError):
        pass
    raise ValueError(f"{files.summary}: step has no number and time")
