"""Grids of a run for pictures: second-order cells cut, bodies as one grid, those of pairs drawn apart, their skin."""

from __future__ import annotations

import ctypes.util
import itertools
import os
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from ...contact_fields import AGAINST
from ...io.field_files import NODE, OPPOSITE, WHOLE, Block, Grid
from ...nearest import in_a_cell, same_nodes, tree_of

_LATTICE = {
    **{(0, 0, 0): 0, (2, 0, 0): 1, (2, 2, 0): 2, (0, 2, 0): 3, (0, 0, 2): 4, (2, 0, 2): 5, (2, 2, 2): 6, (0, 2, 2): 7},
    **{(1, 0, 0): 8, (2, 1, 0): 9, (1, 2, 0): 10, (0, 1, 0): 11, (1, 0, 2): 12, (2, 1, 2): 13, (1, 2, 2): 14},
    **{(0, 1, 2): 15, (0, 0, 1): 16, (2, 0, 1): 17, (2, 2, 1): 18, (0, 2, 1): 19, (0, 1, 1): 20, (2, 1, 1): 21},
    **{(1, 0, 1): 22, (1, 2, 1): 23, (1, 1, 0): 24, (1, 1, 2): 25, (1, 1, 1): 26},
}
"""The nodes of a 27-node hexahedron in VTK's order, by their places."""

_AROUND = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))

_PIECES = {
    "Triangle_6": ("Triangle", ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))),
    "Quadrilateral_9": ("Quadrilateral", ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))),
    "Tetrahedron_10": (
        "Tetrahedron",
        (
            *((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3)),  # at the corners
            *((6, 8, 4, 5), (6, 8, 5, 9), (6, 8, 9, 7), (6, 8, 7, 4)),  # the octahedron between them
        ),
    ),
    "Hexahedron_27": (
        "Hexahedron",
        tuple(
            tuple(_LATTICE[i + a, j + b, k + c] for a, b, c in _AROUND)
            for i, j, k in itertools.product((0, 1), repeat=3)
        ),
    ),
}
"""By XDMF's name of a cell that of its pieces, and their nodes; all in VTK's order."""


def first_order(grid: Grid) -> Grid:
    """A grid with every second-order cell cut into first-order ones at its nodes; others as they are."""
    if grid.cell not in _PIECES:
        return grid
    kind, pieces = _PIECES[grid.cell]
    cells = grid.cells[:, np.array(pieces)].reshape(-1, len(pieces[0]))
    fields = {
        name: np.repeat(values, len(pieces), axis=0) if name in grid.on_cells else values
        for name, values in grid.fields.items()
    }
    return Grid(kind, cells, grid.points, fields, grid.on_cells, grid.cell, len(pieces))


def blocks_of(grid: Grid) -> tuple[Block, ...]:
    """The bodies or faces in a grid; a grid of one only is a block without a name."""
    whole = Block("", slice(0, len(grid.points)), slice(0, len(grid.cells)), grid.cut or grid.cell, grid.pieces)
    return grid.blocks or (whole,)


def contact_points(contact: Grid) -> BoolArray:
    """Which nodes of the contact faces have contact conditions, shape (n,): on cut quadratic triangles the vertices,
    and none on faces opposite in pairs."""
    if OPPOSITE in contact.fields:
        mine = np.asarray(contact.fields[OPPOSITE] < 0.0)
    else:
        mine = np.ones(len(contact.points), dtype=bool)
    for block in blocks_of(contact):
        if block.kind == "Triangle_6":
            corners = contact.cells[block.cells].reshape(-1, 4, contact.cells.shape[1])[:, [0, 1, 2], [0, 1, 2]]
            mine[block.points] &= np.isin(np.arange(len(contact.points))[block.points], corners)
    return mine


_APART: Final = 0.55
"""How far bodies are drawn apart, over the diagonal of the face between them: seen from the side (`camera.beside`) the
upper body then hides nothing of the lower face."""

_ELSEWHERE = {"status": 3.0, OPPOSITE: -1.0}
"""Values of fields on grids that do not have them; 0 for all others."""


def merged(grids: Mapping[str, Grid]) -> Grid:
    """All grids of a file as one, with the fields of all and every face once; the only grid of a file as it is."""
    if list(grids) == [WHOLE]:
        return grids[WHOLE]
    grids = _each_face_once(grids)
    parts = list(grids.values())
    width = max(part.cells.shape[1] for part in parts)
    ends = np.cumsum([(0, 0), *((len(part.points), len(part.cells)) for part in parts)], axis=0).tolist()
    blocks = tuple(
        Block(name, slice(first, last), slice(first_cell, last_cell), part.cut or part.cell, part.pieces)
        for (name, part), (first, first_cell), (last, last_cell) in zip(grids.items(), ends[:-1], ends[1:], strict=True)
    )
    cells = [
        np.pad(part.cells, ((0, 0), (0, width - part.cells.shape[1])), mode="edge") + first
        for part, (first, _) in zip(parts, ends, strict=False)
    ]
    names = dict.fromkeys(name for part in parts for name in part.fields)
    widest = max(parts, key=lambda part: part.cells.shape[1])
    return Grid(
        widest.cell,
        np.concatenate(cells),
        np.concatenate([part.points for part in parts]),
        {name: _everywhere(name, parts) for name in names},
        frozenset().union(*(part.on_cells for part in parts)),
        widest.cut,
        widest.pieces,
        blocks,
    )


def _each_face_once(grids: Mapping[str, Grid]) -> dict[str, Grid]:
    """The grids of a file, those of a face in several contacts as one (`_together`)."""
    of_face: dict[str, list[Grid]] = {}
    for name, grid in grids.items():
        of_face.setdefault(name.partition(AGAINST)[0] if "status" in grid.fields else name, []).append(grid)
    return {face: parts[0] if len(parts) == 1 else _together(parts) for face, parts in of_face.items()}


def _together(parts: Sequence[Grid]) -> Grid:
    """A face in several contacts: every node has the values of the contact whose contact point it is, else of those
    that it is opposite to the one with the largest pressure."""
    touching = [np.round(part.fields["status"]) != _ELSEWHERE["status"] for part in parts]
    ranking = [
        np.where(here, part.fields["pressure"] if OPPOSITE in part.fields else np.inf, -1.0)
        for part, here in zip(parts, touching, strict=True)
    ]
    count = len(parts[0].points)
    chosen = count * np.argmax(ranking, axis=0) + np.arange(count)
    names = dict.fromkeys(name for part in parts for name in part.fields)
    return parts[0]._replace(fields={name: _everywhere(name, parts)[chosen] for name in names})


def _everywhere(name: str, parts: Sequence[Grid]) -> FloatArray:
    """A field on all grids."""
    here = next(part for part in parts if name in part.fields)
    nothing, shape = _ELSEWHERE.get(name, 0.0), here.fields[name].shape[1:]
    sizes = [len(part.cells if name in here.on_cells else part.points) for part in parts]
    rows = [part.fields.get(name, np.full((n, *shape), nothing)) for part, n in zip(parts, sizes, strict=True)]
    return np.concatenate([np.asarray(row, dtype=np.float64) for row in rows])


def body_of(name: str) -> str:
    """Name of the body in the name of one of its faces, "lower:top"; empty for the face of a single body."""
    body, colon, _ = name.partition(":")
    return body if colon else ""


def opposite(contact: Grid) -> BoolArray:
    """Which points are on faces opposite in pairs, shape (n,)."""
    of = np.asarray(contact.fields.get(OPPOSITE, np.full(len(contact.points), -1.0)))
    return np.asarray(of >= 0.0)


def have_partner(contact: Grid) -> BoolArray:
    """Which points have a partner, a foundation or a face opposite, shape (n,): all but those with the status held."""
    return np.asarray(np.round(contact.fields["status"]) != _ELSEWHERE["status"])


def outward(contact: Grid) -> FloatArray:
    """Mean outward normal of the body on its contact face, (3,), of length 1; with pairs that of the faces opposite,
    where they have a partner, or if it points down that of their partners: of bodies drawn apart z is upward."""
    normals, of_pairs = contact.fields["normal"], opposite(contact)
    if np.any(of_pairs):
        partner = of_pairs & have_partner(contact)
        normals = normals[partner if np.any(partner) else of_pairs]
    mean: FloatArray = np.sum(normals, axis=0)
    if np.any(of_pairs) and mean[2] < 0.0:
        mean = -mean
    length = float(np.linalg.norm(mean))
    if length <= 1e-6 * len(normals):  # closed around another body
        return np.array([0.0, 0.0, 1.0 if np.any(of_pairs) else -1.0])
    return np.asarray(mean / length, dtype=np.float64)


def nodes_in_body(contact: Grid, body: Grid) -> IntArray:
    """The node of its own body at every point of the contact faces, shape (n,): bodies touch at coincident nodes.
    Without the numbers of the nodes, or if the body is none (`Step`), the nearest of this body."""
    of_body, everywhere = {one.name: one.points for one in body.blocks}, slice(0, len(body.points))
    node = np.rint(contact.fields.get(NODE, np.zeros(len(contact.points)))).astype(np.int64)
    for block in blocks_of(contact):
        nodes, x = of_body.get(body_of(block.name), everywhere), contact.points[block.points]
        here = np.minimum(nodes.start + node[block.points], nodes.stop - 1)
        if not np.array_equal(body.points[here], x):
            here = nodes.start + tree_of(body.points[nodes]).query(x)[1]
        node[block.points] = here
    return node


def nodes_of(one: Grid, other: Grid) -> IntArray:
    """The points of a grid in another state, `other`, that are the points of `one` (k, 3): nodes may be in another
    order.  Those of a block are in the block of the same name."""
    there = {block.name: block for block in blocks_of(other)}
    node = np.zeros(len(one.points), dtype=np.int64)
    for block in blocks_of(one):
        same, x = there[block.name], one.points[block.points]
        inside = in_a_cell(x, one.cells[block.cells] - block.points.start)
        points, cells = other.points[same.points], other.cells[same.cells] - same.points.start
        node[block.points] = same.points.start + same_nodes(x, inside, points, cells, 1e-9 * float(np.ptp(x)))
    return node


def drawn_apart(body: Grid, contact: Grid) -> tuple[Grid, Grid]:
    """Both grids with the bodies of pairs moved apart, so that both faces of a pair are seen.

    The bodies of a pair are moved apart along the mean normal of its face; a face around its partner, as a hole around
    a pin, along its axis.  A body in several pairs takes the mean of what these ask.
    """
    away = _shifts(body, contact)
    if not away:
        return body, contact
    moved, on_faces = body.points.copy(), contact.points.copy()
    for block in body.blocks:
        moved[block.points] += away[block.name]
    for block in contact.blocks:
        on_faces[block.points] += away.get(body_of(block.name), 0.0)
    return body._replace(points=moved), contact._replace(points=on_faces)


def _shifts(body: Grid, contact: Grid) -> dict[str, FloatArray]:
    """Displacement of every body by which it is drawn apart, metres; empty without pairs of bodies."""
    number = {block.name: k for k, block in enumerate(body.blocks)}
    faces = {block.name: block for block in contact.blocks}
    rows, wanted = [], []
    for name, block in faces.items():
        of = contact.fields.get(OPPOSITE, np.full(len(contact.points), -1.0))[block.points]
        for pair in np.unique(of[of >= 0.0]):
            slave = next((b for b in contact.blocks if np.any(_on_face(contact, b, pair))), None)
            if slave is None:
                continue
            one, other = (number.get(body_of(n)) for n in (name, slave.name))
            if one is None or other is None or one == other:
                continue
            row = np.zeros(len(number))
            row[one], row[other] = -1.0, 1.0  # what is opposite stays, the other moves along its normal
            rows.append(row)
            staying, moving = (body.points[body.blocks[k].points] for k in (one, other))
            nodes = np.flatnonzero(of == pair) + block.points.start
            face = contact.points[slave.points][_on_face(contact, slave, pair)]
            wanted.append(_way_out(contact, nodes, face, staying, moving))
    if not rows:
        return {}
    steady = 1e-6 * np.eye(len(number))  # bodies in no pair stay
    shifts, *_ = np.linalg.lstsq(
        np.vstack([*rows, steady]), np.vstack([*wanted, np.zeros((len(number), 3))]), rcond=None
    )
    return {name: shifts[k] for name, k in number.items()}


def _on_face(contact: Grid, block: Block, number: float) -> BoolArray:
    """Which points of a block are on the face of the contact of this number, not on that opposite."""
    on, of = (contact.fields[name][block.points] for name in ("face", OPPOSITE))
    return np.asarray((of < 0.0) & (on == number))


def _way_out(contact: Grid, nodes: IntArray, face: FloatArray, staying: FloatArray, body: FloatArray) -> FloatArray:
    """How a body is drawn apart from a face, metres, (3,): `nodes` of the contact faces are opposite to it; `face` are
    the points (p, 3) of its own face, `staying` (j, 3) and `body` (k, 3) the nodes of both bodies."""
    normals, area = contact.fields["normal"][nodes], contact.fields["area"][nodes]
    touching = have_partner(contact)[nodes]
    if np.any(touching):
        normals, area = normals[touching], area[touching]
    mean = area @ normals / max(float(area.sum()), 1e-300)
    through = float((body.mean(axis=0) - staying.mean(axis=0)) @ mean) < 0.0  # as a dovetail, held by undercut flanks
    if np.linalg.norm(mean) >= 0.3 and not through:
        return _APART * np.linalg.norm(np.ptp(face, axis=0)) * mean / np.linalg.norm(mean)
    along = np.linalg.eigh(normals.T @ (area[:, None] * normals))[1][:, 0]  # the axis of a hole or of a slot
    ends, others = (np.array([np.min(x @ along), np.max(x @ along)]) for x in (body, staying))
    ahead, back = others[1] - ends[0], ends[1] - others[0]
    return (min(ahead, back) + 0.1 * np.ptp(ends)) * (along if ahead <= back else -along)


_VTK_TYPES = {"Hexahedron": 12, "Tetrahedron": 10, "Quadrilateral": 9, "Triangle": 5}


def renderer() -> Any:
    """pyvista, configured to draw without a display if there is none."""
    if not os.environ.get("DISPLAY") and "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ:  # the search takes a while
        window = "vtkOSOpenGLRenderWindow" if ctypes.util.find_library("OSMesa") else "vtkEGLRenderWindow"
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window
    import pyvista

    return pyvista


def polygons(cells: IntArray) -> IntArray:
    """Cells (k, corners) in VTK's format: the number of corners, then the corners; repeated last ones are left out."""
    count = corners_in(cells)
    return np.column_stack([count, cells])[np.arange(cells.shape[1] + 1) <= count[:, None]]


def corners_in(cells: IntArray) -> IntArray:
    """Number of corners of every cell (k, corners): cells with fewer than others repeat their last one."""
    repeated = np.cumprod((cells[:, :0:-1] == cells[:, -2::-1]), axis=1).sum(axis=1)
    return cells.shape[1] - np.asarray(repeated, dtype=np.int64)


def skin_of(body: Grid, points: FloatArray) -> Any:
    """Boundary of the body, or of several bodies, with its nodes at these points."""
    types = np.full(len(body.cells), _VTK_TYPES[body.cell], dtype=np.uint8)
    types[corners_in(body.cells) == 4] = _VTK_TYPES["Tetrahedron"]
    solid = renderer().UnstructuredGrid(polygons(body.cells), types, points)
    solid.point_data["node"] = np.arange(len(points))
    return solid.extract_surface(algorithm=None)


def without(skin: Any, facets: IntArray) -> Any:
    """The skin without the facets that have the nodes of one of these, shape (f, corners)."""
    taken, node = {frozenset(map(int, facet)) for facet in facets}, np.asarray(skin.point_data["node"])
    return skin.extract_cells(
        [k for k, corners in enumerate(skin.irregular_faces) if frozenset(node[corners].tolist()) not in taken]
    )


def patches(cells: IntArray, points: FloatArray) -> Any:
    """The surface in pieces, one for each corner of every facet: what is nearest to that corner, the `node` of its
    cell data."""
    count, pieces, nodes = corners_in(cells), [], []
    for n in np.unique(count):
        of = cells[count == n, :n]
        corners = points[of]
        middle = 0.5 * (corners + np.roll(corners, -1, axis=1))
        centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
        pieces.append(np.stack([corners, middle, centre, np.roll(middle, 1, axis=1)], axis=2).reshape(-1, 3))
        nodes.append(of.ravel())
    corner = np.concatenate(nodes)
    grid = renderer().PolyData(np.concatenate(pieces), polygons(np.arange(4 * len(corner)).reshape(-1, 4)))
    grid.cell_data["node"] = corner
    return grid
