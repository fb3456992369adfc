"""The common parts of the facets of two faces, and integrals over them of the products of their functions.

Every slave facet, of second order each of its four pieces, has a plane through its corners' mean with their mean
normal n.  The master facets before it are projected along n into that plane and clipped; every common part is
divided into triangles with the points of a quadrature rule, at which both sides' functions are evaluated.  As slave
and master are integrated with the same points, the rows of a linear field are the same on both sides whatever the
rule's error (Puso and Laursen 2004, Popp, Gee and Wall 2009).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ..arrays import FloatArray
from .facet_functions import FacetKind, triangle_rule
from .facet_patch import FacetPatch
from .facet_search import sphere_tree
from .polygon_clipping import areas, clipped

IntArray = npt.NDArray[np.int64]

_FACING = -0.2
"""Largest product of the normals of two facets that are paired: they differ from opposite by less than 78 degrees."""

_STRAIGHT = 1e-10
"""Distortion below which the map of a facet is taken as affine."""

_SLIVER = 1e-13
"""Share of a facet's area below which a common part is a rounding error."""

_TRIANGLES = 20_000
"""Triangles integrated at once."""

_NEWTON_STEPS = 30


@dataclass(frozen=True)
class Cells:
    """The convex polygons of a patch: its facets, or the pieces of curved ones.

    Attributes:
        facet: The facet of each, ascending, shape (c,).
        corners: Their corners, counterclockwise from outside, metres, shape (c, 3 or 4, 3).
        start: Middle of each in its reference facet, shape (c, 2).
    """

    facet: IntArray
    corners: FloatArray
    start: FloatArray

    @cached_property
    def centre(self) -> FloatArray:
        """Mean of the corners, shape (c, 3)."""
        mean: FloatArray = self.corners.mean(axis=1)
        return mean

    @cached_property
    def radius(self) -> FloatArray:
        """Distance of the farthest corner from the centre, shape (c,)."""
        away = np.linalg.norm(self.corners - self.centre[:, None], axis=2)
        radius: FloatArray = away.max(axis=1, initial=0.0)
        return radius

    @cached_property
    def area_vector(self) -> FloatArray:
        """Mean outward normal times the area in its plane, shape (c, 3)."""
        x = self.corners
        far = x[:, 3] - x[:, 1] if x.shape[1] == 4 else x[:, 2] - x[:, 1]
        base = x[:, 2] - x[:, 0] if x.shape[1] == 4 else x[:, 1] - x[:, 0]
        vector: FloatArray = 0.5 * np.cross(base, far)
        return vector

    @cached_property
    def area(self) -> FloatArray:
        """Shape (c,)."""
        area: FloatArray = np.linalg.norm(self.area_vector, axis=1)
        return area

    @cached_property
    def frames(self) -> FloatArray:
        """Rows e1, e2, n with n the mean outward normal, right-handed, shape (c, 3, 3)."""
        n = self.area_vector / self.area[:, None]
        e1 = self.corners[:, 1] - self.corners[:, 0]
        e1 = e1 - np.einsum("ki,ki->k", e1, n)[:, None] * n
        e1 /= np.linalg.norm(e1, axis=1)[:, None]
        return np.stack([e1, np.cross(n, e1), n], axis=1)

    def seen(self, cell: IntArray, x: FloatArray) -> FloatArray:
        """Points x (k, n, 3) in the frames of cells (k,), from their centres over their radii: lengths 1, (k, n, 3)."""
        away = (x - self.centre[cell][:, None]) / self.radius[cell][:, None, None]
        seen: FloatArray = np.einsum("kni,kji->knj", away, self.frames[cell])
        return seen


def cells_of(patch: FacetPatch) -> Cells:
    """The facets if all of them are straight; else the pieces of all."""
    kind = patch.kind
    if np.all(patch.distortion < _STRAIGHT) or kind.degree == 1:
        pieces = np.arange(kind.corners)[None]
    else:
        pieces = kind.pieces
    start = kind.points[pieces].mean(axis=1)
    return Cells(
        np.repeat(np.arange(len(patch)), len(pieces)),
        patch.x[:, pieces].reshape(-1, kind.corners, 3),
        np.tile(start, (len(patch), 1)),
    )


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


@dataclass(frozen=True)
class _Parts:
    """Common parts of pairs of cells, polygons in the frames of the slave cells.

    Attributes:
        slave, master: Cells, ascending by slave, shape (p,).
        polygon: Corners, counterclockwise, in radii of the slave cell, shape (p, v, 2).
        area: Areas in squared radii, shape (p,).
        gap: Distances in the middle along the normal in metres, shape (p,).
    """

    slave: IntArray
    master: IntArray
    polygon: FloatArray
    area: FloatArray
    gap: FloatArray

    def only(self, which: npt.NDArray[np.bool_]) -> _Parts:
        return _Parts(self.slave[which], self.master[which], self.polygon[which], self.area[which], self.gap[which])


def segments(slave: FacetPatch, master: FacetPatch, depth: float, reach: float) -> Segments:
    """The integrals over the common parts of all slave facets.

    Args:
        slave, master: The facets; at least one of the master.
        depth: How far behind a slave facet master facets are found (initial penetration), metres.
        reach: How far before it.
    """
    cells, others = cells_of(slave), cells_of(master)
    parts = _common_parts(cells, others, depth, reach)
    parts, twice = _nearest_layer(parts, cells)
    covered = np.bincount(parts.slave, parts.area * cells.radius[parts.slave] ** 2, len(cells.area))
    facets = len(slave)
    share = np.bincount(cells.facet, covered, facets) / np.bincount(cells.facet, cells.area, facets)
    doubled = np.zeros(facets, dtype=bool)
    doubled[cells.facet[twice]] = True
    return Segments(*_integrals(slave, master, cells, others, parts), share, doubled)


def _common_parts(cells: Cells, others: Cells, depth: float, reach: float) -> _Parts:
    tree = sphere_tree(others.centre, others.radius)
    one, other = tree.before(cells.centre, cells.radius, cells.frames[:, 2], depth, reach)
    cosine = np.einsum("ki,ki->k", cells.frames[one, 2], others.area_vector[other]) / others.area[other]
    one, other = one[cosine < _FACING], other[cosine < _FACING]
    window = cells.seen(np.arange(len(cells.area)), cells.corners)[:, :, :2]
    low, high = window.min(axis=1, initial=np.inf)[one], window.max(axis=1, initial=-np.inf)[one]
    subject = cells.seen(one, others.corners[other])
    meets = np.all(subject[:, :, :2].min(axis=1) < high, axis=1) & np.all(subject[:, :, :2].max(axis=1) > low, axis=1)
    one, other, subject = one[meets], other[meets], subject[meets]
    polygon, left = clipped(subject[:, ::-1, :2], window[one])
    one, other, subject = one[left], other[left], subject[left]
    area = areas(polygon)
    middle = polygon.mean(axis=1)
    n = np.einsum("kij,kj->ki", cells.frames[one], others.area_vector[other])
    away = subject.mean(axis=1)
    height = away[:, 2] - np.einsum("ki,ki->k", middle - away[:, :2], n[:, :2]) / n[:, 2]
    gap = height * cells.radius[one]
    found = _Parts(one, other, polygon, area, gap)
    return found.only((area > _SLIVER) & (gap > -depth) & (gap < reach))


def _nearest_layer(parts: _Parts, cells: Cells) -> tuple[_Parts, IntArray]:
    """Without the parts that are behind others, and the slave cells with such parts.

    Where the areas of a cell's parts are more than its own they overlap; then the nearest that make up its area stay.
    """
    scaled = cells.area / cells.radius**2
    total = np.bincount(parts.slave, parts.area, len(scaled))
    over = total > scaled * (1.0 + 1e-6)
    if not np.any(over):
        return parts, np.empty(0, dtype=np.int64)
    order = np.lexsort((np.abs(parts.gap), parts.slave))
    slave, area = parts.slave[order], parts.area[order]
    running = np.cumsum(area)
    first = np.searchsorted(slave, slave)
    running -= running[first] - area[first]
    keep = np.empty(len(order), dtype=bool)
    keep[order] = ~over[slave] | (running <= scaled[slave] * (1.0 + 1e-6))
    return parts.only(keep), np.unique(parts.slave[~keep])


def _integrals(
    slave: FacetPatch, master: FacetPatch, cells: Cells, others: Cells, parts: _Parts
) -> tuple[FloatArray, FloatArray, scipy.sparse.csr_matrix]:
    """`mass`, `normal` and `coupling` of `Segments`."""
    n, m = slave.kind.width, master.kind.width
    mass, normal = np.zeros((len(slave), n, n)), np.zeros((len(slave), n, 3))
    coupling = scipy.sparse.csr_matrix((len(slave) * n, master.size))
    rule = triangle_rule(_degree(slave, master))
    chunks = len(parts.slave) * (parts.polygon.shape[1] - 2) // _TRIANGLES + 1
    rows, columns, entries = [], [], []
    for at in np.array_split(np.arange(len(parts.slave)), chunks):
        if not len(at):
            continue
        part, triangle = _triangles(parts.polygon[at])
        one, other = parts.slave[at][part], parts.master[at][part]
        products = _products(slave, master, cells, others, one, other, triangle, rule)
        pair = np.flatnonzero(np.append(True, part[1:] != part[:-1]))
        products = np.add.reduceat(products, pair, axis=0)
        facet, opposite = cells.facet[one[pair]], others.facet[other[pair]]
        rows.append(np.repeat(facet[:, None] * n + np.arange(n), m, axis=1).ravel())
        columns.append(np.tile(master.nodes[opposite], (1, n)).ravel())
        entries.append(products[:, :, n : n + m].ravel())
        first = np.flatnonzero(np.append(True, facet[1:] != facet[:-1]))
        own = np.add.reduceat(np.concatenate([products[:, :, :n], products[:, :, n + m :]], axis=2), first, axis=0)
        mass[facet[first]] += own[:, :, :n]
        normal[facet[first]] += own[:, :, n:]
    if entries:
        triplets = np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))
        coupling = scipy.sparse.csr_matrix(triplets, shape=coupling.shape)
    return mass, normal, coupling


def _degree(slave: FacetPatch, master: FacetPatch) -> int:
    """Of the rule: exact for products of the functions of straight facets; more where the inverse maps are no
    polynomials."""
    own = slave.kind.polynomial_degree
    distortion = max(float(patch.distortion.max(initial=0.0)) for patch in (slave, master))
    return own + max(own, master.kind.polynomial_degree) + (0 if distortion < _STRAIGHT else 4)


def _triangles(polygon: FloatArray) -> tuple[IntArray, FloatArray]:
    """Triangles from the first corner of each polygon (p, v, 2): their polygons, and corners (t, 3, 2)."""
    ends = np.stack([polygon[:, 1:-1], polygon[:, 2:]], axis=2)
    part, number = np.nonzero(
        np.any(ends[:, :, 0] != ends[:, :, 1], axis=2) & np.any(ends[:, :, 1] != polygon[:, :1], axis=2)
    )
    return part, np.concatenate([polygon[part, :1], ends[part, number]], axis=1)


def _products(
    slave: FacetPatch,
    master: FacetPatch,
    cells: Cells,
    others: Cells,
    one: IntArray,
    other: IntArray,
    triangle: FloatArray,
    rule: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Integrals over triangles of each slave function times all slave functions, all master functions, and the
    outward normal, shape (t, n, n + m + 3)."""
    points, weights = rule
    edges = triangle[:, 1:] - triangle[:, :1]
    p = triangle[:, None, 0] + np.einsum("qa,tai->tqi", points, edges)
    doubled = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    facet, opposite = cells.facet[one], others.facet[other]
    values, tangents = _at_points(slave.kind, cells.seen(one, slave.x[facet]), p, cells.start[one])
    theirs, _ = _at_points(master.kind, cells.seen(one, master.x[opposite]), p, others.start[other])
    normal = np.cross(*tangents)  # in the frame of the cell: its third component is the area in the plane
    normal /= normal[:, :, 2:]
    length = np.linalg.norm(normal, axis=2)
    area = weights * doubled[:, None] * length * cells.radius[one][:, None] ** 2
    normal = np.einsum("tqj,tji->tqi", normal / length[:, :, None], cells.frames[one])
    product: FloatArray = np.swapaxes(values * area[:, :, None], 1, 2) @ np.concatenate(
        [values, theirs, normal], axis=2
    )
    return product


def _at_points(
    kind: FacetKind, x: FloatArray, p: FloatArray, start: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """The functions (t, q, n) of facets at the points that are projected to p, and their tangents, 2 (t, q, 3).

    Newton's method; x (t, n, 3) are the nodes, of which the third component is along the projection, p is (t, q, 2).
    """
    if kind.width == 3:
        return _in_triangles(x, p)
    r: FloatArray = np.broadcast_to(start[:, 0, None], p.shape[:2]).copy()
    s: FloatArray = np.broadcast_to(start[:, 1, None], p.shape[:2]).copy()
    for _ in range(_NEWTON_STEPS):
        at, along_r, along_s = _map(kind, x, r, s)
        dr, ds = _solved(along_r, along_s, p - at[:, :, :2])
        r, s = r + dr, s + ds
        if np.max(np.abs(dr), initial=0.0) + np.max(np.abs(ds), initial=0.0) < 1e-9:  # the next would be 1e-18
            break
    _, along_r, along_s = _map(kind, x, r, s)
    return np.stack(kind.values(r, s), axis=2), (along_r, along_s)


def _in_triangles(x: FloatArray, p: FloatArray) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """`_at_points` of straight triangles."""
    along_r, along_s = x[:, None, 1] - x[:, None, 0], x[:, None, 2] - x[:, None, 0]
    r, s = _solved(along_r, along_s, p - x[:, None, 0, :2])
    shape = (*p.shape[:2], 3)
    return np.stack([1.0 - r - s, r, s], axis=2), (np.broadcast_to(along_r, shape), np.broadcast_to(along_s, shape))


def _map(kind: FacetKind, x: FloatArray, r: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points and tangents of facets with nodes x (t, n, 3) at (t, q) reference points, each of shape (t, q, 3)."""
    values = np.stack(kind.values(r, s), axis=2)
    slopes = [np.stack([np.broadcast_to(slope, r.shape) for slope in along], axis=2) for along in kind.slopes(r, s)]
    return values @ x, slopes[0] @ x, slopes[1] @ x


def _solved(along_r: FloatArray, along_s: FloatArray, away: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solutions of the systems of two equations with these columns."""
    determinant = along_r[..., 0] * along_s[..., 1] - along_r[..., 1] * along_s[..., 0]
    r = (away[..., 0] * along_s[..., 1] - away[..., 1] * along_s[..., 0]) / determinant
    s = (along_r[..., 0] * away[..., 1] - along_r[..., 1] * away[..., 0]) / determinant
    return r, s
