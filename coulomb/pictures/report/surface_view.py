"""Data in the page for the interactive view of the contact surface (drawn by view.js and its parts)."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...contact_fields import names
from ...io.field_files import Grid
from ..plotting import ZONES, renderer, skin_of
from .camera import looking_at
from .files import Run, Step
from .limits import Limits, limits_of
from .merged import nodes_in_body, outward, same_nodes
from .sheet import AXES
from .shown_fields import named, ramp
from .units import in_seconds, scale_of

IntArray = npt.NDArray[np.int64]

SHOWN, ACCUMULATED = names(shown="report"), names(shown="history")
"""Fields in the menu, and those of load histories besides."""

MOST_NODES, MOST_VALUES, MOST_ARROWS = 40_000, 1_500_000, 900
"""Limits of a page: nodes of the surface, numbers over all nodes and steps, arrows."""

_A_NODE = len(SHOWN) + len(ACCUMULATED) + 6  # numbers per node and step: fields, displacement, traction


def surface_view(run: Run, scale: float) -> tuple[dict[str, Any], str]:
    """The data, and a remark on what had to be left out (or nothing).

    Args:
        run: The run.
        scale: Initial factor of the displacement.
    """
    first, body = run.steps[-1].grid("contact"), run.steps[-1].grid("solution")
    nodes, cells, faces = _thinned(first, MOST_NODES)
    most_steps = max(1, MOST_VALUES // (_A_NODE * len(nodes)))
    numbers = np.unique(np.round(np.linspace(0, len(run.steps) - 1, min(most_steps, len(run.steps)))).astype(int))
    if most_steps == 1:
        numbers = np.array([len(run.steps) - 1])
    points, size = first.points[nodes], float(np.linalg.norm(np.ptp(body.points, axis=0)))
    outline_nodes, lines = _outline(body)
    shown = _Shown(first, body, nodes, outline_nodes)
    direction, up = looking_at(outward(first))
    fields = [_field(run, name) for name in (*SHOWN, *(ACCUMULATED if run.is_history else ()))]
    largest = max(
        float(np.linalg.norm(step.grid("contact").fields["friction_traction"], axis=1).max()) for step in run.steps
    )
    every = max(1, -(-len(nodes) // MOST_ARROWS))
    cell = float(np.sqrt(np.sum(first.fields["area"]) / max(1, len(nodes) // every)))
    length_factor, length_unit = scale_of(size, "m")
    data = {
        "points": _packed(points),
        "faces": faces,
        "normals": _packed(first.fields["normal"][nodes]),
        "triangles": _packed(_by_face(_triangles, cells, faces), np.uint32),
        "edges": _packed(_by_face(_edges, cells, faces), np.uint32),
        "outline": {"points": _packed(body.points[outline_nodes]), "lines": _packed(lines, np.uint32)},
        "axes": [{"name": name, "colour": colour} for name, colour in zip("xyz", AXES, strict=True)],
        "size": size,
        "scale": scale,
        "length": {"factor": length_factor, "unit": length_unit},
        "direction": direction.tolist(),
        "up": up.tolist(),
        "arrow": {"every": every, "largest": largest or 1.0, "length": 1.5 * cell},
        "fields": [{key: value for key, value in entry.items() if key not in ("field", "limits")} for entry in fields],
        "steps": [_step(run.steps[k], fields, shown) for k in numbers],
        "flat": False,
    }
    notes = []
    if len(nodes) < len(first.points):
        notes.append(f"{len(nodes)} of {len(first.points)} nodes are shown")
    if len(numbers) < len(run.steps):
        notes.append(f"{len(numbers)} of {len(run.steps)} steps are shown")
    return data, "; ".join(notes)


def _field(run: Run, name: str) -> dict[str, Any]:
    """Entry of the field menu; values are divided by `factor`."""
    field = named(name)
    limits = limits_of(run, field)
    low, high = limits.low, limits.high
    factor, unit = scale_of(high, field.unit)
    entry: dict[str, Any] = {"name": name, "title": field.title, "unit": unit, "factor": factor, "field": field}
    entry |= {"low": low / factor, "high": high / factor, "colours": ramp(field), "limits": limits}
    entry["of_faces"] = {} if limits.ends == () else _share_of_faces(run.steps[-1].grid("contact"), limits)
    if field.zones:
        entry["zones"] = [{"name": zone, "colour": colour} for zone, colour in ZONES.values()]
    return entry


def _share_of_faces(contact: Grid, limits: Limits) -> dict[str, float]:
    """By name of a face its range over the largest."""
    share = np.asarray(limits.end_at(contact)) / limits.high
    return {block.name: float(np.max(share[block.points])) for block in contact.blocks}


class _Shown(NamedTuple):
    """The surface and the body of the last state, and the numbers of their nodes that are shown."""

    contact: Grid
    body: Grid
    nodes: IntArray
    outline: IntArray


def _step(step: Step, fields: Sequence[dict[str, Any]], shown: _Shown) -> dict[str, Any]:
    """Data of a step at these nodes: a history resumed on other ranks has its nodes in another order."""
    contact, body = step.grid("contact"), step.grid("solution")
    displacement = body.fields["displacement"]
    nodes = same_nodes(shown.contact.points, shown.contact.blocks, contact)[shown.nodes]
    outline = same_nodes(shown.body.points, shown.body.blocks, body)[shown.outline]
    return {
        "label": "" if step.time is None else f"time {in_seconds(step.time)}",
        "surface": _packed(displacement[nodes_in_body(contact, body)[nodes]]),
        "outline": _packed(displacement[outline]),
        "arrows": _packed(contact.fields["friction_traction"][nodes]),
        "values": {
            entry["name"]: _packed(entry["limits"].exact(entry["field"].values(contact))[nodes] / entry["factor"])
            for entry in fields
        },
    }


def _thinned(contact: Grid, most: int) -> tuple[IntArray, IntArray, list[dict[str, Any]]]:
    """`thinned_surface` of every face, with so many nodes in all, and the faces for the menu.

    Returns:
        Numbers of the nodes kept, the cells between them, and of every face its name, where its nodes, triangles and
        edges begin and end in the data, and the direction in which it is seen.
    """
    if not contact.blocks:
        return *thinned_surface(contact, most), []
    nodes, cells, faces, ends = [], [], [], [0, 0, 0]
    for block in contact.blocks:
        mine = Grid(contact.cell, contact.cells[block.cells] - block.points.start, contact.points[block.points], {})
        kept, corners = thinned_surface(mine, max(1, most * len(mine.points) // len(contact.points)))
        sizes = (len(kept), 3 * len(_triangles(corners)), 2 * len(_edges(corners)))
        here = {key: [end, end + n] for key, end, n in zip(("nodes", "triangles", "edges"), ends, sizes, strict=True)}
        normals = contact.fields["normal"][block.points]
        direction, up = looking_at(outward(mine._replace(fields={"normal": normals})))
        faces.append({"name": block.name, **here, "direction": direction.tolist(), "up": up.tolist()})
        nodes.append(kept + block.points.start)
        cells.append(corners + ends[0])
        ends = [end + n for end, n in zip(ends, sizes, strict=True)]
    return np.concatenate(nodes), np.concatenate(cells), faces


def thinned_surface(contact: Grid, most: int) -> tuple[IntArray, IntArray]:
    """A surface with at most about `most` nodes: per cube of a grid the node nearest to the mean of its nodes.

    Values are those of nodes; none is averaged.

    Returns:
        Numbers of the nodes kept (k,), and the cells between them, by their indices in that list; corners of cells of a
        thinned surface may coincide.
    """
    points, cells = contact.points, np.asarray(contact.cells, dtype=np.int64)
    everything: IntArray = np.arange(len(points))
    if len(points) <= most:
        return everything, cells
    extent = np.ptp(points, axis=0)
    edge = float(np.sqrt(max(np.sort(extent)[1:].prod(), 1e-300) / most))
    while True:
        cube = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
        _, cluster = np.unique(cube, axis=0, return_inverse=True)
        cluster = np.ravel(cluster)
        if cluster.max() < most:
            break
        edge *= 1.1
    count = np.bincount(cluster)
    mean = np.column_stack([np.bincount(cluster, points[:, k]) / count for k in range(3)])
    order = np.lexsort((np.linalg.norm(points - mean[cluster], axis=1), cluster))
    kept = order[np.searchsorted(cluster[order], np.arange(len(count)))]
    smaller = cluster[cells]
    different = np.array([len(set(corners)) >= 3 for corners in smaller.tolist()])
    return kept, np.unique(smaller[different], axis=0)


def _by_face(parts: Callable[[IntArray], IntArray], cells: IntArray, faces: Sequence[dict[str, Any]]) -> IntArray:
    """Triangles or edges of all cells, face by face."""
    if not faces:
        return parts(cells)
    found: IntArray = np.concatenate(
        [parts(cells[(face["nodes"][0] <= cells[:, 0]) & (cells[:, 0] < face["nodes"][1])]) for face in faces]
    )
    return found


def _triangles(cells: IntArray) -> IntArray:
    """Triangles of triangles and quadrilaterals, without degenerate ones."""
    parts = [cells[:, :3]] if cells.shape[1] == 3 else [cells[:, :3], cells[:, [0, 2, 3]]]
    found = np.concatenate(parts)
    proper = (found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2]) & (found[:, 2] != found[:, 0])
    kept: IntArray = found[proper]
    return kept


def _edges(cells: IntArray) -> IntArray:
    """Every edge of the cells once."""
    pairs = np.stack([cells, np.roll(cells, 1, axis=1)], axis=2).reshape(-1, 2)
    found: IntArray = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    return found


def _outline(body: Grid) -> tuple[IntArray, IntArray]:
    """Nodes and segments of the body's sharp edges."""
    skin = skin_of(renderer(), body, body.points)
    sharp = skin.extract_feature_edges(40.0, manifold_edges=False)
    if sharp.n_points == 0:  # a sphere has none
        return np.empty(0, dtype=np.int64), np.empty((0, 2), dtype=np.int64)
    nodes: IntArray = np.asarray(sharp.point_data["node"], dtype=np.int64)
    return nodes, np.asarray(sharp.lines, dtype=np.int64).reshape(-1, 3)[:, 1:]


def _packed(values: FloatArray | IntArray, kind: type[np.generic] = np.float32) -> str:
    """Numbers as base64 text for the page, little endian."""
    little = np.dtype(kind).newbyteorder("<")
    return base64.b64encode(np.ascontiguousarray(values, dtype=little).tobytes()).decode("ascii")
