"""Integrals of products of the functions of two faces over the common parts of their facets.

Every common part is divided into triangles with the points of a quadrature rule, at which both sides' functions are
evaluated.  As slave and master are integrated with the same points, the rows of a linear field are the same on both
sides whatever the rule's error (Puso and Laursen 2004; Popp, Gitterle, Gee and Wall 2010).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse

from ...arrays import BoolArray, FloatArray, IntArray
from .facet_patch import STRAIGHT, FacetKind, FacetPatch, functions_at
from .mortar_parts import Cells, Most, Parts, cells_of, common_parts, nearest_layer, nearest_sheets

_POINTS: Final = 100_000
"""Quadrature points evaluated at once, so that memory stays small."""

_SAME: Final = 1e-9
"""Distance of a corner of a triangle from that of its cell, over the cell's radius, below which they are the same."""

_MORE = ((STRAIGHT, 0), (0.05, 4), (0.15, 8), (0.3, 12), (np.inf, 20))
"""Distortion of two facets up to which the rule has so many degrees more than for straight ones: the inverse maps of
distorted facets are no polynomials.  Measured with random quadrilaterals: errors of 1e-10 of the nodal forces of a
uniform pressure up to a distortion of 0.3, of 5e-9 at 0.54; without, 1e-4 and 1e-3."""


_LEAST_BENT: Final = 0.05
"""Covered share of a facet below which its averages do not continue the distance (`mortar.LEAST_DUAL`)."""


@dataclass(frozen=True, eq=False)
class Segments:
    """Integrals over the common parts; f slave facets with n functions N.

    Attributes:
        mass: Integrals of N_i N_k, shape (f, n, n).
        normal: Integrals of N_i times the outward normal, shape (f, n, 3).
        coupling: Integrals of N_i times the master's function of every node, shape (f n, master nodes of all ranks).
        separation: Integrals of N_i times the way from the slave to the master along the projection, shape (f, n, 3).
        square: Integral of the square of this way, shape (f,).
        at_corners: This way at the corners of each facet, 0 where no part reaches the corner, shape (f, corners, 3).
        reached: Whether a part reaches the corner, shape (f, corners).
        least: Smallest distance along the projection at the points of the rule and the corners of its triangles,
            metres, negative where the faces overlap, shape (f,); inf of uncovered facets.
        share: Covered share of every facet's area, shape (f,).
        doubled: Facets before which master facets lie in several layers, of which the nearest counts, shape (f,).
    """

    mass: FloatArray
    normal: FloatArray
    coupling: scipy.sparse.csr_matrix
    separation: FloatArray
    square: FloatArray
    at_corners: FloatArray
    reached: BoolArray
    least: FloatArray
    share: FloatArray
    doubled: BoolArray

    @property
    def chord(self) -> FloatArray:
        """How far the distance of the faces in a facet is from linear between its corners: h^2/(8 R) for facets of the
        size h and the difference 1/R of the curvatures of both; 0 of partly covered facets; metres, shape (f,).

        The mean of a function s (h - s)/(2 R) is h^2/(12 R).
        """
        area = self.mass.sum(axis=(1, 2))
        mean = self.separation.sum(axis=1) / np.maximum(area, 1e-300)[:, None]
        off: FloatArray = 1.5 * np.linalg.norm(mean - self.at_corners.mean(axis=1), axis=1)
        return np.where(np.all(self.reached, axis=1) & (self.share > 0.999), off, 0.0)

    def bend(self, linear: FloatArray) -> FloatArray:
        """The same of partly covered facets, 0 of others, by functions (c, n) that are linear: what is left of the
        distance without its linear part in the mean, of s (h - s)/(2 R) 3.35 times less than h^2/(8 R), for all of the
        facet, to which averages continue it; metres, shape (f,)."""
        bend, area = np.zeros(len(self.share)), self.mass.sum(axis=(1, 2))
        part = np.flatnonzero((self.share > _LEAST_BENT) & ~(np.all(self.reached, axis=1) & (self.share > 0.999)))
        inverse = np.linalg.pinv(linear @ self.mass[part] @ linear.T, 1e-10, hermitian=True)
        ways = linear @ self.separation[part]
        rest = self.square[part] - np.einsum("fik,fij,fjk->f", ways, inverse, ways)
        bend[part] = 3.35 * np.sqrt(np.maximum(rest, 0.0) / area[part]) / self.share[part] ** 2
        return bend


def segments(slave: FacetPatch, master: FacetPatch, depth: float, reach: float, most: Most | None = None) -> Segments:
    """The integrals over the common parts of all slave facets with master facets, of which there is one at least, up to
    `depth` behind them (initial penetration) and `reach` before them, metres."""
    cells, others = cells_of(slave), cells_of(master)
    parts, twice = nearest_layer(common_parts(cells, others, depth, reach), cells)
    parts = nearest_sheets(parts, cells, others, slave, master, most)
    covered = np.bincount(parts.slave, parts.area * cells.radius[parts.slave] ** 2, len(cells.area))
    facets = len(slave)
    share = np.bincount(cells.facet, covered, facets) / np.bincount(cells.facet, cells.area, facets)
    doubled = np.zeros(facets, dtype=bool)
    doubled[cells.facet[twice]] = True
    return _Integrals(slave, master, cells, others).over(parts, share, doubled)


class _Integrals:
    """Integrals over the common parts of the cells of two faces."""

    def __init__(self, slave: FacetPatch, master: FacetPatch, cells: Cells, others: Cells):
        self._slave, self._master, self._cells, self._others = slave, master, cells, others
        own = slave.kind.polynomial_degree
        self._degree = own + max(own, master.kind.polynomial_degree)

    def over(self, parts: Parts, share: FloatArray, doubled: BoolArray) -> Segments:
        """Sums over all parts; the other arguments as of `Segments`."""
        facets, n, m = len(self._slave), self._slave.kind.width, self._master.kind.width
        mass, vectors, least = np.zeros((facets, n, n)), np.zeros((facets, n, 7)), np.full(facets, np.inf)
        corners = np.zeros((facets, self._slave.kind.corners, 4))
        rows, columns, entries = [], [], []
        for chunk, straight, rule in self._chunks(parts):
            part, triangle = _triangles(parts.polygon[chunk])
            if not len(part):
                continue
            one, other = parts.slave[chunk][part], parts.master[chunk][part]
            products, distance = self._products(one, other, triangle, straight, rule)
            np.minimum.at(least, self._cells.facet[one], distance.min(axis=1))
            self._add_corners(corners, one, triangle, distance[:, -3:])
            pair = np.flatnonzero(np.append(True, part[1:] != part[:-1]))
            products = np.add.reduceat(products, pair, axis=0)
            facet, opposite = self._cells.facet[one[pair]], self._others.facet[other[pair]]
            rows.append(np.repeat(facet[:, None] * n + np.arange(n), m, axis=1).ravel())
            columns.append(np.tile(self._master.nodes[opposite], (1, n)).ravel())
            entries.append(products[:, :, n : n + m].ravel())
            first = np.flatnonzero(np.append(True, facet[1:] != facet[:-1]))
            own = np.add.reduceat(np.concatenate([products[:, :, :n], products[:, :, n + m :]], axis=2), first, axis=0)
            mass[facet[first]] += own[:, :, :n]
            vectors[facet[first]] += own[:, :, n:]
        coupling = scipy.sparse.csr_matrix((facets * n, self._master.size))
        if entries:
            triplets = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
            coupling = scipy.sparse.csr_matrix(triplets, shape=coupling.shape)
        number = corners[:, :, 3]
        at_corners = corners[:, :, :3] / np.maximum(number, 1.0)[:, :, None]
        normal, separation, reached = vectors[:, :, :3], vectors[:, :, 3:6], number > 0.0
        square = vectors[:, :, 6].sum(axis=1)
        return Segments(mass, normal, coupling, separation, square, at_corners, reached, least, share, doubled)

    def _add_corners(self, corners: FloatArray, one: IntArray, triangle: FloatArray, distance: FloatArray) -> None:
        """Add to sums (f, corners, 4) the ways to the master, by the distances (t, 3) in the corners of triangles (t,
        3, 2) in slave cells, and 1, where these are corners of the facets."""
        cells, kind = self._cells, self._slave.kind
        facet = cells.facet[one]
        place = cells.seen(one, self._slave.x[facet][:, : kind.corners])[:, None, :, :2]
        there = np.all(np.abs(triangle[:, :, None] - place) < _SAME, axis=3)
        t, k, corner = np.nonzero(there)
        way = distance[t, k, None] * cells.frames[one[t], 2]
        np.add.at(corners, (facet[t], corner), np.column_stack([way, np.ones(len(t))]))

    def _chunks(self, parts: Parts) -> Iterator[tuple[IntArray, bool, tuple[FloatArray, FloatArray]]]:
        """Some of the parts, ascending, whether both facets are straight, and the rule that they need."""
        distortion = np.maximum(
            self._slave.distortion[self._cells.facet[parts.slave]],
            self._master.distortion[self._others.facet[parts.master]],
        )
        least = -1.0
        for limit, more in _MORE:
            chosen = np.flatnonzero((distortion > least) & (distortion <= limit))
            least = limit
            rule = _with_corners(*FacetKind(3, 1).rule(self._degree + more))
            size = max(1, _POINTS // (len(rule[1]) * (parts.polygon.shape[1] - 2)))
            for chunk in np.split(chosen, range(size, len(chosen), size)):
                yield chunk, more == 0, rule

    def _products(
        self, one: IntArray, other: IntArray, triangle: FloatArray, straight: bool, rule: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Integrals over triangles (t, 3, 2) in slave cells and before master cells of each slave function times all
        slave functions, all master functions, the outward normal, the way to the master and its square, shape (t, n,
        n + m + 7);
        and the distances of the master at the points of the rule, shape (t, q)."""
        cells, others = self._cells, self._others
        edges = triangle[:, 1:] - triangle[:, :1]
        p = triangle[:, None, 0] + rule[0] @ edges
        doubled = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
        slave = cells.seen(one, self._slave.x[cells.facet[one]])
        values, normal = functions_at(self._slave.kind, slave, p, cells.start[one], straight)
        master = cells.seen(one, self._master.x[others.facet[other]])
        theirs, _ = functions_at(self._master.kind, master, p, others.start[other], straight)
        ends = self._heights(self._master, others.facet[other], one, theirs, master)
        starts = self._heights(self._slave, cells.facet[one], one, values, slave)
        distance = (ends - starts) * cells.radius[one][:, None, None]
        normal /= normal[:, :, 2:]  # in the frame of the cell: its third component is the area in the plane
        length = np.linalg.norm(normal, axis=2)
        area = rule[1] * (doubled * cells.radius[one] ** 2)[:, None] * length
        normal = np.broadcast_to((normal / length[:, :, None]) @ cells.frames[one], (*p.shape[:2], 3))
        way = distance * cells.frames[one, 2][:, None]
        product: FloatArray = np.swapaxes(values * area[:, :, None], 1, 2) @ np.concatenate(
            [values, theirs, normal, way, distance**2], axis=2
        )
        return product, distance[:, :, 0]

    def _heights(
        self, patch: FacetPatch, facet: IntArray, one: IntArray, values: FloatArray, seen: FloatArray
    ) -> FloatArray:
        """Heights in the frames of slave cells, shape (t, q, 1), of points of facets with these functions (t, q, n),
        and nodes `seen` (t, n, 3) in the frames."""
        if patch.curved is None:
            return values @ seen[:, :, 2:]
        if patch.kind.degree == 1:
            ends = ([1], [2]) if patch.kind.corners == 3 else ([1, 2], [2, 3])
            values = np.stack(patch.second_order.values(*(values[:, :, end].sum(axis=2) for end in ends)), axis=2)
        return values @ self._cells.seen(one, patch.curved[facet])[:, :, 2:]


def _with_corners(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A rule on the reference triangle with its corners as further points, of weight 0."""
    return np.concatenate([points, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]]), np.concatenate([weights, np.zeros(3)])


def _triangles(polygon: FloatArray) -> tuple[IntArray, FloatArray]:
    """Triangles from the first corner of each polygon (p, v, 2): their polygons, and corners (t, 3, 2)."""
    ends = np.stack([polygon[:, 1:-1], polygon[:, 2:]], axis=2)
    first = np.any(ends[:, :, 1] != polygon[:, :1], axis=2)
    part, number = np.nonzero(np.any(ends[:, :, 0] != ends[:, :, 1], axis=2) & first)
    return part, np.concatenate([polygon[part, :1], ends[part, number]], axis=1)
