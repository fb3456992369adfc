"""What a mesh file holds, and which cells it may have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ...arrays import FloatArray, IntArray
from .lagrange import CORNERS


def titles(where: str, present: list[int], names: Mapping[str, int], key: str) -> dict[str, int]:
    """Every number that is present, by its name, or by the number itself, as in "3".

    Raises:
        ValueError: If a name has a number that does not occur; `where` and `key` are file and argument in the message.
    """
    for name, number in names.items():
        if number not in present:
            listed = ", ".join(map(str, present))
            raise ValueError(f"{where}: {key} has {name!r} = {number}, but the numbers there are {listed}")
    title = {number: name for name, number in names.items()}
    return {title.get(number, str(number)): number for number in present}


def members_by_name(where: str, numbers: IntArray, names: Mapping[str, int], key: str) -> dict[str, IntArray]:
    """The positions of every number, by its name as of `titles`, of the number of every facet or cell."""
    present: list[int] = list(map(int, np.unique(numbers)))
    return {name: np.flatnonzero(numbers == number) for name, number in titles(where, present, names, key).items()}


def only_set(where: str, sets: list[str]) -> str:
    """The one set of numbers to use; ValueError if there are several without a known order of preference."""
    if len(sets) > 1:  # meshio writes gmsh's own numbers beside the physical ones
        sets = [name for name in sets if name == "gmsh:physical"] or sets
    if len(sets) > 1:
        raise ValueError(f"{where}: has several sets of numbers ({', '.join(sets)}), but needs one; write one only")
    return sets[0]


FACETS = {
    4: ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    8: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
"""Corners of every facet, in order round it, of cells with 4 and 8 corners, as gmsh and VTK number."""

A_SLICE: Final = 'for a plane or axisymmetric problem give slice = "axisymmetric" in [mesh], or use coulomb.slice'
"""What to do with a mesh in 2D."""

SUPPORTED = (
    "coulomb computes with first-order tetrahedra or hexahedra, 10-node tetrahedra or 27-node hexahedra, not mixed"
)
_COMPLETE = (
    "nodal areas of eight-node faces are negative at their corners; export complete second-order cells (in gmsh: "
    "Mesh.SecondOrderIncomplete = 0), or first-order ones, which degree = 2 raises"
)
_TOO_HIGH = "export second-order cells (in gmsh: Mesh.ElementOrder = 2)"
_ONE_KIND = "mesh the body with tetrahedra alone or hexahedra alone"


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh of one cell type as a file has it.

    Attributes:
        path: The file, for messages.
        points: Coordinates, shape (p, 3).
        cells: Points of every cell in VTK's order (`second_order`), shape (c, 4, 8, 10 or 27).
        cell_groups: Cells of every group of cells, by name.
        face_groups: Corners of every facet of every group of facets, by name, shape (k, 3) or (k, 4).
        node_groups: Points of every named set of nodes.  It is a face if it covers whole facets of the boundary.
        numbers: Of every point the number that the file gives it, shape (p,); None if it gives none: then they are
            counted from 1.
    """

    path: str
    points: FloatArray
    cells: IntArray
    cell_groups: dict[str, IntArray]
    face_groups: dict[str, IntArray]
    node_groups: dict[str, IntArray] = field(default_factory=dict)
    numbers: IntArray | None = None


@dataclass(frozen=True, eq=False)
class SectionFile:
    """What a file of a mesh in 2D holds.

    Attributes:
        path: The file, for messages.
        points: Coordinates, shape (p, 2 or 3).
        cells: Points of the cells by their number of nodes (3, 4, 6, 8, 9), corners first, then the middles of the
            edges from the first corner on.
        cell_groups: Cells of every group, among all of `cells` in their order.
        line_groups: Ends of every edge of every group of lines, by name, shape (k, 2).
    """

    path: str
    points: FloatArray
    cells: dict[int, IntArray]
    cell_groups: dict[str, IntArray]
    line_groups: dict[str, IntArray]
    node_groups: dict[str, IntArray] = field(default_factory=dict)
    numbers: IntArray | None = None

    def of_group(self, name: str | None) -> SectionFile:
        """The cells of a group alone, with what lines and sets of nodes have on them; ValueError if there is none."""
        chosen = members_of(self.path, self.cell_groups, name)
        if chosen is None:
            return self
        cells, place, first = dict[int, IntArray](), np.full(sum(map(len, self.cells.values())), -1), 0
        place[chosen] = np.arange(len(chosen))
        used = np.zeros(len(self.points), dtype=bool)
        for width, rows in self.cells.items():
            cells[width] = rows[place[first : first + len(rows)] >= 0]
            used[cells[width]] = True
            first += len(rows)
        return replace(
            self,
            cells={width: rows for width, rows in cells.items() if len(rows)},
            cell_groups=not_empty({name: place[rows][place[rows] >= 0] for name, rows in self.cell_groups.items()}),
            line_groups=not_empty({name: of[np.all(used[of], axis=1)] for name, of in self.line_groups.items()}),
            node_groups=not_empty({name: some[used[some]] for name, some in self.node_groups.items()}),
        )


def not_empty(groups: Mapping[str, IntArray]) -> dict[str, IntArray]:
    """Groups that have members."""
    return {name: rows for name, rows in groups.items() if len(rows)}


def among_all(blocks: Iterable[tuple[int, Mapping[str, IntArray]]]) -> dict[str, IntArray]:
    """The members of every group among the elements of all blocks: of each their number, and the members in it."""
    rows_of, first = dict[str, list[IntArray]](), 0
    for count, groups in blocks:
        for name, rows in groups.items():
            rows_of.setdefault(name, []).append(first + rows)
        first += count
    return {name: np.concatenate(parts) for name, parts in rows_of.items()}


def members_of(path: str, groups: Mapping[str, IntArray], name: str | None) -> IntArray | None:
    """The cells of a group, in order, None if none is asked for; ValueError if there is no such group."""
    if name is None:
        return None
    if name not in groups:
        listed = ", ".join(groups) or "it has none"
        raise ValueError(f"{path}: has no group of cells {name!r} with any cells; its groups of cells are: {listed}")
    return np.unique(groups[name])


_TITLES = {
    **{4: "tetrahedra", 5: "pyramids", 6: "prisms", 8: "hexahedra", 10: "10-node tetrahedra", 13: "13-node pyramids"},
    **{14: "14-node pyramids", 15: "15-node prisms", 18: "18-node prisms", 20: "20-node hexahedra"},
    **{27: "27-node hexahedra"},
}


def solid_nodes(path: str, solids: Mapping[int, int], surface_elements: int = 0) -> int:
    """Nodes of the cells of a mesh, 4, 8, 10 or 27, from the counts of its elements in 3D by their number of nodes.

    Raises:
        ValueError: If there are none, or anything but cells of one kind that coulomb computes with.
    """
    present = [nodes for nodes, count in solids.items() if count]
    if not present:
        flat = f"; it has {surface_elements} surface elements, but no solid ones: {A_SLICE}" if surface_elements else ""
        raise ValueError(f"{path}: has no tetrahedra or hexahedra{flat}: export the mesh of the volume")
    refuse_cells(path, {_TITLES.get(nodes, f"{nodes}-node cells"): nodes for nodes in sorted(present)})
    return present[0]


def refuse_cells(path: str, kinds: Mapping[str, int]) -> None:
    """ValueError, saying how to export it, unless a mesh has cells of one kind, with 4, 8, 10 or 27 nodes; `kinds` are
    the nodes of each, by its name."""
    if len(kinds) == 1 and not set(kinds.values()) - CORNERS.keys():
        return
    hint = _ONE_KIND
    if any(nodes in (20, 24) and "hexahedr" in name for name, nodes in kinds.items()):
        hint = _COMPLETE
    elif any(nodes >= 20 and nodes != 27 for nodes in kinds.values()):
        hint = _TOO_HIGH
    raise ValueError(f"{path}: has {' and '.join(kinds)}, but {SUPPORTED}: {hint}")
