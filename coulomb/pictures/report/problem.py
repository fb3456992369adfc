"""The problem as rows of text: bodies, materials, supports, loads and contact, from the case and the files of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from ...arrays import FloatArray
from ...contact_fields import named_faces
from ...load_curve import LoadCurve
from ...units import in_seconds, number, quantity, used, vector
from .files import Run
from .grids import blocks_of
from .words import friction_in_words, in_nodes

Facts = list[tuple[str, str]]

_CELLS = {
    **{"Hexahedron": "hexahedra", "Tetrahedron": "tetrahedra"},
    **{"Hexahedron_27": "27-node hexahedra", "Tetrahedron_10": "10-node tetrahedra"},
}


def bodies_and_meshes(run: Run) -> list[tuple[str, str]]:
    """Size and mesh of every body."""
    grid, case = run.steps[-1].grid("solution"), run.case or {}
    tables = {body.get("name"): body for body in case.get("body") or ()}
    facts = []
    for block in blocks_of(grid):
        of = f" {block.name}" if block.name else ""
        mesh = tables.get(block.name, {}) if of else case.get("mesh", {})
        source = f" ({' × '.join(map(str, mesh['cells']))})" if "cells" in mesh else ""
        source = f" from {str(mesh['file']).rsplit('/', 1)[-1]}" if "file" in mesh else source
        points = grid.points[block.points]
        count = (block.cells.stop - block.cells.start) // block.pieces
        facts += [
            (f"body{of}", " × ".join(quantity(length, "m") for length in np.ptp(points, axis=0))),
            (
                f"mesh{of and f' of{of}'}",
                f"{count} {_CELLS.get(block.kind, block.kind)}{source}, {in_nodes(len(points))}",
            ),
        ]
    return facts


_ROWS: Final = 8
"""Maximum number of rows of a table in time that are shown."""

_LOADS: Final = {
    "traction": ("traction on", {"value": "Pa"}),
    "pressure": ("pressure on", {"value": "Pa"}),
    "point_load": ("point load on", {"force": "N", "moment": "N m"}),
    "total_force": ("total force on", {"force": "N"}),
    "nodal_force": ("force at every node of", {"force": "N"}),
    "volume_force": ("force in the volume of", {"value": "N/m³"}),
}
"""Loads of a case: title, and the units of their values."""

_AFTER = {"error": ", not defined after the last", "repeat": ", repeated"}


def supports(summary: dict[str, Any]) -> Facts:
    """Supports and springs, as they were understood."""
    given = summary.get("understood", {}).get("supports", ())
    return [(f"{one['kind']} on {one['face']}", one["holds"] + in_time(one.get("amplitude"))) for one in given]


def ties_and_loads(case: dict[str, Any]) -> Facts:
    """Rigid faces, ties, equations, bolts and loads of a case.json, as pairs of name and description."""
    facts: Facts = []
    for face in case.get("rigid_face", ()):
        moves = [
            f"{what} {axis} = {value}" + in_time(face.get(f"{what}_{axis}_amplitude"))
            for what in ("translation", "rotation")
            for axis, value in (face.get(what) or {}).items()
            if value is not None
        ]
        kind = "plane face" if face.get("along") == "free" else "rigid face"
        facts.append((f"{kind} {face['face']}", (", ".join(moves) or "free") + in_time(face.get("amplitude"))))
    for kind in ("tie", "cyclic_symmetry"):
        facts += [(f"{kind.replace('_', ' ')} of {tie['face']}", f"to {tie['against']}") for tie in case.get(kind, ())]
    for equation in case.get("equation", ()):
        terms = [f"{number(one['coefficient'])} u_{one['component']}({one['nodes']})" for one in equation["terms"]]
        constant = quantity(equation.get("constant", 0.0), "m")
        facts.append(("equation", f"{' + '.join(terms)} = {constant}{in_time(equation.get('amplitude'))}"))
    for bolt in case.get("pretension", ()):
        given = quantity(bolt["force"], "N") if bolt["force"] is not None else quantity(bolt["shortening"], "m")
        lock = "" if bolt["lock"] is None else f", locked at {number(bolt['lock'])} s"
        facts.append((f"pretension of {bolt['face']}", f"{given}{lock}{in_time(bolt.get('amplitude'))}"))
    for kind, (title, values) in _LOADS.items():
        for load in case.get(kind, ()):
            shown = ", ".join(_with_unit(load[name], unit) for name, unit in values.items() if name in load)
            where = load.get("face") or load["cells"]
            facts.append((f"{title} {where}", shown + in_time(load.get("amplitude"))))
    for heat in case.get("heat", ()):
        kinds = {"temperature": "temperature of", "flux": "heat flux into", "film": "film on", "source": "heat in"}
        kind = next(name for name in kinds if name in heat)
        units = {"temperature": "", "flux": "W/m²", "film": "W/(m² K)", "source": "W/m³"}
        beyond = f", {number_at(heat['ambient'])} beyond" if "ambient" in heat else ""
        where = heat.get("face") or heat.get("body") or "all bodies"
        value = f"{number_at(heat[kind])} {used().name(units[kind])}".strip() + beyond + in_time(heat.get("amplitude"))
        facts.append((f"{kinds[kind]} {where}", value))
    for key, name, unit in (("body_force", "body force", "N/m³"), ("gravity", "gravity", "m/s²")):
        value = case.get(key, ())
        if any(value):
            facts.append((name, f"{_bare(value)} {used().name(unit)}{in_time(case.get(f'{key}_amplitude'))}"))
    for body in case.get("body", ()):
        if (own := body.get("gravity")) is not None:
            shown = f"{_bare(own)} {used().name('m/s²')}{in_time(case.get('gravity_amplitude'))}"
            facts.append((f"gravity on {body['name']}", shown))
    return facts


def _with_unit(value: float | str | Sequence[float | str], unit: str) -> str:
    """A number or a vector, whose components may be expressions of place."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return vector_at(value, unit)
    return f"{value} {used().name(unit)}" if isinstance(value, str) else quantity(value, unit)


def vector_at(value: Sequence[float | str], unit: str) -> str:
    """A vector, whose components may be expressions of place."""
    numbers = [component for component in value if not isinstance(component, str)]
    return vector(numbers, unit) if len(numbers) == len(value) else f"{_bare(value)} {used().name(unit)}"


def number_at(value: float | str) -> str:
    """A number, or an expression of place."""
    return value if isinstance(value, str) else number(value)


def _bare(value: Sequence[float | str]) -> str:
    return f"({', '.join(map(number_at, value))})"


def in_time(amplitude: Any) -> str:
    """A factor in time: rows [time, factor], a load curve, or what it is in words; empty without one."""
    if isinstance(amplitude, str):
        return f", times {amplitude}"
    shown = _rows_in_time(amplitude, lambda values: number(values[0]))
    return shown and f", factor {shown}"


def _rows_in_time(given: Any, shown: Callable[[Sequence[float]], str]) -> str:
    """Rows of a table in time of a case.json, and what follows the last if it is not its value; empty without rows."""
    rows, after = (given["table"], given.get("after", "hold")) if isinstance(given, dict) else (given or [], "hold")
    more = ", …" if len(rows) > _ROWS else ""
    return ", ".join(f"{shown(row[1:])} at {in_seconds(row[0])}" for row in rows[:_ROWS]) + more + _AFTER.get(after, "")


def values_in_time(given: Any, times: Sequence[float]) -> FloatArray:
    """Values of a table in time of a case.json at k times, shape (k, columns)."""
    table: dict[str, Any] = given if isinstance(given, dict) else {"table": given}
    rows, after = table["table"], table.get("after", "hold")
    curve = LoadCurve([row[0] for row in rows], [row[1:] for row in rows], after)
    return np.array([curve.at(time) for time in times])


def geometry(run: Run) -> Facts:
    """Size, mesh, materials, supports, loads, contact: from the case if there is one, else from the files."""
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
    return facts + (ties_and_loads(run.case) if run.case is not None else _of_fields(run)) + _contact(run)


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


def _of_fields(run: Run) -> Facts:
    """Facts of a run without case.json, from Python."""
    load = run.steps[-1].grid("solution").fields.get("load")
    return [] if load is None else [("loads", f"{vector(load.sum(axis=0).tolist(), 'N')} in all")]


def _contact(run: Run) -> Facts:
    given = (run.case or {}).get("contact", {})
    contacts = given if isinstance(given, list) else [given]
    faces = [name for name, _ in named_faces(run.summary["faces"])]
    named = f"contact {'faces' if len(faces) > 1 else 'face'}"
    facts = [(named, f"{', '.join(faces)}; {in_nodes(run.summary['nodes']['contact'], 'contact')}")]
    changing = [contact for contact in contacts if _changing_friction(contact, "")]
    facts.append(("friction law in the last step" if changing else "friction", friction_in_words(run.summary)))
    for contact in contacts if run.case is not None else ():
        where = f" at {contact['face']}" if len(contacts) > 1 else ""
        facts += _changing_friction(contact, where) + _foundation(contact, where)
    if run.is_history:
        facts.append(("history", f"{len(run.rows)} load steps to time {in_seconds(run.rows[-1]['time'])}"))
    method = run.summary["method"]
    used = f"{method['solver']}; K⁻¹ by {method['stiffness']}; A {method['compliance']}"
    return [*facts, ("method", used)]


def _changing_friction(contact: dict[str, Any], where: str) -> Facts:
    """How friction at a contact face of the case depends on slip rate and time; empty where it does not."""
    facts: Facts = []
    law = contact.get("friction")
    if isinstance(law, dict):
        static, kinetic, speed = (number_at(law[key]) for key in ("static", "kinetic", "decay_speed"))
        shown = f"static {static}, kinetic {kinetic}, decay speed {speed} {used().name('m/s')}"
        facts.append((f"friction by slip rate{where}", shown))
    if contact.get("friction_amplitude"):
        facts.append((f"friction in time{where}", in_time(contact["friction_amplitude"]).removeprefix(", ")))
    return facts


def _foundation(contact: dict[str, Any], where: str) -> Facts:
    """Foundation of a contact face of the case, and its motion; `where` is appended to the names."""
    facts: Facts = []
    foundation = contact.get("foundation")
    if contact.get("against"):
        facts.append((f"pair{where}", f"{contact['face']} and {contact['against']}"))
    elif foundation:
        shape = foundation.get("shape", "plane")
        more = [f"{key} {vector(value, 'm')}" for key in ("point", "centre") if (value := foundation.get(key))]
        more += [f"{key} {_bare(foundation[key])}" for key in ("normal", "axis") if key in foundation]
        more += [f"radius {quantity(foundation['radius'], 'm')}"] if "radius" in foundation else []
        hollow = ", hollow" if foundation.get("hollow") else ""
        facts.append((f"foundation{where}", f"{shape}{hollow}: {', '.join(more)}"))
    else:
        facts.append((f"foundation{where}", "the plane of the face"))
    if contact.get("gap"):
        given, in_steps = contact["gap"], in_time(contact["gap_amplitude"]) if contact.get("gap_amplitude") else ""
        source = (
            f"{given['field']} of {given['file']}"
            if isinstance(given, dict)
            else f"{number_at(given)} {used().name('m')}"
        )
        facts.append((f"given gap{where}", f"{source}{in_steps}"))
    if contact.get("motion"):
        moved = _rows_in_time(contact["motion"], lambda values: vector(values, "m"))
        facts.append((f"motion of the foundation{where}", moved))
    if rotation := contact.get("rotation"):
        axis = f"about ({', '.join(map(number, rotation['axis']))}) through {vector(rotation['point'], 'm')}"
        turned = _rows_in_time(rotation["angle"], lambda values: f"{number(values[0])} rad")
        facts.append((f"rotation of the foundation{where}", f"{axis}: {turned}" if turned else axis))
    return facts
