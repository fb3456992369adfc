"""Inverse maps of facets: the reference points, and there the functions, of places in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...arrays import FloatArray
from .facet_functions import FacetKind

_NEWTON_STEPS = 30

_SETTLED = 1e-8
"""Newton step in the reference facet after which the error is the square of it."""


def at_points(
    kind: FacetKind, x: FloatArray, p: FloatArray, start: FloatArray, straight: bool
) -> tuple[FloatArray, FloatArray]:
    """The functions of facets at the points that are projected to places in a plane, and their area vectors there.

    Args:
        kind: Of the facets.
        x: Their nodes, the third component along the projection, shape (t, n, 3).
        p: The places, shape (t, q, 2).
        start: Reference points near them, shape (t, 2).
        straight: Whether the maps of all facets are affine.

    Returns:
        The functions, shape (t, q, n), and normals with the length area over reference area, shape (t, q or 1, 3).

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
