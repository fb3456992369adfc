"""Finite rotations by their vectors: the axis times the angle in radians."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ...arrays import FloatArray

_AXIS: Final = 1e-7
"""Angle below which the axis of a rotation by whole turns is not known."""


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """R of a rotation vector (3,), shape (3, 3)."""
    from scipy.spatial.transform import Rotation  # messages are to come without it

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def turn_by_change(vector: FloatArray) -> FloatArray:
    """J, shape (3, 3): a change dv of a rotation vector (3,) turns by J dv in space (the left Jacobian of SO(3))."""
    angle, (x, y, z) = float(np.linalg.norm(vector)), vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-4:  # further terms are rounding errors
        first, second = 0.5, 1.0 / 6.0
    else:
        first, second = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    return np.eye(3) + first * cross + second * cross @ cross


def rotation_vector(R: FloatArray, near: FloatArray) -> FloatArray:
    """Of the vectors of a rotation R (3, 3), which differ by whole turns, the nearest to another (3,)."""
    from scipy.spatial.transform import Rotation

    vector = np.asarray(Rotation.from_matrix(R).as_rotvec())
    size, size_near = float(np.linalg.norm(vector)), float(np.linalg.norm(near))
    axis: FloatArray = near / size_near if size <= _AXIS and size_near > 0.0 else vector / (size or 1.0)
    angle = float(axis @ vector)
    turns = round((float(axis @ near) - angle) / (2.0 * math.pi))
    return (angle + 2.0 * math.pi * turns) * axis
