"""Rigid foundations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from ...arrays import FloatArray, is_number

Point = tuple[float, float, float]

_DIFFERENCE = 1e-5
"""Relative step of the finite differences for a normal: the cube root of the rounding error."""


LEAST_LENGTH = 1e-100
"""Smallest length of a direction, and the inverse of the largest: squares do not underflow or overflow."""

_SAME = 1e-12
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
        distance: FloatArray = (x - np.asarray(self.point)) @ _unit(self.normal_vector)
        return distance

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
        across: FloatArray = r - np.outer(r @ axis, axis)
        return across


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

    def signed_distance(self, x: FloatArray) -> FloatArray:
        distance: FloatArray = self._values(x) / np.linalg.norm(self._slope(x), axis=1)
        return distance

    def normal(self, x: FloatArray) -> FloatArray:
        slope = self._slope(x)
        unit: FloatArray = slope / np.linalg.norm(slope, axis=1)[:, None]
        return unit

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
            h = _DIFFERENCE * max(float(np.max(np.abs(x))), 1e-300)
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


def _check_radius(what: str, radius: float) -> None:
    if not (is_number(radius) and radius > 0.0):
        raise ValueError(f"{what} must be a positive number of metres, but is {radius!r}")
