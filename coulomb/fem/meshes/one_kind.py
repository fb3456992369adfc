"""Cells of several kinds as cells of one that coulomb computes with.

20-node hexahedra become 27-node ones: the middles of faces and of the cell are where the 20-node functions have
them, so that the shape is the same.  Prisms, pyramids, and hexahedra beside them are split into tetrahedra, 10-node
ones where they are of second order: every quadrilateral by the diagonal through the smallest of its nodes, so that
neighbours agree, and every cell from its smallest node (Dompierre et al., 1999, "How to subdivide pyramids, prisms and
hexahedra into tetrahedra").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray, distinct, rows_among
from ...decks.geometry import CORNERS, SIDES
from ...decks.node_surfaces import EDGES
from .lagrange import nodes_between
from .mesh_file import MeshFile
from .mesh_parts import places

READ: Final = frozenset((4, 5, 6, 8, 10, 13, 15, 20))
"""Numbers of nodes of cells that formats with VTK's order of nodes may have, besides 27."""


@dataclass(eq=False)
class OneKind:
    """Cells of one kind.

    Attributes:
        points: Coordinates, the given ones first, shape (p, 3).
        cells: Points of every cell in VTK's order, shape (c, 4, 8, 10 or 27).
        source: The given cell of each, among all given ones in their order, shape (c,).
        middles: Of the points that were added, the number of each and the given points whose mean position it has with
            equal parts of all that are near: those of the face, or of the cell, by their number.
        split: Whether hexahedra, prisms or pyramids were split: `facets` then makes triangles of quadrilaterals.
        used: Whether a given point is one of the chosen cells, shape (p,); None if all cells were chosen.
    """

    points: FloatArray
    cells: IntArray
    source: IntArray
    middles: list[tuple[IntArray, IntArray]] = field(default_factory=list)
    split: bool = False
    used: BoolArray | None = None

    def facets(self, corners: IntArray) -> IntArray:
        """Corners of facets (k, 3 or 4), as those of `cells` are; without those of cells that were not chosen."""
        if self.used is not None:
            corners = corners[np.all(self.used[corners], axis=1)]
        return triangles(corners) if self.split and corners.shape[1] == 4 else corners

    def completed(self, nodes: IntArray) -> IntArray:
        """A set of points with those that were added between them: of faces and cells all of whose points are in it;
        without those of cells that were not chosen."""
        if self.used is not None:
            nodes = nodes[self.used[nodes]]
        inside = np.zeros(len(self.points), dtype=bool)
        inside[nodes] = True
        return np.concatenate([nodes, *(new[np.all(inside[of], axis=1)] for new, of in self.middles)])

    @property
    def side(self) -> int:
        """Corners of a facet."""
        return 3 if CORNERS[self.cells.shape[1]] == 4 else 4

    @property
    def shapes(self) -> tuple[int, ...]:
        """Corners of the facets that may be those of cells."""
        return (3, 4) if self.split else (self.side,)

    def file(
        self,
        path: str,
        cell_groups: Mapping[str, IntArray],
        faces: Mapping[str, Sequence[IntArray]],
        nodes: Mapping[str, IntArray],
        numbers: IntArray | None,
    ) -> MeshFile:
        """These cells with what a file has of the given ones.

        Args:
            cell_groups: The given cells of every group, among all in their order.
            faces: Corners of the facets of every group, as `facets` takes them; of another shape beside those that fit
                they are left out.
            nodes: Points of every named set.
            numbers: Of the given points, or None.
        """
        of_faces = {name: [self.facets(part) for part in parts if len(part)] for name, parts in faces.items()}
        none = np.empty((0, self.side), dtype=np.int64)
        for name, parts in of_faces.items():
            if len({part.shape[1] for part in parts}) > 1:
                of_faces[name] = [part for part in parts if part.shape[1] == self.side]
        if numbers is not None:
            numbers = np.concatenate([numbers, np.zeros(len(self.points) - len(numbers), dtype=np.int64)])
        return MeshFile(
            path,
            self.points,
            self.cells,
            {name: np.flatnonzero(np.isin(self.source, rows)) for name, rows in cell_groups.items()},
            {name: np.vstack(parts) if parts else none for name, parts in of_faces.items()},
            {name: self.completed(some) for name, some in nodes.items()},
            numbers,
        )


def of_one_kind(
    path: str, points: FloatArray, blocks: Mapping[int, IntArray], chosen: IntArray | None = None
) -> OneKind:
    """Cells by their number of nodes (4, 5, 6, 8, 10, 13, 15, 20, 27), in VTK's order, as cells of one kind.

    Args:
        path: The file, for messages.
        points: Coordinates, shape (p, 3).
        blocks: Points of the cells.
        chosen: The cells that are wanted, among all in their order; by default all.

    Raises:
        ValueError: If cells of first and of second order are among them.
    """
    if chosen is not None:
        parts = np.split(np.arange(sum(map(len, blocks.values()))), np.cumsum([len(rows) for rows in blocks.values()]))
        inside = [np.isin(part, chosen) for part in parts]
        some = {width: rows[mine] for (width, rows), mine in zip(blocks.items(), inside, strict=False)}
        mesh, used = of_one_kind(path, points, some), np.zeros(len(points), dtype=bool)
        for rows in some.values():
            used[rows] = True
        return replace(mesh, source=np.flatnonzero(np.concatenate(inside))[mesh.source], used=used)
    blocks = {width: rows for width, rows in blocks.items() if len(rows)}
    second = {width for width in blocks if width != CORNERS[width]}
    if second and len(second) < len(blocks):
        raise ValueError(
            f"{path}: one body has cells of first and of second order ({', '.join(map(str, sorted(blocks)))} nodes): "
            "mesh it with one order"
        )
    sources = np.arange(sum(map(len, blocks.values())))
    if len(blocks) == 1 and next(iter(blocks)) in (4, 8, 10, 27):
        return OneKind(points, next(iter(blocks.values())), sources)
    made = _Middles(points, blocks) if second else None
    if set(blocks) <= {20, 27}:
        assert made is not None
        cells = np.vstack([made.completed(rows) if width == 20 else rows for width, rows in blocks.items()])
        return OneKind(made.points, cells, sources, made.of)
    parts, origin, first = [], [], 0
    for width, rows in blocks.items():
        tetrahedra, of = _tetrahedra(rows[:, : CORNERS[width]])
        parts.append(tetrahedra)
        origin.append(first + of)
        first += len(rows)
    corners = _right_handed(np.vstack(parts), points)
    cells = corners if made is None else made.second_order(corners)
    x = points if made is None else made.points
    return OneKind(x, cells, np.concatenate(origin), [] if made is None else made.of, split=True)


def triangles(quadrilaterals: IntArray) -> IntArray:
    """Two triangles of each quadrilateral (k, 4), by the diagonal through its smallest node, shape (2 k, 3)."""
    row, first = np.arange(len(quadrilaterals))[:, None], np.argmin(quadrilaterals, axis=1)[:, None]
    cycle = quadrilaterals[row, (first + np.arange(4)) % 4]
    return np.concatenate([cycle[:, [0, 1, 2]], cycle[:, [0, 2, 3]]])


def _tetrahedra(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Corners of tetrahedra of cells (k, 4, 5, 6 or 8), and the cell of each: from the smallest node of a cell to the
    triangles of the faces that do not have it."""
    parts, origin = [], []
    smallest = np.argmin(cells, axis=1)
    for apex in range(cells.shape[1]):
        mine = np.flatnonzero(smallest == apex)
        for face in SIDES[cells.shape[1]]:
            if apex in face or not len(mine):
                continue
            rows = cells[mine][:, list(face)]
            base = triangles(rows) if len(face) == 4 else rows
            of = np.tile(mine, len(base) // len(rows))
            parts.append(np.column_stack([cells[of, apex], base]))
            origin.append(of)
    return np.vstack(parts), np.concatenate(origin)


def _right_handed(tetrahedra: IntArray, x: FloatArray) -> IntArray:
    edges = x[tetrahedra[:, 1:]] - x[tetrahedra[:, :1]]
    turned = np.linalg.det(edges) < 0.0
    tetrahedra[turned] = tetrahedra[turned][:, [0, 2, 1, 3]]
    return tetrahedra


class _Middles:
    """The nodes between corners of second-order cells, and those that are added in the middles of quadrilaterals and of
    20-node hexahedra."""

    def __init__(self, points: FloatArray, blocks: Mapping[int, IntArray]):
        self.points = points
        self.of: list[tuple[IntArray, IntArray]] = []
        pairs, between = [], []
        for width, rows in blocks.items():
            for column, edge in enumerate(EDGES[CORNERS[width]]):
                pairs.append(rows[:, list(edge)])
                between.append(rows[:, CORNERS[width] + column])
        self._edges, self._between = _unique(np.vstack(pairs), np.concatenate(between))
        self._faces, self._centres = self._quadrilaterals(blocks)
        self._cells, self._bodies = self._hexahedra(blocks)

    def _add(self, corners: IntArray, edges: IntArray, parts: tuple[float, float]) -> IntArray:
        """New points: so much of each of the corners (k, c) and of the nodes on edges (k, e)."""
        new = len(self.points) + np.arange(len(corners))
        x = parts[0] * self.points[corners].sum(axis=1) + parts[1] * self.points[edges].sum(axis=1)
        self.points = np.concatenate([self.points, x])
        self.of.append((new, np.column_stack([corners, edges])))
        return new

    def _quadrilaterals(self, blocks: Mapping[int, IntArray]) -> tuple[IntArray, IntArray]:
        """Corners of all quadrilaterals, sorted, and the nodes in their middles."""
        given: list[IntArray] = [np.empty((0, 4), dtype=np.int64)]
        old: list[IntArray] = [np.empty(0, dtype=np.int64)]
        wanted: list[IntArray] = []
        for width, rows in blocks.items():
            faces = [face for face in SIDES[CORNERS[width]] if len(face) == 4]
            if width == 27:
                for column, corners in nodes_between(27):
                    if len(corners) == 4:
                        given.append(rows[:, list(corners)])
                        old.append(rows[:, column])
            else:
                wanted += [rows[:, list(face)] for face in faces]
        known, centre = _unique(np.vstack(given), np.concatenate(old))
        if wanted:
            rows = np.vstack(wanted)
            first, _ = distinct(np.sort(rows, axis=1))
            rows = rows[first]
            if len(known):
                rows = rows[~rows_among(known, np.sort(rows, axis=1))]
            edges = np.column_stack([self._middle_of(rows[:, [k, (k + 1) % 4]]) for k in range(4)])
            new = self._add(rows, edges, (-0.25, 0.5))
            known, centre = np.vstack([known, np.sort(rows, axis=1)]), np.concatenate([centre, new])
        return known, centre

    def _hexahedra(self, blocks: Mapping[int, IntArray]) -> tuple[IntArray, IntArray]:
        """Corners of all hexahedra, sorted, and the nodes in their middles."""
        known: IntArray = np.empty((0, 8), dtype=np.int64)
        centre: IntArray = np.empty(0, dtype=np.int64)
        if 27 in blocks:
            known, centre = np.sort(blocks[27][:, :8], axis=1), blocks[27][:, 26]
        if 20 in blocks:
            rows = blocks[20]
            new = self._add(rows[:, :8], rows[:, 8:20], (-0.25, 0.25))
            known, centre = np.vstack([known, np.sort(rows[:, :8], axis=1)]), np.concatenate([centre, new])
        return known, centre

    def _middle_of(self, pairs: IntArray) -> IntArray:
        return self._between[places(self._edges, np.sort(pairs, axis=1))]

    def completed(self, rows: IntArray) -> IntArray:
        """20-node hexahedra with the nodes of 27."""
        full = np.column_stack([rows, np.empty((len(rows), 7), dtype=np.int64)])
        for column, corners in nodes_between(27):
            if len(corners) == 4:
                full[:, column] = self._centres[places(self._faces, np.sort(rows[:, list(corners)], axis=1))]
            elif len(corners) == 8:
                full[:, column] = self._bodies[places(self._cells, np.sort(rows[:, :8], axis=1))]
        return full

    def second_order(self, corners: IntArray) -> IntArray:
        """10-node tetrahedra of corners (k, 4)."""
        pairs = np.vstack([corners[:, list(edge)] for edge in EDGES[4]])
        between = np.full(len(pairs), -1, dtype=np.int64)
        ends = np.sort(pairs, axis=1)
        on_edge = rows_among(self._edges, ends)
        between[on_edge] = self._middle_of(pairs[on_edge])
        for known, centre, diagonals in (
            (self._faces, self._centres, ((0, 2), (1, 3), (0, 1), (0, 3), (1, 2), (2, 3))),
            (self._cells, self._bodies, tuple((a, b) for a in range(8) for b in range(a + 1, 8))),
        ):
            left = np.flatnonzero(between < 0)
            if not len(left) or not len(known):
                continue
            # any two corners of a quadrilateral, or of a hexahedron, that no edge joins
            rows = np.vstack([known[:, list(pair)] for pair in diagonals])
            of = np.tile(centre, len(diagonals))
            free = ~rows_among(self._edges, rows)
            if known.shape[1] == 8 and len(self._faces):
                on_faces = np.vstack([self._faces[:, [a, b]] for a in range(4) for b in range(a + 1, 4)])
                free &= ~rows_among(on_faces, rows)
            rows, of = _unique(rows[free], of[free])
            present = rows_among(rows, ends[left])
            between[left[present]] = of[places(rows, ends[left[present]])]
        assert np.all(between >= 0)
        return np.column_stack([corners, between.reshape(6, -1).T])


def _unique(rows: IntArray, values: IntArray) -> tuple[IntArray, IntArray]:
    """Distinct rows, sorted within, with the value of each."""
    if not len(rows):
        return rows, values
    rows = np.sort(rows, axis=1)
    first, _ = distinct(rows)
    return rows[first], values[first]
