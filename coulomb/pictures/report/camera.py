"""Camera of a picture: as close as possible with nothing cut off, and with the aspect ratio of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import FloatArray

ANGLE = 30.0
"""Opening angle in degrees of a camera that sees the bounding sphere: the strength of the perspective."""

SHAPES = 0.2, 6.0
"""Smallest and largest aspect ratio of a picture; thinner scenes get empty space."""

MARGIN = 0.015
"""Empty border on each side, over width and height: room for the width of lines."""


@dataclass(frozen=True)
class Camera:
    """A camera of VTK's.

    Attributes:
        position: Its position, (3,).
        focal_point: The point in the centre of view, (3,).
        up: Upward direction, (3,), perpendicular to the direction of view.
        opening: Without perspective half the height of what is seen, metres; else the tangent of half the opening.
        centre: Offset of the picture's centre from the axis, over half the width and height.
        parallel: Whether there is no perspective.
        size: Size of the picture in pixels, width and height.
    """

    position: FloatArray
    focal_point: FloatArray
    up: FloatArray
    opening: float
    centre: tuple[float, float]
    parallel: bool
    size: tuple[int, int]

    @property
    def axes(self) -> FloatArray:
        """Directions of x, y and z in the picture, right and up, (3, 2)."""
        forward = self.focal_point - self.position
        right = np.cross(forward, self.up)
        found: FloatArray = np.column_stack([right / np.linalg.norm(right), self.up])
        return found

    def aim(self, plotter: Any) -> None:
        """Apply it to a plotter."""
        camera = plotter.camera
        camera.position, camera.focal_point, camera.up = map(tuple, (self.position, self.focal_point, self.up))
        camera.SetParallelProjection(self.parallel)
        if self.parallel:
            camera.SetParallelScale(self.opening)
        else:
            camera.SetViewAngle(2.0 * float(np.degrees(np.arctan(self.opening))))
        camera.SetWindowCenter(*self.centre)
        camera.is_set = True
        plotter.renderer.ResetCameraClippingRange()


def beside(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction of view of a face with this outward normal and of the body drawn apart from it, from the side, and
    upward direction."""
    one, other = _along(normal)
    return 0.8 * normal + 0.9 * one - 1.5 * other, normal


def looking_at(normal: FloatArray, turned: bool = False) -> tuple[FloatArray, FloatArray]:
    """Direction of view of a face with this outward normal, inclined to it in two directions, and upward direction;
    `turned` by a quarter turn about the normal."""
    along, across = _along(normal)
    if turned:
        along, across = across, -along
    return normal + 0.25 * along + 0.6 * across, -across


def _along(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two directions along a face, the first as near to an axis as can be; the second is the normal times the first."""
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    one = axis - (axis @ normal) * normal
    one /= np.linalg.norm(one)
    return one, np.cross(normal, one)


def framing(points: FloatArray, direction: FloatArray, up: FloatArray, most: tuple[int, int], parallel: bool) -> Camera:
    """The camera with the closest view of all points.

    Args:
        points: (k, 3).
        direction: From the points to the camera.
        up: Upward direction, not parallel to `direction`.
        most: Maximum pixels, width and height; the picture reaches one of them.
        parallel: Whether there is no perspective.
    """
    back = direction / np.linalg.norm(direction)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    above = np.cross(back, right)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0
    distance = radius / np.sin(np.radians(0.5 * ANGLE))
    across, along = (points - middle) @ right, (points - middle) @ above
    if not parallel:
        depth = distance - (points - middle) @ back
        across, along = across / depth, along / depth
    least = 1e-6 * (radius if parallel else 1.0)
    half = [max(0.5 * float(np.ptp(seen)), least) * (1.0 + 2.0 * MARGIN) for seen in (across, along)]
    width = max(half[0], SHAPES[0] * half[1])
    height = max(half[1], width / SHAPES[1])
    at = [0.5 * float(seen.min() + seen.max()) for seen in (across, along)]
    shape = width / height
    pixels = (most[0], round(most[0] / shape)) if shape > most[0] / most[1] else (round(most[1] * shape), most[1])
    return Camera(
        position=middle + distance * back,
        focal_point=middle,
        up=above,
        opening=height,
        centre=(at[0] / width, at[1] / height),
        parallel=parallel,
        size=pixels,
    )
