"""Problem and results as rows of text, from the summary, the case and the fields of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from functools import partial
from typing import Any

import numpy as np

from ...contact_names import named_faces
from . import rotating_foundations
from .bodies import bodies_and_meshes
from .files import Run
from .given import in_time, number_at, rows_and_after, supports_and_loads
from .scene import friction_in_words, zone_counts
from .units import in_nodes, in_seconds, number, quantity, vector

Facts = list[tuple[str, str]]


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
    return facts + (supports_and_loads(run.case) if run.case is not None else _of_fields(run)) + _contact(run)


def _material(material: dict[str, Any]) -> str:
    """Its constants; those of an orthotropic one along its directions 1, 2, 3."""
    if "shear" in material:
        young, shear = (", ".join(quantity(value, "Pa") for value in material[name]) for name in ("young", "shear"))
        ratios = ", ".join(map(number, material["poisson"]))
        shown = [one if isinstance(one, str) else f"({', '.join(map(number, one))})" for one in material["directions"]]
        text = f"orthotropic: E1, E2, E3 {young}; ν12, ν13, ν23 {ratios}; G12, G13, G23 {shear}; "
        text += f"direction 1 {shown[0]}, direction 2 {shown[1]}"
    else:
        young = quantity(material["young"], "Pa")
        text = f"Young's modulus {young}, Poisson's ratio {number(material['poisson'])}"
    if "density" in material:
        text += f", density {number(material['density'])} kg/m³"
    if "expansion" in material:
        given = material["expansion"]
        values = given if isinstance(given, list) else [given]
        text += f", thermal expansion {', '.join(map(number, values))} 1/K"
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
    body = run.steps[-1].grid("solution")
    load, held = body.fields.get("load"), body.fields.get("held")
    facts: Facts = []
    if held is not None:
        facts.append(("prescribed displacements", f"{in_nodes(np.count_nonzero(np.any(held > 0.0, axis=1)))} held"))
    if load is not None:
        facts.append(("loads", f"{vector(load.sum(axis=0).tolist(), 'N')} in all"))
    return facts


def _contact(run: Run) -> Facts:
    given = (run.case or {}).get("contact", {})
    contacts = given if isinstance(given, list) else [given]
    faces = [name for name, _ in named_faces(run.summary.get("faces") or ())]
    faces = faces or [contact.get("face", "") for contact in contacts]
    named = f"contact {'faces' if len(faces) > 1 else 'face'}"
    facts = [(named, f"{', '.join(faces)}; {in_nodes(run.summary['nodes']['contact'], 'contact')}")]
    changing = [contact for contact in contacts if _changing_friction(contact, "")]
    facts.append(("friction law in the last step" if changing else "friction", friction_in_words(run.summary)))
    for contact in contacts if run.case is not None else ():
        where = f" at {contact['face']}" if len(contacts) > 1 else ""
        facts += _changing_friction(contact, where) + _foundation(contact, where)
    if run.is_history:
        facts.append(("history", f"{len(run.rows)} load steps to time {in_seconds(run.rows[-1]['time'])}"))
    method = run.summary.get("method", {})
    facts.append(
        (
            "method",
            f"{method.get('solver', '–')}; K⁻¹ by {method.get('stiffness', '–')}; A {method.get('compliance', '–')}",
        )
    )
    return facts


def _changing_friction(contact: dict[str, Any], where: str) -> Facts:
    """How friction at a contact face of the case depends on slip rate and time; empty where it does not."""
    facts: Facts = []
    law = contact.get("friction")
    if isinstance(law, dict):
        static, kinetic, speed = (number_at(law[key]) for key in ("static", "kinetic", "decay_speed"))
        facts.append((f"friction by slip rate{where}", f"static {static}, kinetic {kinetic}, decay speed {speed} m/s"))
    if contact.get("friction_amplitude"):
        facts.append((f"friction in time{where}", in_time(contact["friction_amplitude"]).removeprefix(", ")))
    return facts


def _foundation(contact: dict[str, Any], where: str) -> Facts:
    """Foundation of a contact face of the case, and its motion."""
    facts: Facts = []
    foundation = contact.get("foundation")
    if contact.get("against"):
        facts.append((f"pair{where}", f"{contact['face']} and {contact['against']}"))
    elif foundation:
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
    if contact.get("gap"):
        given, in_steps = contact["gap"], in_time(contact["gap_amplitude"]) if contact.get("gap_amplitude") else ""
        source = f"{given['field']} of {given['file']}" if isinstance(given, dict) else f"{number_at(given)} m"
        facts.append((f"given gap{where}", f"{source}{in_steps}"))
    if contact.get("motion"):
        rows, after = rows_and_after(contact["motion"])
        places = [f"{vector(row[1:], 'm')} at {in_seconds(row[0])}" for row in rows[:6]]
        more_rows = ", …" if len(rows) > 6 else ""
        facts.append((f"motion of the foundation{where}", ", ".join(places) + more_rows + after))
    return facts + rotating_foundations.prescribed(contact, where)


def totals(run: Run) -> Facts:
    """Totals at the end of the run."""
    summary, nodes, largest = run.summary, zone_counts(run.steps[-1].grid("contact")), run.summary["maximum"]
    shown, vectorial = partial(quantity, accuracy=run.accuracy), partial(vector, accuracy=run.accuracy)
    totals = summary.get("totals") or {}
    bodies = summary.get("bodies") or ()
    rows = [(f"contact force on {body['name']}", vectorial(body["contact_force"], "N", 5)) for body in bodies] or [
        ("contact force on the body", vectorial(summary["force_on_body"]["vector"], "N", 5))
    ]
    faces = named_faces(summary.get("faces", ()))
    for name, face in faces:
        of = f" of {name}" if len(faces) > 1 else ""
        rows.append((f"normal force{of}", shown(face["normal_force"], "N", 6)))
    rows += [
        ("largest contact pressure", shown(largest["contact_pressure"], "Pa", 5)),
        ("largest displacement", shown(largest["displacement"], "m", 5)),
    ]
    if totals:
        rows[1:1] = [] if bodies else [("moment about the origin", vectorial(totals["moment"], "N m", 5))]
        rows.append(("area in contact", quantity(totals["contact_area"], "m²")))
        if "centre_of_pressure" in totals:
            centre = totals["centre_of_pressure"]
            rows.append(("centre of pressure", vector(centre, "m") if centre else "–"))
        in_step = " in the last step" if run.is_history else ""
        rows += [
            (f"largest slip{in_step}", shown(totals["greatest_slip"], "m")),
            (f"energy dissipated by friction{in_step}", shown(totals["dissipated_energy"], "J")),
        ]
    rows += rotating_foundations.figures(run)
    springs = summary.get("spring_force_on_body") or []
    if any(springs):
        rows.append(("force of springs on the body", vectorial(springs, "N", 5)))
    rows.append(("nodes", f"open {nodes['open']}, stick {nodes['stick']}, slip {nodes['slip']}"))
    return rows


def history_totals(run: Run) -> Facts:
    """For a load history: the largest values of all steps, and the energies since the start; empty for a single run."""
    if not run.is_history:
        return []
    largest, energy = run.history["maximum"], run.history["energy"]
    at_step, shown = partial(_at_step, accuracy=run.accuracy), partial(quantity, accuracy=run.accuracy)
    halved = run.history["halvings"]
    rows = [
        ("load steps", f"{run.history['steps']}, {run.history['certified_steps']} of them certified"),
        ("largest contact pressure", at_step(largest["contact_pressure"], "Pa")),
        ("largest displacement", at_step(largest["displacement"], "m")),
        ("largest slip in one step", at_step(largest["slip_in_a_step"], "m")),
        ("largest penetration", _at_step(largest["penetration"], "m", {})),
        ("energy dissipated by friction", shown(energy["dissipated"], "J")),
    ]
    if worn := run.history.get("accumulated"):
        rows[-1:-1] = [
            ("largest slip accumulated at a node", shown(worn["largest_slip"], "m")),
            ("largest friction work per area", shown(worn["largest_friction_work"], "J/m²")),
        ]
    for name, text in (
        ("loads", "loads"),
        ("prescribed", "prescribed displacements"),
        ("foundation", "the foundation"),
    ):
        if energy[name]:
            rows.append((f"work of {text}", shown(energy[name], "J")))
    rows += [
        ("elastic energy at the end", shown(energy["elastic"], "J")),
        ("time-stepping error (energy)", shown(energy["imbalance"], "J", 2)),
    ]
    return [*rows, ("step intervals halved", str(halved))] if halved else rows


def _at_step(found: dict[str, Any], unit: str, accuracy: Mapping[str, float]) -> str:
    """A maximum with its step: 133.8 kPa (step 6, time 6 s)."""
    value = quantity(found["value"], unit, 5, accuracy)
    return f"{value} (step {found['step']}, time {in_seconds(found['time'])})"


def effort(run: Run) -> Facts:
    """Iterations, ranks and memory; of a history, of all steps together."""
    done = (run.history if run.is_history else run.summary)["iterations"]
    every = f" in all {run.history['steps']} steps" if run.is_history else ""
    facts = [(f"Tresca problems{every}", str(done["outer"]))] if done["outer"] else []
    rate = run.summary.get("contraction")
    if done["outer"] and rate is not None and math.isfinite(rate):
        facts.append((f"measured contraction{' of the last step' if every else ''}", f"{number(rate, 2)} per problem"))
    facts += [
        (f"path-following steps{every}", str(done["path_following"])),
        (f"products by A{every}", str(done["products"])),
        (f"CG iterations{every}", str(done["krylov"])),
        ("ranks", str(run.summary.get("method", {}).get("ranks", "–"))),
    ]
    memory = (run.history if run.is_history else run.summary).get("peak_memory_bytes")
    return [*facts, ("peak memory, all ranks together", quantity(float(memory), "B", 3))] if memory else facts


def seconds(run: Run) -> Facts:
    """Times of all parts, the longest first, the remaining time, and the total."""
    seconds = (run.history if run.is_history else run.summary).get("seconds", {})
    spent = {name: value for name, value in seconds.items() if name != "total"}
    rows = sorted(spent.items(), key=lambda item: -item[1])
    wall = sum(_duration(made) for made in run.made)
    if wall > 0.0:
        rows += [("everything else", max(wall - sum(spent.values()), 0.0)), ("in all", wall)]
    return [(name, quantity(value, "s", 3)) for name, value in rows]


def made(run: Run) -> list[Facts]:
    """Host, date and command: a table for the run, and one per resume."""
    return [
        [
            *([("load steps", f"{entry['first_step']} to {entry['last_step']}")] if len(run.made) > 1 else []),
            ("started", in_date(entry["started"])),
            ("ended", in_date(entry["ended"])),
            ("took", quantity(_duration(entry), "s", 3)),
            ("host", _hosts(entry) + (f", {entry['ranks']} ranks" if entry["ranks"] > 1 else "")),
            ("version", f"coulomb {entry['coulomb']}"),
            ("command", entry["command"]),
        ]
        for entry in run.made
    ]


def made_in_short(run: Run) -> str:
    """Date, host and version in one line; empty if unknown."""
    if not run.made:
        return ""
    first, resumed = run.made[0], len(run.made) - 1
    again = f", resumed {resumed} {'time' if resumed == 1 else 'times'}" if resumed else ""
    return f"{in_date(first['started'])} on {_hosts(first)}, coulomb {first['coulomb']}{again}"


def _hosts(entry: dict[str, Any]) -> str:
    hosts = entry["hosts"]
    return ", ".join(hosts[:3]) + (f" and {len(hosts) - 3} more" if len(hosts) > 3 else "")


def _duration(entry: dict[str, Any]) -> float:
    return (datetime.fromisoformat(entry["ended"]) - datetime.fromisoformat(entry["started"])).total_seconds()


def in_date(moment: str) -> str:
    """Readable date and time: 2026-01-31 12:00:00 UTC+01:00."""
    time = datetime.fromisoformat(moment)
    zone = time.strftime("%z")
    return f"{time:%Y-%m-%d %H:%M:%S} UTC" + (f"{zone[:3]}:{zone[3:5]}" if zone.strip("+-0") else "")


def checks(run: Run) -> list[dict[str, Any]]:
    """The certificate, a row per condition, for a history at the worst step.

    `decades` is the number of decades of the value above its limit, `share` the length of its bar in percent.
    """
    rows = []
    for name, check in run.certificate.items():
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
                "step": str(check.get("step", "")),
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
        beyond = "is not a number" if worst["value"].startswith("–") else f"is {factor} times its limit"
        where = f" at step {worst['step']}" if run.is_history else ""
        bad = [f"{int(row['step'])}" for row in run.rows if not row["certified"]]
        shown = ", ".join(bad[:12]) + (", …" if len(bad) > 12 else "")
        which = f", at {len(bad)} of {len(run.rows)} steps ({shown})" if bad else ""
        many = f"{len(failed)} of {len(rows)} conditions fail{which}."
        return f"{many} The worst is the {worst['name']}, which {beyond}{where}."
    if not run.certified:
        return "A step is not certified, although each of its conditions holds."
    nearest = max(rows, key=lambda row: row["decades"])
    margin = number(10.0 ** -nearest["decades"], 2)
    each = f" at each of the {len(run.rows)} steps" if run.is_history else ""
    where = f", at step {nearest['step']}" if run.is_history else ""
    return (
        f"All {len(rows)} conditions hold{each}. The nearest to its limit is the {nearest['name']}, "
        f"{margin} times below{where}."
    )
