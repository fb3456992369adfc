"""Rigid motions of foundations: rotated about an axis, then translated.

A point X of a foundation as it is given is at the time t at

    x = p + R (X - p) + d         R: rotation by `angle` about `axis`; p: a point of the axis; d: the translation

so that the axis moves with the translation.  Slip and work need the displacement of the foundation's material while it
passes a contact point, which a load step keeps in place: its velocity there, integrated over the step.  With angle and
translation linear in time within the step this is exactly

    (angle1 - angle0) axis x (x - p - (d0 + d1)/2) + d1 - d0

the length of the arc, not of its chord: a drum that turns by 36 degrees in a step slides by 0.628 r, and after a whole
turn in one step by 2 pi r, not by 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from .obstacles import Point, Revolved, RigidFoundation, check_direction, check_point
from .user_values import Amplitude, Motion, evaluate_amplitude, evaluate_motion


@dataclass(frozen=True)
class Rotation:
    """Rotation of a foundation about a fixed axis, or about one that moves with the foundation's translation.

    Attributes:
        point: A point of the axis before any translation, metres.
        axis: Direction of the axis; need not have length 1.  Positive angles are right-handed about it.
        angle: In radians, as a function of time: a function, a table of (time, angle), or a number.

    Raises:
        ValueError: If the axis is zero or an entry is not finite.
    """

    point: Point
    axis: Point
    angle: Amplitude

    def __post_init__(self) -> None:
        check_point("rotation: point", self.point)
        check_direction("rotation: axis", self.axis)


@dataclass(frozen=True)
class Turn:
    """A rotation by an angle in radians, right-handed, about the axis of length 1 through a point in metres, shapes
    (3,); more than a whole turn counts."""

    point: FloatArray
    axis: FloatArray
    angle: float

    @property
    def matrix(self) -> FloatArray:
        """R, shape (3, 3): x is R (X - point) + point (Rodrigues' formula)."""
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        matrix: FloatArray = np.eye(3) + np.sin(self.angle) * cross + (1.0 - np.cos(self.angle)) * cross @ cross
        return matrix


@dataclass(frozen=True)
class RigidMotion:
    """Rigid motion of a foundation from the place where it is given: a turn, if it has a `Rotation`, then a translation
    (3,) in metres."""

    translation: FloatArray
    turn: Turn | None = None

    @property
    def centre(self) -> FloatArray:
        """The point of the axis, moved with the translation, metres, shape (3,)."""
        return self.translation if self.turn is None else self.turn.point + self.translation

    def undone(self, x: FloatArray) -> FloatArray:
        """Points x (k, 3) in metres in the coordinates in which the foundation is given, shape (k, 3)."""
        if self.turn is None:
            return x - self.translation
        return self.turned_back(x - self.centre) + self.turn.point

    def turned(self, vectors: FloatArray) -> FloatArray:
        """Vectors (k, 3) fixed to the foundation, rotated with it."""
        return vectors if self.turn is None else vectors @ self.turn.matrix.T

    def turned_back(self, vectors: FloatArray) -> FloatArray:
        """Vectors (k, 3) of space in the coordinates in which the foundation is given."""
        return vectors if self.turn is None else vectors @ self.turn.matrix

    def since(self, before: RigidMotion, x: FloatArray) -> FloatArray:
        """Displacement in metres of the foundation's material at fixed points x (k, 3) since another time, along the
        arc."""
        way = np.broadcast_to(self.translation - before.translation, x.shape)
        if self.turn is None or before.turn is None:
            return way
        centre = 0.5 * (self.centre + before.centre)
        arc: FloatArray = way + (self.turn.angle - before.turn.angle) * np.cross(self.turn.axis, x - centre)
        return arc


@dataclass(frozen=True)
class Moved:
    foundation: RigidFoundation
    motion: RigidMotion

    def signed_distance(self, x: FloatArray) -> FloatArray:
        return self.foundation.signed_distance(self.motion.undone(x))

    def normal(self, x: FloatArray) -> FloatArray:
        return self.motion.turned(self.foundation.normal(self.motion.undone(x)))


def same_place(one: RigidMotion, other: RigidMotion) -> bool:
    """Whether two motions of the same foundation, at any two times, end in the same place."""
    angles = [0.0 if motion.turn is None else motion.turn.angle for motion in (one, other)]
    return bool(np.array_equal(one.translation, other.translation)) and angles[0] == angles[1]


def moved(foundation: RigidFoundation, motion: RigidMotion) -> RigidFoundation:
    """A foundation after a rigid motion: itself if its shape is in the same place.

    A rotation about an axis about which the foundation is a surface of revolution is left out, so that its normals are
    not changed by rounding errors, and A stays as it is.
    """
    turn = motion.turn
    if turn is not None and (
        turn.angle == 0.0 or (isinstance(foundation, Revolved) and foundation.revolves(turn.point, turn.axis))
    ):
        motion = RigidMotion(motion.translation)
    return Moved(foundation, motion) if motion.turn is not None or np.any(motion.translation) else foundation


@dataclass(frozen=True)
class Spin:
    """The axis of a rotating foundation at the end of a load step, and the rotation in the step.

    Attributes:
        centre: A point of the axis, metres, shape (3,).
        axis: Direction of the axis, length 1, shape (3,).
        angle: At the end of the step, radians.
        angular_velocity: Mean angular velocity in the step, radians per second; None without a step.
    """

    centre: FloatArray
    axis: FloatArray
    angle: float
    angular_velocity: float | None

    def torques(self, x: FloatArray, force: FloatArray) -> FloatArray:
        """Moments about the axis of forces (k, 3) in newtons at points x (k, 3) in metres; N m, shape (k,)."""
        return np.cross(x - self.centre, force) @ self.axis


def rigid_motion(motion: Motion | None, rotation: Rotation | None, time: float, what: str) -> RigidMotion:
    """The rigid motion of a foundation, `what` in errors, at a time; ValueError as of `evaluate_motion`."""
    translation = evaluate_motion(motion, time, what)
    if rotation is None:
        return RigidMotion(translation)
    angle = evaluate_amplitude(rotation.angle, time, f"{what}: rotation", "angle")
    axis = np.asarray(rotation.axis, dtype=np.float64)
    return RigidMotion(translation, Turn(np.asarray(rotation.point, float), axis / np.linalg.norm(axis), angle))


def spin(now: RigidMotion, before: RigidMotion | None, duration: float) -> Spin | None:
    """Axis and rotation of a load step; `before` is its start, if there is a step; None without rotation."""
    if now.turn is None:
        return None
    angular_velocity = None
    if before is not None and before.turn is not None:
        angular_velocity = (now.turn.angle - before.turn.angle) / duration
    return Spin(now.centre, now.turn.axis, now.turn.angle, angular_velocity)


def since_at(
    now: Sequence[RigidMotion], before: Sequence[RigidMotion], part: npt.NDArray[np.int64], x: FloatArray
) -> FloatArray:
    """`RigidMotion.since` at contact points x (m, 3) of several faces, of which each is on `part` (m,)."""
    moved = np.zeros_like(x)
    for number, (here, then) in enumerate(zip(now, before, strict=True)):
        on = part == number
        moved[on] = here.since(then, x[on])
    return moved
