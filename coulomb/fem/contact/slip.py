"""Slip over a load step, measured on the surface that is slid on, whatever motion both have in common.

On a rigid foundation a node has a foot point, fixed in the foundation's coordinates: slip is the way of the foot point
since the start of the step, along the arc, in the direction of its chord in the present tangent plane.  It is exactly 0
where the node has stayed on its place of the foundation, however far this has moved.

Of two deformable faces, contact point j has the averages D x of the slave and M x of the master.  With the weights of
the start of the step these are of the points that were opposite then, with the present ones of those that are now: slip
is (D0 - M0) x - (D - M) x in the tangent plane (Puso and Laursen 2004), 0 in every rigid motion of both.  A point with
nothing opposite at the start has no such weights: its slip is the displacement since then relative to the face that is
opposite now, (D - M) (x - x0).

A point that is open at the start of the step travels before it touches: that way is no slip, and is extrapolated from
the step before (`way_to_touch`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from ...arrays import FloatArray
from ..bodies import Deformable
from ..geometry import RigidFoundation, RigidMotion, on_all_ranks
from .surface import ContactSurface

Foundations = Sequence[RigidFoundation | None]
"""Of all contact faces; None of pairs."""

_FOOT_STEPS: Final = 3
"""Projections of a point on a foundation: one is exact for a distance, the others for other level-set functions."""

_PARALLEL: Final = 1e-4
"""Angle in radians of two normals below which chord and arc are equal to rounding: its square over 24 is 4e-10."""


@dataclass(frozen=True)
class FaceMotion:
    """Where the nodes of the contact faces were on their foundations at the start of a load step.

    Attributes:
        feet: By the number of the contact, foot points of this rank's nodes in the coordinates of its foundation,
            shape (k, 3); nan elsewhere; none of pairs.
        normals: Unit normals of the foundation there, shape (k, 3).
        surface: Contact points at the start of the step.
        x: Places of this rank's nodes there, shape (k, 3).
        motions: Of the foundations at the start of the step.
        flown: Way of these contact points along the face before they touch (`way_to_touch`), as space vectors, shape
            (m, 3).
        way: Displacement of this rank's nodes in the step before, shape (k, 3); 0 in the first.
        longer: Duration of the step over that of the step before.
    """

    feet: dict[int, FloatArray]
    normals: dict[int, FloatArray]
    surface: ContactSurface
    motions: Sequence[RigidMotion]
    x: FloatArray
    flown: FloatArray
    way: FloatArray
    longer: float

    def slip(
        self, body: Deformable, surface: ContactSurface, motions: Sequence[RigidMotion], foundations: Foundations
    ) -> FloatArray:
        """Slip since the start of the step at the contact points of a surface, space vectors in metres, shape (m, 3);
        collective."""
        slip = np.zeros_like(surface.x)
        present, normals = foot_points(body, surface.faces, motions, foundations)
        for part, feet in present.items():
            here, way = surface.part == part, _along_arc(feet - self.feet[part], normals[part], self.normals[part])
            # of points that are averages of nodes: of the feet of these
            slip[here] = motions[part].turned(surface.points.average(np.nan_to_num(way))[here])
        paired = surface.points.opposite is not None
        if body.comm.allreduce(paired):
            slip += self._between_faces(body, surface, foundations)
        return slip - self._flown(surface, motions, foundations)

    def _flown(self, surface: ContactSurface, motions: Sequence[RigidMotion], foundations: Foundations) -> FloatArray:
        """The way before they touch of the contact points of a surface, turned with the foundations, and with normals
        between bodies; space vectors in metres, shape (m, 3)."""
        flown, place = np.zeros_like(surface.x), surface.places_among(self.surface.nodes, self.surface.part)
        known = place >= 0
        for part, foundation in enumerate(foundations):
            here = known & (surface.part == part)
            then = self.flown[place[here]]
            if foundation is not None:
                flown[here] = motions[part].turned(self.motions[part].turned_back(then))
            elif np.any(then):
                turn = least_rotations(self.surface.frames[place[here], 0], surface.frames[here, 0])
                flown[here] = np.einsum("kij,kj->ki", turn, then)
        return flown

    def _between_faces(self, body: Deformable, surface: ContactSurface, foundations: Foundations) -> FloatArray:
        then, now = (_separation(one, body.x) for one in (self.surface, surface))
        place = surface.places_among(self.surface.nodes, self.surface.part)
        slip, known, rows = _separation(surface, body.x - self.x), place >= 0, surface.rows(self.way)
        gap = -np.einsum("ki,ki->k", surface.frames[:, 0], _separation(surface, self.x))
        slip -= surface.displacements(way_to_touch(rows, gap, self.longer))
        slip[known] = then[place[known]] - now[known]
        on_foundation = np.array([foundation is not None for foundation in foundations])[surface.part]
        slip[on_foundation] = 0.0
        return slip


def way_to_touch(way: FloatArray, gap: FloatArray, longer: float) -> FloatArray:
    """The way of contact points along their face in a load step before their gap closes, metres, shape (m, 3).

    The gap g closes at the part s = g / (v_n dt) of the step dt, with the velocity v of the step before.  From the
    middle of that step, dt0 long, to the touch the velocity along the face changes from v_t to that of the slip, w,
    with the root of the time that is left, as ahead of the edge of a rolling contact (Carter 1926): forces are 0 at the
    touch, so that nothing changes it there.  The way is s dt (c v_t + (1 - c) w), c = 2/3 (s dt / (s dt + dt0/2))^1/2,
    and that of the rest of the step w (1 - s) dt.  So there is no slip where the displacement of the step is
    s dt c v_t, which is the way given here; else slip is along the rest of it.

    A point that would have needed 1/s > 1 steps counts with s in its place, so that one that does not come near has 0.

    Args:
        way: Displacement in the step before, relative to what is opposite, along n, t1, t2, shape (m, 3).
        gap: At the start of the step, shape (m,); 0 of points that have touched.
        longer: dt / dt0.
    """
    closing = np.maximum(way[:, 0], 0.0) * longer
    near = (gap > 0.0) & (closing > 0.0)
    least, most = np.minimum(gap, closing), np.maximum(gap, closing)
    part = np.divide(least, most, out=np.zeros_like(gap), where=near)
    c = 2.0 / 3.0 * np.sqrt(part * longer / (part * longer + 0.5))
    found = way * (longer * part * c)[:, None]
    found[:, 0] = 0.0
    return found


def least_rotations(n: FloatArray, m: FloatArray) -> FloatArray:
    """The least rotations from unit vectors to others near to them, both of shape (k, 3), shape (k, 3, 3)."""
    n, m = (one / np.linalg.norm(one, axis=1)[:, None] for one in (n, m))
    axis, cosine = np.cross(n, m), np.einsum("ki,ki->k", n, m)
    cross = np.zeros((len(n), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, k, j], cross[:, j, k] = axis[:, i], -axis[:, i]
    outer = axis[:, :, None] * axis[:, None, :] / (1.0 + cosine)[:, None, None]
    turned: FloatArray = cosine[:, None, None] * np.eye(3) + cross + outer
    return turned


def foot_points(
    body: Deformable, faces: Sequence[str], motions: Sequence[RigidMotion], foundations: Foundations
) -> tuple[dict[int, FloatArray], dict[int, FloatArray]]:
    """Foot points and normals of `FaceMotion`, of the present places of the nodes; collective."""
    feet, normals = dict[int, FloatArray](), dict[int, FloatArray]()
    for part, (face, motion, foundation) in enumerate(zip(faces, motions, foundations, strict=True)):
        if foundation is not None:
            nodes = body.nodes(face, "contact")
            find = partial(_foot, foundation, motion.undone(body.x[nodes]))
            feet[part], normals[part] = np.full((2, *body.x.shape), np.nan)
            found = on_all_ranks(find, f"contact face {face!r}: foundation", body.comm)
            feet[part][nodes], normals[part][nodes] = found
    return feet, normals


def _foot(foundation: RigidFoundation, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    for _ in range(_FOOT_STEPS if len(x) else 0):
        x = x - foundation.signed_distance(x)[:, None] * foundation.normal(x)
    return x, foundation.normal(x) if len(x) else x


def _along_arc(chord: FloatArray, now: FloatArray, then: FloatArray) -> FloatArray:
    """Vectors in the present tangent plane along chords (k, 3), as long as the arcs between normals (k, 3)."""
    tangent = chord - np.einsum("ki,ki->k", chord, now)[:, None] * now
    length, along = np.linalg.norm(chord, axis=1), np.linalg.norm(tangent, axis=1)
    half = 0.5 * np.arctan2(np.linalg.norm(np.cross(then, now), axis=1), np.einsum("ki,ki->k", then, now))
    arc = np.where(half > _PARALLEL, length * half / np.sin(np.maximum(half, _PARALLEL)), length)
    stretched: FloatArray = tangent * np.divide(arc, along, out=np.zeros_like(arc), where=along > 0.0)[:, None]
    return stretched


def _separation(surface: ContactSurface, x: FloatArray) -> FloatArray:
    """(D - M) x at the contact points, without its part along the present normal; shape (m, 3); collective."""
    apart: FloatArray = surface.points.average(x)
    opposite = surface.points.opposite_average(x)
    return apart if opposite is None else apart - opposite
