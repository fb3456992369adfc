"""Slip over a load step, measured on the surface that is slid on, whatever motion both have in common.

On a rigid foundation a node has a foot point, fixed in the foundation's coordinates: slip is the way of the foot point
since the start of the step, along the arc, in the direction of its chord in the present tangent plane; with a given gap
g the way on the surface at the distance -g, longer by -g times the angle of the arc.  It is exactly 0 where the node
has stayed on its place of the foundation, however far this has moved.  Where the foundation turns about an axis about
which it is a surface of revolution, as a disc or a drum, or the body is turned about one at rest, the angle between the
two is an arc about that: it may be longer than a turn, and friction is against the velocity at the end of the step, as
in small motions.

Of two deformable faces, contact point j has the averages D x of the slave and M x of the master.  With the weights of
the start of the step these are of the points that were opposite then, with the present ones of those that are now: slip
is (D0 - M0) x - (D - M) x in the tangent plane (Puso and Laursen 2004), 0 in every rigid motion of both.  A point with
nothing opposite at the start has no such weights: its slip is the displacement since then relative to the face that is
opposite now, (D - M) (x - x0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from ...arrays import FloatArray
from ..bodies import Deformable
from ..geometry import Revolved, RigidFoundation, RigidMotion, Turn, on_all_ranks
from .surface import ContactSurface

Foundations = Sequence[RigidFoundation | None]
"""Of all contact faces; None of pairs."""

_FOOT_STEPS: Final = 3
"""Projections of a point on a foundation: one is exact for a distance, the others for other level-set functions."""

_PARALLEL: Final = 1e-4
"""Angle in radians of two normals below which chord and arc are equal to rounding: its square over 24 is 4e-10."""


_SAME: Final = 1e-9
"""Sine of the angle between axes, and distance between them over that of the nodes, up to which they are the same."""


@dataclass(frozen=True, eq=False)
class FaceMotion:
    """Where the nodes of the contact faces were on their foundations at the start of a load step.

    Attributes:
        feet: By the number of the contact, foot points of this rank's nodes in the coordinates of its foundation,
            shape (k, 3); nan elsewhere; none of pairs.
        normals: Unit normals of the foundation there, shape (k, 3).
        surface: Contact points at the start of the step.
        x: Places of this rank's nodes there, shape (k, 3).
        motions: Of the foundations at the start of the step.
    """

    feet: dict[int, FloatArray]
    normals: dict[int, FloatArray]
    surface: ContactSurface
    motions: Sequence[RigidMotion]
    x: FloatArray

    def slip(
        self,
        body: Deformable,
        surface: ContactSurface,
        given: FloatArray,
        motions: Sequence[RigidMotion],
        foundations: Foundations,
        turns: Sequence[Turn | None],
        drawn: Sequence[FloatArray],
    ) -> FloatArray:
        """Slip since the start of the step at the contact points of a surface with given gaps (m,), space vectors in
        metres, shape (m, 3), where supports turn the body of each face so in the step, and draw it by translations (3,)
        in metres; collective."""
        slip = np.zeros_like(surface.x)
        present, normals = foot_points(body, surface.faces, motions, foundations)
        for part, feet in present.items():
            foundation, motion = foundations[part], motions[part]
            then = _Foot(self.feet[part], self.normals[part])
            about = _turns(feet, motion, self.motions[part], foundation, turns[part], drawn[part])
            ways = _ways(_Foot(feet, normals[part]), then, about)
            # of points that are averages of nodes: of the feet of these
            here = surface.part == part
            way, turn = (surface.points.average(np.nan_to_num(of))[here] for of in ways)
            slip[here] = motion.turned(way - given[here, None] * turn)
        paired = surface.points.opposite is not None
        if body.comm.allreduce(paired):
            slip += self.between_faces(body.x, surface, foundations)
        return slip

    def between_faces(self, x: FloatArray, surface: ContactSurface, foundations: Foundations) -> FloatArray:
        """`slip` of pairs, 0 of others, with this rank's nodes at x (k, 3), metres; collective."""
        then, now = (_separation(one, x) for one in (self.surface, surface))
        place = surface.places_among(self.surface.nodes, self.surface.part)
        slip, known = _separation(surface, x - self.x), place >= 0
        slip[known] = then[place[known]] - now[known]
        if surface.points.mirrored is not None:  # beyond a plane of symmetry both faces go on
            slip -= np.einsum("mij,mj->mi", surface.points.mirrored, slip)
        on_foundation = np.array([foundation is not None for foundation in foundations])[surface.part]
        slip[on_foundation] = 0.0
        return slip


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
            feet_and_normals = on_all_ranks(find, f"contact face {face!r}: foundation", body.comm)
            feet[part][nodes], normals[part][nodes] = feet_and_normals
    return feet, normals


def _foot(foundation: RigidFoundation, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    for _ in range(_FOOT_STEPS if len(x) else 0):
        x = x - foundation.signed_distance(x)[:, None] * foundation.normal(x)
    return x, foundation.normal(x) if len(x) else x


class _Foot(NamedTuple):
    """Foot points and unit normals of a foundation there, in its coordinates, shapes (k, 3)."""

    x: FloatArray
    normal: FloatArray


class _Turns(NamedTuple):
    """Angles in radians by which a foundation and the body turn in a step about an axis of length 1 through a point, in
    the coordinates of the foundation; and by how much the body is drawn, metres, shape (3,)."""

    point: FloatArray
    axis: FloatArray
    foundation: float
    body: float
    drawn: FloatArray


def _turns(
    x: FloatArray,
    motion: RigidMotion,
    earlier: RigidMotion,
    foundation: RigidFoundation | None,
    driven: Turn | None,
    drawn: FloatArray,
) -> _Turns | None:
    """About an axis about which the foundation is a surface of revolution, of points x (k, 3), metres; None if neither
    turns about one."""
    turn, before, angle = motion.turn, earlier.turn, motion.angle - earlier.angle
    if not isinstance(foundation, Revolved):
        return None
    if driven is not None:
        (point,), (axis,) = motion.undone(driven.point[None]), motion.turned_back(driven.axis[None])
    if turn and before and angle != 0.0:
        if not np.array_equal(turn.axis, before.axis) or not foundation.revolves(turn.point, turn.axis):
            return None
        of_body = 0.0
        if driven is not None and _same_line(point - turn.point, axis, turn.axis, x - turn.point):
            of_body = float(np.sign(axis @ turn.axis)) * driven.angle
        return _Turns(turn.point, turn.axis, angle, of_body, motion.turned_back(drawn[None])[0])
    if driven is None or not foundation.revolves(point, axis):
        return None
    moved = motion.turned_back((motion.translation - earlier.translation)[None])[0]
    if not _same_line(moved, axis, axis, x - point):
        return None
    return _Turns(point, axis, 0.0, driven.angle, np.zeros(3))


def _same_line(apart: FloatArray, axis: FloatArray, other: FloatArray, arms: FloatArray) -> bool:
    """Whether two axes of length 1, with a vector from one to the other, are the same line for points with these arms
    from it (k, 3), metres."""
    near = np.linalg.norm(np.cross(apart, other)) <= _SAME * np.max(np.nan_to_num(np.abs(arms)), initial=0.0)
    return bool(near and np.linalg.norm(np.cross(axis, other)) <= _SAME)


def _ways(now: _Foot, then: _Foot, about: _Turns | None) -> tuple[FloatArray, FloatArray]:
    """`_along_arc` from the feet at the start of a step to those at its end.  Where foundation or body turn about an
    axis of the foundation, these are first turned by the angle between its nodes and the foundation, an arc of its
    own."""
    arcs = np.zeros((2, *now.x.shape))
    if about is not None:
        point, axis = about.point, about.axis
        left = _lag(then.x - point, now.x - point, about)[:, None]
        then = _Foot(_turned(then.x - point, axis, left) + point, _turned(then.normal, axis, left))
        arcs = np.stack([left * np.cross(axis, of) for of in (now.x - point, now.normal)])
    way, angles = _along_arc(now.x - then.x, now.normal, then.normal)
    return way + arcs[0], angles + arcs[1]


def _lag(then: FloatArray, now: FloatArray, about: _Turns) -> FloatArray:
    """Angles by which points (k, 3) lag behind the foundation, of places in its coordinates from the axis: by less than
    half a turn they turn otherwise than the body, and by angles between 0 and those of body and foundation.

    The angle of a point is also that of the translation of its body, which is no arc, and is taken off; but of points
    that stick only as far as they have slipped, over the square of the angle: an arc leaves half of that of a way."""
    own = _own_lag(then, now, about)
    if not np.any(about.drawn):
        return own
    most = (about.body - about.foundation) ** 2 * np.linalg.norm(np.cross(about.axis, now), axis=1)
    slipped = np.linalg.norm(now - then, axis=1)
    sliding = np.divide(slipped, most, out=np.ones_like(most), where=slipped < most)
    lag: FloatArray = own + sliding * (_own_lag(then, now - about.drawn, about) - own)
    return lag


def _own_lag(then: FloatArray, now: FloatArray, about: _Turns) -> FloatArray:
    axis = about.axis
    sine, cosine = np.cross(then, now) @ axis, np.einsum("ki,ki->k", then, now) - (then @ axis) * (now @ axis)
    other = about.foundation - about.body + np.arctan2(sine, cosine)
    own = about.body + np.arctan2(np.sin(other), np.cos(other))
    ends = 0.0, about.foundation, about.body
    lag: FloatArray = np.clip(own, min(ends), max(ends)) - about.foundation
    return lag


def _turned(x: FloatArray, axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (k, 3) turned by angles (k, 1) about an axis (Rodrigues' formula)."""
    along = np.outer(x @ axis, axis)
    return along + np.cos(angle) * (x - along) + np.sin(angle) * np.cross(axis, x)


def _along_arc(chord: FloatArray, now: FloatArray, then: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Vectors in the present tangent plane along chords (k, 3): as long as the arcs between normals (k, 3), and as the
    angles of these in radians, against the chord where normals converge, as inside a cylinder."""
    tangent = chord - np.einsum("ki,ki->k", chord, now)[:, None] * now
    length, along = np.linalg.norm(chord, axis=1), np.linalg.norm(tangent, axis=1)
    half = 0.5 * np.arctan2(np.linalg.norm(np.cross(then, now), axis=1), np.einsum("ki,ki->k", then, now))
    arc = np.where(half > _PARALLEL, length * half / np.sin(np.maximum(half, _PARALLEL)), length)
    unit = tangent * np.divide(1.0, along, out=np.zeros_like(along), where=along > 0.0)[:, None]
    angle = 2.0 * half * np.sign(np.einsum("ki,ki->k", chord, now - then))
    return unit * arc[:, None], unit * angle[:, None]


def _separation(surface: ContactSurface, x: FloatArray) -> FloatArray:
    """(D - M) x at the contact points, without its part along the present normal; shape (m, 3); collective."""
    apart: FloatArray = surface.points.average(x)
    opposite = surface.points.opposite_average(x)
    return apart if opposite is None else apart - opposite
