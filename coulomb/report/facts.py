"""What was solved and what came out, as rows of words: from the summary, the case and the fields of a run."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .files import Run
from .scene import friction_in_words, zone_counts
from .units import number, quantity, vector

Facts = list[tuple[str, str]]

_CELLS = {"Hexahedron": "hexahedra", "Tetrahedron": "tetrahedra"}


def geometry(run: Run) -> Facts:
    """Size, mesh, materials, supports, loads, contact: from the case where there is one, else from the files."""
    body, summary = run.steps[-1].grid("solution"), run.summary
    extent = " × ".join(quantity(length, "m") for length in np.ptp(body.points, axis=0))
    mesh = (run.case or {}).get("mesh", {})
    source = f" ({' × '.join(map(str, mesh['cells']))})" if "cells" in mesh else ""
    source = f" from {str(mesh['file']).rsplit('/', 1)[-1]}" if "file" in mesh else source
    unknowns = summary["unknowns"]
    facts = [
        ("body", extent),
        ("mesh", f"{len(body.cells)} {_CELLS.get(body.cell, body.cell)}{source}, {len(body.points)} nodes"),
        ("unknowns", f"{unknowns['displacement']} displacements, {unknowns['contact']} contact forces"),
    ]
    for material in summary["material"]:
        name = f"material of {material['cells']}" if material["cells"] else "material"
        young = quantity(material["young"], "Pa")
        facts.append((name, f"Young's modulus {young}, Poisson's ratio {number(material['poisson'])}"))
    return facts + (_of_case(run.case) if run.case is not None else _of_fields(run)) + _contact(run)


def _of_case(case: dict[str, Any]) -> Facts:
    facts: Facts = []
    for clamp in case.get("clamp", ()):
        value = clamp.get("value", [0.0] * 3)
        moved = f" moved by {vector(value, 'm')}" if any(value) else ""
        held = f"components {clamp.get('components', 'xyz')} held{moved}"
        facts.append((f"clamp on {clamp['face']}", held + _in_time(clamp.get("amplitude"))))
    for spring in case.get("spring", ()):
        given = spring["stiffness"]
        along = [float(given)] * 3 if isinstance(given, int | float) else given
        facts.append((f"spring on {spring['face']}", f"({', '.join(number(k) for k in along)}) N/m³ along x, y, z"))
    for load in case.get("traction", ()):
        facts.append((f"traction on {load['face']}", vector(load["value"], "Pa") + _in_time(load.get("amplitude"))))
    if any(case.get("body_force", ())):
        force = f"({', '.join(number(f) for f in case['body_force'])}) N/m³"
        facts.append(("body force", force + _in_time(case.get("body_force_amplitude"))))
    return facts


def _in_time(amplitude: list[list[float]] | None) -> str:
    """Rows [time, factor] in words."""
    if not amplitude:
        return ""
    shown = ", ".join(f"{number(factor)} at {number(time)}" for time, factor in amplitude[:8])
    return f", times {shown}{', …' if len(amplitude) > 8 else ''}"


def _of_fields(run: Run) -> Facts:
    """Of a run without case.json, made from Python."""
    body = run.steps[-1].grid("solution")
    load, held = body.fields.get("load"), body.fields.get("held")
    facts: Facts = []
    if held is not None:
        facts.append(("clamps", f"{np.count_nonzero(np.any(held > 0.5, axis=1))} nodes held"))
    if load is not None:
        facts.append(("loads", f"{vector(load.sum(axis=0).tolist(), 'N')} in all"))
    return facts


def _contact(run: Run) -> Facts:
    given = (run.case or {}).get("contact", {})
    contacts = given if isinstance(given, list) else [given]
    faces = (run.summary.get("totals") or {}).get("faces") or [contact.get("face", "") for contact in contacts]
    named = f"contact {'faces' if len(faces) > 1 else 'face'}"
    facts = [(named, f"{', '.join(faces)}; {run.summary['nodes']['contact']} contact nodes")]
    facts.append(("friction", friction_in_words(run.summary)))
    for contact in contacts if run.case is not None else ():
        facts += _foundation(contact, f" at {contact['face']}" if len(contacts) > 1 else "")
    if run.is_history:
        facts.append(("history", f"{len(run.rows)} load steps to time {number(run.rows[-1]['time'])}"))
    method = run.summary.get("method", {})
    facts.append(
        (
            "method",
            f"{method.get('solver', '–')}; K⁻¹ by {method.get('stiffness', '–')}; A {method.get('compliance', '–')}",
        )
    )
    return facts


def _foundation(contact: dict[str, Any], where: str) -> Facts:
    """What a contact face of the case may touch, and how that moves."""
    facts: Facts = []
    foundation = contact.get("foundation")
    if foundation:
        shape = foundation.get("shape", "plane")
        more = [f"{key} {vector(value, 'm')}" for key in ("point", "centre") if (value := foundation.get(key))]
        more += [
            f"{key} ({', '.join(map(number, foundation[key]))})" for key in ("normal", "axis") if key in foundation
        ]
        more += [f"radius {quantity(foundation['radius'], 'm')}"] if "radius" in foundation else []
        hollow = ", hollow" if foundation.get("hollow") else ""
        facts.append((f"foundation{where}", f"{shape}{hollow}: {', '.join(more)}"))
    else:
        facts.append((f"foundation{where}", "the plane of the face"))
    if contact.get("motion"):
        ways = [f"{vector(row[1:], 'm')} at {number(row[0])}" for row in contact["motion"][:6]]
        more_ways = ", …" if len(contact["motion"]) > 6 else ""
        facts.append((f"motion of the foundation{where}", ", ".join(ways) + more_ways))
    return facts


def totals(run: Run) -> Facts:
    """What the contact face does as a whole, at the end of the run."""
    summary, nodes, greatest = run.summary, zone_counts(run.steps[-1].grid("contact")), run.summary["maximum"]
    told = summary.get("totals") or {}
    face = [
        ("contact force on the body", vector(summary["force_on_body"]["vector"], "N", 5)),
        ("normal force", quantity(summary["force_on_body"]["normal"], "N", 6)),
        ("greatest contact pressure", quantity(greatest["contact_pressure"], "Pa", 5)),
        ("greatest displacement", quantity(greatest["displacement"], "m", 5)),
    ]
    if told:
        face[2:2] = [("moment about the origin", vector(told["moment"], "N m", 5))]
        face += [
            ("area in contact", quantity(told["contact_area"], "m²")),
            ("centre of pressure", vector(told["centre_of_pressure"], "m") if told["centre_of_pressure"] else "–"),
            ("greatest slip", quantity(told["greatest_slip"], "m")),
            ("energy dissipated by friction", quantity(told["dissipated_energy"], "J")),
        ]
    springs = summary.get("spring_force_on_body") or []
    if any(springs):
        face.append(("force of springs on the body", vector(springs, "N", 5)))
    face.append(("nodes", f"open {nodes['open']}, stick {nodes['stick']}, slip {nodes['slip']}"))
    return face


def effort(run: Run) -> Facts:
    """Iterations, and seconds of every part."""
    done = run.summary["iterations"]
    facts = [("Tresca problems", str(done["outer"]))] if done["outer"] else []
    facts += [
        ("path-following steps", str(done["path_following"])),
        ("products by A", str(done["products"])),
        ("CG iterations", str(done["krylov"])),
        ("ranks", str(run.summary.get("method", {}).get("ranks", "–"))),
    ]
    return facts


def seconds(run: Run) -> Facts:
    """Of every part, the longest first."""
    spent = {name: value for name, value in run.summary.get("seconds", {}).items() if name != "total"}
    return [(name, quantity(value, "s", 3)) for name, value in sorted(spent.items(), key=lambda item: -item[1])]


def checks(run: Run) -> list[dict[str, Any]]:
    """The certificate, a row for each condition; `room` is how many decades its value is below the limit, 0 to 1."""
    rows = []
    for name, check in run.summary["certificate"].items():
        if not isinstance(check, dict):
            continue
        value = math.nan if check["value"] is None else float(check["value"])
        decades = math.log10(max(value, 1e-300) / check["limit"]) if not math.isnan(value) else 9.0
        unit = "°" if check.get("unit") == "deg" else ""
        rows.append(
            {
                "name": name.replace("_", " "),
                "meaning": check.get("meaning", ""),
                "value": number(value, 2) + unit,
                "limit": number(check["limit"], 2) + unit,
                "passed": bool(check["passed"]),
                "share": 100.0 * min(max((decades + 10.0) / 16.0, 0.012), 1.0),
                "decades": decades,
            }
        )
    return rows


def in_words(run: Run) -> str:
    """The verdict of the certificate."""
    rows = checks(run)
    failed = [row for row in rows if not row["passed"]]
    if failed:
        worst = max(failed, key=lambda row: row["decades"])
        factor = number(10.0 ** worst["decades"], 2)
        beyond = "is no number" if worst["value"].startswith("–") else f"is {factor} times its limit"
        return f"{len(failed)} of {len(rows)} conditions fail. The worst is the {worst['name']}, which {beyond}."
    if not run.certified:
        return "The last step passes, but an earlier one does not."
    nearest = max(rows, key=lambda row: row["decades"])
    margin = number(10.0 ** -nearest["decades"], 2)
    each = " at the last step, and at every step before" if run.is_history else ""
    name = nearest["name"]
    return f"All {len(rows)} conditions hold{each}. The nearest to its limit is the {name}, {margin} times below."
