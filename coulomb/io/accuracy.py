"""Amounts below the accuracy of an answer, shown as 0 (`units.rounded`) by terminal, report and pictures.  Standard
library only."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

TOLERANCE: Final = 1e-8
"""The tolerance of a solver if none is given."""


def accuracy(
    summary: Mapping[str, Any],
    tolerance: float = TOLERANCE,
    history: Mapping[str, Any] | None = None,
    forces: Iterable[float] = (),
) -> dict[str, float]:
    """The tolerance times the natural scale of the answer, by unit.

    The scales: of forces and moments the largest load, reaction or contact force, at the distance of the centre of
    pressure from the origin or across the contact, which may be centred there; of lengths the largest displacement or
    slip, or what a nodal contact force does at its node, with which solvers compare gap and slip; of stresses the
    largest contact pressure; of energies their products.

    Args:
        summary: The summary of a single run, or of the last step of a load history; what it lacks counts as 0.
        history: The entry `history` of the summary of a load history, for the largest values of all steps.
        forces: Forces in newtons at other steps.
    """
    totals, maximum, faces = (summary.get(name) or {} for name in ("totals", "maximum", "faces"))
    parts = [*summary.get("loads", ()), *summary.get("reactions", ()), *faces]
    pressing = [face.get("normal_force") for face in faces] or [(summary.get("force_on_body") or {}).get("normal")]
    force = _largest(forces, pressing, *(part["force"] for part in parts))
    areas = [part.get("contact_area") or 0.0 for part in (totals, *faces)]
    arm = _largest(*(part.get("centre_of_pressure") or () for part in (totals, *faces)), map(math.sqrt, areas))
    moment = _largest([force * arm], *(part["moment"] for part in parts))
    nodes, compliance = (summary.get("nodes") or {}).get("contact") or 1, summary.get("mean_compliance") or 0.0
    at_node = compliance * sum(_largest([normal]) for normal in pressing) / math.sqrt(nodes)
    length = _largest([maximum.get("displacement"), totals.get("greatest_slip"), at_node])
    pressure = _largest([maximum.get("contact_pressure")])
    if history:
        most = {name: entry["value"] for name, entry in history["maximum"].items()}
        length = _largest([length, most["displacement"], most["slip_in_a_step"]])
        pressure = _largest([pressure, most["contact_pressure"]])
    scales = {"N": force, "N m": moment, "m": length, "Pa": pressure, "J": force * length, "J/m²": pressure * length}
    return {unit: tolerance * scale for unit, scale in scales.items()}


def _largest(*values: Iterable[float | None]) -> float:
    """The largest magnitude; files have None for numbers that are not finite."""
    return max((abs(v) for some in values for v in some if v is not None and math.isfinite(v)), default=0.0)
