"""The problem as rows of text: bodies, materials, supports, ties and contact, as they were understood; and its case."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ...arrays import FloatArray
from ...io.run_directory import as_toml
from ...load_curve import LoadCurve
from ...units import in_seconds, number, quantity, used
from .files import Run
from .grids import blocks_of
from .words import contact_in_words, in_nodes, tie_in_words

Facts = list[tuple[str, str]]

_CELLS = {
    **{"Hexahedron": "hexahedra", "Tetrahedron": "tetrahedra"},
    **{"Hexahedron_27": "27-node hexahedra", "Tetrahedron_10": "10-node tetrahedra"},
}


def bodies_and_meshes(run: Run) -> Facts:
    """Size and mesh of every body."""
    grid, facts = run.steps[-1].grid("solution"), Facts()
    for block in blocks_of(grid):
        of, points = f" {block.name}" if block.name else "", grid.points[block.points]
        count = (block.cells.stop - block.cells.start) // block.pieces
        size = " × ".join(quantity(length, "m") for length in np.ptp(points, axis=0))
        mesh = f"{count} {_CELLS.get(block.kind, block.kind)}, {in_nodes(len(points))}"
        facts += [(f"body{of}", size), (f"mesh{of and f' of{of}'}", mesh)]
    return facts


_ROWS: Final = 8
"""Maximum number of rows of a table in time that are shown."""

_AFTER = {"error": ", not defined after the last", "repeat": ", repeated"}


def supports(summary: dict[str, Any]) -> Facts:
    """Supports and springs, as they were understood."""
    given = summary.get("understood", {}).get("supports", ())
    return [(f"{one['kind']} on {one['face']}", one["holds"] + in_time(one.get("amplitude"))) for one in given]


def in_time(amplitude: Any) -> str:
    """A factor in time: rows [time, factor], a load curve, or what it is in words; empty without one."""
    if isinstance(amplitude, str):
        return f", times {amplitude}"
    rows, after = amplitude, "hold"
    if isinstance(amplitude, dict):
        rows, after = amplitude["table"], amplitude.get("after", after)
    if not rows:
        return ""
    shown = ", ".join(f"{number(factor)} at {in_seconds(time)}" for time, factor in rows[:_ROWS])
    return f", factor {shown}{', …' if len(rows) > _ROWS else ''}{_AFTER.get(after, '')}"


def values_in_time(given: Any, times: Sequence[float]) -> FloatArray:
    """Values of a table in time of a case.json at k times, shape (k, columns)."""
    table: dict[str, Any] = given if isinstance(given, dict) else {"table": given}
    rows, after = table["table"], table.get("after", "hold")
    curve = LoadCurve([row[0] for row in rows], [row[1:] for row in rows], after)
    return np.array([curve.at(time) for time in times])


def geometry(run: Run) -> Facts:
    """Size, mesh, materials, supports, ties and contact, as they were understood; loads are among the forces."""
    unknowns, summary = run.summary["unknowns"], run.summary
    facts = [
        *bodies_and_meshes(run),
        ("unknowns", f"{unknowns['displacement']} displacements, {unknowns['contact']} contact forces"),
    ]
    for material in summary["material"]:
        name = f"material of {material['cells']}" if material["cells"] else "material"
        facts.append((name, _material(material)))
    forms = summary.get("forms") or {}
    for body, given in {"": forms}.items() if "degree" in forms else forms.items():
        text = f"displacements of degree {given['degree']}, {given['bcs']} Dirichlet conditions; not in the files"
        facts.append((f"the user's own forms{f' of {body}' if body else ''}", text))
    facts += _temperature(summary)
    facts += supports(summary)
    understood, method = summary.get("understood", {}), summary["method"]
    facts += [tie_in_words(tie) for tie in understood.get("ties", ())]
    facts += [(f"contact of {one['face']!r}", contact_in_words(one)) for one in understood.get("contacts", ())]
    if run.is_history:
        facts.append(("history", f"{len(run.rows)} load steps to time {in_seconds(run.rows[-1]['time'])}"))
    return [*facts, ("method", f"{method['solver']}; K⁻¹ by {method['stiffness']}; A {method['compliance']}")]


def case_as_text(run: Run) -> str:
    """The case as a case file, with files by their names alone; empty for a run without."""

    def shown(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: shown(one) for key, one in value.items() if one is not None}
        if isinstance(value, list):
            return [shown(one) for one in value]
        return value.rpartition("/")[2] if isinstance(value, str) and value.startswith("/") else value

    return as_toml(shown(run.case or {}))


def _material(material: dict[str, Any]) -> str:
    """Its constants; those of an orthotropic one along its directions 1, 2, 3."""
    if "shear" in material:
        young, shear = (", ".join(quantity(value, "Pa") for value in material[name]) for name in ("young", "shear"))
        ratios = ", ".join(map(number, material["poisson"]))
        shown = [one if isinstance(one, str) else f"({', '.join(map(number, one))})" for one in material["directions"]]
        text = f"orthotropic: E1, E2, E3 {young}; ν12, ν13, ν23 {ratios}; G12, G13, G23 {shear}; "
        text += f"direction 1 {shown[0]}, direction 2 {shown[1]}"
    else:
        young = material["young"] if isinstance(material["young"], str) else quantity(material["young"], "Pa")
        text = f"Young's modulus {young}, Poisson's ratio {number(material['poisson'])}"
    if "density" in material:
        text += f", density {number(material['density'] * used().factor('kg/m³'))} kg/m³"
    if "expansion" in material:
        given = material["expansion"]
        values = given if isinstance(given, list) else [given]
        text += f", thermal expansion {', '.join(map(number, values))} 1/K"
    if "conductivity" in material:
        text += f", conductivity {number(material['conductivity'])} {used().name('W/(m K)')}"
    return text


def _temperature(summary: dict[str, Any]) -> Facts:
    change = summary.get("temperature_change")
    if change is None:
        return []
    ends = list(dict.fromkeys(number(change[name]) for name in ("min", "max")))
    reference = number(summary["reference_temperature"])
    return [("temperature change", f"{' to '.join(ends)} K from the reference {reference}")]
