"""Finite rotations by their vectors: the axis times the angle in radians."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ...arrays import FloatArray

_AXIS: Final = 1e-7
"""Sine of half an angle below which the axis of a rotation by whole turns is not known."""


def cross_matrix(v: FloatArray) -> FloatArray:
    """The matrix of v x, shape (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """R of a rotation vector (3,), shape (3, 3) (Rodrigues' formula)."""
    angle, cross = float(np.linalg.norm(vector)), cross_matrix(vector)
    half = 0.5 * angle
    first = float(np.sinc(angle / math.pi))
    second = 0.5 * float(np.sinc(half / math.pi)) ** 2
    R: FloatArray = np.eye(3) + first * cross + second * cross @ cross
    return R


def turn_by_change(vector: FloatArray) -> FloatArray:
    """J, shape (3, 3): a change dv of a rotation vector (3,) turns by J dv in space (the left Jacobian of SO(3))."""
    angle, cross = float(np.linalg.norm(vector)), cross_matrix(vector)
    if angle < 1e-4:  # further terms are rounding errors
        first, second = 0.5, 1.0 / 6.0
    else:
        first, second = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    turned: FloatArray = np.eye(3) + first * cross + second * cross @ cross
    return turned


def rotation_vector(R: FloatArray, near: FloatArray) -> FloatArray:
    """Of the vectors of a rotation R (3, 3), which differ by whole turns, the nearest to another (3,)."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], 0.0, 0.0, 0.0],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], 0.0, 0.0],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], 0.0],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    *q, w = np.linalg.eigh(K)[1][:, -1]  # the unit quaternion, of either sign (I. Y. Bar-Itzhack 2000)
    sine, angle_near = float(np.linalg.norm(q)), float(np.linalg.norm(near))
    whole = sine <= _AXIS and angle_near > 0.0
    axis: FloatArray = near / angle_near if whole else np.array(q) / (sine or 1.0)
    angle = 2.0 * math.atan2(float(axis @ q), w)
    turns = round((float(axis @ near) - angle) / (2.0 * math.pi))
    vector: FloatArray = (angle + 2.0 * math.pi * turns) * axis
    return vector
