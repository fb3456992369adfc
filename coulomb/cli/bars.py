"""What a summary has beside the answer, if it is asked for: error bars of the mesh, and sensitivities to inputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..case.case import Case
from ..io.error_bars import ComparisonHistories, error_of
from ..io.other_meshes import NoErrorBars
from ..model.load_step import LoadStep
from ..model.problem import ContactProblem
from ..model.provenance import timed
from ..model.sensitivity import Sensitivity, sensitivity_entries
from ..model.solution import Solution
from .console import errors
from .session import Session
from .terminal import Display


def bars_of_steps(session: Session, settings: Case, problem: ContactProblem) -> Callable[[LoadStep], dict[str, Any]]:
    """Gives the entry `error` of the summary of a load step, if they are asked for; a warning says once why not."""
    said = set[str]()

    def without(reason: NoErrorBars) -> dict[str, Any]:
        if str(reason) not in said:
            errors.out(f"warning: no error bars: {reason}")
        said.add(str(reason))
        return {}

    if not settings.output.error:
        return lambda _: {}
    try:
        progress = session.progress(Display(session.console, changing=True))
        companions = ComparisonHistories(problem, settings.load_history(), settings.solver.tolerance, progress)
    except NoErrorBars as reason:
        without(reason)
        return lambda _: {}

    def bars(step: LoadStep) -> dict[str, Any]:
        try:
            with timed(step.solution.problem.seconds, "error bars"):
                return {"error": companions.error_of(step).entry()}
        except NoErrorBars as reason:
            return without(reason)

    return bars


class Sensitivities:
    """Gives the entries of sensitivities in the summary of one load step after the other, if they are asked for; a
    warning says why not, once."""

    def __init__(self, settings: Case):
        self._asked, self._found = settings.output.sensitivity, list[Sensitivity]()

    def of(self, solution: Solution) -> dict[str, Any]:
        if not self._asked:
            return {}
        try:
            with timed(solution.problem.seconds, "sensitivity"):
                self._found = solution.sensitivities(self._found)
            return sensitivity_entries(self._found, self._asked)
        except ValueError as reason:
            errors.out(f"warning: output.sensitivity: {reason}")
            self._asked = False
            return {}


def error_bars(session: Session, settings: Case, solution: Solution) -> dict[str, Any]:
    """The entry `error` of summary.json; without it, and a warning, if there are none."""
    display = Display(session.console, changing=True)
    try:
        with display, timed(solution.problem.seconds, "error bars"):
            solver, progress = settings.contact_solver(), session.progress(display)
            return {
                "error": error_of(
                    solution, tolerance=settings.solver.tolerance, solver=solver, progress=progress
                ).entry()
            }
    except NoErrorBars as reason:
        errors.out(f"warning: no error bars: {reason}")
        return {}
