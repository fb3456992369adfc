"""The common parts of the facets of two faces.

Every slave facet, of second order each of its four pieces, has a plane through its corners' mean with their mean
normal n.  The master facets before it are projected along n into that plane and clipped.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, IntArray
from .facet_patch import FacetPatch
from .facet_search import SphereTree, sphere_tree
from .polygon_clipping import areas, clipped

FACING = -0.2
"""Largest product of the normals of two facets that are paired: they differ from opposite by less than 78 degrees."""

_CELLS = 20_000
"""Slave cells treated at once, so that memory stays small."""

_SLIVER = 1e-13
"""Share of a facet's area below which a common part is a rounding error."""


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


@dataclass(frozen=True)
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

    def only(self, which: npt.NDArray[np.bool_]) -> Parts:
        return Parts(self.slave[which], self.master[which], self.polygon[which], self.area[which], self.gap[which])


def common_parts(cells: Cells, others: Cells, depth: float, reach: float) -> Parts:
    """The common parts of all slave cells with the master cells behind them by up to `depth`, before them by up to
    `reach`, in metres."""
    tree = sphere_tree(others.centre, others.radius)
    chunks = np.array_split(np.arange(len(cells.facet)), len(cells.facet) // _CELLS + 1)
    found = [_parts_of(at, cells, others, tree, depth, reach) for at in chunks]
    return Parts(*(np.concatenate([getattr(part, field.name) for part in found]) for field in fields(Parts)))


def _parts_of(at: IntArray, cells: Cells, others: Cells, tree: SphereTree, depth: float, reach: float) -> Parts:
    """Those of some slave cells, ascending."""
    line, other = tree.before(cells.centre[at], cells.radius[at], cells.frames[at, 2], depth, reach)
    one = at[line]
    cosine = np.einsum("ki,ki->k", cells.frames[one, 2], others.area_vector[other]) / others.area[other]
    line, one, other = (values[cosine < FACING] for values in (line, one, other))
    window = cells.seen(at, cells.corners[at])[:, :, :2]
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
