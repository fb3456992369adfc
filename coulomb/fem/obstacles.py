"""Rigid foundations that a body may touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays import FloatArray


class RigidFoundation(Protocol):
    """The free side of a rigid foundation."""

    def signed_distance(self, x: FloatArray) -> FloatArray:
        """Distance in metres of the points x (k, 3) from the foundation, negative inside it, shape (k,)."""
        ...

    def normal(self, x: FloatArray) -> FloatArray:
        """Unit normals out of the foundation, into the free space, at the points x (k, 3), shape (k, 3)."""
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

    point: tuple[float, float, float]
    normal_vector: tuple[float, float, float]

    def __post_init__(self) -> None:
        for name, vector in (("point", self.point), ("normal", self.normal_vector)):
            if len(vector) != 3 or not np.all(np.isfinite(vector)):
                raise ValueError(f"plane: {name} must be three finite numbers, but is {vector}")
        if not np.linalg.norm(self.normal_vector) > 0.0:
            raise ValueError("plane: the normal must not be zero")

    def signed_distance(self, x: FloatArray) -> FloatArray:
        distance: FloatArray = (x - np.asarray(self.point)) @ self._unit
        return distance

    def normal(self, x: FloatArray) -> FloatArray:
        return np.tile(self._unit, (len(x), 1))

    @property
    def _unit(self) -> FloatArray:
        n = np.asarray(self.normal_vector, dtype=np.float64)
        unit: FloatArray = n / np.linalg.norm(n)
        return unit
