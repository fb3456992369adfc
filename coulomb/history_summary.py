"""The numbers of a whole load history, from the summaries of its steps: the entry `history` of its summary.json.

A step's summary speaks of that step alone: its iterations, its seconds, its largest pressure, the slip since the step
before.  Here iterations and seconds are sums over all steps; pressures, slips, residuals and the measures of the
certificate are the largest of all steps, each with the step and the time where it was found; energies count from the
start of the history.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import reduce
from typing import Any

from .small_strain import SmallStrain

Told = dict[str, Any]


def whole(steps: Iterable[Mapping[str, Any]]) -> Told:
    """What the summaries of all steps, in their order, say together; empty of none."""
    return reduce(added, steps, {})


def added(before: Told, step: Mapping[str, Any]) -> Told:
    """The history with one step more.

    Args:
        before: What the steps before say together; empty before the first.
        step: summary.json of the step.
    """
    record = step["step"]
    where = {"step": record["number"], "time": record["time"]}
    most = {**step["maximum"], "slip_in_a_step": step["totals"]["greatest_slip"]}
    strain = {field.name: step["small_strain"][field.name] for field in fields(SmallStrain)}
    largest_strain = _largest_of(before.get("small_strain", {}), strain, where)
    return {
        "steps": before.get("steps", 0) + 1,
        "certified_steps": before.get("certified_steps", 0) + bool(step["certificate"]["passed"]),
        "halvings": before.get("halvings", 0) + record["halvings"],
        "iterations": _sum(before.get("iterations", {}), step["iterations"]),
        "energy": {name: record["row"][f"energy_{name}"] for name in (*record["energy"], "imbalance")},
        "maximum": _largest_of(before.get("maximum", {}), most, where),
        "residual": _larger(before.get("residual"), {"value": step["residual"], **where}),
        "certificate": _certificate(before.get("certificate", {}), step["certificate"], where),
        "small_strain": largest_strain,
        "warnings": _warnings(largest_strain),
        "seconds": _sum(before.get("seconds", {}), step["seconds"]),
        "peak_memory_bytes": max(before.get("peak_memory_bytes", 0), step["peak_memory_bytes"]),
        "runs": _runs(before.get("runs", []), step.get("run"), record["number"]),
    }


def _sum(before: Mapping[str, float], step: Mapping[str, float]) -> Told:
    return {name: before.get(name, 0) + step.get(name, 0) for name in dict.fromkeys([*before, *step])}


def _number(value: float | None) -> float:
    """Files have null where a number is not finite: worse than every other."""
    return math.inf if value is None or math.isnan(value) else value


def _larger(before: Told | None, now: Told) -> Told:
    """The larger value; the earlier one of equals."""
    return now if before is None or _number(now["value"]) > _number(before["value"]) else before


def _largest_of(before: Mapping[str, Told], now: Mapping[str, float], where: Told) -> Told:
    return {name: _larger(before.get(name), {"value": value, **where}) for name, value in now.items()}


def _certificate(before: Mapping[str, Told], now: Mapping[str, Any], where: Told) -> Told:
    """Of every condition the worst step; it has passed if it has at every step."""
    worst: Told = {}
    for name, check in now.items():
        if not isinstance(check, Mapping):
            continue
        found = _larger(before.get(name), {**check, **where})
        worst[name] = {**found, "passed": bool(check["passed"]) and before.get(name, check)["passed"]}
    return {**worst, "passed": bool(now["passed"]) and before.get("passed", True)}


def _warnings(largest: Mapping[str, Told]) -> list[str]:
    """The small-strain warnings with the largest figures of the history."""
    return list(SmallStrain(**{name: _number(entry["value"]) for name, entry in largest.items()}).warnings)


def _runs(before: list[Told], run: Told | None, number: int) -> list[Told]:
    """The runs that made the history, each with its first and last step: one, and one more for every resume."""
    if run is None:  # written by an older version
        return before
    if before and all(before[-1][key] == run[key] for key in ("started", "hosts", "command")):
        return [*before[:-1], {**before[-1], "ended": run["ended"], "last_step": number}]
    return [*before, {**run, "first_step": number, "last_step": number}]
