"""From where a picture is taken: as near as can be with nothing cut off, and in the shape of what is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arrays import FloatArray

ANGLE = 30.0
"""Opening in degrees of a camera that sees the ball round the scene: how strong the perspective is."""

SHAPES = 0.2, 6.0
"""Least and largest width over height of a picture: what is thinner gets empty space beside it."""

MARGIN = 0.015
"""Empty border on each side, over width and height: room for the width of lines."""


@dataclass(frozen=True)
class Camera:
    """A camera of VTK's.

    Attributes:
        position: Where it is, (3,).
        focal_point: What it looks at, (3,).
        up: What is up, (3,), at a right angle to where it looks.
        opening: Without perspective half the height of what is seen, metres; else the tangent of half the opening.
        centre: By how many halves of width and height the middle of the picture is off the axis.
        parallel: Whether there is no perspective.
        size: Of the picture in pixels, width and height.
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
        """Of x, y and z the direction in the picture, right and up, (3, 2)."""
        forward = self.focal_point - self.position
        right = np.cross(forward, self.up)
        found: FloatArray = np.column_stack([right / np.linalg.norm(right), self.up])
        return found

    def aim(self, plotter: Any) -> None:
        """Let a plotter look through it."""
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


def framing(points: FloatArray, direction: FloatArray, up: FloatArray, most: tuple[int, int], parallel: bool) -> Camera:
    """The camera that sees all points, and as little else as can be.

    Args:
        points: (k, 3).
        direction: From the points to the camera.
        up: What is up, not along `direction`.
        most: Pixels, width and height; the picture has one of them.
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
