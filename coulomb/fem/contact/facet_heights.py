"""How high the surfaces for which facets stand are above them: named ones, curved ones of second order, smooth ones.

For the evidence of pairs: it shares nothing with the mortar integration.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ...arrays import FloatArray, IntArray, unit_vectors
from ..geometry import RigidFoundation
from ..meshes import CurvedFaces
from .closest_points import Facets, plane_vectors

_SLANT: Final = 2.0
_OFF: Final = 1.5
"""See `risen`."""

_CREASE: Final = 0.9
"""Cosine between a facet and the mean normals at its corners below which a smooth surface has an edge there."""


def _along(surface: RigidFoundation, start: FloatArray, along: FloatArray, way: float) -> FloatArray:
    """Way in metres from points (q, 3) along unit vectors to a surface, shape (q,), by Newton's method."""
    height = np.full(len(start), way)
    for _ in range(6 if len(start) else 0):
        x = start + height[:, None] * along
        slope = np.einsum("qi,qi->q", surface.normal(x), along)
        height = height - surface.signed_distance(x) / np.where(np.abs(slope) < 0.1, np.copysign(0.1, slope), slope)
    return height


def risen(
    face: Facets,
    surface: RigidFoundation | None,
    held: FloatArray | None,
    facet: IntArray,
    local: FloatArray,
    x: FloatArray,
    along: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The way along unit vectors (q, 3) from points x (q, 3) of facets (q,), with the linear functions `at`
    (q, corners) of the corners, to a surface or, without one, to the smooth face with the mean normals n_k of the
    facets at the corners, 1/2 sum N_k ((x_k - x) . n_k) n_k; and how far it may be off; metres, shape (q,) each.

    At nodes where the face ends on a plane of symmetry, by projectors on `held` directions at the nodes (f, n, 3, 3),
    normals are within it.  The mortar integration has second-order facets with nodes on the surface, and their heights
    above places of the facets: with a bulge s and an angle between line and normals, that is off by up to the part
    sin^2 of s.  Of facets that are of second order themselves the difference from the surface is not known better.
    """
    corner, size = face.nodes[:, : face.corners], int(face.nodes.max()) + 1
    areas = plane_vectors(face.x[:, : face.corners]) * face.sign[:, None]
    sums, total = np.zeros((size, 3)), np.zeros(size)
    np.add.at(sums, corner, areas[:, None])
    np.add.at(total, corner, np.linalg.norm(areas, axis=1)[:, None])
    means = (sums / np.maximum(total, 1e-300)[:, None])[corner]
    n = unit_vectors(means)
    slant = np.max(1.0 - np.einsum("qki,qi->qk", n[facet], along) ** 2, axis=1)
    if isinstance(surface, CurvedFaces):
        rise = np.einsum("qi,qi->q", surface.bulges(face.x[:, : face.corners], facet, local), along)
        return rise, _SLANT * slant * np.abs(rise)
    if surface is not None:
        rise = _along(surface, x, along, 0.0)
        return rise, np.abs(rise) * (_OFF if face.degree == 2 else _SLANT * slant)
    aslant = np.einsum("fki,fi->fk", n, face.normal) < _CREASE
    creased = np.any(aslant | (np.linalg.norm(means, axis=2) < _CREASE), axis=1)
    across = np.zeros_like(n) if held is None else np.einsum("fkij,fkj->fki", held[:, : face.corners], n)
    symmetric = (face.rim | np.roll(face.rim, 1, axis=1)) & (np.linalg.norm(across, axis=2) < 0.5)
    away = face.x[facet][:, : face.corners] - x[:, None]
    heights = []
    for normals in (n, unit_vectors(np.where(symmetric[:, :, None], n - across, n))):
        each = np.einsum("qki,qki->qk", away, normals[facet])
        bulge = 0.5 * np.einsum("qk,qk,qki,qi->q", local, each, normals[facet], along)
        heights.append(np.where(creased[facet], 0.0, bulge))
    return heights[1], np.abs(heights[1] - heights[0]) + _SLANT * slant * np.abs(heights[1])
