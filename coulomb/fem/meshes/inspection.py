"""The faults of a mesh that would make the finite elements wrong, found before DOLFINx sees it.

Every rank has some of the points and cells of a file, and checks its own cells.  What concerns several cells, their
common facets, is compared on the rank that is responsible for the smallest point of a facet.  No rank needs the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray, distinct, in_words
from ...exchange import Exchange, even_starts, fetched, owner_of, starts_of
from .lagrange import CORNERS, in_dolfinx_order, is_second_order, jacobians, nodes_of_facets, torn
from .mesh_file import FACETS, MeshFile

FLAT: Final = 1e-12
"""Smallest admissible Jacobian at a node of a cell, over the cube of the longest derivative there."""

_CELLS: Final = 50_000
"""Cells whose facets are treated at once, so that memory stays small."""

_TORN = (
    "nodes between its corners that its neighbours do not share: merge the points where the mesh was made (in gmsh: "
    "Coherence Mesh), or check the order of nodes in the file"
)
_CURVED = (
    "; where cells are too coarse for a curved surface, refine them there (in gmsh also Mesh.HighOrderOptimize = 2)"
)


@dataclass(frozen=True, eq=False)
class InspectedMesh:
    """A mesh without faults.

    Attributes:
        points: Coordinates of this rank's points of the file in metres, shape (p, 3).
        cells: This rank's cells, as in the file.
        face_groups: Corners of this rank's facets, sorted in each row, by name.
        refused: Why the other groups of facets cannot be used, by name.
        node_groups: This rank's points of sets of nodes that are no faces, by name.
        numbers: Of this rank's points the numbers in the file, 0 where it has no such node, shape (p,); None for a
            mesh that is not from a file.
    """

    points: FloatArray
    cells: IntArray
    cell_groups: dict[str, IntArray]
    face_groups: dict[str, IntArray]
    refused: dict[str, str]
    node_groups: dict[str, IntArray] = field(default_factory=dict)
    numbers: IntArray | None = None


def inspect(file: MeshFile, scale: float, comm: MPI.Comm) -> InspectedMesh:
    """Check the parts of a mesh that the ranks have read, in units of `scale` metres, for all faults that would make
    the finite elements wrong; collective.

    A group of facets that is not on the boundary is an error only where it is used as a face.

    Raises:
        ValueError: On every rank, if a coordinate is not finite, a cell flat or inside out, or if cells overlap.
    """
    cells = _Cells(file, scale, comm)
    second = is_second_order(file.cells.shape[1])
    if second:
        cells.refuse(torn(file.cells, comm), _TORN)
    flat, tangled = _jacobians(cells.x, cells.local)
    for bad, fault in ((flat, "no volume"), (tangled, "a Jacobian that changes its sign: it is turned inside out")):
        fault = fault.replace("no volume", "no volume, or none beside one of its nodes") if second else fault
        cells.refuse(bad, f"{fault}; repair the mesh where it was made{_CURVED if second else ''}")
    facets = _Facets(cells)
    judged = {("face group", name): facets.on_boundary(group) for name, group in file.face_groups.items()}
    for name, nodes in file.node_groups.items():
        if name not in file.face_groups:  # the file says exactly which facets
            judged["node set", name] = facets.covered(nodes)
    faces = {name: rows for (_, name), (rows, fault) in judged.items() if not fault}
    refused = {name: f"{kind} {name!r} of {file.path} {fault}" for (kind, name), (_, fault) in judged.items() if fault}
    sets = {name: nodes for name, nodes in file.node_groups.items() if name not in file.face_groups and name in refused}
    sets = {name: nodes for name, nodes in sets.items() if len(nodes) and np.all(np.isin(nodes, cells.numbers))}
    first, given = cells.starts[comm.rank], file.numbers
    numbers = first + np.arange(1, len(file.points) + 1) if given is None else given
    return InspectedMesh(scale * file.points, file.cells, file.cell_groups, faces, refused, sets, numbers)


class _Cells:
    """This rank's cells with the coordinates of their points; collective.

    Attributes:
        numbers: Numbers of the points of this rank's cells in the file, ascending.
        x: Their coordinates in metres.
        local: The points of every cell, among these.
        starts: First point of the file on every rank.
    """

    def __init__(self, file: MeshFile, scale: float, comm: MPI.Comm):
        self.file, self.comm = file, comm
        self.starts = starts_of(comm, len(file.points))
        cells = file.cells
        unknown = bool(cells.size and not (0 <= cells.min() and cells.max() < self.starts[-1]))
        if comm.allreduce(unknown, op=MPI.LOR):
            raise ValueError(f"{file.path}: a cell has a node that the file does not define; is it whole?")
        self.numbers, inverse = np.unique(cells, return_inverse=True)
        self.local: IntArray = inverse.reshape(cells.shape).astype(np.int64)
        self.x: FloatArray = scale * fetched(comm, self.starts, self.numbers, file.points)
        if not comm.allreduce(bool(np.all(np.isfinite(self.x))), op=MPI.LAND):
            raise ValueError(f"{file.path}: has coordinates that are not finite")

    def refuse(self, bad: BoolArray, fault: str) -> None:
        """Raises ValueError on every rank if a cell is bad on one; collective."""
        place = self.x[self.local[np.argmax(bad)]].mean(axis=0) if np.any(bad) else None
        seen = self.comm.allgather((int(bad.sum()), len(bad), place))
        count, of = (sum(each) for each in list(zip(*seen, strict=True))[:2])
        if count:
            where = in_words(next(place for *_, place in seen if place is not None))
            has = "has" if count == 1 else "have"
            raise ValueError(f"{self.file.path}: {count} of {of} cells (first seen at x = {where}) {has} {fault}")


def _jacobians(points: FloatArray, cells: IntArray) -> tuple[BoolArray, BoolArray]:
    """Which cells are flat, and which change the sign of their Jacobian from node to node."""
    determinants, longest = jacobians(points[in_dolfinx_order(cells)])
    values = determinants / np.where(longest > 0.0, longest, 1.0) ** 3
    least, largest = np.min(values, axis=0), np.max(values, axis=0)
    flat = np.min(np.abs(values), axis=0) < FLAT
    return flat, ~flat & (np.sign(least) != np.sign(largest))


class _Facets:
    """The facets of all cells, each on the rank that is responsible for its smallest point; ValueError on every rank if
    one has more than two cells, or both on the same side; collective."""

    def __init__(self, cells: _Cells):
        self._cells, self._comm = cells, cells.comm
        self._hubs = even_starts(cells.comm.size, int(cells.starts[-1]))
        width = cells.file.cells.shape[1]
        self._table = np.array(nodes_of_facets(width, FACETS[CORNERS[width]]))
        self._sides = 3 if CORNERS[width] == 4 else 4
        corners, side = (np.concatenate(parts) for parts in zip(*self._with_sides(), strict=True))
        exchange = Exchange(self._comm, owner_of(self._hubs, corners[:, 0]))
        side, there = exchange.send(side), exchange.send(corners)
        self._rows, number, self._count = _distinct(there)
        order = np.argsort(number, kind="stable")
        first = np.concatenate([[0], np.cumsum(self._count)])[:-1][self._count == 2]
        one, other = order[first], order[first + 1]
        folded = np.zeros(len(there), dtype=bool)
        folded[other] = side[one] * side[other] >= 0.0
        answers = exchange.reply(np.column_stack([np.minimum(self._count[number], 3), folded]))
        times, turned = answers.reshape(-1, len(self._table), 2).transpose(2, 0, 1)
        cells.refuse(np.any(times > 2, axis=1), "a facet with more than one neighbour: cells are doubled or overlap")
        cells.refuse(np.any(turned != 0, axis=1), "been folded over a neighbour, inside out; repair the mesh")
        self._boundary = times == 1

    def _with_sides(self) -> Iterator[tuple[IntArray, FloatArray]]:
        """Sorted corners of the facets of some cells after the other, and how far the cell's middle is along a normal
        that does not depend on the cell."""
        local, numbers, x = self._cells.local, self._cells.numbers, self._cells.x
        for start in range(0, max(len(local), 1), _CELLS):
            some = local[start : start + _CELLS]
            facets = some[:, self._table].reshape(-1, self._table.shape[1])
            corners = facets[:, : self._sides]  # local numbers ascend with those of the file
            ascending = np.sort(corners, axis=1)
            at = x[_from_smallest(corners) if self._sides == 4 else ascending]
            last = at[:, 3] if self._sides == 4 else at[:, 0]
            normal = np.cross(at[:, 2] - at[:, 0], last - at[:, 1])
            middle = np.repeat(x[some].mean(axis=1), len(self._table), axis=0)
            yield numbers[ascending], np.einsum("ki,ki->k", normal, middle - x[facets].mean(axis=1))

    def on_boundary(self, group: IntArray) -> tuple[IntArray, str]:
        """Facets of a group, sorted and each once; and what is wrong with them, or nothing; collective."""
        nothing = np.empty((0, self._sides), dtype=np.int64)
        if self._sum(len(group)) == 0:
            return nothing, "is empty"
        if group.shape[1] != self._sides:
            return nothing, f"has facets of {group.shape[1]} nodes, but the cells have facets of {self._sides}"
        group = np.sort(group, axis=1)
        exchange = Exchange(self._comm, owner_of(self._hubs, group[:, 0]))
        there = exchange.send(group)
        once, number = distinct(there)
        first = np.zeros(len(there), dtype=bool)
        first[once] = True
        times = _lookup(self._rows, self._count, there[once])[number]
        answers = exchange.reply(np.column_stack([times, first]))
        mine = answers[:, 1] > 0
        every, missing, inside = (
            self._sum(int(np.sum(mine & which))) for which in (mine, answers[:, 0] == 0, answers[:, 0] == 2)
        )
        if missing:
            if self._any_unused(group):
                return nothing, "has facets whose nodes belong to no cell"
            return nothing, f"has {missing} of {every} facets that are a side of no cell"
        if inside:
            return nothing, (
                f"lies inside the body with {inside} of its {every} facets; a face must be on the boundary, or its "
                "mesh be cut there (cut in [mesh], read_mesh(cuts=))"
            )
        return group[mine], ""

    def covered(self, nodes: IntArray) -> tuple[IntArray, str]:
        """The boundary facets all of whose nodes are in a set of nodes; and why the set is no face, or nothing.

        Where the set has corners only, a facet needs only these.  For meshes that one rank has as a whole.
        """
        numbers, points = self._cells.numbers, int(self._cells.starts[-1])
        boundary = self._cells.file.cells[:, self._table][self._boundary]
        rows = np.sort(boundary[:, : self._sides], axis=1)
        nothing = rows[:0]
        if len(nodes) == 0:
            return nothing, "is empty"
        stray = int(np.sum(~np.isin(nodes, numbers)))
        if stray:
            return nothing, f"has {stray} of {len(nodes)} nodes that belong to no cell"
        inside = np.zeros(points, dtype=bool)
        inside[nodes] = True
        whole = boundary if np.any(inside[boundary[:, self._sides :]]) else rows
        found = np.all(inside[whole], axis=1)
        inside[boundary[found]] = False
        if np.any(inside):
            return nothing, (
                f"has {inside.sum()} of {len(np.unique(nodes))} nodes that are no corners of boundary facets within "
                "the set; a face must consist of whole facets"
            )
        return rows[found], ""

    def _any_unused(self, group: IntArray) -> bool:
        """Whether a group has points that belong to no cell; collective."""
        starts, numbers = self._cells.starts, self._cells.numbers
        used = np.zeros(starts[self._comm.rank + 1] - starts[self._comm.rank], dtype=bool)
        used[Exchange(self._comm, owner_of(starts, numbers)).send(numbers) - starts[self._comm.rank]] = True
        return self._sum(int(np.sum(~fetched(self._comm, starts, group.ravel(), used)))) > 0

    def _sum(self, count: int) -> int:
        return int(self._comm.allreduce(count))


def _from_smallest(quadrilaterals: IntArray) -> IntArray:
    """The corners in their cyclic order, from the smallest on, towards the smaller of its two neighbours."""
    row, first = np.arange(len(quadrilaterals))[:, None], np.argmin(quadrilaterals, axis=1)[:, None]
    cycle = quadrilaterals[row, (first + np.arange(4)) % 4]
    return np.where(cycle[:, [1]] < cycle[:, [3]], cycle, cycle[:, [0, 3, 2, 1]])


def _distinct(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Distinct rows in lexicographic order, for every row the number of its own, and how often each occurs."""
    first, number = distinct(rows)
    return rows[first], number, np.bincount(number)


def _lookup(rows: IntArray, values: IntArray, wanted: IntArray) -> IntArray:
    """The value (k,) of each wanted row (q, w) among distinct rows (k, w); 0 of those that are not among them."""
    _, number, times = _distinct(np.vstack([rows, wanted]))
    of_row = np.zeros(len(times), dtype=np.int64)
    of_row[number[: len(rows)]] = values
    return of_row[number[len(rows) :]]
