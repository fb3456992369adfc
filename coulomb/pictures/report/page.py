"""The report of a run: one self-contained HTML page."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from PIL import Image

from ...contact_fields import normal_forces
from ...regular_file import replacing
from ...units import in_seconds, number, quantity, scale_of, vector
from . import charts, problem, results
from .fields import AXES, ZONES, Bar, Field, limits_of, named, ramp, zone_counts
from .files import Run, read_run
from .picture import draw
from .scene import Look, Shot, automatic_scale, cropped, shoot
from .surface_view import surface_view
from .words import compared_in_words

PICTURES = (
    ("pressure", "contact"),
    ("friction_traction", "contact"),
    ("status", "contact"),
    ("friction_use", "contact"),
    ("displacement", "iso"),
    ("von_mises_stress", "iso"),
    ("principal_stress_1", "iso"),
    ("principal_stress_3", "iso"),
    ("stress_error", "iso"),
)
"""Fields and views of the pictures."""

OF_HISTORIES = (("friction_work", "contact"),)
"""Further pictures of a load history."""

SCRIPTS = ("drawing.js", "controls.js")
"""Scripts of the page, in one function."""


def write(directory: str | Path, save: str | Path, run: Run | None = None) -> Path:
    """Write the report of a run, single or a load history, converged or not, as one page; it may have been read.

    Raises:
        ValueError: If the directory contains no run, or a file cannot be read.
        OSError: If the page cannot be written; no partial file is left then.
    """
    page = render(run or read_run(directory))
    target = Path(save)
    try:
        with replacing(target) as partial:
            partial.write_text(page, encoding="utf-8")
    except OSError as error:
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(save)) from None
    return target


def render(run: Run) -> str:
    """The page as text."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    scale, alarm = automatic_scale(run), run.alarm or ("NOT CERTIFIED" if _unfinished(run) else "")
    data, omitted = surface_view(run, scale)
    here = Path(__file__).parent
    return environment.get_template("page.html").render(
        title=run.title,
        judged="failed" if alarm else "passed" if results.resolved(run) else "unresolved",
        alarm=alarm,
        verdict=results.in_words(run),
        no_answer=results.without_answer(run),
        made=results.made_in_short(run),
        message=run.summary.get("message", "") or _unfinished(run),
        warnings=run.warnings,
        run=run,
        status=run.summary["status"].replace("_", " "),
        residual=number(run.summary.get("residual") or float("nan"), 2),
        tiles=_tiles(run),
        scale=number(scale),
        facts={
            "geometry": problem.geometry(run),
            "totals": results.totals(run),
            "history": results.history_totals(run),
            "made": results.made(run),
            "effort": results.effort(run),
            "seconds": results.seconds(run),
            "versions": list(run.summary["versions"].items()),
        },
        tables={
            "forces": results.forces(run),
            "faces": results.faces(run),
            "probes": results.probes(run),
            "error_bars": results.error_bars(run),
            "stresses": results.stresses(run),
        },
        case=problem.case_as_text(run),
        error_meshes=compared_in_words(run.summary),
        left_by_tolerance=results.left_by_tolerance(run),
        checks=results.checks(run),
        pictures=_pictures(run, scale),
        charts=_charts(run),
        steps=_table(run),
        force_in_steps=_force_in_steps(run),
        omitted=omitted,
        data=json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        style=(here / "page.css").read_text(encoding="utf-8"),
        script="\n".join((here / name).read_text(encoding="utf-8") for name in SCRIPTS),
    )


def _unfinished(run: Run) -> str:
    """A sentence about the steps not taken; empty if the history is complete."""
    pending = (run.summary.get("step") or {}).get("pending") if run.is_history else None
    if not pending:
        return ""
    reached, end = run.rows[-1]["time"], pending[0]
    return f"The history stopped at time {in_seconds(reached)}, before its end at {in_seconds(end)}."


def _tiles(run: Run) -> list[tuple[str, str]]:
    """The key figures."""
    summary, nodes = run.summary, zone_counts(run.steps[-1].grid("contact"))
    shown = partial(quantity, accuracy=run.accuracy)
    on_body = summary.get("force_on_body", {})
    at_end = " at the end" if run.is_history else ""
    forces = []  # of several contacts they are in the tables
    if "normal" in on_body:
        along = sum(value**2 for value in on_body["tangential"]) ** 0.5
        forces = [
            (f"normal force{at_end}", shown(on_body["normal"], "N")),
            (f"friction force{at_end}", shown(along, "N")),
        ]
    zones = f"{nodes['open']} / {nodes['stick']} / {nodes['slip']}"
    if not run.is_history:
        return [
            *forces,
            ("largest pressure", shown(summary["maximum"]["contact_pressure"], "Pa")),
            ("largest slip", shown(summary["totals"]["greatest_slip"], "m")),
            ("open / stick / slip", zones),
        ]
    pressure, slip = run.history["maximum"]["contact_pressure"], run.history["maximum"]["slip_in_a_step"]
    return [
        ("steps certified", f"{run.history['certified_steps']} of {run.history['steps']}"),
        (f"largest pressure, step {pressure['step']}", shown(pressure["value"], "Pa")),
        (f"largest slip in one step, step {slip['step']}", shown(slip["value"], "m")),
        ("dissipated, all steps", shown(run.history["energy"]["dissipated"], "J")),
        *forces,
        ("open / stick / slip at the end", zones),
    ]


def _pictures(run: Run, scale: float) -> list[dict[str, Any]]:
    """Pictures of the last step, with their colour legends."""
    entries = []
    step = run.steps[-1]
    for name, view in (*PICTURES, *(OF_HISTORIES if run.is_history else ())):
        field = named(name)
        if (
            field.name.startswith(("von_mises", "principal", "stress_error"))
            and field.name not in step.grid(field.file).fields
        ):
            continue  # the stress of the user's forms is not known, its error only beside error bars
        limits = limits_of(run, field)
        shot = cropped([shoot(step, Look(field, limits, scale, view), (1050, 780))])[0]
        file = io.BytesIO()
        Image.fromarray(shot.pixels).save(file, "png", compress_level=6)
        png = base64.b64encode(file.getvalue()).decode("ascii")
        entry: dict[str, Any] = {
            "name": name,
            "title": field.title[0].upper() + field.title[1:],
            "source": f"data:image/png;base64,{png}",
        }
        entry |= {"axes": _axes(shot), "zones": [], "ramp": ", ".join(ramp(field, 17)), "bars": []}
        if field.zones:
            counts = zone_counts(step.grid("contact"))
            shown = [zone for zone in counts if counts[zone] or zone != ZONES[3][0]]  # as in `picture.legend`
            entry["zones"] = [(zone, colour, counts[zone]) for zone, colour in ZONES.values() if zone in shown]
        else:
            grid = step.grid(field.file)
            entry["bars"] = [_bar(field, bar) for bar in limits.bars(field.values(grid), grid)]
        entries.append(entry)
    return entries


def _bar(field: Field, bar: Bar) -> dict[str, Any]:
    """The numbers below a colour bar, and its title."""
    factor, unit = scale_of(bar.high, field.unit)
    places = [(1.0 - part) * bar.low + part * bar.high for part in (0.0, 0.25, 0.5, 0.75, 1.0)]
    title = f"{bar.of}: {field.title}" if bar.of else field.title[0].upper() + field.title[1:]
    return {"ticks": [number(place / factor, 3) for place in places], "title": f"{title}, {unit}" if unit else title}


def _axes(shot: Shot) -> list[dict[str, Any]]:
    """Name, colour, end and place of the name of each axis on a square from -1.7 to 1.7, down positive as in SVG."""
    axes = []
    for name, colour, (right, up) in zip("xyz", AXES, shot.axes, strict=True):
        length = float(np.hypot(right, up))
        away = (right / length, up / length) if length > 0.1 else (0.7, 0.7)  # otherwise it points at the camera
        place = [1.25 * length * v + 0.38 * w for v, w in zip((right, up), away, strict=True)] if length > 0.1 else away
        ends = {"x": float(right), "y": -float(up), "name_x": float(place[0]), "name_y": 0.17 - float(place[1])}
        axes.append({"name": name, "colour": colour, **ends})
    return axes


def _charts(run: Run) -> dict[str, str]:
    found = {"convergence": charts.convergence(run), "meshes": charts.meshes(run)}
    found["sensitivities"] = charts.sensitivities(run)
    if run.is_history:
        found |= {"forces": charts.forces(run), "driven": charts.force_displacement(run), "torque": charts.torque(run)}
        found |= {"surface": charts.surface(run), "effort": charts.effort(run)}
        found |= {"reactions": charts.reactions(run), "probes": charts.probes(run)}
    return found


def _table(run: Run) -> list[list[str]]:
    """For a load history: time, force, zones, energy of friction, certificate; a row per step."""
    shown = partial(quantity, accuracy=run.accuracy)
    return [
        [
            f"{int(row['step'])}",
            in_seconds(row["time"]),
            _forces_of(row, run.accuracy),
            shown(row["greatest_pressure"], "Pa"),
            " / ".join(str(zone_counts(step.grid("contact"))[zone]) for zone in ("open", "stick", "slip")),
            shown(row["energy_dissipated"], "J"),
            f"{int(row['path_following'])}",
            number(row["residual"], 2),
            "FAILED" if not row["certified"] else "passed" if row["valid"] else "outside the theory",
        ]
        for row, step in zip(run.rows, run.steps, strict=False)  # a single run has no rows
    ]


def _force_in_steps(run: Run) -> str:
    """What `_forces_of` gives."""
    if not run.rows or "force_x" in run.rows[0]:
        return "contact force on the body"
    return f"normal force of {' / '.join(normal_forces(run.rows[0]))}"


def _forces_of(row: dict[str, float], accuracy: Mapping[str, float]) -> str:
    """The contact force on the body; of several contacts whose forces have no sum the normal forces."""
    if "force_x" in row:
        return vector([row["force_x"], row["force_y"], row["force_z"]], "N", accuracy=accuracy)
    return " / ".join(quantity(value, "N", accuracy=accuracy) for value in normal_forces(row).values())


def with_picture(arguments: list[str]) -> str:
    """DIRECTORY FILE: picture.png as well, by libraries and from files that are loaded once."""
    directory, save = arguments
    run = read_run(directory)
    draw(Path(directory), run)
    return str(write(directory, save, run))


def main(arguments: list[str]) -> str:
    """DIRECTORY FILE."""
    directory, save = arguments
    return str(write(directory, save))
