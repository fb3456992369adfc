"""What a summary has beside the answer, if it is asked for: error bars of the mesh, and sensitivities to inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..case.case import Case
from ..case.scaled import NotScaled, inputs_in, lengths, scaled, single_numbers
from ..case.tolerances import called, number_at, place_of, tolerances
from ..io.error_bars import ComparisonHistories, error_of
from ..io.other_meshes import NoErrorBars, without_remarks
from ..linalg.reductions import Reductions
from ..model.load_history import StepFailed
from ..model.load_step import LoadStep
from ..model.problem import ContactProblem
from ..model.provenance import timed
from ..model.sensitivity import Posed, Sensitivity, why_no_others
from ..model.solution import Solution
from ..solvers.results import NotConverged
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
    warning says why not, once.  With `output.verify` each is compared with answers of the changed case, at the end."""

    def __init__(self, settings: Case):
        self._settings, self._tolerances = settings, list(tolerances(settings))
        self._asked, self._found = bool(settings.output.sensitivity), list[Sensitivity]()
        self._posed = dict[str, Posed]()
        self._known: dict[str, tuple[str, float]] | None = None

    def _choose(self, faces: Sequence[str]) -> None:
        """Which inputs are wanted: all, or those of a list and those with tolerances; those beside the inputs of the
        model are lengths, and places of numbers that are none of these alone."""
        wanted, there = self._settings.output.sensitivity, inputs_in(self._settings, faces)
        listed = () if isinstance(wanted, bool) else wanted
        given, lengths_there = [path for path, _ in self._tolerances], lengths(self._settings)
        places = [*given, *(path for name in listed if (path := place_of(self._settings, name)))]
        self._known = known = single_numbers(self._settings, there, places)
        names = [name for name in listed if not place_of(self._settings, name)]
        names += [known.get(called(path), (called(path),))[0] for path in places]
        self._only = frozenset(names).__contains__ if listed else None
        more = [called(path) for path in places if called(path) not in known]
        self._lengths = [name for name in lengths_there if not listed or name in names]
        self._others = [*self._lengths, *dict.fromkeys(more)]
        self._unsaid = [name for name in self._others if name in listed]

    def of(self, solution: Solution) -> dict[str, Any]:
        if not self._asked:
            return {}
        if self._known is None:
            self._choose(solution.problem.surface.faces)
        try:
            with timed(solution.problem.seconds, "sensitivity"):
                self._found = self._of(solution)
            entries = sensitivity_entries(self._found) | self._bars(solution)
        except ValueError as reason:
            errors.out(f"warning: output.sensitivity: {reason}")
            self._asked = False
            return {}
        history = self._settings.history
        if self._settings.output.verify and (history is None or solution.time >= history.ends[-1]):
            verify = TaylorTest(self._settings, solution)
            for one, entry in zip(self._found, entries["sensitivity"], strict=True):
                entry["verified"] = verdict = verify.of(one)
                if verdict["passed"] is False:
                    errors.out(f"warning: the sensitivity to {one.name}: {verdict['words']}")
        return entries

    def _of(self, solution: Solution) -> list[Sensitivity]:
        """With those to lengths of boxes and to numbers with tolerances that are no input by themselves, where they are
        known; a warning says why not."""
        without = why_no_others(solution.problem)
        others = {} if without else self._problems(solution.problem.comm)
        if without and self._unsaid:
            errors.out(f"warning: output.sensitivity: there is none to {', '.join(self._unsaid)}: {without}")
            self._unsaid = []
        try:
            return solution.sensitivities(self._found, others, self._only)
        except ValueError as reason:
            if not others:
                raise
            known = [] if self._others == self._lengths else self._lengths
            left = [name for name in self._others if name not in known]
            errors.out(f"warning: output.sensitivity: there is none to {', '.join(left)}: {reason}")
            self._others = known
            self._found = [one for one in self._found if one.name not in left]
            return self._of(solution)

    def _problems(self, comm: MPI.Comm) -> dict[str, Posed]:
        """Those of other inputs, posed once for all load steps."""

        def posed(name: str, factor: float) -> ContactProblem:
            with without_remarks():
                return scaled(self._settings, name, factor).problem(comm)

        self._posed |= {name: cache(partial(posed, name)) for name in self._others if name not in self._posed}
        return {name: self._posed[name] for name in self._others}

    def _bars(self, solution: Solution) -> dict[str, Any]:
        """Of summary.json, what tolerances make uncertain, and why some are not among them."""
        if not self._tolerances or not self._found:
            return {}
        named, parts, without = {one.name: one for one in self._found}, list[_Part](), dict[str, str]()
        known = self._known or {}
        for path, tolerance in self._tolerances:
            place = called(path)
            name, change = known.get(place, (place, number_at(self._settings, path) or tolerance))
            if name in named:
                parts.append((named[name], tolerance / abs(change)))
            elif place not in known:  # else it does nothing in this answer
                without[place] = why_no_others(solution.problem) or "it is none of the inputs"
        return {**input_bars(self._found, parts), "without_bar": without}


_FARTHEST: Final = 0.01
_NEAREST: Final = 1e-6
"""The change of an input by which its derivative is verified, of which half the step to the next border is taken; and
the least."""

_SECOND: Final = 1.8
"""Order of the remainder from which it counts as of second order."""

_ACCURACY: Final = 1e-10
_OF_ANSWER: Final = 1e-6
"""Tolerance of the answers compared, and remainder over what is compared up to which it is linear."""


class TaylorTest:
    """What answers of changed cases leave over of forces, displacements and heat flows after derivatives: it falls with
    the square of the change (P. E. Farrell et al., Automated derivation of the adjoint of high-level transient finite
    element programs, SIAM J. Sci. Comput. 35, 2013, section on verification)."""

    def __init__(self, settings: Case, like: Solution):
        self._settings, self._like, self._over = settings, like, Reductions(like.problem.comm)

    def of(self, one: Sensitivity) -> dict[str, Any]:
        """The entry `verified` of one of its sensitivities: whether it passed, None if it was not tested, and words."""
        h = min(_FARTHEST, 0.5 * one.step)
        if h < _NEAREST:
            return {"passed": None, "words": "not verified: a contact point changes its state too soon"}
        powers = [flow["power"] for flow in one.others.get("heat_flows", {}).values()]
        left, along = list[float](), (one.contact_force, one.displacement.ravel(), self._once(powers))
        try:
            for change in (h, 0.5 * h):
                after = self._answer(scaled(self._settings, one.name, 1.0 + change))
                if self._over.any(after[0].shape != one.contact_force.shape):
                    return {"passed": None, "words": "not verified: other nodes become contact points"}
                each = zip(after, self._before, along, strict=True)
                parts = [self._over.norm(x - y - change * z) / (self._over.norm(x) or 1.0) for x, y, z in each]
                left.append(math.hypot(*parts))
        except NotScaled as reason:
            return {"passed": None, "words": f"not verified: {reason}"}
        except (NotConverged, StepFailed) as failure:
            return {"passed": None, "words": f"not verified: {failure}"}
        of_answer, percent = left[0], f"{100.0 * h:.2g} %"
        order = math.log2(left[0] / left[1]) if left[1] > 0.0 else math.inf
        test = {"change": h, "remainder": of_answer, "order": order if math.isfinite(order) else None}
        if of_answer <= _OF_ANSWER:
            return {**test, "passed": True, "words": f"verified: linear to {of_answer:.0e} up to {percent}"}
        what = "forces, displacements and heat flows" if powers else "forces and displacements"
        words = f"{of_answer:.1e} of {what} is left over at {percent}, of order {order:.2f}"
        passed = order >= _SECOND
        return {**test, "passed": passed, "words": f"{'verified' if passed else 'NOT VERIFIED'}: {words}"}

    @cached_property
    def _before(self) -> tuple[FloatArray, ...]:
        """Those of the case as it is, as accurately as those of the changed ones."""
        return self._answer(self._settings)

    def _answer(self, case: Case) -> tuple[FloatArray, ...]:
        """Contact forces, displacements and heat flows of a case at the time of the answer."""
        tolerance = min(case.solver.tolerance, _ACCURACY)
        with without_remarks():
            problem = case.problem(self._like.problem.comm)
            if case.history is None:
                answer = problem.solve(tolerance, case.contact_solver())
            else:
                *_, last = replace(case.load_history(), tolerance=tolerance).steps(problem)
                answer = last.solution
            powers = [] if answer.heat is None else [flow.power for flow in answer.heat.flows]
            return answer.contact_force, answer.displacement.ravel(), self._once(powers)

    def _once(self, shared: Sequence[float]) -> FloatArray:
        """What every rank has, on one of them."""
        return np.array(shared if self._over.comm.rank == 0 else [])


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


def _entry(one: Sensitivity) -> dict[str, Any]:
    step = one.step if np.isfinite(one.step) else None
    return {"input": one.name, "totals": one.totals, **one.others, "step": step, "border": one.border}


def sensitivity_entries(sensitivities: Sequence[Sensitivity]) -> dict[str, Any]:
    """Of summary.json: `sensitivity`, where a step without end is null, and `sensitivity_condition`."""
    return {
        "sensitivity_condition": sensitivities[0].condition._asdict() if sensitivities else None,
        "sensitivity": [
            {**_entry(one), "falling": _entry(one.falling)} if one.falling else _entry(one) for one in sensitivities
        ],
    }


_Part = tuple[Sensitivity, float]
"""An input, and its tolerance over it."""


def input_bars(sensitivities: Sequence[Sensitivity], parts: Sequence[_Part]) -> dict[str, Any]:
    """Of summary.json: `input_bars` of contacts and `other_input_bars`, the root of the sum of the squares of what the
    tolerance of each input does to the totals, on the side where it does more."""
    bars = parts or [(sensitivities[0], 0.0)]
    each = [(one, one.falling or one) for one, _ in bars]

    def together(given: list[Any]) -> Any:
        by_input = [part * np.abs(value).max(axis=0) for (_, part), value in zip(bars, given, strict=True)]
        return np.linalg.norm(by_input, axis=0).tolist()

    return {
        "input_bars": {
            face: {
                total: together([[side.totals[face][total] for side in sides] for sides in each]) for total in totals
            }
            for face, totals in sensitivities[0].totals.items()
        },
        "other_input_bars": {
            kind: {
                name: {
                    total: together([[side.others[kind][name][total] for side in sides] for sides in each])
                    for total, value in totals.items()
                    if value is not None
                }
                for name, totals in named.items()
            }
            for kind, named in sensitivities[0].others.items()
            if all(kind in one.others for one, _ in bars)  # probes have none along lengths
        },
    }
