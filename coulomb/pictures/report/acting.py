"""Tables of what acts on a body at the end of a run: loads, reactions, contact faces, probes; and of its stresses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from ...contact_names import sides_of
from ...io.field_files import Block
from .files import Run
from .shown_fields import FIELDS
from .units import number, quantity, vector

Table = list[tuple[str, ...]]

FORCES = ("", "force", "moment about the origin")
"""Columns of `forces`."""

FACES = ("face", "normal force", "force on what it touches", "moment", "area", "centre of pressure", "largest pressure")
"""Columns of `faces`."""

PROBES = ("probe", "point", "contact face", "displacement", "slip", "pressure")
"""Columns of `probes`."""

STRESSES = ("body", "stress", "smallest", "largest")
"""Columns of `stresses`."""


def forces(run: Run) -> Table:
    """Loads, reactions and contact forces on the body with their moments, and the balance; empty for older runs."""
    summary, accuracy = run.summary, run.accuracy
    if "reactions" not in summary:
        return []
    rows = [_row(_named(part), part, accuracy) for part in (*summary["loads"], *summary["reactions"])]
    faces = summary.get("faces", ())
    for (name, against), face in zip(sides_of(faces), faces, strict=True):
        rows.append(_row(f"contact at {name}", face, accuracy))
        if against is not None:
            opposite = {"force": face["opposite_force"], "moment": face["opposite_moment"]}
            rows.append(_row(f"contact at {against}, opposite", opposite, accuracy))
    rows += [(f"left over on {body['name']}", number(body["balance"], 2), "") for body in summary.get("bodies", ())]
    return [*rows, ("left over, relative to the largest", number(summary["balance"], 2), "")]


def faces(run: Run) -> Table:
    """The figures of every contact face, and of every pair."""
    shown, vectorial = partial(quantity, accuracy=run.accuracy), partial(vector, accuracy=run.accuracy)
    return [
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
    return [
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


def stresses(run: Run) -> Table:
    """Smallest and largest of every stress in every body; empty if it is not known."""
    grid, rows, unknown = run.steps[-1].grid("solution"), [], run.summary.get("forms") or {}
    whole = Block("the body", slice(0, len(grid.points)), slice(0, len(grid.cells)), grid.cell, 1)
    for body in grid.blocks or (whole,):
        for field in FIELDS:
            if "stress" in field.name and field.name in grid.fields and body.name not in unknown:
                values = grid.fields[field.name][body.cells]
                ends = (quantity(float(end), "Pa", accuracy=run.accuracy) for end in (values.min(), values.max()))
                rows.append((body.name, field.title, *ends))
    return rows


def _named(part: Mapping[str, Any]) -> str:
    kind = part["kind"].replace("_", " ")
    return kind if part["face"] is None else f"{kind} on {part['face']}"


def _row(name: str, part: Mapping[str, Any], accuracy: Mapping[str, float]) -> tuple[str, ...]:
    if part.get("kind") == "thermal":  # its forces add up to zero: what is left is rounding
        return (name, "0, in balance by itself", "0")
    return (name, vector(part["force"], "N", 5, accuracy), vector(part["moment"], "N m", 5, accuracy))
