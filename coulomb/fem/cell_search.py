"""Points in the cells of a mesh, found by Newton's method for all candidates of the bounding boxes at once.  DOLFINx's
`pull_back` ends with steps of 1e-6, and raises where it does not converge.
"""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any, Final, NamedTuple

import numpy as np

from ..arrays import FloatArray, Int32Array, IntArray
from . import compat
from .compat import basix, geometry

SNAP: Final = 0.05
"""How far outside a cell, in its reference coordinates, a point has its values: other meshes have other chords of a
curved surface."""

ROUNDING: Final = 1e-9
"""How far outside a cell a point is still in it."""

_BEYOND: Final = 0.2
"""Part of its extent by which a curved cell may reach beyond its nodes."""

_STEPS: Final = 20
_AT_ONCE: Final = 5_000
"""Newton steps, and points that are located at a time, so that little memory is needed."""

NEWER: Final = hasattr(geometry, "bb_tree")
"""Whether DOLFINx is 0.7 or newer."""

SIMPLICES: Final = ("interval", "triangle", "tetrahedron")


class Near(NamedTuple):
    """Points and own cells that have them, or nearly: numbers of both, the reference coordinates, and how far outside
    the cell these are, shapes (p,), (p,), (p, d), (p,)."""

    point: IntArray
    cell: Int32Array
    X: FloatArray
    outside: FloatArray


class CellSearch:
    """The cells of a mesh that this rank owns: simplices, quadrilaterals or hexahedra."""

    def __init__(self, domain: Any):
        kind, degree = domain.topology.cell_type.name, int(compat.coordinate_element(domain).degree)
        self._mesh, self._simplex, self._curved = domain, kind in SIMPLICES, degree > 1
        self._element = lagrange(kind, degree)

    def near(self, x: FloatArray) -> Near:
        """The points x (k, 3) in this rank's own cells, and beside them by `SNAP` at most."""
        parts = [
            self._in_boxes(x[first : first + _AT_ONCE], first)
            for first in (range(0, len(x), _AT_ONCE) if self._tree is not None else ())
        ]
        nothing = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int32), np.empty((0, 3)), np.empty(0)
        return Near(*map(np.concatenate, zip(*parts, strict=True))) if parts else Near(*nothing)

    @cached_property
    def _tree(self) -> Any:
        rows, x = compat.cell_geometry(self._mesh), self._mesh.geometry.x
        own = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        if not own:
            return None
        extent = float(np.max(np.ptp(x[rows[:own]], axis=1)))
        return boxes(self._mesh, own, (_BEYOND if self._curved else SNAP) * extent)

    def _in_boxes(self, x: FloatArray, first: int) -> Near:
        """Of points x (k, 3), whose numbers begin with `first`."""
        cell, offsets = _cells_near(self._tree, x)
        point = np.repeat(np.arange(len(x)), np.diff(offsets))
        X, outside = self.reference(cell, x[point])
        here = outside <= SNAP
        return Near(first + point[here], cell[here], X[here], outside[here])

    def reference(self, cell: Int32Array, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Reference coordinates of points x (p, 3) in cells (p,), shape (p, d), and how far outside these are (p,)."""
        nodes = self._mesh.geometry.x[compat.cell_geometry(self._mesh)[cell]]
        size = np.max(np.ptp(nodes, axis=1), axis=1, initial=0.0)
        X = np.full((len(x), self._mesh.topology.dim), 0.25 if self._simplex else 0.5)
        off = np.zeros(len(x))
        going = np.arange(len(x))
        if not len(x):  # Basix tabulates no empty set of points
            return X, off
        for _ in range(_STEPS):
            table = self._element.tabulate(1, X[going])[..., 0]
            residual = x[going] - np.einsum("pn,pni->pi", table[0], nodes[going])
            off[going] = np.max(np.abs(residual), axis=1, initial=0.0) / size[going]
            more = off[going] > 1e-14
            going, residual = going[more], residual[more]
            if not len(going):
                break
            slopes = np.einsum("dpn,pni->pid", table[1:, more], nodes[going])
            X[going] = np.clip(X[going] + _solved(slopes, residual), -2.0, 3.0)
        beyond = (np.sum(X, axis=1) if self._simplex else np.max(X, axis=1, initial=0.0)) - 1.0
        return X, np.maximum(np.maximum(-np.min(X, axis=1, initial=1.0), beyond), np.where(off > ROUNDING, off, 0.0))


def boxes(domain: Any, count: int, padding: float = 0.0) -> Any:
    """The tree of the boxes around the first cells of this rank."""
    cells = np.arange(count, dtype=np.int32)
    if NEWER:
        return geometry.bb_tree(domain, domain.topology.dim, entities=cells, padding=padding)
    return geometry.BoundingBoxTree(domain, domain.topology.dim, cells, padding)


def _cells_near(boxes: Any, x: FloatArray) -> tuple[Int32Array, Int32Array]:
    """The cells whose boxes have the points x (k, 3), one point after the other, and where those of each begin."""
    find = geometry.compute_collisions_points if NEWER else geometry.compute_collisions
    near = find(boxes, np.ascontiguousarray(x))
    return near.array, near.offsets


def _solved(slopes: FloatArray, residual: FloatArray) -> FloatArray:
    """Newton's steps, shape (p, d), by derivatives (p, 3, d) along the reference coordinates."""
    if slopes.shape[2] == 3:
        try:
            return np.linalg.solve(slopes, residual[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:  # a point far outside a distorted cell
            pass
    return np.einsum("pdi,pi->pd", np.linalg.pinv(slopes), residual)


@cache
def lagrange(kind: str, degree: int) -> Any:
    """Basix's element of DOLFINx's "Lagrange" on a cell."""
    variant = basix.LagrangeVariant.equispaced if degree < 3 else basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, getattr(basix.CellType, kind), degree, variant)
