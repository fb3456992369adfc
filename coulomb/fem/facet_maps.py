"""Inverse maps of facets: the reference points, and there the functions, of places in a plane."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import FloatArray
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
    steps = _bilinear(x) if kind.width == 4 else _general(kind, x)
    r, s = (np.broadcast_to(start[:, i, None], p.shape[:2]).copy() for i in (0, 1))
    for _ in range(_NEWTON_STEPS):
        at, along_r, along_s = steps(r, s)
        dr, ds = _solved(along_r, along_s, p[:, :, 0] - at[0], p[:, :, 1] - at[1])
        r, s = r + dr, s + ds
        if max(np.max(np.abs(dr), initial=0.0), np.max(np.abs(ds), initial=0.0)) < _SETTLED:
            break
    else:
        raise ValueError("a facet is folded or so distorted that places in it cannot be found; use a better mesh")
    slopes = [np.stack([np.broadcast_to(slope, r.shape) for slope in along], axis=2) for along in kind.slopes(r, s)]
    return np.stack(kind.values(r, s), axis=2), np.cross(slopes[0] @ x, slopes[1] @ x)


_Components = tuple[FloatArray, FloatArray]
_Step = Callable[[FloatArray, FloatArray], tuple[_Components, _Components, _Components]]


def _bilinear(x: FloatArray) -> _Step:
    """Places and tangents in the plane, by components (t, q), of quadrilaterals with corners x (t, 4, 3)."""
    plane = x[:, :, :2]
    origin, by_r, by_s = plane[:, 0], plane[:, 1] - plane[:, 0], plane[:, 3] - plane[:, 0]
    mixed = plane[:, 0] - plane[:, 1] + plane[:, 2] - plane[:, 3]
    parts = [(origin[:, i, None], by_r[:, i, None], by_s[:, i, None], mixed[:, i, None]) for i in (0, 1)]

    def step(r: FloatArray, s: FloatArray) -> tuple[_Components, _Components, _Components]:
        along_r, along_s = [b + d * s for _, b, _, d in parts], [c + d * r for _, _, c, d in parts]
        at = [a + r * along + c * s for (a, _, c, _), along in zip(parts, along_r, strict=True)]
        return (at[0], at[1]), (along_r[0], along_r[1]), (along_s[0], along_s[1])

    return step


def _general(kind: FacetKind, x: FloatArray) -> _Step:
    """The same of any facets with nodes x (t, n, 3)."""
    plane = np.ascontiguousarray(x[:, :, :2])

    def combined(functions: list[FloatArray]) -> _Components:
        at = np.stack(functions, axis=2) @ plane
        return at[:, :, 0], at[:, :, 1]

    def step(r: FloatArray, s: FloatArray) -> tuple[_Components, _Components, _Components]:
        along = [[np.broadcast_to(slope, r.shape) for slope in slopes] for slopes in kind.slopes(r, s)]
        return combined(kind.values(r, s)), combined(along[0]), combined(along[1])

    return step


def _solved(along_r: _Components, along_s: _Components, x: FloatArray, y: FloatArray) -> _Components:
    """Solutions of the systems of two equations with these columns."""
    scale = 1.0 / (along_r[0] * along_s[1] - along_r[1] * along_s[0])
    return (x * along_s[1] - y * along_s[0]) * scale, (along_r[0] * y - along_r[1] * x) * scale
