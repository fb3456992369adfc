"""Quasi-static load steps with path-dependent friction.

Coulomb's law is a condition on the slip rate.  A step from t0 to t1 takes the slip increment (backward Euler): the
change of the tangential displacement less the foundation's displacement; friction is opposite to it.  So a step is a
contact problem with `ContactState.slip_origin` at the displacement after the step before.

Energies are summed over the steps.  Loads, reactions and the foundation do work, which becomes elastic energy or is
dissipated by friction.  Elastic energy is exact, and so is the sum of all work by the trapezoidal rule, since the
stress is linear in u.  Dissipation is taken by the law, x_t . slip >= 0, with the mean of the bounds of friction at
both ends of the step (`NodalAnswer.friction_work`); the difference, the `imbalance`, is the error of the time
discretisation and falls with the step size.

The slip of a node that comes to touch within a step counts over the whole of it: an error of first order in the size of
the steps.  With `friction_error` each step is also taken in two halves, and again in halves of
these, until friction no longer depends on it (step doubling: Hairer, Norsett and Wanner, Solving ODEs I, II.4).

A step that fails is halved.  A `Recorder` receives the steps: `coulomb.HistoryFiles` writes each before the next
begins, and an interrupted history resumes with the same figures, to the solution's tolerance, on any number of ranks.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Protocol

import numpy as np

from ..fem.geometry import on_every_rank, same_on_all_ranks
from ..solvers.automatic import Automatic
from ..solvers.friction_problem import Solver
from ..solvers.results import NotConverged, ProgressCallback, SolverResult, Status
from ..solvers.semismooth_newton import SemismoothNewton
from . import notebook
from .certificate import judge, settled_to
from .equilibrium import NoEquilibrium
from .iterate import linearised
from .load_step import LoadStep, friction_change
from .notebook import NotebookBar, in_notebook
from .problem import ContactProblem
from .solution import Solution
from .solving import LinearSolveFailed
from .state import State
from .times import HALVINGS, in_times, refuse_missed, refuse_times

_log = logging.getLogger(__name__)

SMALLEST: Final = 1e-9
"""Smallest step as a fraction of the whole history; below it a step is not halved."""

_GROWS: Final = 0.4
"""Part of its error at which the next step is taken twice as long: the error per length doubles with the length."""


@dataclass(frozen=True)
class LoadHistory:
    """Load steps from `start` to the last of `times`.

    At `start` displacement, stress and slip are zero.

    Attributes:
        times: Ends of the steps, increasing, after `start`.
        start: Start time of the history.
        tolerance: Residual at which the solver of a step stops.
        solver: Replaces the default, as for `ContactProblem.solve`.
        halvings: Maximum number of halvings of a step.
        friction_error: Error of friction by the size of the steps that is aimed at (`State.friction_error`): each step
            is taken in halves, and these again, until halving it changes friction by at most its part of that, which is
            its part of the history or of the normal forces that come in it, whichever is larger.  By default steps
            are as given, and the error is not known.

    Raises:
        ValueError: If the times do not increase, or a number is out of range.

    Examples:
        A block is pressed, then pulled by its end face: friction is 0.3 times the normal force when it slides.

        >>> import coulomb
        >>> loads = [
        ...     coulomb.TotalForce("top", (0.0, 0.0, -1000.0), amplitude=[(0.0, 0.0), (1.0, 1.0)]),
        ...     coulomb.PrescribedDisplacement("right", (1e-3, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), (2.0, 1.0)]),
        ... ]
        >>> mesh = coulomb.box((0.1, 0.1, 0.05), (4, 4, 2))
        >>> block = coulomb.ContactProblem(
        ...     mesh, coulomb.Material(2.1e11, 0.3), loads[1:], coulomb.Contact("bottom", 0.3), loads[:1]
        ... )
        >>> for step in coulomb.LoadHistory([1.0, 2.0]).steps(block):
        ...     print(step.state.time, step.solution.force_on_body[:, [0, 2]].sum(axis=0).round(1))
        1.0 [ 119.1 1000. ]
        2.0 [-300. 1000.]
    """

    times: Sequence[float]
    start: float = 0.0
    tolerance: float = 1e-8
    solver: Solver | None = None
    halvings: int = HALVINGS
    friction_error: float | None = None

    def __post_init__(self) -> None:
        refuse_times(self.start, self.times)
        if self.halvings < 0:
            raise ValueError(f"history: halvings must be at least 0, but is {self.halvings}")
        if self.friction_error is not None and not 0.0 < self.friction_error < 1.0:
            raise ValueError(f"history: friction_error must be between 0 and 1, but is {self.friction_error!r}")

    def beginning(self, problem: ContactProblem) -> State:
        """The state at `start`."""
        pending = tuple(reversed([float(t) for t in self.times]))
        return State.beginning(self.start, len(problem.elasticity.x), len(problem.points_of_states.nodes), pending)

    def steps(
        self, problem: ContactProblem, state: State | None = None, progress: ProgressCallback | None = None
    ) -> Iterator[LoadStep]:
        """Compute the steps one by one, from a state (by default from the beginning); collective.

        Raises:
            ValueError: On every rank, before the first step, if an amplitude or a motion has no value at the end.
            StepFailed: If a step fails after all halvings, or is interrupted.
        """
        state = state or self.beginning(problem)
        state = replace(state, friction_error=self.friction_error and (state.friction_error or 0.0))
        if state.pending:
            problem.body.refuse_undefined(state.pending[0])
            problem.refuse_wrong_supports(state.pending[::-1])
            refuse_missed(problem.elasticity.limits, state.time, state.pending)
        problem.body.stiffness.expect_load_steps(len(state.pending))
        halved, why, length = 0, "", math.inf
        known: Solution | None = None
        bar = NotebookBar() if progress is None and in_notebook() and problem.comm.rank == 0 else None
        if in_notebook():  # one bar for all steps
            progress = progress or (lambda _: None)
        same_on_all_ranks({"history": self}, problem.comm)
        while state.pending:
            time = state.pending[-1]
            while time - state.time > (1.0 + SMALLEST) * length:
                time = 0.5 * (state.time + time)
                state, halved, known = replace(state, pending=(*state.pending, time)), halved + 1, None
            middle = 0.5 * (state.time + time)
            if bar is not None:
                share = (state.time - self.start) / (self.times[-1] - self.start)
                bar.show(share, f"load step {state.number + 1} to {time:g} s")
            try:
                solution = known or self._attempt(problem, state, time, progress)
            except NotConverged as failure:
                posed = self._posed(problem, state, time)
                self._refuse_interrupted(failure, state, posed)
                if isinstance(failure, NoEquilibrium | LinearSolveFailed):  # smaller steps do not help
                    text = f"the load step from {state.time:g} s to {time:g} s failed: {failure}"
                    raise StepFailed(text, failure.result, posed) from None
                if not self._may_end(state, middle):
                    if problem.large is not None and problem.large.damps():
                        if problem.comm.rank == 0:
                            _log.warning("load step from %g s to %g s damped: %s", state.time, time, failure)
                        continue
                    interval = f"from {state.time:g} s to {time:g} s"
                    depth = round(math.log2(self._whole(time) / (time - state.time)))
                    after = f", halved {in_times(depth)}" if depth else ""
                    text = f"the load step {interval} failed{after}: {failure}"
                    raise StepFailed(text, failure.result, posed) from None
                if problem.comm.rank == 0:
                    _log.warning("load step from %g s to %g s halved: %s", state.time, time, failure)
                state = replace(state, pending=(*state.pending, middle))
                halved, why = halved + 1, str(failure)
                continue
            known, taken = None, list[LoadStep]()
            if self.friction_error is not None and self._may_end(state, middle):
                halves = replace(state, pending=(*state.pending, middle))
                new = state.new_part(problem.points_of_states.places(solution.problem.surface), solution.at_nodes)
                most = self.friction_error * max((time - state.time) / (self.times[-1] - self.start), new)
                try:
                    pair = self._in_halves(problem, halves, progress)
                except NotConverged as failure:  # the error is not known
                    self._refuse_interrupted(failure, state, self._posed(problem, state, time))
                else:
                    error = friction_change(solution.at_nodes, pair[1].solution.at_nodes)
                    halved, why = halved + 1, f"friction changes by {error:.2g}"
                    if error > most and self._may_end(state, 0.5 * (state.time + middle)):
                        state, known = halves, pair[0].solution
                        continue
                    length = (2.0 if error <= _GROWS * most else 1.0) * (time - state.time)
                    ends = [
                        replace(one.state, friction_error=(one.state.friction_error or 0.0) + part * error)
                        for one, part in zip(pair, (0.5, 1.0), strict=True)
                    ]
                    taken = [
                        replace(pair[0], state=ends[0], halvings=halved, why_halved=why),
                        replace(pair[1], state=ends[1]),
                    ]
            for step in taken or [self._completed(problem, state, solution, halved, why)]:
                if taken:
                    _present(problem, step.solution)
                state = step.state
                if problem.comm.rank == 0:
                    passed = "passed" if step.solution.certificate.passed else "FAILED"
                    _log.info("load step %d to %g s: certificate %s", state.number, state.time, passed)
                if bar is not None and not state.pending:
                    bar.show(1.0, f"{state.number} load steps")
                yield step
            halved, why = 0, ""

    def _completed(
        self, problem: ContactProblem, state: State, solution: Solution, halved: int = 0, why: str = ""
    ) -> LoadStep:
        """The step from a state that a solution is of; collective."""
        if problem.large is not None:
            problem.large.damped = False
        # Slip is measured from the state before, independently of the slip origin given to the solver.
        if solution.problem.before is not state:
            evidence = solution.problem.evidence(solution.contact_force, solution.displacement, state)
            evidence, certificate = settled_to(evidence, judge(evidence), solution.result.unsettled)
            solution = replace(solution, evidence=evidence, certificate=certificate)
        return LoadStep(solution, problem.after(state, solution), halved, why)

    def _in_halves(self, problem: ContactProblem, state: State, progress: ProgressCallback | None) -> list[LoadStep]:
        """The next two steps from a state; collective."""
        steps = list[LoadStep]()
        for time in state.pending[:-3:-1]:
            steps.append(self._completed(problem, state, self._attempt(problem, state, time, progress)))
            state = steps[-1].state
        return steps

    @staticmethod
    def _refuse_interrupted(failure: NotConverged, state: State, posed: ContactProblem) -> None:
        if failure.result.status is Status.INTERRUPTED:
            text = f"interrupted in the load step from {state.time:g} s to {posed.time:g} s, which is discarded"
            raise StepFailed(text, failure.result, posed) from None

    def _may_end(self, state: State, time: float) -> bool:
        """Whether a step from a state may end at a time, the middle of a longer one."""
        least = max(self._whole(time) * 0.5**self.halvings, SMALLEST * (self.times[-1] - self.start))
        return time - state.time >= (1.0 - SMALLEST) * least

    def _whole(self, time: float) -> float:
        """Length of the load step in `times` that contains a time."""
        ends = [self.start, *self.times]
        number = min(int(np.searchsorted(ends, time)), len(self.times))
        return float(ends[number] - ends[number - 1])

    def _repr_html_(self) -> str:
        rows = [(len(self.times), self.start, self.times[-1], self.tolerance, self.halvings)]
        return notebook.table(
            ("load steps", "from (s)", "to (s)", "tolerance", "halvings at most"), rows, "load history"
        )

    def _posed(self, problem: ContactProblem, state: State, time: float) -> ContactProblem:
        """The step from a state to a time, as a problem."""
        return problem.at(time, state)

    def _attempt(
        self, problem: ContactProblem, state: State, time: float, progress: ProgressCallback | None
    ) -> Solution:
        posed = self._posed(problem, state, time)
        starts = posed.starts(state)
        if starts is not None and self.solver is not None and not isinstance(self.solver, Automatic | SemismoothNewton):
            starts = starts[0]
        return posed.solve(self.tolerance, self.solver, progress, starts)

    def run(
        self,
        problem: ContactProblem,
        recorder: Recorder,
        *,
        progress: ProgressCallback | None = None,
        on_step: Callable[[LoadStep], bool | None] | None = None,
    ) -> None:
        """Take all steps, each of them recorded before the next begins; collective.

        Args:
            problem: The problem; its own time does not matter.
            recorder: Receives the steps: `coulomb.HistoryFiles(directory)`, or an object of the user.
            progress: Called after every path-following step.
            on_step: Called after every load step, once it is recorded; a true return value, the same on every rank,
                ends it.

        Raises:
            ValueError: On every rank, if the recorder cannot begin.
            StepFailed: As `steps`; all steps before are recorded.
        """
        with recorder.recording(problem, self.beginning(problem)) as state:
            for step in self.steps(problem, state, progress):
                recorder.record(step)
                if on_step is None:
                    continue
                if any(on_every_rank(partial(on_step, step), "on_step", problem.comm)):
                    break


class Recorder(Protocol):
    """Stores the steps of a load history as they are computed, on disk or elsewhere."""

    def recording(self, problem: ContactProblem, beginning: State) -> AbstractContextManager[State]:
        """Open for the steps of a problem; collective.

        Args:
            beginning: The state from which a new history begins.

        Returns:
            The state from which to continue: `beginning`, or that of the last recorded step.
        """
        ...

    def record(self, step: LoadStep) -> None:
        """Store a step; collective."""
        ...


class StepFailed(NotConverged):
    """NotConverged of a load step, with the problem that it posed."""

    def __init__(self, message: str, result: SolverResult, problem: ContactProblem):
        super().__init__(message, result)
        self.problem = problem


def _present(problem: ContactProblem, solution: Solution) -> None:
    """Let the user's functions and coefficients be those of an answer again; collective."""
    if problem.large is None:
        solution.problem.elasticity.at_time(solution.problem.time)
    else:
        linearised(problem.elasticity, solution.displacement, solution.problem.time)
