"""Data in the page for the interactive view of the contact surface (drawn by drawing.js and controls.js)."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...arrays import FloatArray, IntArray
from ...contact_fields import names
from ...io.field_files import Grid
from ...units import in_seconds, scale_of
from .fields import AXES, ZONES, limits_of, named, ramp
from .files import Run, Step
from .grids import blocks_of, nodes_in_body, nodes_of, outward, skin_of
from .scene import looking_at

SHOWN, ACCUMULATED = names(shown="report"), names(shown="history")
"""Fields in the menu, and those of load histories besides."""

MOST_VALUES, MOST_ARROWS = 1_500_000, 900
"""Limits of a page: numbers over all nodes and steps, and arrows."""

_A_NODE = len(SHOWN) + len(ACCUMULATED) + 6  # numbers per node and step: fields, displacement, traction


def surface_view(run: Run, scale: float) -> tuple[dict[str, Any], str]:
    """The data, at first with this factor of the displacement, and a remark on what is left out (or nothing)."""
    last, body = run.steps[-1].grid("contact"), run.steps[-1].grid("solution")
    most_steps = max(1, MOST_VALUES // (_A_NODE * len(last.points)))
    if most_steps == 1:
        numbers = np.array([len(run.steps) - 1])
    else:
        numbers = np.unique(np.round(np.linspace(0, len(run.steps) - 1, min(most_steps, len(run.steps)))).astype(int))
    size = float(np.linalg.norm(np.ptp(body.points, axis=0)))
    triangles, edges, faces = _connected(last)
    outline_nodes, lines = _outline(body)
    direction, up = looking_at(outward(last))
    fields = [_field(run, name) for name in (*SHOWN, *(ACCUMULATED if run.is_history else ()))]
    largest = max(
        float(np.linalg.norm(step.grid("contact").fields["friction_traction"], axis=1).max()) for step in run.steps
    )
    every = max(1, -(-len(last.points) // MOST_ARROWS))
    cell = float(np.sqrt(np.sum(last.fields["area"]) / max(1, len(last.points) // every)))
    length_factor, length_unit = scale_of(size, "m")
    data = {
        "points": _packed(last.points),
        "faces": faces,
        "normals": _packed(last.fields["normal"]),
        "triangles": _packed(triangles, np.uint32),
        "edges": _packed(edges, np.uint32),
        "outline": {"points": _packed(body.points[outline_nodes]), "lines": _packed(lines, np.uint32)},
        "axes": [{"name": name, "colour": colour} for name, colour in zip("xyz", AXES, strict=True)],
        "size": size,
        "scale": scale,
        "length": {"factor": length_factor, "unit": length_unit},
        "direction": direction.tolist(),
        "up": up.tolist(),
        "arrow": {"every": every, "largest": largest or 1.0, "length": 1.5 * cell},
        "fields": [{key: value for key, value in entry.items() if key not in ("field", "limits")} for entry in fields],
        "steps": [_step(run.steps[k], fields, run.steps[-1], outline_nodes) for k in numbers],
    }
    return data, f"{len(numbers)} of {len(run.steps)} steps are shown" if len(numbers) < len(run.steps) else ""


def _field(run: Run, name: str) -> dict[str, Any]:
    """Entry of the field menu; values are divided by `factor`."""
    field = named(name)
    limits = limits_of(run, field)
    low, high = limits.low, limits.high
    factor, unit = scale_of(high, field.unit)
    entry: dict[str, Any] = {"name": name, "title": field.title, "unit": unit, "factor": factor, "field": field}
    entry |= {"low": low / factor, "high": high / factor, "colours": ramp(field), "limits": limits}
    contact = run.steps[-1].grid("contact")
    share = np.asarray(limits.end_at(contact)) / high
    entry["of_faces"] = {block.name: float(np.max(share[block.points])) for block in contact.blocks if limits.ends}
    if field.zones:
        entry["zones"] = [{"name": zone, "colour": colour} for zone, colour in ZONES.values()]
    return entry


def _step(step: Step, fields: Sequence[dict[str, Any]], last: Step, outline_nodes: IntArray) -> dict[str, Any]:
    """Data of a step at the nodes of the contact faces and, by their numbers, of the edges of the body in the last
    step: a history resumed on other ranks has its nodes in another order."""
    contact, body = step.grid("contact"), step.grid("solution")
    displacement = body.fields["displacement"]
    nodes, outline = (
        nodes_of(of_last, grid) for of_last, grid in ((last.grid("contact"), contact), (last.grid("solution"), body))
    )
    return {
        "label": "" if step.time is None else f"time {in_seconds(step.time)}",
        "surface": _packed(displacement[nodes_in_body(contact, body)[nodes]]),
        "outline": _packed(displacement[outline[outline_nodes]]),
        "arrows": _packed(contact.fields["friction_traction"][nodes]),
        "values": {
            entry["name"]: _packed(entry["limits"].exact(entry["field"].values(contact))[nodes] / entry["factor"])
            for entry in fields
        },
    }


def _connected(contact: Grid) -> tuple[IntArray, IntArray, list[dict[str, Any]]]:
    """Triangles and edges of all faces, face by face, and of several faces the entries of the menu: the name, where
    nodes, triangles and edges of the face begin and end, and the direction in which it is seen."""
    triangles, edges, faces, begun = [], [], [], (0, 0)
    for block in blocks_of(contact):
        cells = np.asarray(contact.cells[block.cells], dtype=np.int64)
        triangles.append(_triangles(cells).ravel())
        edges.append(_edges(cells).ravel())
        ended = (begun[0] + len(triangles[-1]), begun[1] + len(edges[-1]))
        normals = {"normal": contact.fields["normal"][block.points]}
        direction, up = looking_at(outward(Grid(contact.cell, cells, contact.points[block.points], normals)))
        ranges = {"nodes": (block.points.start, block.points.stop)}
        ranges |= {"triangles": (begun[0], ended[0]), "edges": (begun[1], ended[1])}
        faces.append({"name": block.name, **ranges, "direction": direction.tolist(), "up": up.tolist()})
        begun = ended
    return np.concatenate(triangles), np.concatenate(edges), faces if contact.blocks else []


def _triangles(cells: IntArray) -> IntArray:
    """Triangles of triangles and quadrilaterals, without degenerate ones."""
    parts = [cells[:, :3]] if cells.shape[1] == 3 else [cells[:, :3], cells[:, [0, 2, 3]]]
    found = np.concatenate(parts)
    proper = (found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2]) & (found[:, 2] != found[:, 0])
    return found[proper]


def _edges(cells: IntArray) -> IntArray:
    """Every edge of the cells once."""
    pairs = np.stack([cells, np.roll(cells, 1, axis=1)], axis=2).reshape(-1, 2)
    return np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)


def _outline(body: Grid) -> tuple[IntArray, IntArray]:
    """Nodes and segments of the body's sharp edges."""
    skin = skin_of(body, body.points)
    sharp = skin.extract_feature_edges(40.0, manifold_edges=False)
    if sharp.n_points == 0:  # a sphere has none
        return np.empty(0, dtype=np.int64), np.empty((0, 2), dtype=np.int64)
    nodes: IntArray = np.asarray(sharp.point_data["node"], dtype=np.int64)
    return nodes, np.asarray(sharp.lines, dtype=np.int64).reshape(-1, 3)[:, 1:]


def _packed(values: FloatArray | IntArray, kind: type[np.generic] = np.float32) -> str:
    """Numbers as base64 text for the page, little endian."""
    little = np.dtype(kind).newbyteorder("<")
    return base64.b64encode(np.ascontiguousarray(values, dtype=little).tobytes()).decode("ascii")
