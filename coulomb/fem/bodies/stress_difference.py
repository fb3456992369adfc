"""By how much the stresses of two answers on different meshes of a body differ, in the energy norm:

    d^2 = integral over the cells of one mesh of (s - s') : C^-1 : (s - s'),    s - s' = C (e(u) - e(u'))

The strain e(u') of the other answer is taken at the integration points, in whichever of its cells they are, so that
neither mesh need contain the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...arrays import FloatArray, IntArray
from ...nearest import tree_of
from ..meshes import lagrange_slopes, lagrange_values
from .materials import PAIRS
from .recovery import StressedCells

_AT_ONCE: Final = 20_000
"""Points at a time, so that little memory is needed: some 2 kB for each."""

_NEAREST: Final = 8
"""Cells whose middles are nearest to a point that are tried first: of well-shaped cells one of them has it."""

_NEWTON_STEPS: Final = 8

_INSIDE: Final = 1e-6
"""Reference coordinates outside the reference cell by less are inside it."""

_OUTSIDE: Final = 0.5
"""How far outside the reference cell the strain is extrapolated, where a curved boundary is outside the other mesh."""


@dataclass(frozen=True)
class StressDifference:
    """Of two answers for a body.

    Attributes:
        squared: d^2 in joules, twice the strain energy of the difference.
        cells: Number of cells over which it was integrated.
        across: Number of those that are in several cells of the other mesh; 0 if that is the coarser one of a mesh that
            was refined.
    """

    squared: float
    cells: int
    across: int


def stress_difference(cells: StressedCells, other: StressedCells) -> StressDifference:
    """The difference, integrated over the `cells`; collective.

    Both are without a temperature: a thermal strain is the same in both.  The other answer, best that on larger cells,
    is copied to all ranks.
    """
    X, weights = cells.integration(of_slopes=True)
    other_answer = _OtherAnswer(other)
    sums, at_once = np.zeros(3), max(_AT_ONCE // len(X), 1)
    for first in range(0, cells.count, at_once):
        part = np.arange(first, min(first + at_once, cells.count))
        terms, stress, volume = cells.at(part, X)
        x = terms[..., 1:4] + cells.origins(part)[:, None]
        of_points, strain = other_answer.strain(x)
        density = cells.energy(part, stress - cells.hooke(part, strain.reshape(stress.shape)))
        across = np.ptp(of_points, axis=1) > 0
        sums += np.sum(density * volume * weights), len(part), np.sum(across)
    squared, count, across = cells.comm.allreduce(sums)
    return StressDifference(float(squared), int(count), int(across))


class _OtherAnswer:
    """All cells of an answer on every rank, with places and displacements of their nodes; collective."""

    def __init__(self, cells: StressedCells):
        x, u = cells.nodal()
        self._kind = cells.kind
        self._x, self._u = (np.concatenate(cells.comm.allgather(of)) for of in (x, u))
        self._simplex, self._order = x.shape[1] in (4, 10), 1 if x.shape[1] in (4, 8) else 2
        low, high = self._x.min(axis=1), self._x.max(axis=1)
        margin = (1e-6 if self._order == 1 else 0.1) * np.max(high - low, axis=1, keepdims=True)
        self._low, self._high = low - margin, high + margin
        self._middle = np.full((1, 3), 0.25 if self._simplex else 0.5)
        self._centre = np.einsum("n,cni->ci", lagrange_values(self._kind, self._order, self._middle)[0], self._x)
        self._inverse = np.linalg.inv(self._slopes(self._middle, self._order) @ self._x)

    def strain(self, x: FloatArray) -> tuple[IntArray, FloatArray]:
        """Of points (c, q, 3), of which q are near each other, the cells, shape (c, q), and the strains there, shape
        (c q, 6) in the order of `PAIRS`."""
        cell, X = self._containing(x)
        jacobian = self._slopes(X, self._order) @ self._x[cell]
        degree = 1 if self._u.shape[1] in (4, 8) else 2
        gradient = np.linalg.inv(jacobian) @ (self._slopes(X, degree) @ self._u[cell])
        strain: FloatArray = np.stack([gradient[:, i, j] + (i != j) * gradient[:, j, i] for i, j in PAIRS], axis=1)
        return cell.reshape(x.shape[:2]), strain

    def _containing(self, x: FloatArray) -> tuple[IntArray, FloatArray]:
        """The cell of each point, and its reference coordinates there: most are in the cell of their mean."""
        points = x.reshape(-1, 3)
        cell = np.repeat(self._found(x.mean(axis=1))[0], x.shape[1])
        X, outside = self._local(cell, points)
        others = np.flatnonzero(outside > _INSIDE)
        if len(others):
            cell[others], X[others] = self._found(points[others])
        return cell, X

    def _found(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """The cell of each point (p, 3), and its reference coordinates; of points outside all, a cell nearby."""
        every, few = np.arange(len(points)), min(_NEAREST, len(self._centre))
        nearest = np.asarray(tree_of(self._centre).query(points, few)[1], dtype=np.int64).reshape(-1, few)
        cell, X, outside = self._best(points, np.repeat(every, few), nearest.ravel())
        left = every[outside > _INSIDE]
        if len(left):
            known, places, beyond = self._best(points[left], *self._near(points[left]))
            better = beyond < outside[left]
            cell[left[better]], X[left[better]], outside[left[better]] = known[better], places[better], beyond[better]
        alone = every[np.isinf(outside)]
        cell[alone] = nearest[alone, 0]
        X[alone] = self._estimated(cell[alone], points[alone])[0]
        return cell, X

    def _best(self, points: FloatArray, point: IntArray, cell: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Of pairs of a point and a cell, for every point the cell that it is inside or least outside of, its reference
        coordinates, and how far outside, inf where it is far from all of its cells."""
        close = self._estimated(cell, points[point])[1] < 0.9 * _OUTSIDE
        point, cell = point[close], cell[close]
        X, outside = self._local(cell, points[point])
        order = np.lexsort([outside, point])
        known, first = np.unique(point[order], return_index=True)
        best = order[first]
        cells, places = np.zeros(len(points), dtype=np.int64), np.zeros(points.shape)
        beyond = np.full(len(points), np.inf)
        cells[known], places[known], beyond[known] = cell[best], X[best], outside[best]
        return cells, places, beyond

    def _near(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        """Pairs of a point and a cell whose bounding box has it.

        Each coordinate is replaced by its rank among those of the boxes, so that graded and flat cells become about
        cubes, whose surroundings a k-d tree finds; what is in a box remains so.
        """
        some = np.flatnonzero(np.all((self._low <= points.max(axis=0)) & (self._high >= points.min(axis=0)), axis=1))
        if not len(some):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        ends = np.stack([self._low[some], self._high[some]])
        moved = np.empty_like(points)
        for axis in range(3):
            knots = np.unique(ends[:, :, axis])
            ranks = np.arange(float(len(knots)))
            moved[:, axis] = np.interp(points[:, axis], knots, ranks)
            ends[:, :, axis] = np.interp(ends[:, :, axis], knots, ranks)
        low, high = ends
        near = tree_of(moved).query_ball_point(0.5 * (low + high), 0.5 * np.max(high - low, axis=1) + 1e-9, p=np.inf)
        cell = np.repeat(some, [len(of) for of in near])
        point = np.concatenate([np.asarray(of, dtype=np.int64) for of in near])
        inside = np.all((self._low[cell] <= points[point]) & (points[point] <= self._high[cell]), axis=1)
        return point[inside], cell[inside]

    def _estimated(self, cell: IntArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Reference coordinates (p, 3) by the slopes in the middle of the cell, and how far they are outside, (p,)."""
        X = self._middle + np.einsum("pi,pij->pj", points - self._centre[cell], self._inverse[cell])
        return self._bounded(X)

    def _local(self, cell: IntArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same exactly, by Newton's method."""
        X, outside = self._estimated(cell, points)
        if self._simplex and self._order == 1:
            return X, outside
        left = np.arange(len(points))
        for _ in range(_NEWTON_STEPS):
            nodes = self._x[cell[left]]
            places = np.einsum("pn,pni->pi", lagrange_values(self._kind, self._order, X[left]), nodes)
            residual = points[left] - places
            off = np.max(np.abs(residual), axis=1) >= 1e-9 * np.max(np.abs(nodes), axis=(1, 2))
            if not np.any(off):
                break
            left, nodes, residual = left[off], nodes[off], residual[off]
            inverse = np.linalg.inv(self._slopes(X[left], self._order) @ nodes)
            X[left], outside[left] = self._bounded(X[left] + np.einsum("pi,pij->pj", residual, inverse))
        return X, outside

    def _bounded(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Near the cell, and how far outside."""
        X = np.clip(X, -_OUTSIDE, 1.0 + _OUTSIDE)
        beyond = 1.0 - X.sum(axis=1) if self._simplex else np.min(1.0 - X, axis=1)
        return X, np.maximum(-np.minimum(X.min(axis=1), beyond), 0.0)

    def _slopes(self, X: FloatArray, degree: int) -> FloatArray:
        """Of the Lagrange functions, shape (p, 3, functions), or (1, 3, 4) where they are the same everywhere."""
        same = self._simplex and degree == 1
        return lagrange_slopes(self._kind, degree, X[:1] if same else X).swapaxes(0, 1)
