"""The common parts of the facets of two faces.

Every slave facet, of second order each of its four pieces, has a plane through its corners' mean with their mean
normal n.  The master facets before it are projected along n into that plane and clipped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from .facet_patch import FacetPatch
from .sphere_tree import SphereTree, sphere_tree

# Intersections of convex polygons in a plane, many pairs at once (Sutherland and Hodgman 1974).
#
# Measured against shapely 2.2 (GEOS) on 400 000 pairs of random quadrilaterals: the same areas to 6e-16 in a sixth of
# the time; of quadrilaterals that coincide up to rounding errors shapely finds no area in five.

_ON_LINE: Final = 1e-12
"""Distance from a side, over the longest side, within which a corner is on it: else rounding errors of sides that
coincide, as of matching meshes, give polygons with more crossings than convex ones have."""

_PAIRS: Final = 20_000
"""Pairs clipped at once, so that the arrays stay in the cache."""


def clipped(subject: FloatArray, window: FloatArray) -> tuple[FloatArray, IntArray]:
    """The common parts, shape (k, a + b, 2), of those pairs of convex polygons that have one, and the numbers of these
    pairs, ascending: subjects (p, a, 2) of either orientation, windows (p, b, 2) counterclockwise.  A part with fewer
    corners ends with copies of its first one."""
    parts, pairs = [], []
    for chunk in np.array_split(np.arange(len(subject)), len(subject) // _PAIRS + 1):
        part, left = _clip(subject[chunk], window[chunk])
        parts.append(part)
        pairs.append(chunk[left])
    return np.concatenate(parts), np.concatenate(pairs)


def _clip(subject: FloatArray, window: FloatArray) -> tuple[FloatArray, IntArray]:
    x, y = subject[:, :, 0], subject[:, :, 1]
    around = np.roll(window, -1, axis=1) - window
    least = _ON_LINE * np.max(np.einsum("psi,psi->ps", around, around), axis=1, initial=0.0)
    left: IntArray = np.arange(len(subject))
    sides = window.shape[1]
    for side in range(sides):
        from_x, from_y = window[left, side].T[:, :, None]
        to_x, to_y = window[left, (side + 1) % sides].T[:, :, None]
        inside = (to_x - from_x) * (y - from_y) - (to_y - from_y) * (x - from_x)
        inside[np.abs(inside) <= least[left, None]] = 0.0
        some = np.any(inside > 0.0, axis=1)
        left, x, y, inside = left[some], x[some], y[some], inside[some]
        x, y = _cut_by_lines(x, y, inside)
    return np.stack([x, y], axis=2), left


def _cut_by_lines(x: FloatArray, y: FloatArray, inside: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Polygons cut by lines; `inside` is positive at corners that are kept.  The result has one more column."""
    kept = inside >= 0.0
    crossing = kept != np.roll(kept, -1, axis=1)
    there = np.roll(inside, -1, axis=1)
    share = inside / np.where(crossing, inside - there, 1.0)
    cut_x, cut_y = x + share * (np.roll(x, -1, axis=1) - x), y + share * (np.roll(y, -1, axis=1) - y)
    emitted = kept.astype(np.int64) + crossing
    last = np.cumsum(emitted, axis=1)
    width = x.shape[1] + 1
    new = np.full((2, len(x), width), np.nan)
    for values, wanted, place in (
        (np.stack([x, y]), kept, last - emitted),
        (np.stack([cut_x, cut_y]), crossing, last - 1),
    ):
        row, column = np.nonzero(wanted & (place < width))
        new[:, row, place[row, column]] = values[:, row, column]
    copies = np.isnan(new[0])
    first = np.broadcast_to(new[:, :, :1], new.shape)
    new[:, copies] = first[:, copies]
    return new[0], new[1]


def areas(polygons: FloatArray) -> FloatArray:
    """Areas of polygons (p, n, 2), positive if counterclockwise, shape (p,)."""
    x, y = np.moveaxis(polygons - polygons[:, :1], 2, 0)
    doubled: FloatArray = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    return 0.5 * doubled


FACING: Final = -0.2
"""Largest product of the normals of two facets that are paired: they differ from opposite by less than 78 degrees."""

_CELLS: Final = 20_000
"""Slave cells treated at once, so that memory stays small."""

_SLIVER: Final = 1e-13
"""Share of a facet's area below which a common part is a rounding error."""


@dataclass(frozen=True, eq=False)
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
        return self.corners.mean(axis=1)

    @cached_property
    def radius(self) -> FloatArray:
        """Distance of the farthest corner from the centre, shape (c,)."""
        away = np.linalg.norm(self.corners - self.centre[:, None], axis=2)
        return away.max(axis=1, initial=0.0)

    @cached_property
    def area_vector(self) -> FloatArray:
        """Mean outward normal times the area in its plane, shape (c, 3)."""
        x = self.corners
        return 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])

    @cached_property
    def area(self) -> FloatArray:
        return np.linalg.norm(self.area_vector, axis=1)

    @cached_property
    def frames(self) -> FloatArray:
        """Rows e1, e2, n with n the mean outward normal, right-handed, shape (c, 3, 3)."""
        n = self.area_vector / self.area[:, None]
        e1 = self.corners[:, 1] - self.corners[:, 0]
        e1 = e1 - np.einsum("ki,ki->k", e1, n)[:, None] * n
        e1 /= np.linalg.norm(e1, axis=1)[:, None]
        return np.stack([e1, np.cross(n, e1), n], axis=1)

    @cached_property
    def tree(self) -> SphereTree:
        """Of at least one cell."""
        return sphere_tree(self.centre, self.radius)

    def seen(self, cell: IntArray, x: FloatArray) -> FloatArray:
        """Points x (k, n, 3) in the frames of cells (k,), from their centres over their radii: lengths 1, (k, n, 3)."""
        away = (x - self.centre[cell][:, None]) / self.radius[cell][:, None, None]
        return np.einsum("kni,kji->knj", away, self.frames[cell])


def cells_of(patch: FacetPatch) -> Cells:
    """The facets if all of them are straight; else the pieces of all."""
    kind = patch.kind
    if patch.straight or kind.degree == 1:
        pieces = np.arange(kind.corners)[None]
    else:
        pieces = kind.pieces
    start = kind.points[pieces].mean(axis=1)
    return Cells(
        np.repeat(np.arange(len(patch)), len(pieces)),
        patch.x[:, pieces].reshape(-1, kind.corners, 3),
        np.tile(start, (len(patch), 1)),
    )


@dataclass(frozen=True, eq=False)
class Parts:
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

    def only(self, which: BoolArray) -> Parts:
        return Parts(self.slave[which], self.master[which], self.polygon[which], self.area[which], self.gap[which])


def common_parts(cells: Cells, others: Cells, depth: float, reach: float) -> Parts:
    """The common parts of all slave cells with the master cells up to `depth` behind them and `reach` before them,
    metres."""
    chunks = np.array_split(np.arange(len(cells.facet)), len(cells.facet) // _CELLS + 1)
    found = [_parts_of(chunk, cells, others, depth, reach) for chunk in chunks]
    return Parts(*(np.concatenate([getattr(part, field.name) for part in found]) for field in fields(Parts)))


def _parts_of(chunk: IntArray, cells: Cells, others: Cells, depth: float, reach: float) -> Parts:
    line, other = others.tree.before(cells.centre[chunk], cells.radius[chunk], cells.frames[chunk, 2], depth, reach)
    one = chunk[line]
    cosine = np.einsum("ki,ki->k", cells.frames[one, 2], others.area_vector[other]) / others.area[other]
    line, one, other = (values[cosine < FACING] for values in (line, one, other))
    window = cells.seen(chunk, cells.corners[chunk])[:, :, :2]
    low, high = window.min(axis=1, initial=np.inf)[line], window.max(axis=1, initial=-np.inf)[line]
    subject = cells.seen(one, others.corners[other])
    meets = np.all(subject[:, :, :2].min(axis=1) < high, axis=1) & np.all(subject[:, :, :2].max(axis=1) > low, axis=1)
    line, one, other, subject = line[meets], one[meets], other[meets], subject[meets]
    polygon, left = clipped(subject[:, ::-1, :2], window[line])
    one, other, subject = one[left], other[left], subject[left]
    area, middle = areas(polygon), polygon.mean(axis=1)
    n = np.einsum("kij,kj->ki", cells.frames[one], others.area_vector[other])
    away = subject.mean(axis=1)
    height = away[:, 2] - np.einsum("ki,ki->k", middle - away[:, :2], n[:, :2]) / n[:, 2]
    gap = height * cells.radius[one]
    return Parts(one, other, polygon, area, gap).only((area > _SLIVER) & (gap > -depth) & (gap < reach))


def nearest_layer(parts: Parts, cells: Cells) -> tuple[Parts, IntArray]:
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


PROBES: Final = 0.8137
"""Way from the middle of a facet, of second order of its pieces, to the corners of the points before which the nearest
part and slopes count: where edges of structured meshes do not meet."""

LEVEL: Final = 0.1
STEP: Final = 2.5
"""How much distances may differ around a facet before it is a step: a part of the width of a facet, which is a strain
for which a step would close, and a multiple of what its extent along the slope times `_slopes` is."""

NEAR: Final = 4.0
"""Widths of a facet within which the nearest part must be for others to be beyond a step: lines of curved faces that
are far apart diverge."""


Most: TypeAlias = Callable[[FloatArray], FloatArray]
"""The largest of all ranks of values (nodes of the master, d) on this rank; collective."""


def nearest_sheets(
    parts: Parts, cells: Cells, others: Cells, slave: FacetPatch, master: FacetPatch, most: Most | None = None
) -> Parts:
    """Without the parts beyond a step: farther from a facet of either face than the nearest part before a point of it
    or of the facets beside it (`PROBES`), by more than `LEVEL` and `STEP` explain; distances along its own normal.
    With `most` collective.

    The mean of distances on both sides of the edge of a step would let the edge into the slave; and teeth of a slave
    beside those that are in the grooves of the master are not opposite to these.
    """
    width, other_width = (LEVEL * 2.0 * of.areas / of.diameters for of in (slave, master))
    away = np.abs(parts.gap)
    if most is None and (not len(away) or np.ptp(away) <= min(np.min(width), np.min(other_width))):
        return parts
    n, m = cells.frames[parts.slave, 2], others.area_vector[parts.master] / others.area[parts.master][:, None]
    cosine = np.einsum("pi,pi->p", n, m)[:, None]
    facet, heights = cells.facet[parts.slave], away * np.abs(cosine[:, 0])
    seen = _before_points(parts, cells, slave, facet)
    least, farthest = _levels(slave, facet, away, _slopes((m - cosine * n) / cosine**2), width, seen)
    level = (away >= least) & (away <= farthest)
    facet = others.facet[parts.master]
    seen, slope = _before_points(parts, cells, master, facet), _slopes((n - cosine * m) / cosine**2)
    return parts.only(level & (heights <= _levels(master, facet, heights, slope, other_width, seen, most)[1]))


def _slopes(vectors: FloatArray) -> FloatArray:
    """Vectors (p, 3) along the slope, of the length s = sin t/cos^2 t of the angle t between both faces, times
    1 + (s/3)^4: beyond 60 degrees, as of a ball beside its pole, all is a slope."""
    return vectors * (1.0 + (np.linalg.norm(vectors, axis=1)[:, None] / 3.0) ** 4)


def _before_points(parts: Parts, cells: Cells, face: FacetPatch, facet: IntArray) -> BoolArray:
    """Whether the parts have a point (`PROBES`) of one of these facets (p,), shape (p,)."""
    corners = face.x[:, face.kind.pieces]
    middle = corners.mean(axis=2, keepdims=True)
    probes = (middle + PROBES * (corners - middle)).reshape(len(face), -1, 3)
    points = cells.seen(parts.slave, probes[facet])[:, :, None, :2]
    start, end = parts.polygon[:, None], np.roll(parts.polygon, -1, axis=1)[:, None]
    along, to = end - start, points - start
    inside = along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0] >= 0.0
    return np.any(np.all(inside, axis=2), axis=1)


def _levels(
    face: FacetPatch,
    facet: IntArray,
    away: FloatArray,
    slope: FloatArray,
    width: FloatArray,
    seen: BoolArray,
    most: Most | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Distances (p,) between which parts on some facets (p,) are on the level of the nearest around them, by those of
    the parts (p,) and slopes (p, 3): not beyond a step of the nearest that are `seen`, and no slivers before one."""
    values = np.column_stack([width, np.zeros(len(face)), np.full(len(face), -np.inf)])
    rises = np.ptp(np.einsum("pni,pi->pn", face.x[facet], slope), axis=1)
    np.maximum.at(values[:, 1], facet[seen], rises[seen])
    np.maximum.at(values[:, 2], facet[seen], -away[seen])
    at_nodes: FloatArray = np.full((face.size, 3), -np.inf)  # the largest around each
    np.maximum.at(at_nodes, face.nodes, values[:, None])
    at_nodes = at_nodes if most is None else most(at_nodes)
    around = np.max(at_nodes[face.nodes], axis=1)
    near = -LEVEL * around[:, 2] <= NEAR * around[:, 0]
    farthest = np.where(near, around[:, 0] + STEP * around[:, 1] - around[:, 2], np.inf)
    own = -values[:, 2]
    nearest = np.where(-LEVEL * values[:, 2] <= NEAR * values[:, 0], own - values[:, 0] - STEP * values[:, 1], 0.0)
    return nearest[facet] - STEP * rises, farthest[facet] + STEP * rises
