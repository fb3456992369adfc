"""Lagrange functions of facets, triangles and quadrilaterals of first and second order, with nodes in VTK's order.

Written out, since pairing two surfaces evaluates them at millions of points, other ones in every facet.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, in_words, unit_vectors
from .. import compat
from ..bodies import DisplacementSpace
from ..compat import basix
from ..geometry import RigidFoundation

_NEWTON_STEPS: Final = 30

_SETTLED: Final = 1e-8
"""Newton step in the reference facet after which the error is the square of it."""


def functions_at(
    kind: FacetKind, x: FloatArray, p: FloatArray, start: FloatArray, straight: bool
) -> tuple[FloatArray, FloatArray]:
    """The functions of facets at the points that are projected to places in a plane, shape (t, q, n), and normals there
    with the length area over reference area, shape (t, q or 1, 3).

    Args:
        x: Their nodes, the third component along the projection, shape (t, n, 3).
        p: The places, shape (t, q, 2).
        start: Reference points near them, shape (t, 2).
        straight: Whether the maps of all facets are affine.

    Raises:
        ValueError: If a facet is so distorted that Newton's method fails.
    """
    if straight:
        edges = x[:, [1, kind.corners - 1]] - x[:, :1]
        r, s = _solutions(
            *np.moveaxis(edges[:, :, None, :2], (1, 3), (0, 1)), *np.moveaxis(p - x[:, None, 0, :2], 2, 0)
        )
        return np.stack(kind.values(r, s), axis=2), np.cross(edges[:, :1], edges[:, 1:])
    r, s = _bilinear_inverse(x, p) if kind.width == 4 else _newton_inverse(kind, x, p, start)
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(s))):
        raise ValueError("a facet is folded or so distorted that places in it cannot be found; use a better mesh")
    slopes = [np.stack([np.broadcast_to(slope, r.shape) for slope in along], axis=2) for along in kind.slopes(r, s)]
    return np.stack(kind.values(r, s), axis=2), np.cross(slopes[0] @ x, slopes[1] @ x)


_Components = tuple[FloatArray, FloatArray]


def _bilinear_inverse(x: FloatArray, p: FloatArray) -> _Components:
    """Reference points of bilinear facets, in a twelfth of the time of Newton's method: of places a + b r + c s + d r
    s; their product with c + d r is a quadratic equation of r."""
    plane = x[:, :, :2]
    b, c = plane[:, 1] - plane[:, 0], plane[:, 3] - plane[:, 0]
    d = plane[:, 0] - plane[:, 1] + plane[:, 2] - plane[:, 3]
    product = (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])[:, None]
    quadratic = -(b[:, 0] * d[:, 1] - b[:, 1] * d[:, 0])[:, None]
    (bx, by), (cx, cy), (dx, dy) = (np.moveaxis(v[:, :, None], 1, 0) for v in (b, c, d))
    qx, qy = p[:, :, 0] - plane[:, None, 0, 0], p[:, :, 1] - plane[:, None, 0, 1]
    linear = product - (qx * dy - qy * dx)
    constant = qx * cy - qy * cx
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(linear * linear - 4.0 * quadratic * constant)
        r = 2.0 * constant / (linear + np.sign(product) * root)
        cx, cy = cx + dx * r, cy + dy * r
        s = ((qx - bx * r) * cx + (qy - by * r) * cy) / (cx * cx + cy * cy)
    return r, s


def _newton_inverse(kind: FacetKind, x: FloatArray, p: FloatArray, start: FloatArray) -> _Components:
    """The same of any facets with nodes x (t, n, 3); nan if Newton's method fails."""
    plane = np.ascontiguousarray(x[:, :, :2])
    r, s = (np.broadcast_to(start[:, i, None], p.shape[:2]).copy() for i in (0, 1))

    def combined(functions: Sequence[Any]) -> _Components:
        point = np.stack([np.broadcast_to(values, r.shape) for values in functions], axis=2) @ plane
        return point[:, :, 0], point[:, :, 1]

    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            point, (along_r, along_s) = combined(kind.values(r, s)), map(combined, kind.slopes(r, s))
            dr, ds = _solutions(along_r, along_s, p[:, :, 0] - point[0], p[:, :, 1] - point[1])
            r, s = r + dr, s + ds
            if max(np.max(np.abs(dr), initial=0.0), np.max(np.abs(ds), initial=0.0)) < _SETTLED:
                return r, s
    return np.full_like(r, np.nan), s


def _solutions(along_r: _Components, along_s: _Components, x: FloatArray, y: FloatArray) -> _Components:
    """Solutions of the systems of two equations with these columns."""
    scale = 1.0 / (along_r[0] * along_s[1] - along_r[1] * along_s[0])
    return (x * along_s[1] - y * along_s[0]) * scale, (along_r[0] * y - along_r[1] * x) * scale


@dataclass(frozen=True)
class FacetKind:
    """Triangles or quadrilaterals with functions of order 1 or 2."""

    corners: int
    degree: int

    @property
    def width(self) -> int:
        """Number of its nodes: 3, 4, 6 or 9."""
        return len(self.points)

    @property
    def points(self) -> FloatArray:
        """Its nodes in the reference facet, shape (n, 2): corners, middles of edges, the centre."""
        return _points(self.corners, self.degree)

    @property
    def mirrored(self) -> list[int]:
        """The columns of its nodes in the order that reverses its orientation."""
        return {3: [0, 2, 1], 4: [0, 3, 2, 1], 6: [0, 2, 1, 5, 4, 3], 9: [0, 3, 2, 1, 7, 6, 5, 4, 8]}[self.width]

    @property
    def pieces(self) -> IntArray:
        """Columns of the corners of the four pieces of a second-order facet, of the one of a first-order facet."""
        tables: dict[int, list[list[int]]] = {
            3: [[0, 1, 2]],
            4: [[0, 1, 2, 3]],
            6: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
            9: [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]],
        }
        return np.array(tables[self.width], dtype=np.int64)

    @property
    def polynomial_degree(self) -> int:
        """Of the functions as polynomials in two variables: a bilinear one has degree 2."""
        return self.degree if self.corners == 3 else 2 * self.degree

    @property
    def vertex_functions(self) -> FloatArray:
        """The linear or bilinear functions of the corners as combinations of its functions, shape (corners, n)."""
        return np.stack(FacetKind(self.corners, 1).values(self.points[:, 0], self.points[:, 1]))

    def values(self, r: FloatArray, s: FloatArray) -> list[FloatArray]:
        """The n functions at reference points, arrays of any one shape."""
        if self.corners == 4:
            at_r, at_s = _line(r, self.degree), _line(s, self.degree)
            return [at_r[i] * at_s[j] for i, j in _tensor(self.degree)]
        t = 1.0 - r - s
        if self.degree == 1:
            return [t, r, s]
        return [t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t]

    def slopes(self, r: FloatArray, s: FloatArray) -> tuple[Sequence[Any], Sequence[Any]]:
        """The derivatives of the n functions along r and along s at reference points: arrays, or numbers."""
        if self.corners == 4:
            at_r, at_s = _line(r, self.degree), _line(s, self.degree)
            along_r, along_s = _line_slopes(r, self.degree), _line_slopes(s, self.degree)
            pairs = _tensor(self.degree)
            return [along_r[i] * at_s[j] for i, j in pairs], [at_r[i] * along_s[j] for i, j in pairs]
        if self.degree == 1:
            return [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]
        t = 1.0 - r - s
        return (
            [1 - 4 * t, 4 * r - 1, 0.0, 4 * (t - r), 4 * s, -4 * s],
            [1 - 4 * t, 0.0, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)],
        )

    def rule(self, degree: int) -> tuple[FloatArray, FloatArray]:
        """Points (q, 2) and weights (q,) of a quadrature rule, exact on parallelograms for such polynomials."""
        return _rule(basix.CellType.triangle if self.corners == 3 else basix.CellType.quadrilateral, degree)


@functools.cache
def _rule(cell: Any, degree: int) -> tuple[FloatArray, FloatArray]:
    points, weights = basix.make_quadrature(cell, degree)
    return np.asarray(points), np.asarray(weights)


@functools.cache
def _points(corners: int, degree: int) -> FloatArray:
    if corners == 3:
        triangle = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)]
        return np.array(triangle[: 3 if degree == 1 else 6], dtype=float)
    line = (0.0, 1.0, 0.5)
    return np.array([(line[i], line[j]) for i, j in _tensor(degree)])


def _tensor(degree: int) -> list[tuple[int, int]]:
    """Which functions of a line, at 0, 1 and 1/2, make those of a quadrilateral."""
    second = [(2, 0), (1, 2), (2, 1), (0, 2), (2, 2)] if degree == 2 else []
    return [(0, 0), (1, 0), (1, 1), (0, 1), *second]


def _line(r: FloatArray, degree: int) -> list[FloatArray]:
    if degree == 1:
        return [1.0 - r, r]
    return [(1.0 - r) * (1.0 - 2 * r), r * (2 * r - 1.0), 4 * r * (1.0 - r)]


def _line_slopes(r: FloatArray, degree: int) -> list[Any]:
    if degree == 1:
        return [-1.0, 1.0]
    return [4 * r - 3.0, 4 * r - 1.0, 4.0 - 8 * r]


STRAIGHT: Final = 1e-10
"""Distortion below which the map of a facet is taken as affine."""

_CREASE: Final = 0.9
"""Cosine of the angle between a facet and the mean of those around a corner below which the face has an edge there."""

_OFF_SURFACE: Final = 0.1
"""Distance of a corner from a given surface over its facet's diameter above which that is the wrong surface."""


@dataclass(frozen=True, eq=False)
class FacetPatch:
    """Facets of a face with the nodes of the displacements on them.

    Attributes:
        kind: Triangles or quadrilaterals, of first or second order.
        nodes: Global numbers of the nodes of every facet, in VTK's order, counterclockwise seen from outside; (f, n).
        x: Their coordinates in metres, shape (f, n, 3).
        size: Number of nodes of the space in all.
        curved: Nodes of second-order facets through the surface for which the facets stand, in VTK's order, metres,
            shape (f, 6 or 9, 3): between them gaps are measured.  None: the facets themselves.
    """

    kind: FacetKind
    nodes: IntArray
    x: FloatArray
    size: int
    curved: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.nodes)

    @cached_property
    def whole(self) -> FloatArray:
        """Integrals of the functions over every facet in m^2, shape (f, n)."""
        points, weights = self.kind.rule(3 * self.kind.polynomial_degree)
        values = np.stack(self.kind.values(points[:, 0], points[:, 1]))
        return np.einsum("q,fq,nq->fn", weights, np.linalg.norm(self.area_vectors(points), axis=2), values)

    @cached_property
    def areas(self) -> FloatArray:
        return self.whole.sum(axis=1)

    @cached_property
    def places(self) -> FloatArray:
        """Coordinates of the nodes of the patch, 0 of all others, shape (size, 3)."""
        x = np.zeros((self.size, 3))
        x[self.nodes] = self.x
        return x

    def area_vectors(self, points: FloatArray) -> FloatArray:
        """Outward normals times the area per area of the reference facet, at its points (q, 2), shape (f, q, 3)."""
        along_r, along_s = (
            np.stack([np.broadcast_to(slope, len(points)) for slope in slopes])
            for slopes in self.kind.slopes(points[:, 0], points[:, 1])
        )
        r, s = (np.einsum("nq,fni->fqi", slopes, self.x) for slopes in (along_r, along_s))
        return np.cross(r, s)

    @cached_property
    def distortion(self) -> FloatArray:
        """How far the nodes of every facet are from those of a triangle or parallelogram with straight edges and the
        nodes of its edges in their middles, over its diameter; 0 where its map is affine; shape (f,)."""
        three, linear = [0, 1, self.kind.corners - 1], np.column_stack([np.ones(self.kind.width), self.kind.points])
        affine = linear @ np.linalg.inv(linear[three])
        straight = np.einsum("nc,fci->fni", affine, self.x[:, three])
        off = np.linalg.norm(self.x - straight, axis=2).max(axis=1, initial=0.0)
        return off / self.diameters

    @cached_property
    def straight(self) -> bool:
        return bool(np.all(self.distortion < STRAIGHT))

    @cached_property
    def diameters(self) -> FloatArray:
        """Twice the distance of the farthest node of every facet from the mean of its nodes, metres, shape (f,)."""
        away = np.linalg.norm(self.x - self.x.mean(axis=1, keepdims=True), axis=2)
        return 2.0 * away.max(axis=1, initial=0.0)

    @cached_property
    def bulges(self) -> FloatArray:
        """The way from the middle of every facet to the smooth face for which the facets may stand, metres, shape
        (f, 3).

        The smooth face has the mean normals n_k of the facets around the nodes: to second order the middle is off by
        1/2 of the mean of ((x_k - x) . n_k) n_k.  0 of second-order facets, where `curved` is known, and at edges
        between facets that differ by more than about 50 degrees.
        """
        vectors = np.repeat(self.middle_vectors, self.kind.width, axis=0)
        return self.bulges_with(mean_normals(self.nodes.ravel(), vectors, self.size)[self.nodes])

    @cached_property
    def middle_vectors(self) -> FloatArray:
        """`area_vectors` in the middles of the facets, shape (f, 3)."""
        return self.area_vectors(self.kind.points.mean(axis=0)[None])[:, 0]

    def bulges_with(self, n: FloatArray) -> FloatArray:
        """`bulges` with the `mean_normals` at the nodes of each facet, shape (f, n, 3)."""
        if self.kind.degree == 2 or self.curved is not None or not len(self):
            return np.zeros((len(self), 3))
        creased, n = self._creased(n), unit_vectors(n)
        away = np.einsum("fki,fki->fk", self.x - self.x.mean(axis=1, keepdims=True), n)
        bulges: FloatArray = 0.5 * (away[:, :, None] * n).mean(axis=1)
        return np.where(creased[:, None], 0.0, bulges)

    @property
    def multiplier_columns(self) -> IntArray:
        """Columns of the nodes that are contact points: all, of 6-node triangles the corners."""
        return np.arange(3 if self.kind.width == 6 else self.kind.width)

    def only(self, which: BoolArray | IntArray) -> FacetPatch:
        curved = None if self.curved is None else self.curved[which]
        return replace(self, nodes=self.nodes[which], x=self.x[which], curved=curved)

    @property
    def second_order(self) -> FacetKind:
        return FacetKind(self.kind.corners, 2)

    def on_surface(self, surface: RigidFoundation) -> FacetPatch:
        """The facets with `curved` at the nearest points of a surface; ValueError if a corner is farther from it than a
        tenth of its facet."""
        if not len(self):
            return replace(self, curved=self._in_second_order)
        x = self.x[:, : self.kind.corners].reshape(-1, 3)
        off = np.abs(surface.signed_distance(x)) / np.repeat(self.diameters, self.kind.corners)
        if np.max(off) > _OFF_SURFACE:
            where = in_words(x[np.argmax(off)])
            raise ValueError(
                f"has a node off the surface given for it by {100 * np.max(off):.3g} % of its facet, at x = {where}: "
                "give the surface on which its nodes are"
            )
        places: FloatArray = self._in_second_order.reshape(-1, 3)
        for _ in range(2):  # signed distances may be so to first order only
            places = places - surface.signed_distance(places)[:, None] * surface.normal(places)
        return replace(self, curved=places.reshape(len(self), -1, 3))

    def smoothed(self, n: FloatArray) -> FacetPatch:
        """The facets with `curved` on the smooth surface with the normals n: `mean_normals` at the corners of each,
        shape (f, corners, 3).

        To second order the middle of an edge is off by 1/2 of the mean of ((x_k - x) . n_k) n_k over its ends.
        """
        if self.kind.degree == 2:
            return self
        creased, n, straight, count = self._creased(n), unit_vectors(n), self.x, self.kind.corners
        ends = np.stack([np.arange(count), np.roll(np.arange(count), -1)], axis=1)
        half = 0.5 * (straight[:, ends[:, 0]] - straight[:, ends[:, 1]])
        rise = [sign * np.einsum("fei,fei->fe", half, n[:, ends[:, k]]) for k, sign in enumerate((1.0, -1.0))]
        offset = 0.25 * sum(r[:, :, None] * n[:, ends[:, k]] for k, r in enumerate(rise))
        offset[creased] = 0.0
        if count == 4:
            offset = np.concatenate([offset, 0.5 * offset.sum(axis=1, keepdims=True)], axis=1)
        curved = self._in_second_order
        curved[:, count:] += offset
        return replace(self, curved=curved)

    @property
    def _in_second_order(self) -> FloatArray:
        """Nodes of second-order facets of the same shape, (f, 6 or 9, 3)."""
        points = self.second_order.points
        values = np.stack(self.kind.values(points[:, 0], points[:, 1]))
        return np.einsum("nq,fni->fqi", values, self.x)

    def _creased(self, n: FloatArray) -> BoolArray:
        """Facets that differ by more than about 50 degrees from those beside them, by mean normals n at the corners:
        one is aslant to them, or they are short, since the facets around a corner differ."""
        area = self.middle_vectors
        aslant = np.einsum("fki,fi->fk", unit_vectors(n), area) < _CREASE * np.linalg.norm(area, axis=1)[:, None]
        return np.any(aslant | (np.linalg.norm(n, axis=2) < _CREASE), axis=1)


def mean_normals(node: IntArray, vectors: FloatArray, size: int) -> FloatArray:
    """Means of the unit normals of the facets around each of `size` nodes, weighted by their area, shape (size, 3), of
    `FacetPatch.middle_vectors` (k, 3) and the nodes at which they count (k,)."""
    sums, areas = np.zeros((size, 3)), np.bincount(node, np.linalg.norm(vectors, axis=1), size)
    np.add.at(sums, node, vectors)
    return sums / np.maximum(areas, 1e-300)[:, None]


def facet_patch(space: DisplacementSpace, facets: Int32Array) -> FacetPatch:
    topology = space.domain.topology
    kind = FacetKind(3 if topology.cell_type.name == "tetrahedron" else 4, space.degree)
    cell, columns = space.in_cells(facets)
    dofs = compat.cell_dofs(space.V)[cell[:, None], columns]
    in_cells = space.points_of_cells(cell)
    x = np.take_along_axis(in_cells, columns[:, :, None], axis=1)
    nodes = space.global_numbers(dofs)
    patch = FacetPatch(kind, nodes, x, space.numbering.total)
    outward = x[:, : kind.corners].mean(axis=1) - in_cells.mean(axis=1)
    inside = np.einsum("fi,fi->f", patch.area_vectors(kind.points[: kind.corners]).sum(axis=1), outward) < 0.0
    nodes, x = patch.nodes.copy(), x.copy()
    nodes[inside], x[inside] = nodes[inside][:, kind.mirrored], x[inside][:, kind.mirrored]
    return replace(patch, nodes=nodes, x=x)
