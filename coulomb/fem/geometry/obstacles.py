"""Rigid foundations, and their rigid motions: rotated about an axis, then translated.

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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol, cast, runtime_checkable

import numpy as np

from ...arrays import FloatArray, IntArray, is_number
from ...load_curve import LoadCurve
from .triangles import read_stl
from .user_values import Amplitude, Motion, evaluate_amplitude, evaluate_motion

Point = tuple[float, float, float]

_DIFFERENCE: Final = 1e-5
"""Relative step of the finite differences for a normal: the cube root of the rounding error."""


LEAST_LENGTH: Final = 1e-100
"""Smallest length of a direction, and the inverse of the largest: squares do not underflow or overflow."""

_SAME: Final = 1e-12
"""Distance over the radius, and sine of the angle, below which two axes are the same up to rounding."""


class RigidFoundation(Protocol):
    def signed_distance(self, x: FloatArray) -> FloatArray:
        """Distance in metres of the points x (k, 3) from the foundation, negative inside it, shape (k,)."""
        ...

    def normal(self, x: FloatArray) -> FloatArray:
        """Unit normals out of the foundation, into the free space, at the points x (k, 3), shape (k, 3)."""
        ...


@runtime_checkable
class Revolved(Protocol):
    """A foundation that reports whether it is a surface of revolution about an axis: rotation about such an axis leaves
    distance and normals exactly unchanged.  Without this method they are computed in rotated coordinates."""

    def revolves(self, point: FloatArray, axis: FloatArray) -> bool:
        """Whether it is one about the axis through a point (3,) in metres with the direction axis (3,) of length 1."""
        ...


@dataclass(frozen=True)
class Plane:
    """Rigid half space behind a plane.

    Attributes:
        point: A point of the plane, metres.
        normal_vector: Normal out of the foundation towards the body; need not have length 1.

    Raises:
        ValueError: If the normal is zero or an entry is not finite.
    """

    point: Point
    normal_vector: Point

    def __post_init__(self) -> None:
        check_point("plane: point", self.point)
        check_direction("plane: normal", self.normal_vector)

    def signed_distance(self, x: FloatArray) -> FloatArray:
        return (x - np.asarray(self.point)) @ _unit(self.normal_vector)

    def normal(self, x: FloatArray) -> FloatArray:
        return np.tile(_unit(self.normal_vector), (len(x), 1))

    def revolves(self, point: FloatArray, axis: FloatArray) -> bool:
        return _parallel(axis, self.normal_vector)


@dataclass(frozen=True)
class Sphere:
    """Rigid ball, or the space around a spherical hollow.

    Attributes:
        centre: In metres.
        radius: In metres, > 0.
        hollow: The body lies inside, in a spherical cup.

    Raises:
        ValueError: If the radius is not positive or an entry is not finite.
    """

    centre: Point
    radius: float
    hollow: bool = False

    def __post_init__(self) -> None:
        check_point("sphere: centre", self.centre)
        _check_radius("sphere: radius", self.radius)

    def signed_distance(self, x: FloatArray) -> FloatArray:
        distance: FloatArray = np.linalg.norm(x - np.asarray(self.centre), axis=1) - self.radius
        return -distance if self.hollow else distance

    def normal(self, x: FloatArray) -> FloatArray:
        return _radial(x - np.asarray(self.centre), self.hollow)

    def revolves(self, point: FloatArray, axis: FloatArray) -> bool:
        return _off_axis(np.asarray(self.centre) - point, axis) <= _SAME * self.radius


@dataclass(frozen=True)
class Cylinder:
    """Rigid circular cylinder without ends, or the space around a bore.

    Attributes:
        point: A point of the axis, metres.
        axis: Direction of the axis; need not have length 1.
        radius: In metres, > 0.
        hollow: The body lies inside, in a bore.

    Raises:
        ValueError: If the radius is not positive, the axis zero, or an entry not finite.
    """

    point: Point
    axis: Point
    radius: float
    hollow: bool = False

    def __post_init__(self) -> None:
        check_point("cylinder: point", self.point)
        check_direction("cylinder: axis", self.axis)
        _check_radius("cylinder: radius", self.radius)

    def signed_distance(self, x: FloatArray) -> FloatArray:
        distance: FloatArray = np.linalg.norm(self._from_axis(x), axis=1) - self.radius
        return -distance if self.hollow else distance

    def normal(self, x: FloatArray) -> FloatArray:
        return _radial(self._from_axis(x), self.hollow)

    def revolves(self, point: FloatArray, axis: FloatArray) -> bool:
        off = _off_axis(np.asarray(self.point) - point, axis)
        return _parallel(axis, self.axis) and off <= _SAME * self.radius

    def _from_axis(self, x: FloatArray) -> FloatArray:
        r, axis = x - np.asarray(self.point), _unit(self.axis)
        return r - np.outer(r @ axis, axis)


@dataclass(frozen=True)
class SignedDistance:
    """A foundation given by a function.

    Attributes:
        function: x (3, k) in metres -> signed distances (k,) in metres, negative inside the foundation.  It may be
            any function that is zero on the surface, such as z - h(x, y): it is divided by the length of its gradient.
        gradient: x (3, k) -> its gradient, shape (3, k); by default central differences, accurate to about 1e-10.
    """

    function: Callable[[FloatArray], FloatArray]
    gradient: Callable[[FloatArray], FloatArray] | None = None

    @classmethod
    def of_stl(cls, file: str | Path, scale: float = 1.0) -> SignedDistance:
        """A tool from an STL file, binary or of text: the surface of a solid, with normals outwards.

        Normals are those of the triangles, and along the distance beside edges and corners: where they are seen in the
        answer, take a finer triangulation than the mesh of the face.

        Args:
            file: The file.
            scale: Its unit in metres, such as 1e-3 for millimetres.

        Raises:
            ValueError: If the file cannot be read, or its surface is not closed, or not oriented outwards.
        """
        if not is_number(scale) or scale == 0.0:
            raise ValueError(f"of_stl: scale must be a number > 0, but is {scale!r}")
        surface = read_stl(file, scale)
        return cls(lambda x: surface.distance(x.T), lambda x: surface.normal(x.T).T)

    def signed_distance(self, x: FloatArray) -> FloatArray:
        return self._values(x) / np.linalg.norm(self._slope(x), axis=1)

    def normal(self, x: FloatArray) -> FloatArray:
        slope = self._slope(x)
        return slope / np.linalg.norm(slope, axis=1)[:, None]

    def _values(self, x: FloatArray) -> FloatArray:
        values = np.asarray(self.function(x.T.copy()), dtype=np.float64)
        if values.shape != (len(x),):
            raise ValueError(f"the function must return {len(x)} numbers, but returned shape {values.shape}")
        return values

    def _slope(self, x: FloatArray) -> FloatArray:
        if self.gradient is not None:
            slope: FloatArray = np.asarray(self.gradient(x.T.copy()), dtype=np.float64).T
            if slope.shape != x.shape:
                raise ValueError(f"the gradient must have shape (3, {len(x)}), but has {slope.T.shape}")
        else:
            h = _DIFFERENCE * (float(np.max(np.abs(x), initial=0.0)) or 1.0)  # a rank may have the origin alone
            sides = [(self._values(x + h * e) - self._values(x - h * e)) / (2.0 * h) for e in np.eye(3)]
            slope = np.stack(sides, axis=1)
        flat = ~(np.linalg.norm(slope, axis=1) > 0.0)
        if np.any(flat):
            raise ValueError(f"has no normal at x = {', '.join(f'{c:.6g}' for c in x[np.argmax(flat)])}")
        return slope


def _radial(r: FloatArray, inwards: bool) -> FloatArray:
    length = np.linalg.norm(r, axis=1)
    if np.any(length == 0.0):
        raise ValueError("has no normal at its centre, where the body has a node")
    unit: FloatArray = r / length[:, None]
    return -unit if inwards else unit


def _parallel(axis: FloatArray, other: Point) -> bool:
    return bool(np.linalg.norm(np.cross(axis, _unit(other))) <= _SAME)


def _off_axis(r: FloatArray, axis: FloatArray) -> float:
    """Distance of a point r from the axis through 0 along the unit vector axis."""
    return float(np.linalg.norm(np.cross(axis, r)))


def _unit(vector: Point) -> FloatArray:
    n = np.asarray(vector, dtype=np.float64)
    return n / np.linalg.norm(n)


def check_point(what: str, point: Point) -> None:
    """Raises ValueError if a point has not three finite coordinates."""
    if np.shape(point) != (3,) or not all(is_number(entry, -np.inf) for entry in point):
        raise ValueError(f"{what} must be three finite numbers, but is {point}")


def check_direction(what: str, vector: Point) -> None:
    """Raises ValueError if a direction has not three finite components, or its length is zero or overflows."""
    check_point(what, vector)
    if not any(vector):
        raise ValueError(f"{what} must not be zero")
    if not LEAST_LENGTH <= max(map(abs, vector)) <= 1.0 / LEAST_LENGTH:
        raise ValueError(
            f"{what} must have a length between {LEAST_LENGTH:g} and {1.0 / LEAST_LENGTH:g}, but is {vector}"
        )


def check_angle(what: str, angle: object) -> None:
    """Raises ValueError if an angle is not a finite number, or more than a turn in radians, as degrees are."""
    if not is_number(angle, -np.inf):
        raise ValueError(f"{what} must be a finite number of radians, but is {angle}")
    number = float(cast(float, angle))
    if abs(number) > 2.0 * np.pi:
        raise ValueError(
            f"{what} is in radians: {number:g} are {abs(number) / (2.0 * np.pi):.3g} turns; for {number:g} degrees "
            f"give {np.radians(number):.6g}, for several turns a table or function of time in radians"
        )


def _check_radius(what: str, radius: float) -> None:
    if not (is_number(radius) and radius > 0.0):
        raise ValueError(f"{what} must be a positive number of metres, but is {radius!r}")


@dataclass(frozen=True)
class Rotation:
    """Rotation of a foundation about a fixed axis, or about one that moves with the foundation's translation.

    Attributes:
        point: A point of the axis before any translation, metres.
        axis: Direction of the axis; need not have length 1.  Positive angles are right-handed about it.
        angle: In radians, as a function of time: a function, a table of (time, angle), or a number.

    Raises:
        ValueError: If the axis is zero, an entry is not finite, or a number as the angle more than a turn.
    """

    point: Point
    axis: Point
    angle: Amplitude

    def __post_init__(self) -> None:
        check_point("rotation: point", self.point)
        check_direction("rotation: axis", self.axis)
        if not callable(self.angle) and not isinstance(self.angle, LoadCurve | Sequence):
            check_angle("rotation: angle", self.angle)


@dataclass(frozen=True, eq=False)
class Turn:
    """A rotation by an angle in radians, right-handed, about the axis of length 1 through a point in metres, shapes
    (3,); more than a whole turn counts."""

    point: FloatArray
    axis: FloatArray
    angle: float

    @property
    def vector(self) -> FloatArray:
        """The angle times the axis, radians, shape (3,)."""
        return self.angle * self.axis

    @property
    def matrix(self) -> FloatArray:
        """R, shape (3, 3): x is R (X - point) + point (Rodrigues' formula)."""
        x, y, z = self.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.eye(3) + np.sin(self.angle) * cross + (1.0 - np.cos(self.angle)) * cross @ cross


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Rigid motion of a foundation from the place where it is given: a turn, if it has a `Rotation`, then a translation
    (3,) in metres."""

    translation: FloatArray
    turn: Turn | None = None

    @property
    def centre(self) -> FloatArray:
        """The point of the axis, moved with the translation, metres, shape (3,)."""
        return self.translation if self.turn is None else self.turn.point + self.translation

    @property
    def angle(self) -> float:
        """Radians."""
        return 0.0 if self.turn is None else self.turn.angle

    def times(self, factor: float) -> RigidMotion:
        """As much farther, and turned as much more."""
        turn = None if self.turn is None else replace(self.turn, angle=factor * self.turn.angle)
        return RigidMotion(factor * self.translation, turn)

    def undone(self, x: FloatArray) -> FloatArray:
        """Points x (k, 3) in metres in the coordinates in which the foundation is given, shape (k, 3)."""
        if self.turn is None:
            return x - self.translation
        return self.turned_back(x - self.centre) + self.turn.point

    def done(self, x: FloatArray) -> FloatArray:
        """Where points x (k, 3) in metres in the coordinates in which the foundation is given are now, (k, 3)."""
        return self.centre + self.turned(x if self.turn is None else x - self.turn.point)

    def turned(self, vectors: FloatArray) -> FloatArray:
        """Vectors (k, 3) fixed to the foundation, rotated with it."""
        return vectors if self.turn is None else vectors @ self.turn.matrix.T

    def turned_back(self, vectors: FloatArray) -> FloatArray:
        """Vectors (k, 3) of space in the coordinates in which the foundation is given."""
        return vectors if self.turn is None else vectors @ self.turn.matrix

    def since(self, before: RigidMotion, x: FloatArray) -> FloatArray:
        """Displacement in metres of the foundation's material at fixed points x (k, 3) since another time, along the
        arc; of small angles where the axis is another one."""
        way = np.broadcast_to(self.translation - before.translation, x.shape)
        if self.turn is None or before.turn is None:
            return way
        centre = 0.5 * (self.centre + before.centre)
        arc: FloatArray = np.cross(self.turn.vector - before.turn.vector, x - centre)
        return way + arc


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
    here, there = (np.zeros(3) if motion.turn is None else motion.turn.vector for motion in (one, other))
    return np.array_equal(one.translation, other.translation) and np.array_equal(here, there)


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


@dataclass(frozen=True, eq=False)
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


def since_at(now: Sequence[RigidMotion], before: Sequence[RigidMotion], part: IntArray, x: FloatArray) -> FloatArray:
    """`RigidMotion.since` at contact points x (m, 3) of several faces, of which each is on `part` (m,)."""
    moved = np.zeros_like(x)
    for number, (here, then) in enumerate(zip(now, before, strict=True)):
        on = part == number
        moved[on] = here.since(then, x[on])
    return moved
