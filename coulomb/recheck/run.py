"""Check of one run or load step: judged in the problem posed anew, and its files compared with what would be written
anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from mpi4py import MPI
from pydantic import ValidationError

from ..case.case import Case
from ..case.record import FREE, changes_of_case
from ..contact_fields import ANSWER, COMPLIANCES
from ..fem.bodies import TEMPERATURE
from ..fem.meshes import NODE_NUMBER
from ..io.answer import totals_in
from ..io.field_files import OPPOSITE, WHOLE
from ..io.history_files import HistoryFiles
from ..io.result_grids import OURS
from ..io.run_directory import CASE, CONTACT, SOLUTION, SUMMARY, RunDirectory
from ..model.heated import at_contact
from ..model.load_history import LoadHistory
from ..model.solution import Solution
from ..model.state import State
from ..ranks import on_rank_0
from ..solvers.successive_tresca import SuccessiveTresca
from ..version import __version__
from .comparison import Comparison, Field, Place, complete, in_files, named
from .fields import fields_of, grids_of, in_order, sound
from .files_alone import check_alone
from .findings import Findings, unread
from .posed import SEEDS, Posed, WrittenAnswer, numbers_of

_HEAT: Final = "conduction, contact forces and slip"

_EXACT: Final = ("status", "face", OPPOSITE, NODE_NUMBER)
"""Fields of whole numbers, which rounding does not change."""

_SLIP_BOUND: Final = 1e-6
"""Accepted difference of the slip bound of the last Tresca problem from the law at its forces, over the norm of these,
plus ten times the natural residual; for other solvers it is that of the law."""

_AGREEMENT: Final = 1e-7
"""Difference of temperatures from those of conduction with the contact forces and slip of the files, over the largest
change: contact and conduction were solved in turn until they agreed to less."""


def check_run(files: RunDirectory, posed: Posed | str) -> Findings:
    """Check a single run (`check`), or one load step in its history, relative to the step before, which must be
    there."""
    number, before = files.step_number, None
    if number is not None and not isinstance(posed, str):
        before = [beginning(files.of_history, posed)] * len(SEEDS)
        if number > 1:
            history = HistoryFiles(files.of_history.path, resume=True)
            before = [history.state_after(posed.problem, number - 1)] * len(SEEDS)
    elif not isinstance(posed, str) and posed.settings is not None and posed.settings.history is not None:
        raise ValueError(f"{files.case}: has a [history], but these are the results of a single run")
    return judged(files, posed, before)[0]


def beginning(history: RunDirectory, posed: Posed) -> State:
    """The state from which a load history begins; of a script at the time that its summary has."""
    if posed.settings is None:
        start = history.read_summary(("history",))["history"]["start"]
        return LoadHistory([start + 1.0], start=start).beginning(posed.problem)
    if posed.settings.history is None:
        raise ValueError(f"{history.case}: has no [history], but there are load steps")
    return posed.settings.load_history().beginning(posed.problem)


def judged(files: RunDirectory, posed: Posed | str, before: Sequence[State] | None) -> tuple[Findings, list[State]]:
    """Judge the answer in the files, of a load step from the states `before`, which follow from the numbers as written
    and from perturbed ones; gives the states after it as well; collective.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others or the problem.
    """
    if isinstance(posed, str):
        return check_alone(files, posed), []
    comm, problems, there = posed.problem.comm, [posed.problem] * len(SEEDS), list[Any]()  # on rank 0

    def look() -> dict[str, Any]:
        contents, *compared = sound(files)
        there[:] = compared
        return contents

    contents = on_rank_0(comm, lambda: complete(files.path, look))
    posed.problem.small_strain = "warn" if posed.accepts(contents.get("step") or {}) else "enforce"
    if before is not None:
        number, time, then = contents["step"]["number"], contents["step"]["time"], before[0]
        if not then.time < time < math.inf or number != then.number + 1:
            raise ValueError(
                f"{files.summary}: is of step {number} to {time:g} s, but the step before, {then.number}, ends at "
                f"{then.time:g} s"
            )
        problems = [posed.problem.at(time, state) for state in before]
    answer, compared = WrittenAnswer(files, posed.problem), Comparison()
    answers = [answer.judged(problem, seed) for problem, seed in zip(problems, SEEDS, strict=True)]
    states = [posed.problem.after(state, one) for state, one in zip(before or (), answers, strict=False)]
    _compare_temperature(answers[0], compared)
    numbers = [numbers_of(one, contents, state) for one, state in zip_longest(answers, states)]
    grids = [grids_of(one, contents.get("error")) for one in answers]

    def compare() -> list[str]:
        """Compare what is in the files; gives the names of what was not compared."""
        written = fields_of(in_order(files.path, there[0], grids[0], answer.numbers))
        expected, *others = map(fields_of, grids)
        for tree, names in ((expected, COMPLIANCES), *((other, _EXACT) for other in others)):
            for grid in tree[CONTACT].values():
                for name in names:
                    grid.pop(name, None)
        bounds = expected[CONTACT].values() if SuccessiveTresca.name in str(contents.get("method")) else ()
        for grid in (grid for grid in bounds if "slip_bound" in grid):
            limit = _SLIP_BOUND + 10.0 * answers[0].certificate["natural residual"].value
            bound = grid["slip_bound"]
            grid["slip_bound"] = bound._replace(floor=limit * float(np.linalg.norm(bound.values)))
        for name in (CONTACT, SOLUTION):  # in a list that is cut
            compared.tree(there[1][name], problems[0].time, (), (name, WHOLE, "time"))
            compared.tree(written[name], expected[name], [other[name] for other in others], (name,))
        said = dict(contents)
        if "step" in said:  # `_compare_record` judges the case, `check_times` the rest
            apart = ("case", "pending", "halvings")
            said["step"] = {name: one for name, one in said["step"].items() if name not in apart}
            _compare_record(contents["step"].get("case"), posed.settings, compared)
        compared.tree(said, numbers[0], numbers[1:], (SUMMARY,))
        compare_error_bars(contents, compared)
        ours = [place for place in compared.left if place[0] == SOLUTION and place[-1] in OURS]
        compared.faults += [f"{in_files(place)}: is none of the case" for place in ours]
        return named([place for place in compared.left if place not in ours]) + unread(files)

    unjudged, faults = on_rank_0(comm, lambda: (complete(files.path, compare), compared.faults))
    taken = [] if contents.get("coulomb") == __version__ else [f"written by coulomb {contents.get('coulomb')}"]
    return Findings(contents, answers[0].certificate, answers[0].outside, faults, taken, unjudged), states


def _compare_record(record: Any, settings: Case | None, compared: Comparison) -> None:
    """Compare the case from which a load step was computed, if it is recorded, but for what may change between
    steps."""
    if record is None or settings is None:
        return
    place: Place = (SUMMARY, "step", "case")
    try:
        changed, _ = changes_of_case(record, settings, MPI.COMM_SELF)
    except ValidationError:
        changed = ["is none"]
    compared.faults += [f"{in_files(place)}: {text} in {CASE}" for text in changed]
    compared.left += [(*place, *key.split(".")) for key in FREE if key != "output"]
    compared.left += [(*place, "file")] * bool(record["files"])


def compare_error_bars(contents: Mapping[str, Any], compared: Comparison) -> None:
    """Compare the values that have error bars with the totals of the summary, and the bars with the sums of their
    parts, which are those of the run."""
    bars = {bar["quantity"]: bar for bar in (contents.get("error") or {}).get("bars", ())}
    if not bars:
        return
    totals = {name: value.tolist() for name, value, _ in totals_in(contents) if name in bars}
    said = {name: np.atleast_1d(bars[name]["value"]).tolist() for name in totals}
    compared.tree(said, totals, (), (f"{SUMMARY}: error",), ANSWER)
    with_parts = {name: bar for name, bar in bars.items() if "parts" in bar}  # none without an order
    sums = {name: sum(np.atleast_1d(part) for part in bar["parts"].values()) for name, bar in with_parts.items()}
    said = {name: np.atleast_1d(bar["error"]).tolist() for name, bar in with_parts.items()}
    whole = {name: np.asarray(of).tolist() for name, of in sums.items()}
    compared.tree(said, whole, (), (f"{SUMMARY}: error bar",), "its parts")


def _compare_temperature(answer: Solution, compared: Comparison) -> None:
    """Compare the temperature with that of conduction; collective."""
    heat, conduction = answer.heat, answer.problem.body.heat
    if heat is None or conduction is None:
        return
    try:
        expected = conduction.solve(*at_contact(answer), heat.change)
    except ValueError as error:  # on all ranks: these fix no temperature
        compared.faults.append(f"{SOLUTION}: {TEMPERATURE}: {error}")
        return
    x, floor = answer.problem.elasticity.x, _AGREEMENT * float(np.max(np.abs(heat.change), initial=0.0))
    compared.tree(Field(heat.change, x), Field(expected, x, floor), (), (SOLUTION, WHOLE, TEMPERATURE), _HEAT)
    if not heat.balanced:
        compared.faults.append(f"{SUMMARY}.heat: {heat.imbalance:.3g} W of {heat.power_in:.6g} W are missing")
    compared.faults = [fault for faults in answer.problem.comm.allgather(compared.faults) for fault in faults]
