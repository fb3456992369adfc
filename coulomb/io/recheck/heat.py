"""Recheck of temperatures and heat flows: conduction is computed anew on the meshes of the case."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arrays import FloatArray
from ...fem.bodies import TEMPERATURE
from ..run_directory import SOLUTION, SUMMARY
from ..run_files import WrittenRun
from .case_reference import CaseReference
from .comparison import Comparison

_AGREEMENT = 1e-7
"""Difference of temperatures from those of conduction with the contact forces and slip of the files, over the largest
change: contact and conduction were solved in turn until they agreed to less."""


def compare_heat(case: CaseReference, run: WrittenRun, time: float, duration: float | None, found: Comparison) -> None:
    """Compare the temperature and the heat flows with those that follow from pressure and friction in the files, of a
    load step of some duration in seconds; None without load steps."""
    if TEMPERATURE not in run.on_body or not isinstance(run.summary.get("heat"), dict):
        found.fault(f"{SOLUTION}: has no {TEMPERATURE}, or {SUMMARY} no heat, but the case has heat")
        return
    problem = case.problem.at(time)
    heat, surface = problem.body.heat, problem.surface
    assert heat is not None
    unfit = f"{run.folder}: has another mesh than the case"
    node = run.body.numbers_in([member.body.x for member in problem.elasticity.members], unfit)
    change, pressure, friction = np.zeros(len(node)), *np.zeros((2, len(surface.nodes)))
    change[node] = run.on_body[TEMPERATURE]
    for part in range(len(problem.contacts)):
        here, points = surface.part == part, run.faces[part].points if run.faces[0].name else slice(None)

        def at_points(values: FloatArray, points: slice = points, here: Any = here) -> FloatArray:
            everywhere = np.zeros(len(node))
            everywhere[node[run.node[points]]] = values[points]
            found_here: FloatArray = everywhere[surface.nodes[here]]
            return found_here

        pressure[here] = at_points(run.on_face["pressure"])
        if duration is not None:
            against = -np.einsum("qi,qi->q", run.on_face["friction_traction"], run.on_face["slip"])
            friction[here] = at_points(against * run.on_face["area"]) / duration
    expected = heat.solve(surface, time, pressure, friction, change)
    floor = _AGREEMENT * float(np.max(np.abs(change), initial=0.0))
    source = "conduction, contact forces and slip"
    found.field(f"{SOLUTION}: {TEMPERATURE}", change, expected, problem.elasticity.x, source, floor=floor)
    flows = heat.flows(surface, time, pressure, friction, change)
    if not flows.balanced:
        found.fault(f"{SUMMARY}.heat: {flows.imbalance:.3g} W of {flows.power_in:.6g} W are missing")
    entry, written = flows.entry(), run.summary["heat"]
    said = {name: written.get(name) for name in ("rounds", "agreement")}  # of the run
    around = [_moved(entry, flows.limit), _moved(entry, -flows.limit)]
    found.tree(f"{SUMMARY}.heat", written, {**entry, **said}, around, source)


def _moved(entry: Any, by: float) -> Any:
    """All numbers of an entry, moved by so much."""
    if isinstance(entry, dict):
        return {name: _moved(value, by) for name, value in entry.items()}
    if isinstance(entry, list):
        return [_moved(value, by) for value in entry]
    return entry + by if isinstance(entry, float) else entry
