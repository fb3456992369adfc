"""Coarser meshes of hexahedra, by taking out sheets.

A sheet of a mesh of hexahedra is a layer of cells: the edges that are opposite to one another in a face of a cell,
from cell to cell, are those across it.  A sheet is taken out by merging the two ends of every edge across it; the mesh
stays one of hexahedra (M. Borden, S. Benzley and J. Shepherd, Hexahedral sheet extraction, 11th International Meshing
Roundtable, 2002).  Without every second sheet cells are about twice as large, as in a box with half as many.

Nodes are merged into one of the two, so that those of the boundary stay on it.  A patch is a smooth part of the
boundary, or of the border of groups of cells, with the same named faces.  Nodes of a patch move along its edges, those
of a crease, where patches meet, along the crease, and its ends and corners not at all.  No library does this: MMG has
tetrahedra alone.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from ...arrays import BoolArray, FloatArray, IntArray, unit_vectors
from .curving import CREASE
from .inspection import InspectedMesh
from .mesh_file import FACETS
from .mesh_parts import distinct, places, sets

LEAST_JACOBIAN: Final = 0.1
"""Least Jacobian at a corner of a cell that changes, over the product of the lengths of its edges; bricks have 1."""

SWEEPS: Final = 10
"""Of moves of the nodes of flatter cells."""

LONGEST: Final = 2.5
"""Factor by which edges that meet a sheet from outside may become longer, in the mean."""

SEEN: Final = 0.7
"""Least part of the cells, over the three directions, that becomes coarser.  Where a body is one cell thick, two thirds
do, and the error that this causes is not seen."""

_ACROSS = np.array(
    [[[0, 1], [3, 2], [4, 5], [7, 6]], [[0, 3], [1, 2], [4, 7], [5, 6]], [[0, 4], [1, 5], [2, 6], [3, 7]]]
)
"""Edges of a cell in VTK's order, by direction."""

_FACES = np.array(FACETS[8])

_AT_CORNERS = np.array(
    [[0, 1, 3, 4], [1, 2, 0, 5], [2, 3, 1, 6], [3, 0, 2, 7], [4, 7, 5, 0], [5, 4, 6, 1], [6, 5, 7, 2], [7, 6, 4, 3]]
)
"""Each corner of a cell with its three neighbours, in right-handed order."""


def extract_sheets(mesh: InspectedMesh, again: bool = False) -> InspectedMesh:
    """The mesh without every second sheet, as far as faces, groups of cells and creases allow it.

    Args:
        mesh: 8-node hexahedra in VTK's order, with names of faces and of groups of cells, all on this rank.
        again: Of a mesh without sheets: what is one cell thick now was not before.

    Raises:
        ValueError: If less than SEEN of it becomes coarser, but for `again`.
    """
    mirrored = _scaled_jacobians(mesh.points, mesh.cells).sum(axis=1) < 0.0
    cells = np.where(mirrored[:, None], np.roll(mesh.cells, 4, axis=1), mesh.cells)
    x, (ends, of_cell, sheet) = mesh.points, _sheets(cells)
    sheets = sheet[of_cell[:, :, 0]]
    of_node, of_edge, free, normal = _patches(mesh, ends)
    length = _length(x, ends)
    by_sheet = np.split(np.argsort(sheet, kind="stable"), np.cumsum(np.bincount(sheet))[:-1])
    seen: BoolArray = np.zeros(len(by_sheet), dtype=bool)
    merged, alive = np.arange(len(x)), np.ones(len(cells), dtype=bool)  # node in place of each, cells that are left
    for number in _inwards(ends, of_cell, sheet, of_node[ends] == of_edge[:, None]):
        across = by_sheet[number]
        pairs, on = _distinct_pairs(merged[ends[across]], of_edge[across])
        moves = of_node[pairs] == on[:, None]
        if np.bincount(pairs.ravel()).max() > 1 or not np.all(np.any(moves, axis=1)):
            continue
        left = alive & ~np.any(sheets == number, axis=1)
        least, now = LONGEST, (x, merged, alive)
        for side in (0, 1):  # of the sheet, whose nodes are merged into the others where both may move
            gone = np.where(moves[:, side], side, 1 - side)[:, None]
            onto = np.arange(len(x))
            onto[np.take_along_axis(pairs, gone, axis=1)] = np.take_along_axis(pairs, 1 - gone, axis=1)
            before, after = merged[cells[left]], onto[merged[cells[left]]]
            moved = _untangled(x, after, np.any(before != after, axis=1), free, normal)
            if moved is not None:
                seen[number] = True
                growth = _growth(moved, merged[ends], onto[merged[ends]], length)
                if growth < least:
                    least, now = growth, (moved, onto[merged], left)
        x, merged, alive = now
    seen |= np.bincount(sheet, _length(x, merged[ends])) >= 1.5 * np.bincount(sheet, length)
    if (part := np.mean(seen[sheets])) < SEEN and not again:
        raise ValueError(
            f"{part:.0%} of the hexahedra, over all directions, have coarser ones: others are in a single layer"
        )
    return _made(mesh, x, merged[cells[alive]], merged, alive)


def _sheets(cells: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """The ends of all edges, shape (e, 2), in the same direction across the whole sheet; the edges of the cells by
    direction, shape (c, 3, 4); and the sheet of every edge, numbered by their first edges."""
    rows = cells[:, _ACROSS]
    first, number = distinct(np.sort(rows.reshape(-1, 2), axis=1))
    ends = np.sort(rows.reshape(-1, 2)[first], axis=1)
    of_cell = number.reshape(rows.shape[:-1])
    one = 2 * of_cell + (rows[..., 0] > rows[..., 1])  # an edge in one of its two directions
    links = np.concatenate(
        [np.stack([one[..., k] ^ back, one[..., k + 1] ^ back], axis=-1) for k in range(3) for back in (0, 1)]
    )
    start, end = links.reshape(-1, 2).T
    graph = coo_array((np.ones(len(start), dtype=bool), (start, end)), shape=(2 * len(ends),) * 2)
    label = connected_components(graph, directed=False)[1].reshape(-1, 2)
    turned = label[:, 1] < label[:, 0]
    ends[turned] = ends[turned, ::-1]
    _, at, sheet = np.unique(label.min(axis=1), return_index=True, return_inverse=True)
    return ends, of_cell, np.argsort(np.argsort(at))[sheet]


def _inwards(ends: IntArray, of_cell: IntArray, sheet: IntArray, moves: BoolArray) -> IntArray:
    """The sheets in the order in which they are looked at: first those at the boundary, where one end alone of an edge
    across them may move, then those beside them, and so on.  Without each second one no single sheet stays there, where
    contact begins and bodies are held."""
    count, sheets = int(sheet.max()) + 1, sheet[of_cell[:, :, 0]]
    pairs = []
    for number in range(count):
        touched, inside = np.zeros(int(ends.max()) + 1, dtype=bool), np.zeros(len(ends), dtype=bool)
        touched[ends[sheet == number]] = True
        inside[of_cell[np.any(sheets == number, axis=1)]] = True
        beside = np.unique(sheet[np.any(touched[ends], axis=1) & ~inside])
        pairs.append(np.stack([np.full(len(beside), number), beside]))
    start, end = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(count, count)).tocsr()
    outermost = np.unique(sheet[moves[:, 0] != moves[:, 1]])
    depth = dijkstra(graph, indices=outermost, unweighted=True, min_only=True) if len(outermost) else np.zeros(count)
    return np.argsort(depth, kind="stable")


def _patches(mesh: InspectedMesh, ends: IntArray) -> tuple[IntArray, IntArray, BoolArray, FloatArray]:
    """On how many patches every node is, many for those that must not move, and every edge; which nodes may be moved to
    other places, in the body and on plane patches, and the normals of these, shape (nodes, 3), otherwise 0."""
    x, cells = mesh.points, mesh.cells
    corners: IntArray = cells[:, _FACES].reshape(-1, 4)
    first, number = distinct(np.sort(corners, axis=1))
    group, _ = sets(len(cells), mesh.cell_groups)
    low, high = np.full(len(first), len(cells)), np.full(len(first), -1)
    np.minimum.at(low, number, np.repeat(group, 6))
    np.maximum.at(high, number, np.repeat(group, 6))
    facets = np.flatnonzero((np.bincount(number) == 1) | (low != high))
    corners = corners[first[facets]]
    name, _ = sets(
        len(corners), {face: places(np.sort(corners, axis=1), rows) for face, rows in mesh.face_groups.items()}
    )
    # every facet at each of its edges
    around = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edge = places(np.sort(ends, axis=1), around)
    facet = np.repeat(np.arange(len(corners)), 4)
    along = unit_vectors(x[around[:, 1]] - x[around[:, 0]])
    into = np.repeat(x[corners].mean(axis=1), 4, axis=0) - x[around].mean(axis=1)
    into = unit_vectors(into - np.einsum("ki,ki->k", into, along)[:, None] * along)
    _, kind = distinct(np.column_stack([edge, name[facet], low[facets][facet], high[facets][facet] + 1]))
    order = np.argsort(kind, kind="stable")
    two = np.flatnonzero(np.bincount(kind) == 2)
    one = order[np.searchsorted(kind[order], two)]
    other = order[np.searchsorted(kind[order], two) + 1]
    smooth = np.einsum("ki,ki->k", into[one], into[other]) < -math.cos(CREASE)
    graph = coo_array(
        (np.ones(smooth.sum(), dtype=bool), (facet[one[smooth]], facet[other[smooth]])), shape=(len(corners),) * 2
    )
    patch = connected_components(graph, directed=False)[1]
    of_node = _counted(len(x), corners.ravel(), np.repeat(patch, 4))
    of_edge = _counted(len(ends), edge, patch[facet])
    crease = ends[of_edge > 1]
    directions, step = np.zeros_like(x), unit_vectors(x[crease[:, 1]] - x[crease[:, 0]])
    np.add.at(directions, crease, np.stack([step, -step], axis=1))
    meeting = np.bincount(crease.ravel(), minlength=len(x))
    bent = np.linalg.norm(directions, axis=1) > 2.0 * math.sin(0.5 * CREASE)
    of_node[(of_node > 1) & ((meeting != 2) | bent)] = len(corners) + 1

    across = unit_vectors(np.cross(x[corners[:, 2]] - x[corners[:, 0]], x[corners[:, 3]] - x[corners[:, 1]]))
    spread = np.zeros((patch.max(initial=-1) + 1, 3, 3))
    np.add.at(spread, patch, across[:, :, None] * across[:, None, :])
    sizes, axes = np.linalg.eigh(spread)
    plane = sizes[:, 2] > (1.0 - 1e-6) * np.bincount(patch)
    free = of_node == 0
    free[corners[plane[patch]]] = True
    free &= of_node < 2
    normal = np.zeros_like(x)
    normal[corners[plane[patch]]] = axes[patch[plane[patch]], None, :, 2]
    return of_node, of_edge, free, normal


def _distinct_pairs(pairs: IntArray, counts: IntArray) -> tuple[IntArray, IntArray]:
    """Distinct rows, and the largest count of each."""
    first, number = distinct(pairs)
    largest = np.zeros(len(first), dtype=np.int64)
    np.maximum.at(largest, number, counts)
    return pairs[first], largest


def _growth(x: FloatArray, before: IntArray, after: IntArray, length: FloatArray) -> float:
    """How much longer edges became, in the mean, of which one end was merged into another node, or both if they are
    those of a single cell inside a ring; `before` and `after` are the ends of all edges, shape (e, 2)."""
    ends = np.where(after[:, 0] != after[:, 1], np.count_nonzero(before != after, axis=1), 0)
    longer = ends == (1 if np.any(ends == 1) else 2)
    return float(_length(x, after[longer]).sum() / max(length[longer].sum(), 1e-300))


def _untangled(
    x: FloatArray, cells: IntArray, changed: BoolArray, free: BoolArray, normal: FloatArray
) -> FloatArray | None:
    """Places of the nodes (nodes, 3) with which cells are not flatter than LEAST_JACOBIAN: free ones of flatter cells
    are moved to the mean of their neighbours; None if that is not enough.

    Args:
        cells: All, shape (c, 8).
        changed: Those that may be flat, shape (c,).
        free: Nodes that may move, perpendicularly to their normals.
    """
    for _ in range(SWEEPS):
        near = cells[changed]
        flat = np.min(_scaled_jacobians(x, near), axis=1, initial=1.0) < LEAST_JACOBIAN
        if not np.any(flat):
            return x
        moves = np.zeros(len(x), dtype=bool)
        moves[near[flat]] = True
        moves &= free
        changed = changed | np.any(moves[cells], axis=1)
        edges: IntArray = cells[changed][:, _ACROSS].reshape(-1, 2)
        edges = np.concatenate([edges, edges[:, ::-1]])
        edges = edges[moves[edges[:, 0]]]
        step = np.zeros_like(x)
        np.add.at(step, edges[:, 0], x[edges[:, 1]] - x[edges[:, 0]])
        step /= np.maximum(np.bincount(edges[:, 0], minlength=len(x)), 1)[:, None]
        x = x + step - np.einsum("ni,ni->n", step, normal)[:, None] * normal
    return None


def _scaled_jacobians(x: FloatArray, cells: IntArray) -> FloatArray:
    """Jacobians at the corners of cells over the products of the lengths of their edges, shape (c, 8)."""
    corners = x[cells[:, _AT_CORNERS]]
    edges = corners[:, :, 1:] - corners[:, :, :1]
    return np.linalg.det(edges) / np.maximum(np.prod(np.linalg.norm(edges, axis=3), axis=2), 1e-300)


def _made(mesh: InspectedMesh, x: FloatArray, cells: IntArray, merged: IntArray, alive: BoolArray) -> InspectedMesh:
    """The mesh of the cells that are left, with the faces and groups of the mesh that it was."""
    nodes = np.unique(cells)
    number = np.full(len(x), -1)
    number[nodes] = np.arange(len(nodes))
    of_cell = np.cumsum(alive) - 1
    faces = {}
    for name, rows in mesh.face_groups.items():
        left = np.sort(merged[rows], axis=1)
        left = left[np.all(left[:, 1:] != left[:, :-1], axis=1)]
        faces[name] = number[left[distinct(left)[0]]]
    groups = {name: of_cell[some[alive[some]]] for name, some in mesh.cell_groups.items()}
    return InspectedMesh(x[nodes], number[cells], groups, faces, {})


def _counted(count: int, at: IntArray, patch: IntArray) -> IntArray:
    """The number of different patches at each of so many places."""
    return np.bincount(at[distinct(np.column_stack([at, patch]))[0]], minlength=count)


def _length(x: FloatArray, ends: IntArray) -> FloatArray:
    return np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
