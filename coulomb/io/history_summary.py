"""The numbers of a whole load history, from the summaries of its steps: the entry `history` of its summary.json.

The summary of a step is about that step: its iterations, time, largest pressure, and slip since the step before.  Here
iterations and seconds are sums over all steps; pressures, slips, residuals and the measures of the
certificate are the largest of all steps, each with its step and time; energies are accumulated from the start of the
history.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import reduce
from typing import Any

from ..model.load_step import Energy
from ..model.small_strain import SmallStrain
from .summary import LOOK_AT_GAP

Entries = dict[str, Any]


def whole(steps: Iterable[Mapping[str, Any]]) -> Entries:
    """Summary of the history from those of all steps in order; empty without steps."""
    return reduce(added, steps, {})


def added(before: Entries, step: Mapping[str, Any]) -> Entries:
    """The history, empty before the first step, extended by the summary.json of one step."""
    record = step["step"]
    where = {"step": record["number"], "time": record["time"]}
    most = {**step["maximum"], "slip_in_a_step": step["totals"]["greatest_slip"]}
    strain = {field.name: step["small_strain"][field.name] for field in fields(SmallStrain)}
    largest_strain = _largest_of(before.get("small_strain", {}), strain, where)
    largest = _largest_of(before.get("maximum", {}), most, where)
    energy = Energy(**{field.name: record["row"][f"energy_{field.name}"] for field in fields(Energy)})
    touching = before.get("steps_in_contact", 0) + (step["totals"]["contact_area"] > 0.0)
    outside = _outside(before.get("outside"), step)
    # of faces with what they touch before deformation, metres; and the energy in joules of rounding errors: of a fixed
    # node moved by the rounding error of its coordinates
    overlaps = [one["given_gap"]["min"] - one["gap"]["min"] for one in step["understood"]["contacts"]]
    overlap, compliance = float(max(before.get("overlap", 0.0), *overlaps, 0.0)), step["mean_compliance"]
    way = _number(largest["displacement"]["value"])
    rounding = 1e-12 * way**2 / compliance if compliance else 0.0
    remarks = [
        energy.warning(rounding, overlap if overlap > 1e-6 * way else 0.0),
        "" if touching else f"nothing touches in any load step: {LOOK_AT_GAP}",
    ]
    warnings = SmallStrain(**{name: _number(entry["value"]) for name, entry in largest_strain.items()}).warnings
    return {
        "steps": before.get("steps", 0) + 1,
        "certified_steps": before.get("certified_steps", 0) + bool(step["certificate"]["passed"]),
        "valid_steps": before.get("valid_steps", 0) + bool(step["valid"]),
        "steps_in_contact": touching,
        "overlap": overlap,
        "halvings": before.get("halvings", 0) + record["halvings"],
        "iterations": _sum(before.get("iterations", {}), step["iterations"]),
        "accumulated": step["accumulated"],
        "energy": {name: record["row"][f"energy_{name}"] for name in (*record["energy"], "imbalance")},
        "maximum": largest,
        "residual": _larger(before.get("residual"), {"value": step["residual"], **where}),
        "certificate": _certificate(before.get("certificate", {}), step["certificate"], where),
        "small_strain": largest_strain,
        "warnings": list(warnings),
        "outside": outside,
        "violations": _violations(outside, before.get("steps", 0) + 1),
        "remarks": [text for text in remarks if text],
        "seconds": _sum(before.get("seconds", {}), step["seconds"]),
        "peak_memory_bytes": max(before.get("peak_memory_bytes", 0), step["peak_memory_bytes"]),
        "runs": _runs(before.get("runs", []), step["run"], record["number"]),
    }


def _sum(before: Mapping[str, float], step: Mapping[str, float]) -> Entries:
    return {name: before.get(name, 0) + step.get(name, 0) for name in dict.fromkeys([*before, *step])}


def _number(value: float | None) -> float:
    """Infinity for null, which replaces non-finite numbers in files."""
    return math.inf if value is None or math.isnan(value) else value


def _larger(before: Entries | None, now: Entries) -> Entries:
    """The larger value; the earlier one if equal."""
    return now if before is None or _number(now["value"]) > _number(before["value"]) else before


def _largest_of(before: Mapping[str, Entries], now: Mapping[str, float], where: Entries) -> Entries:
    return {name: _larger(before.get(name), {"value": value, **where}) for name, value in now.items()}


def _certificate(before: Mapping[str, Entries], now: Mapping[str, Any], where: Entries) -> Entries:
    """Worst step per condition; a condition has passed if it passed in every step."""
    worst: Entries = {}
    for name, check in now.items():
        if not isinstance(check, Mapping):
            continue
        found = _larger(before.get(name), {**check, **where})
        worst[name] = {**found, "passed": bool(check["passed"]) and before.get(name, check)["passed"]}
    return {**worst, "passed": bool(now["passed"]) and before.get("passed", True)}


def _outside(before: Entries | None, step: Mapping[str, Any]) -> Entries | None:
    """Number of steps outside the theory of small strains, the first of them and its violations; null if none.

    Steps for which this was accepted are not counted.
    """
    if step["small_strain"]["accepted"] or not step["small_strain"]["violations"]:
        return before
    if before is None:
        before = {"steps": 0, "first": step["step"]["number"], "violations": step["small_strain"]["violations"]}
    return {**before, "steps": before["steps"] + 1}


def _violations(outside: Entries | None, steps: int) -> list[str]:
    """Description of the steps outside the theory."""
    if outside is None:
        return []
    first, *others = outside["violations"]
    return [f"{outside['steps']} of {steps} load steps, the first is step {outside['first']}: {first}", *others]


def _runs(before: list[Entries], run: Entries, number: int) -> list[Entries]:
    """The run and resumes of the history, each with its first and last step."""
    if before and all(before[-1][key] == run[key] for key in ("started", "hosts", "command")):
        return [*before[:-1], {**before[-1], "ended": run["ended"], "last_step": number}]
    return [*before, {**run, "first_step": number, "last_step": number}]
