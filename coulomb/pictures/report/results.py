"""Results as rows of text: totals, forces on the bodies, certificate, effort, and how the run was made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from functools import partial
from typing import Any

from ...contact_fields import named_faces, sides_of
from ...units import NARROW, in_seconds, number, quantity, vector
from .fields import FIELDS, zone_counts
from .files import Run
from .grids import blocks_of
from .words import bars_in_words, share_of_tolerance

Facts = list[tuple[str, str]]
Table = tuple[tuple[str, ...], list[tuple[str, ...]]]
"""Columns and rows."""


def totals(run: Run) -> Facts:
    """Totals at the end of the run."""
    summary, nodes, largest = run.summary, zone_counts(run.steps[-1].grid("contact")), run.summary["maximum"]
    shown, vectorial = partial(quantity, accuracy=run.accuracy), partial(vector, accuracy=run.accuracy)
    totals, in_step = summary["totals"], " in the last step" if run.is_history else ""
    bodies = summary.get("bodies") or ()
    rows = [(f"contact force on {body['name']}", vectorial(body["contact_force"], "N", 5)) for body in bodies]
    if not bodies and "force_on_body" in summary:  # not of components of one mesh in several pairs
        rows.append(("contact force on the body", vectorial(summary["force_on_body"]["vector"], "N", 5)))
    faces = named_faces(summary["faces"])
    for name, face in faces:
        of = f" of {name}" if len(faces) > 1 else ""
        rows.append((f"normal force{of}", shown(face["normal_force"], "N", 6)))
    rows += [
        ("largest contact pressure", shown(largest["contact_pressure"], "Pa", 5)),
        ("largest displacement", shown(largest["displacement"], "m", 5)),
    ]
    if not bodies and "moment" in totals:
        rows.insert(1, ("moment about the origin", vectorial(totals["moment"], "N m", 5)))
    rows.append(("area in contact", quantity(totals["contact_area"], "m²")))
    if "centre_of_pressure" in totals:
        centre = totals["centre_of_pressure"]
        rows.append(("centre of pressure", vector(centre, "m") if centre else "–"))
    rows += [
        (f"largest slip{in_step}", shown(totals["greatest_slip"], "m")),
        (f"energy dissipated by friction{in_step}", shown(totals["dissipated_energy"], "J")),
        *_rotating_foundations(run),
    ]
    for flow in summary.get("heat", {}).get("flows", ()):
        of = f" of {flow['face']}" if flow["face"] else ""
        rows.append((f"heat into the bodies{in_step}, {flow['kind']}{of}", quantity(flow["power"], "W", 5)))
    springs = summary["spring_force_on_body"]
    if any(springs):
        rows.append(("force of springs on the body", vectorial(springs, "N", 5)))
    if "slice" in summary:
        rows.insert(0, (summary["slice"]["kind"], f"forces are for {summary['slice']['forces_for']}"))
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
        ("largest slip accumulated at a node", shown(run.history["accumulated"]["largest_slip"], "m")),
        ("largest friction work per area", shown(run.history["accumulated"]["largest_friction_work"], "J/m²")),
        ("energy dissipated by friction", shown(energy["dissipated"], "J")),
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


def _at_step(largest: dict[str, Any], unit: str, accuracy: Mapping[str, float]) -> str:
    """A maximum with its step: 133.8 kPa (step 6, time 6 s)."""
    value = quantity(largest["value"], unit, 5, accuracy)
    return f"{value} (step {largest['step']}, time {in_seconds(largest['time'])})"


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
        ("ranks", str(run.summary["method"]["ranks"])),
    ]
    memory = (run.history if run.is_history else run.summary)["peak_memory_bytes"]
    return [*facts, ("peak memory, all ranks together", quantity(float(memory), "B", 3))]


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
                "resolved": bool(check.get("resolved", check["passed"])),
                "share": 100.0 * min(max((decades + 10.0) / 16.0, 0.012), 1.0),
                "decades": decades,
                "step": str(check.get("step", "")),
            }
        )
    return rows


def without_answer(run: Run) -> bool:
    """Whether a single run has found that there is no equilibrium."""
    return not run.is_history and run.summary["status"] == "no_equilibrium"


def in_words(run: Run) -> str:
    """The verdict of the certificate; without an answer the reason, whose consequences the failing conditions are."""
    if without_answer(run):
        reason = run.summary["message"]
        return f"{reason[0].upper()}{reason[1:]}. There is no answer to judge."
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
    known = [f" Contact forces are known to {row['value']} of the largest only." for row in rows if not row["resolved"]]
    return (
        f"All {len(rows)} conditions hold{each}. The nearest to its limit is the {nearest['name']}, "
        f"{margin} times below{where}.{''.join(known)}"
    )


def resolved(run: Run) -> bool:
    """Whether contact forces are known as well as the certificate wants, at every step."""
    return all(row["resolved"] for row in checks(run))


def _rotating_foundations(run: Run) -> list[tuple[str, str]]:
    """Torque and power of every rotating foundation at the end of the run, or of its last step."""
    summary, accuracy = run.summary, run.accuracy
    rows = []
    for face in [face for face in summary["faces"] if "torque" in face]:
        where = f" of {face['faces'][0]}" if len(summary["faces"]) > 1 else ""
        said = f"{quantity(face['torque'], 'N m', 5, accuracy)} at {number(face['angle'], 5)} rad"
        rows.append((f"torque of the contact on the foundation{where}", said))
        if face["power"] is not None:
            least = {"W": accuracy["N m"] * abs(face["angular_velocity"])}
            speed = f"{quantity(face['power'], 'W', 5, least)} at {number(face['angular_velocity'], 5)} rad/s"
            rows.append((f"power of the contact on the foundation{where}", speed))
    return rows


def forces(run: Run) -> Table:
    """Loads, reactions and contact forces on the body with their moments, and the balance."""
    summary, accuracy, columns = run.summary, run.accuracy, ("", "force", "moment about the origin")
    rows = [_row(_named(part), part, accuracy) for part in (*summary["loads"], *summary["reactions"])]
    rows += [
        _row(f"{part['kind'].replace('_', ' ')} on {part['face']}", part, accuracy) for part in summary.get("ties", ())
    ]
    rows += [
        _row(f"rigid face {face['face']}, about its point", face, accuracy) for face in summary.get("rigid_faces", ())
    ]
    rows += [
        _row(f"contact on the foundation of {one['face']}, about its point", one, accuracy)
        for one in summary.get("loaded_foundations", ())
    ]
    rows += [
        (
            f"bolt at {bolt['face']}, {'' if bolt['locked'] else 'not '}locked, shortened by "
            f"{quantity(bolt['shortening'], 'm', 5)}",
            f"pulls {quantity(bolt['force'], 'N', 5)}, shear {quantity(bolt['shear'], 'N', 3)}",
            f"bending {quantity(bolt['bending'], 'N m', 3)}",
        )
        for bolt in summary.get("bolts", ())
    ]
    faces = summary["faces"]
    for (name, against), face in zip(sides_of(faces), faces, strict=True):
        rows.append(_row(f"contact at {name}", face, accuracy))
        if against is not None:
            opposite = {"force": face["opposite_force"], "moment": face["opposite_moment"]}
            rows.append(_row(f"contact at {against}, opposite", opposite, accuracy))
    rows += [
        (f"left over on {body['name']}, relative to the largest force", number(body["balance"], 2), "")
        for body in summary.get("bodies", ())
    ]
    return columns, [*rows, ("left over, relative to the largest force", number(summary["balance"], 2), "")]


def faces(run: Run) -> Table:
    """The figures of every contact face, and of every pair."""
    shown, vectorial = partial(quantity, accuracy=run.accuracy), partial(vector, accuracy=run.accuracy)
    columns = ("face", "normal force", "force on what it touches", "moment", "area", "centre of pressure")
    return (*columns, "largest pressure"), [
        (
            f"{face['faces'][0]} against {face['against']}" if "against" in face else face["faces"][0],
            shown(face["normal_force"], "N"),
            vectorial([-value for value in face["force"]], "N"),
            vectorial([-value for value in face["moment"]], "N m"),
            quantity(face["contact_area"], "m²"),
            vector(face["centre_of_pressure"], "m") if face["centre_of_pressure"] else "–",
            shown(face["greatest_pressure"], "Pa"),
        )
        for face in run.summary.get("faces", ())
    ]


def probes(run: Run) -> Table:
    """What is at every probe."""
    shown, vectorial = partial(quantity, accuracy=run.accuracy), partial(vector, accuracy=run.accuracy)
    return ("probe", "point", "contact face", "displacement", "slip", "pressure"), [
        (
            probe["name"],
            vector(probe["point"], "m"),
            probe["face"] or "–",
            vectorial(probe["displacement"], "m"),
            vectorial(probe["slip"], "m") if probe["slip"] else "–",
            shown(probe["pressure"], "Pa"),
        )
        for probe in run.summary.get("probes", ())
    ]


def error_bars(run: Run) -> Table:
    """Every total with its error bar, and the observed order of convergence; empty if they were not asked for."""
    return ("total", "value and error of the mesh", "order"), list(bars_in_words(run.summary))


def left_by_tolerance(run: Run) -> str:
    """What part of the error bars the tolerance of the solver leaves, as a sentence; empty without error bars."""
    if (largest := share_of_tolerance(run.summary)) is None:
        return ""
    share, total = largest
    part = f"{number(100.0 * share, 2)}{NARROW}% of an error bar, that of {total}"
    return f"The solver's tolerance, {number(run.tolerance)}, leaves at most {part}; the rest is of the mesh."


def stresses(run: Run) -> Table:
    """Smallest and largest of every stress in every body; empty if it is not known."""
    grid, rows, unknown = run.steps[-1].grid("solution"), [], run.summary.get("forms") or {}
    for body in blocks_of(grid):
        for field in FIELDS:
            if "stress" in field.name and field.name in grid.fields and body.name not in unknown:
                values = grid.fields[field.name][body.cells]
                ends = (quantity(float(end), "Pa", accuracy=run.accuracy) for end in (values.min(), values.max()))
                rows.append((body.name or "the body", field.title, *ends))
    return ("body", "stress", "smallest", "largest"), rows


def _named(part: Mapping[str, Any]) -> str:
    kind = part["kind"].replace("_", " ")
    return kind if part["face"] is None else f"{kind} on {part['face']}"


def _row(name: str, part: Mapping[str, Any], accuracy: Mapping[str, float]) -> tuple[str, ...]:
    if part.get("kind") == "thermal":  # its forces add up to zero: what is left is rounding
        return (name, "0, in balance by itself", "0")
    return (name, vector(part["force"], "N", 5, accuracy), vector(part["moment"], "N m", 5, accuracy))
