"""The list of loads, supports and contact pairs as they were understood, printed before the solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console

from ..arrays import FloatArray
from ..case.case import Case
from ..model.input_summary import contacts_of, loads_of, supports_of
from ..model.problem import ContactProblem
from .console import bad_input
from .terminal import law_in_words, metres

_MOST = 5
"""Lines of loads, of supports, and of contact pairs; the summary has all."""


def show_understood(console: Console, settings: Case, problem: ContactProblem) -> None:
    """Print a line per load, support and contact pair; collective."""
    history = settings.history
    times = [problem.time] if history is None else [float(time) for time in history.ends]
    with bad_input():
        loads = loads_of(problem, times)
    _print(
        console,
        "load",
        [
            f"{load.what}{'' if history is None else f', largest at {load.time:g} s'}: force {_vector(load.force)} N, "
            f"moment about the origin {_vector(load.moment)} N m"
            for load in loads
        ],
    )
    _print(console, "support", [f"{one['kind']} on {one['face']!r}: {one['holds']}" for one in supports_of(problem)])
    _print(console, "contact", [_contact(one) for one in contacts_of(problem)])


def _contact(one: dict[str, Any]) -> str:
    gap, given = _range(one["gap"]), ""
    if any(one["given_gap"].values()):
        times = " times its amplitude" if "gap amplitude" in one["moves"] else ""
        given = f", of which given {_range(one['given_gap'])}{times}"
    moves = f", moves by {one['moves']}" if one["moves"] else ""
    return f"{one['face']!r}: {one['nodes']} nodes, {law_in_words(one)}, gap {gap}{given}; {one['foundation']}{moves}"


def _range(values: dict[str, float]) -> str:
    """In metres, one number if all are the same."""
    low, high = values["min"], values["max"]
    return metres(low) if high - low <= 1e-9 * max(abs(low), abs(high)) else f"{metres(low)} to {metres(high)}"


def _print(console: Console, what: str, lines: Sequence[str]) -> None:
    for line in lines[:_MOST]:
        console.print(f"{what:<8} {line}", markup=False, soft_wrap=True)
    if len(lines) > _MOST:
        console.print(f"{what:<8} and {len(lines) - _MOST} more, in summary.json", markup=False, soft_wrap=True)


def _vector(values: FloatArray) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"
