"""Lagrange functions of facets, triangles and quadrilaterals of first and second order, with nodes in VTK's order.

Written out, since pairing two surfaces evaluates them at millions of points, other ones in every facet.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ..compat import basix

_NEWTON_STEPS = 30

_SETTLED = 1e-8
"""Newton step in the reference facet after which the error is the square of it."""


def at_points(
    kind: FacetKind, x: FloatArray, p: FloatArray, start: FloatArray, straight: bool
) -> tuple[FloatArray, FloatArray]:
    """The functions of facets at the points that are projected to places in a plane, shape (t, q, n), and normals there
    with the length area over reference area, shape (t, q or 1, 3).

    Args:
        kind: Of the facets.
        x: Their nodes, the third component along the projection, shape (t, n, 3).
        p: The places, shape (t, q, 2).
        start: Reference points near them, shape (t, 2).
        straight: Whether the maps of all facets are affine.

    Raises:
        ValueError: If a facet is so distorted that Newton's method fails.
    """
    if straight:
        edges = x[:, [1, 2 if kind.corners == 3 else 3]] - x[:, :1]
        r, s = _solved(*np.moveaxis(edges[:, :, None, :2], (1, 3), (0, 1)), *np.moveaxis(p - x[:, None, 0, :2], 2, 0))
        return np.stack(kind.values(r, s), axis=2), np.cross(edges[:, :1], edges[:, 1:])
    r, s = _in_quadrilaterals(x, p) if kind.width == 4 else _by_newton(kind, x, p, start)
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(s))):
        raise ValueError("a facet is folded or so distorted that places in it cannot be found; use a better mesh")
    slopes = [np.stack([np.broadcast_to(slope, r.shape) for slope in along], axis=2) for along in kind.slopes(r, s)]
    return np.stack(kind.values(r, s), axis=2), np.cross(slopes[0] @ x, slopes[1] @ x)


_Components = tuple[FloatArray, FloatArray]


def _in_quadrilaterals(x: FloatArray, p: FloatArray) -> _Components:
    """Reference points of bilinear facets: of places a + b r + c s + d r s; their product with c + d r is a quadratic
    equation of r."""
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


def _by_newton(kind: FacetKind, x: FloatArray, p: FloatArray, start: FloatArray) -> _Components:
    """The same of any facets with nodes x (t, n, 3); nan if Newton's method fails."""
    plane = np.ascontiguousarray(x[:, :, :2])
    r, s = (np.broadcast_to(start[:, i, None], p.shape[:2]).copy() for i in (0, 1))

    def combined(functions: Sequence[Any]) -> _Components:
        at = np.stack([np.broadcast_to(values, r.shape) for values in functions], axis=2) @ plane
        return at[:, :, 0], at[:, :, 1]

    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            at, (along_r, along_s) = combined(kind.values(r, s)), map(combined, kind.slopes(r, s))
            dr, ds = _solved(along_r, along_s, p[:, :, 0] - at[0], p[:, :, 1] - at[1])
            r, s = r + dr, s + ds
            if max(np.max(np.abs(dr), initial=0.0), np.max(np.abs(ds), initial=0.0)) < _SETTLED:
                return r, s
    return np.full_like(r, np.nan), s


def _solved(along_r: _Components, along_s: _Components, x: FloatArray, y: FloatArray) -> _Components:
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
    def pieces(self) -> npt.NDArray[np.int64]:
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
