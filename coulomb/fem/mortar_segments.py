"""Integrals of products of the functions of two faces over the common parts of their facets.

Every common part is divided into triangles with the points of a quadrature rule, at which both sides' functions are
evaluated.  As slave and master are integrated with the same points, the rows of a linear field are the same on both
sides whatever the rule's error (Puso and Laursen 2004; Popp, Gitterle, Gee and Wall 2010).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ..arrays import FloatArray
from .facet_functions import triangle_rule
from .facet_maps import at_points
from .facet_patch import STRAIGHT, FacetPatch
from .mortar_parts import Cells, Parts, cells_of, common_parts, nearest_layer

IntArray = npt.NDArray[np.int64]

_POINTS = 100_000
"""Quadrature points evaluated at once, so that memory stays small."""

_MORE = ((STRAIGHT, 0), (0.05, 4), (0.15, 8), (0.3, 12), (np.inf, 20))
"""Distortion of two facets up to which the rule has so many degrees more than for straight ones: the inverse maps of
distorted facets are no polynomials.  Measured with random quadrilaterals: errors of 1e-10 of the nodal forces of a
uniform pressure up to a distortion of 0.3, of 5e-9 at 0.54; without, 1e-4 and 1e-3."""


@dataclass(frozen=True)
class Segments:
    """Integrals over the common parts; f slave facets with n functions N.

    Attributes:
        mass: Integrals of N_i N_k, shape (f, n, n).
        normal: Integrals of N_i times the outward normal, shape (f, n, 3).
        coupling: Integrals of N_i times the master's function of every node, shape (f n, master nodes of all ranks).
        share: Covered share of every facet's area, shape (f,).
        doubled: Facets before which master facets lie in several layers, of which the nearest counts, shape (f,).
    """

    mass: FloatArray
    normal: FloatArray
    coupling: scipy.sparse.csr_matrix
    share: FloatArray
    doubled: npt.NDArray[np.bool_]


def segments(slave: FacetPatch, master: FacetPatch, depth: float, reach: float) -> Segments:
    """The integrals over the common parts of all slave facets.

    Args:
        slave, master: The facets; at least one of the master.
        depth: How far behind a slave facet master facets are found (initial penetration), metres.
        reach: How far before it.
    """
    cells, others = cells_of(slave), cells_of(master)
    parts, twice = nearest_layer(common_parts(cells, others, depth, reach), cells)
    covered = np.bincount(parts.slave, parts.area * cells.radius[parts.slave] ** 2, len(cells.area))
    facets = len(slave)
    share = np.bincount(cells.facet, covered, facets) / np.bincount(cells.facet, cells.area, facets)
    doubled = np.zeros(facets, dtype=bool)
    doubled[cells.facet[twice]] = True
    return Segments(*_Integrals(slave, master, cells, others).over(parts), share, doubled)


class _Integrals:
    """`mass`, `normal` and `coupling` of `Segments`."""

    def __init__(self, slave: FacetPatch, master: FacetPatch, cells: Cells, others: Cells):
        self._slave, self._master, self._cells, self._others = slave, master, cells, others
        own = slave.kind.polynomial_degree
        self._degree = own + max(own, master.kind.polynomial_degree)

    def over(self, parts: Parts) -> tuple[FloatArray, FloatArray, scipy.sparse.csr_matrix]:
        """Sums over all parts."""
        facets, n, m = len(self._slave), self._slave.kind.width, self._master.kind.width
        mass, normal = np.zeros((facets, n, n)), np.zeros((facets, n, 3))
        rows, columns, entries = [], [], []
        for at, straight, rule in self._chunks(parts):
            part, triangle = _triangles(parts.polygon[at])
            if not len(part):
                continue
            one, other = parts.slave[at][part], parts.master[at][part]
            products = self._products(one, other, triangle, straight, rule)
            pair = np.flatnonzero(np.append(True, part[1:] != part[:-1]))
            products = np.add.reduceat(products, pair, axis=0)
            facet, opposite = self._cells.facet[one[pair]], self._others.facet[other[pair]]
            rows.append(np.repeat(facet[:, None] * n + np.arange(n), m, axis=1).ravel())
            columns.append(np.tile(self._master.nodes[opposite], (1, n)).ravel())
            entries.append(products[:, :, n : n + m].ravel())
            first = np.flatnonzero(np.append(True, facet[1:] != facet[:-1]))
            own = np.add.reduceat(np.concatenate([products[:, :, :n], products[:, :, n + m :]], axis=2), first, axis=0)
            mass[facet[first]] += own[:, :, :n]
            normal[facet[first]] += own[:, :, n:]
        shape = (facets * n, self._master.size)
        if not entries:
            return mass, normal, scipy.sparse.csr_matrix(shape)
        triplets = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
        return mass, normal, scipy.sparse.csr_matrix(triplets, shape=shape)

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
            rule = triangle_rule(self._degree + more)
            size = max(1, _POINTS // (len(rule[1]) * (parts.polygon.shape[1] - 2)))
            for at in np.split(chosen, range(size, len(chosen), size)):
                yield at, more == 0, rule

    def _products(
        self,
        one: IntArray,
        other: IntArray,
        triangle: FloatArray,
        straight: bool,
        rule: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Integrals over triangles (t, 3, 2) in slave cells and before master cells of each slave function times all
        slave functions, all master functions, and the outward normal, shape (t, n, n + m + 3)."""
        cells, others = self._cells, self._others
        edges = triangle[:, 1:] - triangle[:, :1]
        p = triangle[:, None, 0] + rule[0] @ edges
        doubled = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
        seen = cells.seen(one, self._slave.x[cells.facet[one]])
        values, normal = at_points(self._slave.kind, seen, p, cells.start[one], straight)
        seen = cells.seen(one, self._master.x[others.facet[other]])
        theirs, _ = at_points(self._master.kind, seen, p, others.start[other], straight)
        normal /= normal[:, :, 2:]  # in the frame of the cell: its third component is the area in the plane
        length = np.linalg.norm(normal, axis=2)
        area = rule[1] * (doubled * cells.radius[one] ** 2)[:, None] * length
        normal = (normal / length[:, :, None]) @ cells.frames[one]
        width = (*p.shape[:2], 3)
        product: FloatArray = np.swapaxes(values * area[:, :, None], 1, 2) @ np.concatenate(
            [values, theirs, np.broadcast_to(normal, width)], axis=2
        )
        return product


def _triangles(polygon: FloatArray) -> tuple[IntArray, FloatArray]:
    """Triangles from the first corner of each polygon (p, v, 2): their polygons, and corners (t, 3, 2)."""
    ends = np.stack([polygon[:, 1:-1], polygon[:, 2:]], axis=2)
    first = np.any(ends[:, :, 1] != polygon[:, :1], axis=2)
    part, number = np.nonzero(np.any(ends[:, :, 0] != ends[:, :, 1], axis=2) & first)
    return part, np.concatenate([polygon[part, :1], ends[part, number]], axis=1)
