"""Quasi-static load steps: friction that remembers.

Coulomb's law speaks of the rate of slip.  In the step from t0 to t1 it is the slip increment that counts (backward
Euler): a node has slipped by u_t(t1) - u_t(t0) less the way of the foundation, and friction points against that.  So a
step is a problem like any other, with `ContactProblem.slip_origin` at what the step before has left.

Energy, of every step and added up.  Loads, reactions and foundation do work; it is kept as elastic energy or dissipated
by friction.  Elastic energy is exact, and so, by the trapezoidal rule, is all work together, since the stress is linear
in u.  What friction dissipates is taken by the law, x_t . slip >= 0, with the friction of the end of the step; the
difference, the `imbalance`, is the error of finite steps and falls with their size.

A step that fails is halved.  Everything is on disk before the next step begins: a run that was killed continues with
the same numbers (`coulomb resume`), on as many ranks as one likes.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..io import output
from ..io.history_summary import Told, added, whole
from ..io.lock import locked
from ..io.restart import nodal_vectors, read_step, read_summary, steps_in
from ..ranks import on_rank_0
from ..solvers.coulomb import CoulombSolver
from ..solvers.results import NotConverged, ProgressCallback, Status
from ..solvers.tresca import QPSolver
from .certificate import certify
from .load_step import Energy, LoadStep, State
from .problem import ContactProblem
from .solution import Solution
from .times import HALVINGS, refuse_times

SMALLEST = 1e-9
"""Step, as a part of the whole history, under which halving ends."""


@dataclass(frozen=True)
class LoadHistory:
    """Load steps from `start` to the last of `times`, as a value.

    At `start` the body is free of displacement, stress and slip.

    Attributes:
        times: Ends of the steps, increasing, after `start`.
        start: Where the history begins.
        tolerance: Residual at which a step is solved.
        solver: In place of the default, as for `ContactProblem.solve`.
        halvings: How often the interval of a step that fails may be halved.

    Raises:
        ValueError: If the times do not increase.
    """

    times: Sequence[float]
    start: float = 0.0
    tolerance: float = 1e-8
    solver: CoulombSolver | QPSolver | None = None
    halvings: int = HALVINGS

    def __post_init__(self) -> None:
        refuse_times(self.start, self.times)
        if self.halvings < 0:
            raise ValueError(f"history: halvings must be at least 0, but is {self.halvings}")

    def beginning(self, problem: ContactProblem) -> State:
        """The state at `start`."""
        zero = np.zeros_like(problem.elasticity.x)
        return State(0, self.start, zero, zero, Energy(), tuple(reversed([float(t) for t in self.times])))

    def steps(
        self, problem: ContactProblem, state: State | None = None, progress: ProgressCallback | None = None
    ) -> Iterator[LoadStep]:
        """One step after another, from a state (by default from the beginning); collective.

        Raises:
            StepFailed: If a step fails however often it is halved, or is interrupted.
        """
        state = state or self.beginning(problem)
        halved = 0
        while state.pending:
            time = state.pending[-1]
            try:
                solution = self._attempt(problem, state, time, progress)
            except NotConverged as failure:
                posed = self._posed(problem, state, time)
                if failure.result.status is Status.INTERRUPTED:
                    text = f"interrupted in the load step from {state.time:g} s to {time:g} s, which is given up"
                    raise StepFailed(text, failure.result, posed) from None
                middle = 0.5 * (state.time + time)
                halved += 1
                if halved > self.halvings or time - state.time < 2.0 * SMALLEST * (self.times[-1] - self.start):
                    interval = f"from {state.time:g} s to {time:g} s"
                    text = f"the load step {interval} failed, halved {halved - 1} times: {failure}"
                    raise StepFailed(text, failure.result, posed) from None
                state = replace(state, pending=(*state.pending, middle))
                continue
            # Judged from what the step before has left, not from the slip origin that the solver was given.
            judged = certify(solution.problem, solution.contact_force, solution.displacement, state)
            solution = replace(solution, certificate=judged)
            state = state.after(solution)
            yield LoadStep(solution, state, halved)
            halved = 0

    def _posed(self, problem: ContactProblem, state: State, time: float) -> ContactProblem:
        """The step from a state to a time, as a problem."""
        moved = problem.motions_at(time) - problem.motions_at(state.time)
        surface = problem.surface
        return problem.at(time, state.displacement[surface.nodes] + moved[surface.part])

    def _attempt(
        self, problem: ContactProblem, state: State, time: float, progress: ProgressCallback | None
    ) -> Solution:
        posed = self._posed(problem, state, time)
        start = None
        if posed.coulomb and state.number > 0:  # from the forces before, in the frames of now
            start = -posed.surface.components(state.on_body[posed.surface.nodes]).ravel()
        return posed.solve(self.tolerance, self.solver, progress, start)

    def run(
        self,
        problem: ContactProblem,
        directory: str | Path,
        *,
        resume: bool = False,
        progress: ProgressCallback | None = None,
        on_step: Callable[[LoadStep], bool | None] | None = None,
        record: Mapping[str, Any] | None = None,
    ) -> list[dict[str, Any]]:
        """Take all steps, and write each of them before the next.

        DIRECTORY/steps/0001, 0002, ... have the results of a step as a single run would write them;
        DIRECTORY/solution.xdmf and contact.xdmf show them as time series; history.csv has a line for each.

        Args:
            problem: The problem; its own time does not matter.
            directory: Where to.
            resume: Continue from the last step that is there.
            progress: Called after every path-following step.
            on_step: Called after every load step, once it is on disk; a true answer, the same on every rank, ends it.
            record: What is being computed, kept in the summary of every step under step.case (`case_record`).

        Returns:
            The lines of history.csv.

        Raises:
            ValueError: On every rank, if there are steps and `resume` is not asked for, or they do not fit, or another
                run is at work in the directory.
            StepFailed: As `steps`; all steps before are kept.
        """
        with locked(directory, problem.comm):
            return self._run(problem, Path(directory), resume, progress, on_step, record)

    def _run(
        self,
        problem: ContactProblem,
        folder: Path,
        resume: bool,
        progress: ProgressCallback | None,
        on_step: Callable[[LoadStep], bool | None] | None,
        record: Mapping[str, Any] | None,
    ) -> list[dict[str, Any]]:
        comm = problem.comm
        found = comm.bcast(steps_in(folder) if comm.rank == 0 else None)
        if not resume:
            refuse_steps(folder, len(found))
        state = self.beginning(problem)
        told = [read_summary(folder / "steps" / f"{number:04d}", comm) for number in found]
        rows, history = [summary["step"]["row"] for summary in told], whole(told)
        if found:
            state = restored(problem, folder, found[-1])
        for step in self.steps(problem, state, progress):
            target = folder / "steps" / f"{step.state.number:04d}"
            rows.append(step.row)
            if len(rows) == len(found) + 1:  # assembly and factorisation, done once, are in the seconds of this step
                _add(problem.seconds, to=step.solution.problem.seconds)
            extra = {"step": _record(step, rows[-1], record)}
            contents = output.write(step.solution, target, picture=False, extra=extra)
            history = added(history, contents)
            _write_series(folder, rows, {"start": self.start, **history}, contents, comm)
            if on_step is not None and on_step(step):
                break
        return rows


class StepFailed(NotConverged):
    """NotConverged of a load step, with the problem that it posed."""

    def __init__(self, message: str, result: Any, problem: ContactProblem):
        super().__init__(message, result)
        self.problem = problem


def refuse_steps(folder: Path, found: int) -> None:
    """Not to begin a history where another one is.

    Raises:
        ValueError: If there are load steps.
    """
    if found:
        raise ValueError(
            f"{folder} already holds {found} load steps: continue with `coulomb resume {folder}`, remove it, "
            "or choose another directory"
        )


# --- on disk -----------------------------------------------------------------------------------------------------


def restored(problem: ContactProblem, folder: Path, number: int) -> State:
    """The state that a step has left, from its files; collective.

    Raises:
        ValueError: On every rank, if the files cannot be read or belong to another mesh.
    """
    step = folder / "steps" / f"{number:04d}"
    record = read_step(step, problem.comm)
    x = problem.elasticity.x
    return State(
        number=number,
        time=record["time"],
        displacement=nodal_vectors(step / "solution.h5", "displacement", x, problem.comm),
        on_body=nodal_vectors(step / "contact.h5", "contact_force", x, problem.comm, elsewhere=0.0),
        energy=Energy(**record["energy"]),
        pending=tuple(record["pending"]),
    )


def _record(step: LoadStep, row: dict[str, Any], of: Mapping[str, Any] | None) -> dict[str, Any]:
    """What summary.json of a step keeps for going on."""
    state = step.state
    case = {} if of is None else {"case": dict(of)}
    return {
        **case,
        "number": state.number,
        "time": state.time,
        "halvings": step.halvings,
        "energy": asdict(state.energy),
        "pending": list(state.pending),
        "row": row,
    }


def _add(seconds: dict[str, float], to: dict[str, float]) -> None:
    for name, value in seconds.items():
        to[name] = to.get(name, 0.0) + value


def _write_series(
    folder: Path, rows: list[dict[str, Any]], history: Told, last: dict[str, Any], comm: MPI.Comm
) -> None:
    """What speaks of all steps so far; collective.

    Raises:
        OSError: On every rank, if it cannot be written.
    """
    on_rank_0(comm, lambda: _series(folder, rows, history, last))


def _series(folder: Path, rows: list[dict[str, Any]], history: Told, last: dict[str, Any]) -> str:
    """history.csv, the time series over the steps' own files, and the summary, replaced whole."""
    partial = folder / ".history.csv"
    with partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    os.replace(partial, folder / "history.csv")
    for name in ("solution.xdmf", "contact.xdmf"):
        output.write_series(folder, name, [(f"steps/{row['step']:04d}", row["time"]) for row in rows])
    contents = {
        "steps": len(rows),
        "time": rows[-1]["time"],
        "certificate": {"passed": all(row["certified"] for row in rows)},
        "valid": all(row["valid"] for row in rows),
        "history": history,
        "last": last,
    }
    output.write_json(contents, folder / "summary.json")
    return ""
