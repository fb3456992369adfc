"""A rigid surface of triangles, as of a tool in an STL file, by its signed distance.

The nearest point of the surface is on a triangle, an edge or a corner.  The sign is that of the distance along the
normal there: on edges and at corners the sum of the normals of the triangles around, at corners weighted by the angles
(J. A. Baerentzen, H. Aanaes: Signed distance computation using the angle weighted pseudonormal, IEEE Trans. Vis.
Comput. Graph. 11, 2005).
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...arrays import FloatArray, IntArray
from ...nearest import tree_of

_NEAR: Final = 24
"""Triangles whose middles are nearest, among which the nearest point is looked for first."""

_SAME: Final = 1e-9
"""Distance over the size of the surface up to which corners of triangles are one point."""


class Triangles:
    """Distances and normals of a surface of triangles with corners x (t, 3, 3) in metres, right-handed about the normal
    out of the solid.

    Raises:
        ValueError: If there are no triangles, or the surface has an edge with one triangle, where inside and outside
            are not told apart.
    """

    def __init__(self, x: FloatArray, what: str):
        size = float(np.ptp(x.reshape(-1, 3), axis=0).max()) if len(x) else 0.0
        if not (size > 0.0 and np.all(np.isfinite(x))):
            raise ValueError(f"{what} has no triangles, or coordinates that are not finite")
        whole = np.round(x.reshape(-1, 3) / (_SAME * size)).astype(np.int64)
        _, first, number = np.unique(whole, axis=0, return_index=True, return_inverse=True)
        corners: IntArray = number.reshape(-1, 3).astype(np.int64)
        corners = corners[np.all(corners != np.roll(corners, 1, axis=1), axis=1)]
        self._x = x.reshape(-1, 3)[first][corners]
        cross = np.cross(self._x[:, 1] - self._x[:, 0], self._x[:, 2] - self._x[:, 0])
        area = np.linalg.norm(cross, axis=1)
        keep = area > _SAME * size**2 * _SAME
        self._x, corners, self._normal = self._x[keep], corners[keep], cross[keep] / area[keep, None]
        self._of_corners = np.zeros((len(first), 3))
        edges = np.roll(self._x, -1, axis=1) - self._x
        edges /= np.linalg.norm(edges, axis=2, keepdims=True)
        angles = np.arccos(np.clip(-np.einsum("tki,tki->tk", np.roll(edges, 1, axis=1), edges), -1.0, 1.0))
        for k in range(3):
            np.add.at(self._of_corners, corners[:, k], angles[:, k, None] * self._normal)
        self._corners = corners
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
        keys = np.sort(ends, axis=2) @ np.array([len(first), 1])
        pairs, of_keys, count = np.unique(keys, return_inverse=True, return_counts=True)
        self._edges: IntArray = of_keys.reshape(-1, 3).astype(np.int64)
        open_, several = int(np.sum(count == 1)), int(np.sum(count > 2))
        if open_ or several:
            raise ValueError(
                f"{what} is not closed: {open_} of its {len(pairs)} edges have one triangle and {several} more than "
                "two; a tool must be a solid, so that inside and outside are told apart"
            )
        directed = np.where(ends[:, :, 0] < ends[:, :, 1], 1, -1)
        if np.any(np.bincount(self._edges.ravel(), directed.ravel()) != 0.0):
            raise ValueError(f"{what}: neighbouring triangles have opposite normals; orient them all outwards")
        volume = np.einsum("ti,ti->", self._x[:, 0], np.cross(self._x[:, 1], self._x[:, 2])) / 6.0
        if volume < 0.0:
            raise ValueError(f"{what}: normals point into the solid; orient them outwards")
        self._of_edges = np.zeros((len(pairs), 3))
        for k in range(3):
            np.add.at(self._of_edges, self._edges[:, k], self._normal)
        self._middle = self._x.mean(axis=1)
        self._reach = np.linalg.norm(self._x - self._middle[:, None], axis=2).max(axis=1)
        self._tree = tree_of(self._middle)
        self._last: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def distance(self, x: FloatArray) -> FloatArray:
        """Of points x (k, 3), negative inside, metres, shape (k,)."""
        return self._nearest(x)[0]

    def normal(self, x: FloatArray) -> FloatArray:
        """Unit normals at the points nearest to x (k, 3), shape (k, 3): along the distance, of a triangle near it."""
        return self._nearest(x)[1]

    def _nearest(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1], self._last[2]
        distance, normal = np.empty(len(x)), np.empty((len(x), 3))
        few = min(_NEAR, len(self._middle))
        to_middle, near = self._tree.query(x, few)
        near, to_middle = near.reshape(len(x), few), to_middle.reshape(len(x), few)
        largest = float(self._reach.max())
        for k in range(len(x)):
            best = self._of_point(x[k], near[k])
            if to_middle[k, -1] - largest < best[0]:  # another triangle, farther by its middle, may be nearer
                best = self._of_point(x[k], np.array(self._tree.query_ball_point(x[k], best[0] + largest)))
            distance[k], normal[k] = self._signed(x[k], *best)
        self._last = x.copy(), distance, normal
        return distance, normal

    def _of_point(self, x: FloatArray, triangles: IntArray) -> tuple[float, FloatArray, FloatArray]:
        """The distance of a point from some triangles, the nearest point, and the normal there."""
        points, weights = nearest_points(x, self._x[triangles])
        distances = np.linalg.norm(points - x, axis=1)
        one = int(np.argmin(distances))
        t, zero = triangles[one], weights[one] <= 0.0
        if np.sum(zero) == 2:
            normal = self._of_corners[self._corners[t, int(np.argmin(zero))]]
        elif np.sum(zero) == 1:
            normal = self._of_edges[self._edges[t, (int(np.argmax(zero)) + 1) % 3]]
        else:
            normal = self._normal[t]
        return float(distances[one]), points[one], normal

    def _signed(self, x: FloatArray, size: float, point: FloatArray, normal: FloatArray) -> tuple[float, FloatArray]:
        length = float(np.linalg.norm(normal))
        side = 1.0 if (x - point) @ normal >= 0.0 else -1.0
        scale = float(np.abs(point).max()) or 1.0
        along = normal / length if size <= 1e-9 * scale else side * (x - point) / size
        return side * size, along


def nearest_points(x: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of triangles (n, 3, 3) the points nearest to x (3,), shape (n, 3), and their barycentric coordinates, (n, 3), 0
    on edges that they are on."""
    a, b, c = t[:, 0], t[:, 1], t[:, 2]
    e, f, r = b - a, c - a, x - a
    ee, ef, ff = (np.einsum("ni,ni->n", *both) for both in ((e, e), (e, f), (f, f)))
    re_, rf = np.einsum("ni,ni->n", r, e), np.einsum("ni,ni->n", r, f)
    area = ee * ff - ef**2
    v, w = (ff * re_ - ef * rf) / area, (ee * rf - ef * re_) / area
    best = np.stack([1.0 - v - w, v, w], axis=1)
    outside = np.any(best < 0.0, axis=1)
    least = np.where(outside, np.inf, -1.0)
    for k in range(3):
        first, second = t[:, k], t[:, (k + 1) % 3]
        d = second - first
        s = np.clip(np.einsum("ni,ni->n", x - first, d) / np.einsum("ni,ni->n", d, d), 0.0, 1.0)
        gap = np.linalg.norm(first + s[:, None] * d - x, axis=1)
        nearer = gap < least
        weights = np.zeros_like(best)
        weights[:, k], weights[:, (k + 1) % 3] = 1.0 - s, s
        best[nearer], least[nearer] = weights[nearer], gap[nearer]
    return np.einsum("nk,nki->ni", best, t), best


def read_stl(file: str | Path, scale: float = 1.0) -> Triangles:
    """The surface in an STL file, binary or of text, whose coordinates times `scale` are metres.

    Raises:
        ValueError: If the file cannot be read, is no STL file, or `Triangles` refuses it.
    """
    what = f"{file}"
    try:
        content = Path(file).read_bytes()
    except OSError as error:
        raise ValueError(f"{what}: cannot be read: {error.strerror or error}") from None
    count = struct.unpack("<I", content[80:84])[0] if len(content) >= 84 else -1
    if len(content) == 84 + 50 * count:
        rows = np.frombuffer(content, dtype=np.uint8, offset=84).reshape(count, 50)[:, 12:48]
        x: Any = np.ascontiguousarray(rows).view("<f4").astype(np.float64)
    elif content.lstrip()[:5].lower() == b"solid":
        number = rb"[-+.\deE]+"
        found = re.findall(rb"vertex\s+(" + number + rb")\s+(" + number + rb")\s+(" + number + rb")", content)
        if len(found) % 3:
            raise ValueError(f"{what}: has {len(found)} vertices, not three for each triangle: the file is incomplete")
        x = np.array(found, dtype=np.float64)
    else:
        raise ValueError(f"{what}: is no STL file, binary or of text")
    return Triangles(scale * x.reshape(-1, 3, 3), what)
