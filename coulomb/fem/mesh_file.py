"""What a mesh file holds, inspected on one rank before DOLFINx sees it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from .mesh_parts import hinged, parts_of, touching
from .second_order import CORNERS, is_second_order, jacobians, nodes_of_facets, torn

IntArray = npt.NDArray[np.int64]

FACETS = {
    4: ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    8: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
"""Corners of every facet, in order round it, of cells with 4 and 8 corners, as gmsh and VTK number."""

_EDGES_AT = {
    4: ((0, 1, 2, 3),),
    8: (
        *((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7)),
        *((4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3)),
    ),
}
"""A corner and its three neighbours, right-handed, for every corner where the Jacobian is evaluated."""

FLAT = 1e-12
"""Smallest admissible Jacobian of a cell, over the cube of its longest edge from a corner."""

_TORN = (
    "nodes between its corners that its neighbours do not share: merge the points where the mesh was made (in gmsh: "
    "Coherence Mesh), or check the order of nodes in the file"
)
_CURVED = (
    "; where cells are too coarse for a curved surface, refine them there (in gmsh also Mesh.HighOrderOptimize = 2)"
)

SUPPORTED = (
    "coulomb computes with first-order tetrahedra or hexahedra, 10-node tetrahedra or 27-node hexahedra, not mixed"
)
_COMPLETE = (
    "nodal areas of eight-node faces are negative at their corners; export complete second-order cells (in gmsh: "
    "Mesh.SecondOrderIncomplete = 0), or first-order ones, which degree = 2 raises"
)
_TOO_HIGH = "export second-order cells (in gmsh: Mesh.ElementOrder = 2)"
_ONE_KIND = "mesh the body with tetrahedra alone or hexahedra alone"


@dataclass(frozen=True)
class MeshFile:
    """A mesh of one cell type as a file has it.

    Attributes:
        path: The file, for messages.
        points: Coordinates, shape (p, 3).
        cells: Points of every cell in VTK's order (`second_order`), shape (c, 4, 8, 10 or 27).
        cell_groups: Cells of every group of cells, by name.
        face_groups: Corners of every facet of every group of facets, by name, shape (k, 3) or (k, 4).
        node_groups: Points of every named set of nodes.  It is a face if it covers whole facets of the boundary.
    """

    path: str
    points: FloatArray
    cells: IntArray
    cell_groups: dict[str, IntArray]
    face_groups: dict[str, IntArray]
    node_groups: dict[str, IntArray] = field(default_factory=dict)


_TITLES = {
    **{4: "tetrahedra", 5: "pyramids", 6: "prisms", 8: "hexahedra", 10: "10-node tetrahedra", 13: "13-node pyramids"},
    **{14: "14-node pyramids", 15: "15-node prisms", 18: "18-node prisms", 20: "20-node hexahedra"},
    **{27: "27-node hexahedra"},
}


def solid_nodes(path: str, solids: Mapping[int, int], surface_elements: int = 0) -> int:
    """Nodes of the cells of a mesh, 4, 8, 10 or 27.

    Args:
        path: The file, for messages.
        solids: How many elements in 3D there are, by their number of nodes.
        surface_elements: How many elements in 2D there are.

    Raises:
        ValueError: If there are none, or anything but cells of one kind that coulomb computes with.
    """
    present = [nodes for nodes, count in solids.items() if count]
    if not present:
        flat = f"; it has {surface_elements} surface elements, but no solid ones" if surface_elements else ""
        raise ValueError(f"{path}: has no tetrahedra or hexahedra{flat}: export the mesh of the volume")
    refuse_cells(path, {_TITLES.get(nodes, f"{nodes}-node cells"): nodes for nodes in sorted(present)})
    return present[0]


def refuse_cells(path: str, kinds: Mapping[str, int]) -> None:
    """Check that a mesh has cells of one kind, with 4, 8, 10 or 27 nodes.

    Args:
        path: The file, for messages.
        kinds: Nodes of the cells of each kind, by its name.

    Raises:
        ValueError: If not, saying how to export it.
    """
    if len(kinds) == 1 and not set(kinds.values()) - CORNERS.keys():
        return
    hint = _ONE_KIND
    if any(nodes in (20, 24) and "hexahedr" in name for name, nodes in kinds.items()):
        hint = _COMPLETE
    elif any(nodes >= 20 and nodes != 27 for nodes in kinds.values()):
        hint = _TOO_HIGH
    raise ValueError(f"{path}: has {' and '.join(kinds)}, but {SUPPORTED}: {hint}")


@dataclass(frozen=True)
class InspectedMesh:
    """A mesh without faults: no points outside the cells; the usable face groups, and why others are not usable.

    Attributes:
        points: Coordinates in metres, shape (p, 3).
        cells: As in the file.
        cell_groups: As in the file.
        face_groups: Corners of every facet, sorted in each row, by name.
        refused: Why the other groups of facets cannot be used, by name.
        components: How many components its cells make, which share no nodes.
        touching: Places in metres at which nodes of several components coincide, shape (k, 3).
    """

    points: FloatArray
    cells: IntArray
    cell_groups: dict[str, IntArray]
    face_groups: dict[str, IntArray]
    refused: dict[str, str]
    components: int
    touching: FloatArray


def inspect(file: MeshFile, scale: float) -> InspectedMesh:
    """Check a mesh for all faults that would make the finite elements wrong.

    A group of facets that is not on the boundary is an error only where it is used as a face.

    Args:
        file: What was read.
        scale: Metres per unit of length of the file.

    Raises:
        ValueError: If a coordinate is not finite, a cell flat or inside out, or parts share an edge or a
            corner alone.
    """

    def refuse(fault: str) -> NoReturn:
        raise ValueError(f"{file.path}: {fault}")

    cells = file.cells
    if len(cells) and not (0 <= cells.min() and cells.max() < len(file.points)):
        refuse("a cell has a node that the file does not define; is it whole?")
    used, inverse = np.unique(cells, return_inverse=True)
    points, cells = scale * file.points[used], inverse.reshape(cells.shape).astype(np.int64)
    if not np.all(np.isfinite(points)):
        refuse("has coordinates that are not finite")

    second = is_second_order(cells.shape[1])
    if second and np.any(bad := torn(cells)):
        refuse(f"{_seen(bad, points, cells)} {_TORN}")
    flat, tangled = _jacobians(points, cells)
    for bad, fault in ((flat, "no volume"), (tangled, "a Jacobian that changes its sign: it is turned inside out")):
        if np.any(bad):
            fault = fault.replace("no volume", "no volume, or none beside one of its nodes") if second else fault
            refuse(f"{_seen(bad, points, cells)} {fault}; repair the mesh where it was made{_CURVED if second else ''}")
    facets, of_cell = _all_facets(cells)
    sides = 3 if CORNERS[cells.shape[1]] == 4 else 4
    rows, number, count = _distinct(np.sort(facets[:, :sides], axis=1))
    if np.any(count > 2):
        bad = np.any((count > 2)[number].reshape(len(cells), -1), axis=1)
        refuse(f"{_seen(bad, points, cells)} a facet with more than one neighbour: cells are doubled or overlap")
    order = np.argsort(number, kind="stable")
    first = np.concatenate([[0], np.cumsum(count)])[:-1][count == 2]
    one, other = order[first], order[first + 1]
    folded = _folded(points, cells, facets[one], of_cell[one], of_cell[other])
    if np.any(folded):
        bad = np.zeros(len(cells), dtype=bool)
        bad[of_cell[other][folded]] = True
        refuse(f"{_seen(bad, points, cells)} been folded over a neighbour, inside out; repair the mesh")
    parts, part = parts_of(len(cells), of_cell[one], of_cell[other])
    shared = hinged(cells, part) if parts > 1 else np.empty(0, dtype=np.int64)
    if len(shared):
        bad = np.any(np.isin(cells, shared), axis=1)
        refuse(
            f"{_seen(bad, points, cells)} edges or corners in common with a part of the mesh with which they share no "
            "facet: the parts would turn about them freely; join them with matching nodes (in gmsh: BooleanFragments "
            "or Coherence), or give each part nodes of its own"
        )

    position = np.full(len(file.points), -1, dtype=np.int64)
    position[used] = np.arange(len(used))
    faces, refused = {}, {}
    for name, group in file.face_groups.items():
        found, fault = _on_boundary(position, group, rows, count)
        if fault:
            refused[name] = f"face group {name!r} of {file.path} {fault}"
        else:
            faces[name] = found
    boundary = facets[order[np.concatenate([[0], np.cumsum(count)])[:-1][count == 1]]]
    for name, nodes in file.node_groups.items():
        if name in file.face_groups:  # the file says exactly which facets
            continue
        found, fault = _covered(position[nodes], boundary, sides, len(used))
        if fault:
            refused[name] = f"node set {name!r} of {file.path} {fault}"
        else:
            faces[name] = found
    places = touching(points, cells, part, boundary[:, :sides]) if parts > 1 else points[:0]
    return InspectedMesh(points, cells, file.cell_groups, faces, refused, parts, places)


def _jacobians(points: FloatArray, cells: IntArray) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Which cells are flat, and which change the sign of their Jacobian from node to node."""
    values = list(jacobians(points, cells)) if is_second_order(cells.shape[1]) else []
    for corner, i, j, k in () if values else _EDGES_AT[cells.shape[1]]:
        edges = points[cells[:, [i, j, k]]] - points[cells[:, [corner]]]
        longest = np.max(np.linalg.norm(edges, axis=2), axis=1)
        values.append(np.linalg.det(edges) / np.where(longest > 0.0, longest, 1.0) ** 3)
    least, largest = np.min(values, axis=0), np.max(values, axis=0)
    flat = np.min(np.abs(values), axis=0) < FLAT
    return flat, ~flat & (np.sign(least) != np.sign(largest))


def _all_facets(cells: IntArray) -> tuple[IntArray, IntArray]:
    """The nodes of the facets of all cells, cell by cell, corners first, and the cell of each."""
    width = cells.shape[1]
    table = np.array(nodes_of_facets(width, FACETS[CORNERS[width]]))
    return cells[:, table].reshape(-1, table.shape[1]), np.repeat(np.arange(len(cells)), len(table))


def _distinct(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Distinct rows in lexicographic order, for every row the number of its own, and how often each occurs."""
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    new = np.concatenate([[True], np.any(ordered[1:] != ordered[:-1], axis=1)])
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return ordered[new], number, np.bincount(number).astype(np.int64)


def _folded(
    points: FloatArray, cells: IntArray, facets: IntArray, one: IntArray, other: IntArray
) -> npt.NDArray[np.bool_]:
    """Whether two cells lie on the same side of the facet between them."""
    corners = points[facets]
    middle = corners.mean(axis=1)
    last = corners[:, 3] if facets.shape[1] in (4, 9) else corners[:, 0]
    normal = np.cross(corners[:, 2] - corners[:, 0], last - corners[:, 1])
    centre = points[cells].mean(axis=1)
    side = [np.einsum("ki,ki->k", normal, centre[cell] - middle) for cell in (one, other)]
    folded: npt.NDArray[np.bool_] = side[0] * side[1] >= 0.0
    return folded


def _on_boundary(position: IntArray, group: IntArray, rows: IntArray, count: IntArray) -> tuple[IntArray, str]:
    """Facets of a group by points of the body, sorted; and what is wrong with them, or nothing."""
    nothing = np.empty((0, rows.shape[1]), dtype=np.int64)
    if len(group) == 0:
        return nothing, "is empty"
    if group.shape[1] != rows.shape[1]:
        return nothing, f"has facets of {group.shape[1]} nodes, but the cells have facets of {rows.shape[1]}"
    mine = np.unique(np.sort(position[group], axis=1), axis=0)
    if np.any(mine < 0):
        return nothing, "has facets whose nodes belong to no cell"
    _, number, times = _distinct(np.vstack([rows, mine]))
    of_row = np.full(len(times), -1, dtype=np.int64)
    of_row[number[: len(rows)]] = np.arange(len(rows))
    found = of_row[number[len(rows) :]]
    if np.any(found < 0):
        return nothing, f"has {np.sum(found < 0)} of {len(mine)} facets that are a side of no cell"
    inside = int(np.sum(count[found] == 2))
    if inside:
        return (
            nothing,
            f"lies inside the body with {inside} of its {len(mine)} facets; a face must be on the boundary",
        )
    return mine, ""


def _covered(nodes: IntArray, boundary: IntArray, corners: int, points: int) -> tuple[IntArray, str]:
    """The boundary facets all of whose nodes are in a set of nodes; and why the set is no face, or nothing.

    Args:
        nodes: The set.
        boundary: Nodes of the facets, corners first, shape (f, n).
        corners: How many of the n are corners.  Where the set has corners only, a facet needs only these.
        points: Points of the body.
    """
    rows = np.sort(boundary[:, :corners], axis=1)
    nothing = rows[:0]
    if len(nodes) == 0:
        return nothing, "is empty"
    if np.any(nodes < 0):
        return nothing, f"has {np.sum(nodes < 0)} of {len(nodes)} nodes that belong to no cell"
    inside = np.zeros(points, dtype=bool)
    inside[nodes] = True
    whole = boundary if np.any(inside[boundary[:, corners:]]) else rows
    found = np.all(inside[whole], axis=1)
    inside[boundary[found]] = False
    if np.any(inside):
        return nothing, (
            f"has {inside.sum()} of {len(np.unique(nodes))} nodes that are no corners of boundary facets within the "
            "set; a face must consist of whole facets"
        )
    return rows[found], ""


def _seen(bad: npt.NDArray[np.bool_], points: FloatArray, cells: IntArray) -> str:
    place = points[cells[np.argmax(bad)]].mean(axis=0)
    where = f"(first seen at x = {', '.join(f'{c:.6g}' for c in place)})"
    return f"{int(bad.sum())} of {len(cells)} cells {where} {'has' if bad.sum() == 1 else 'have'}"
