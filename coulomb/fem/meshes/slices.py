"""Plane and axisymmetric problems: a mesh of the section becomes one layer of hexahedra, as in CalculiX.

Of a plane problem the section is in a plane z = const, and the layer is as thick as the body that forces are for.  Of
an axisymmetric one x is the radius and y is along the axis, and the layer is a wedge of an angle theta about y; +z is
in front.  Quadrilaterals give hexahedra; triangles are cut into three quadrilaterals each, by their middle and the
middles of their edges, and quadrilaterals beside them into four.  Sections of second order give 27-node cells.

Nodes of the wedge are on circles, so that gaps on surfaces of revolution are exact.  Of first-order cells the chords
between its planes make all volumes, and all areas across the axis, sin(theta)/theta of what they are: 2 pi/sin(theta)
wedges have those of the body.  Cylinders then have 1/cos(theta/2) of their area, 4e-5 too much at a degree.  Of
27-node cells the nodes in the middle are on the circle, too, and 2 pi/theta wedges make the body.

Nodes on the axis are moved off it by 1e-6 of the smallest cell, so that no cell is flat, and a plane of symmetry holds
them there: it is no hole, but a rigid pin without friction, whose volume is 1e-12 of a cell's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from ...arrays import FloatArray, IntArray, is_number
from ...units import amount
from .lagrange import nodes_between
from .mesh_file import MeshFile, SectionFile
from .mesh_parts import distinct, places

PLANE: Final = ("plane strain", "generalised plane strain", "plane stress")
AXISYMMETRIC: Final = "axisymmetric"
KINDS: Final = (*PLANE, AXISYMMETRIC)

FRONT, BACK, AXIS = "front", "back", "axis"
"""Faces that a slice has beside those of its section's lines."""

FORMS_IN_2D: Final = """.  Forms in 2D become those of a slice, one layer of cells in 3D:
    sliced = coulomb.slice(domain, "plane strain", faces={"top": ...})
    V = fem.functionspace(sliced.domain, ("Lagrange", sliced.degree, (3,)))  # the forms in 3D, with Identity(3)
    body = coulomb.Body(a, L, bcs, faces=sliced)  # bcs hold u_z on sliced.faces["front"] and ["back"]"""
"""What to do with own forms in 2D."""

ANGLE: Final = math.radians(1.0)
"""Of a wedge."""

_ON_AXIS: Final = 1e-9
"""Radius over the largest one up to which a node is on the axis."""

_OFF_AXIS: Final = 1e-6
"""Radius at which nodes on the axis are put, over the size of the smallest cell."""

_FLAT: Final = 1e-6
"""Extent of a section along z over its largest extent up to which it is plane."""


@dataclass(frozen=True)
class Slice:
    """Of what body a mesh is one layer.

    Attributes:
        kind: One of `KINDS`.
        thickness: Of a plane one, metres; of a wedge 0.
        copies: How many layers make the body that forces are for: 1 of a plane problem, of wedges all 360 degrees.
        axis: Whether a wedge has nodes on the axis, which the face "axis" holds.
    """

    kind: str
    thickness: float
    copies: float = 1.0
    axis: bool = False

    def refuse(self, translation: FloatArray, axis: FloatArray | None) -> None:
        """ValueError if a translation (3,) in metres, with a rotation about an axis (3,) or none, leads out of the
        plane of the section, or a wedge off its axis, y."""
        along = np.flatnonzero(translation)
        if self.kind == AXISYMMETRIC and (axis is not None or np.any(along != 1)):
            raise ValueError("moved: an axisymmetric slice can be moved along its axis, y, alone")
        if self.kind != AXISYMMETRIC and (2 in along or (axis is not None and np.any(axis[:2] != 0.0))):
            raise ValueError("moved: a plane slice can be moved along x and y, and rotated about axes along z, alone")

    @property
    def held(self) -> tuple[str, ...]:
        """The faces that are planes of symmetry."""
        if self.kind == AXISYMMETRIC:
            return (FRONT, BACK, AXIS) if self.axis else (FRONT, BACK)
        return (FRONT, BACK) if self.kind == "plane strain" else (BACK,)

    def shares(self, x: FloatArray, degree: int) -> FloatArray:
        """Of a force that is given at a node of the section, the parts of the nodes x (k, 3) of the layer there, (k,):
        of the middle ones of second order two thirds, so that it is spread evenly."""
        if degree == 1:
            return np.full(len(x), 0.5 / self.copies)
        side = x[:, 0] * math.tan(0.5 * ANGLE) if self.kind == AXISYMMETRIC else 0.5 * self.thickness
        return np.where(np.abs(x[:, 2]) < 0.5 * np.abs(side), 2.0 / 3.0, 1.0 / 6.0) / self.copies

    def cell_sizes(self, x: FloatArray, area: FloatArray, degree: int) -> FloatArray:
        """How wide along the section the areas (k,) of nodes x (k, 3) of a face are, metres, shape (k,)."""
        width = 2.0 * x[:, 0] * math.tan(0.5 * ANGLE) if self.kind == AXISYMMETRIC else self.thickness
        return area / (self.copies * self.shares(x, degree) * width)

    def along_section(self, x: FloatArray, vectors: FloatArray) -> FloatArray:
        """The parts of vectors at nodes x that are in the plane of the section, in which it deforms, shapes (k, 3): the
        planes of symmetry of a wedge take 57 times the forces on its surface."""
        across = np.zeros_like(x)
        across[:, 2] = 1.0
        if self.kind == AXISYMMETRIC:
            across[:, [0, 2]] = x[:, [2, 0]] * (-1.0, 1.0)
            across /= np.hypot(x[:, 0], x[:, 2])[:, None]
        return vectors - np.einsum("ki,ki->k", vectors, across)[:, None] * across

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return {"kind": self.kind, "forces_for": self.said, "layers": self.copies}

    @property
    def note(self) -> str:
        """What nodal forces in files are for, in words."""
        return f"{self.kind}: those of one layer; {self.copies:.15g} of these make the totals, for {self.said}"

    @property
    def said(self) -> str:
        """What forces are for, in words."""
        return "360 degrees" if self.kind == AXISYMMETRIC else f"a thickness of {amount(self.thickness)}"


def slice_of(kind: object, thickness: object, what: str) -> Slice:
    """ValueError, beginning with `what`, if the kind is unknown, or the thickness no positive number of metres, or
    given for a wedge; by default it is 1."""
    if kind not in KINDS:
        raise ValueError(f"{what}: slice must be one of {', '.join(map(repr, KINDS))}, but is {kind!r}")
    if kind == AXISYMMETRIC:
        if thickness is not None:
            raise ValueError(f"{what}: an axisymmetric slice has no thickness: its forces are for 360 degrees")
        return Slice(AXISYMMETRIC, 0.0)
    if thickness is not None and not (is_number(thickness, 0.0) and float(thickness) > 0.0):  # type: ignore[arg-type]
        raise ValueError(f"{what}: thickness must be a positive number of metres, but is {thickness!r}")
    return Slice(str(kind), 1.0 if thickness is None else float(thickness))  # type: ignore[arg-type]


def sliced(section: SectionFile, given: Slice, scale: float, degree: int | None = None) -> tuple[MeshFile, Slice]:
    """The layer of a section, in the units of its file, and what it is a layer of.

    Args:
        given: What it is to be.
        scale: Metres per unit of the file.
        degree: Order of the cells; by default that of the section.

    Raises:
        ValueError: If there are no cells in 2D, cells of both orders, a section that is not in a plane z = const or,
            of a wedge, has nodes left of the axis, or a group that is called as a face of the slice.
    """
    path = section.path
    taken = {FRONT, BACK, AXIS} & {*section.line_groups, *section.node_groups}
    if taken:
        raise ValueError(
            f"{path}: a slice has faces {FRONT!r}, {BACK!r} and {AXIS!r} of its own: rename {min(taken)!r}"
        )
    quads = _Quadrilaterals(section, degree)
    x, count, order = quads.points, len(quads.points), quads.order
    on_axis = np.zeros(count, dtype=bool)
    if given.kind == AXISYMMETRIC:
        size = float(np.max(np.abs(x[:, 0])))
        if np.min(x[:, 0]) < -_ON_AXIS * size:
            raise ValueError(
                f"{path}: an axisymmetric section has radii x >= 0 and its axis along y, but the smallest x is "
                f"{np.min(x[:, 0]):.6g}"
            )
        on_axis = x[:, 0] <= _ON_AXIS * size
        r = np.where(on_axis, _OFF_AXIS * math.sqrt(quads.smallest), x[:, 0])
        angles = np.linspace(-0.5 * ANGLE, 0.5 * ANGLE, order + 1)
        layers = [np.column_stack([r * math.cos(a), x[:, 1], r * math.sin(a)]) for a in angles]
    else:
        half = 0.5 * given.thickness / scale
        layers = [np.column_stack([x, np.full(count, z)]) for z in np.linspace(-half, half, order + 1)]
    top = order * count

    def between(lines: IntArray) -> IntArray:
        """The facets (k, 4) on lines (k, 2), without those on the axis, which have no area, beside others."""
        beside = ~np.all(on_axis[lines], axis=1)
        lines = lines[beside] if np.any(beside) else lines
        return np.column_stack([lines, top + lines[:, ::-1]])

    corners = quads.cells[:, :4]
    faces = {name: between(quads.lines(ends)) for name, ends in section.line_groups.items()}
    faces |= {FRONT: top + corners, BACK: corners}
    if np.any(on_axis):
        edges = np.concatenate([corners[:, [k, (k + 1) % 4]] for k in range(4)])
        faces[AXIS] = between(edges[np.all(on_axis[edges], axis=1)])
    levels = count * np.arange(order + 1)[:, None]
    copies = 1.0
    if given.kind == AXISYMMETRIC:
        copies = 2.0 * math.pi / (math.sin(ANGLE) if order == 1 else ANGLE)
    return (
        MeshFile(
            path,
            np.vstack(layers),
            _hexahedra(quads.cells, count),
            {name: np.flatnonzero(np.isin(quads.source, mine)) for name, mine in section.cell_groups.items()},
            faces,
            {name: (levels + quads.members(nodes)).ravel() for name, nodes in section.node_groups.items()},
            None if section.numbers is None else np.tile(quads.given(section.numbers), order + 1),
        ),
        replace(given, copies=copies, axis=bool(np.any(on_axis))),
    )


def _hexahedra(quads: IntArray, count: int) -> IntArray:
    """Cells (c, 8 or 27) in VTK's order between layers of `count` points each, of quadrilaterals (c, 4 or 9)."""
    if quads.shape[1] == 4:
        return np.hstack([quads, count + quads])
    middle = {frozenset({k}): k for k in range(4)} | {frozenset({k, (k + 1) % 4}): 4 + k for k in range(4)}
    middle[frozenset(range(4))] = 8
    cells = np.empty((len(quads), 27), dtype=np.int64)
    for column, of in [*((k, (k,)) for k in range(8)), *nodes_between(27)]:
        layer = {(True, False): 0, (True, True): 1, (False, True): 2}[min(of) < 4, max(of) >= 4]
        cells[:, column] = layer * count + quads[:, middle[frozenset(k % 4 for k in of)]]
    return cells


# --- the section as quadrilaterals ------------------------------------------------------------------------------------

_GRID: Final = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)]) / 2.0
"""Nodes of a 9-node quadrilateral in the unit square."""

_REVERSED: Final = {3: (0, 2, 1), 6: (0, 2, 1, 5, 4, 3), 4: (0, 3, 2, 1), 9: (0, 3, 2, 1, 7, 6, 5, 4, 8)}
"""Columns of the same cell in the other direction round."""

_PLACES: Final = 96
"""Shares of the corners in the places of nodes are whole numbers of these parts."""


def _bilinear(local: FloatArray) -> FloatArray:
    s, t = local.T
    return np.column_stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])


def _functions(width: int, shares: FloatArray) -> FloatArray:
    """The Lagrange functions of a cell with 3, 4, 6 or 9 nodes at places given by shares of its corners, shape (m,
    width): barycentric coordinates, or the bilinear functions."""
    if width in (3, 4):
        return shares
    if width == 6:
        return np.hstack([shares * (2.0 * shares - 1.0), 4.0 * shares * shares[:, [1, 2, 0]]])
    along = [np.column_stack([(1 - a) * (1 - 2 * a), 4 * a * (1 - a), a * (2 * a - 1)]) for a in _of_square(shares).T]
    s, t = np.rint(2.0 * _GRID).astype(int).T
    return along[0][:, s] * along[1][:, t]


def _of_square(shares: FloatArray) -> FloatArray:
    return np.column_stack([shares[:, 1] + shares[:, 2], shares[:, 2] + shares[:, 3]])


def _parts(corners: int, order: int, split: bool) -> FloatArray:
    """Nodes of the quadrilaterals of a cell as shares of its corners, shape (parts, 4 or 9, corners)."""
    grid = _bilinear(_GRID[: 4 if order == 1 else 9])
    if not split:
        return grid[None]
    unit, middle = np.eye(corners), np.full(corners, 1.0 / corners)
    mids = 0.5 * (unit + np.roll(unit, -1, axis=0))
    return np.array([grid @ np.array([unit[k], mids[k], middle, mids[k - 1]]) for k in range(corners)])


class _Quadrilaterals:
    """A section as quadrilaterals of one order.

    Every node is known by a key of three numbers: a corner a by (a, a, 0), a place on an edge by its ends a < b and its
    share of b, one inside cell c by (p + c, p + c, number of the place), p being the number of given points.

    Attributes:
        order: 1 or 2.
        points: Coordinates in the plane, shape (n, 2).
        cells: Points of every quadrilateral, counterclockwise, shape (c, 4 or 9).
        source: The cell of the section of each, shape (c,).
        smallest: The least area of one, by its corners.
    """

    def __init__(self, section: SectionFile, degree: int | None):
        path, self._count = section.path, len(section.points)
        blocks = {width: rows for width, rows in section.cells.items() if len(rows)}
        if not blocks:
            raise ValueError(f"{path}: has no triangles or quadrilaterals, of which a slice is made")
        orders = {1 if width in (3, 4) else 2 for width in blocks}
        if len(orders) > 1:
            raise ValueError(f"{path}: has cells of first and of second order: mesh the section with one order")
        self.order = degree or orders.pop()
        x = _in_plane(path, section.points, np.concatenate([rows.ravel() for rows in blocks.values()]))
        self._split = bool(blocks.keys() & {3, 6})
        first, tables = 0, []
        for rows in blocks.values():
            tables.append(self._nodes(x, rows, first))
            first += len(rows)
        keys, at, given, self.source = (np.concatenate(parts) for parts in zip(*tables, strict=True))
        once, number = distinct(keys)
        self._keys, self._given, self.points = keys[once], given[once], at[once]
        self.cells: IntArray = number.reshape(-1, 4 if self.order == 1 else 9)
        self.smallest = float(np.min(_area(self.points[self.cells[:, :4]])))
        if not self.smallest > 0.0:
            raise ValueError(f"{path}: has a cell in 2D that is not convex, or has no area")

    def _nodes(self, x: FloatArray, rows: IntArray, first: int) -> tuple[IntArray, FloatArray, IntArray, IntArray]:
        """Of the quadrilaterals of cells of one kind, numbered from `first`: keys, places and given points (or -1) of
        their nodes, one quadrilateral after the other; and the cell of each."""
        width, count = rows.shape[1], len(rows)
        if width == 8:  # the middle is where the 8-node functions have it
            x = np.vstack([x, 0.5 * x[rows[:, 4:]].sum(axis=1) - 0.25 * x[rows[:, :4]].sum(axis=1)])
            rows, width = np.column_stack([rows, self._count + np.arange(count)]), 9
        corners = 3 if width in (3, 6) else 4
        turned = _area(x[rows[:, :corners]]) < 0.0
        rows = np.where(turned[:, None], rows[:, list(_REVERSED[width])], rows)
        parts = _parts(corners, self.order, self._split)
        shares = parts.reshape(-1, corners)
        values = _functions(width, shares)
        given = np.where(values.max(axis=1) > 1.0 - 1e-9, rows[:, np.argmax(values, axis=1)], self._count)
        local = np.unique(np.rint(_PLACES * shares), axis=0, return_inverse=True)[1].ravel()
        keys = np.empty((count, len(shares), 3), dtype=np.int64)
        for m, share in enumerate(shares):
            ends = np.flatnonzero(share > 1e-9)
            if len(ends) > 2:
                keys[:, m, :2], keys[:, m, 2] = (self._count + first + np.arange(count))[:, None], local[m]
                continue
            a, b = rows[:, ends[0]], rows[:, ends[-1]]
            of_b = np.where(a < b, share[ends[-1]], share[ends[0]]) if len(ends) == 2 else 0.0
            keys[:, m] = np.column_stack([np.minimum(a, b), np.maximum(a, b), np.rint(_PLACES * of_b + 0 * a)])
        points = np.einsum("mn,cni->cmi", values, x[rows])
        of = first + np.repeat(np.arange(count), len(parts))
        return keys.reshape(-1, 3), points.reshape(-1, 2), np.where(given < self._count, given, -1).ravel(), of

    def lines(self, ends: IntArray) -> IntArray:
        """Points of lines (k, 2) on its edges, halves of the lines where cells are cut; (0, 0) where there is none."""
        low, high = np.sort(ends, axis=1).T
        first, last = (self._at(np.column_stack([of, of, np.zeros_like(of)])) for of in (low, high))
        pairs = [(first, last)]
        if self._split:
            middle = self._at(np.column_stack([low, high, np.full_like(low, _PLACES // 2)]))
            pairs = [(first, middle), (middle, last)]
        lines = np.vstack([np.column_stack(pair) for pair in pairs])
        return np.where(np.any(lines < 0, axis=1)[:, None], 0, lines)

    def _at(self, keys: IntArray) -> IntArray:
        row = places(self._keys, keys)
        return np.where(row < len(self._keys), row, -1)

    def members(self, nodes: IntArray) -> IntArray:
        """Its points among given ones, and those on edges between these."""
        inside = np.zeros(self._count + 1, dtype=bool)
        inside[nodes] = True
        ends = np.minimum(self._keys[:, :2], self._count)
        return np.flatnonzero(np.all(inside[ends], axis=1) | inside[self._given])

    def given(self, numbers: IntArray) -> IntArray:
        """Of its points those of numbers of the given ones, 0 of others."""
        return np.where(self._given < 0, 0, numbers[self._given])


def _area(x: FloatArray) -> FloatArray:
    """Signed areas of polygons (c, n, 2); of quadrilaterals, where they are not convex, at most 0."""
    around = x - x[:, :1]
    after, before = np.roll(x, -1, axis=1) - x, x - np.roll(x, 1, axis=1)
    turns = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    following = np.roll(around, -1, axis=1)
    area: FloatArray = 0.5 * np.sum(around[..., 0] * following[..., 1] - around[..., 1] * following[..., 0], axis=1)
    signs = np.sign(area)[:, None] * turns
    return np.where(np.any(signs <= 0.0, axis=1), 0.0, area)


def _in_plane(path: str, points: FloatArray, used: IntArray) -> FloatArray:
    """x and y of points (p, 2 or 3); ValueError unless those that are used have one z."""
    if points.shape[1] == 3:
        extent = np.ptp(points[used], axis=0)
        if extent[2] > _FLAT * np.max(extent):
            raise ValueError(
                f"{path}: the section of a slice lies in a plane z = const, with x and y (radius and axis of an "
                f"axisymmetric one) along it, but z is from {points[used, 2].min():.6g} to {points[used, 2].max():.6g}"
            )
    return np.ascontiguousarray(points[:, :2])
