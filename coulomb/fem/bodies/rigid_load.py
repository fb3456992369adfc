"""Force and moment on a rigid body, and directions, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from .rigid_modes import RigidPart

SMALL = 1e-3
"""Parts of loads and directions below this are not worth a word."""


@dataclass(frozen=True)
class RigidLoad:
    """Force and moment of loads along the free motions of a component.

    Attributes:
        component: Number of the component.
        part: The component.
        force: In newtons, shape (3,).
        moment: About the centre of the component, newton metres, shape (3,).
    """

    component: int
    part: RigidPart
    force: FloatArray
    moment: FloatArray

    @property
    def size(self) -> float:
        """Of the force, or of the moment over the radius, newtons."""
        return max(float(np.linalg.norm(self.force)), float(np.linalg.norm(self.moment)) / self.part.radius)

    def scaled(self, factor: float) -> str:
        """The amounts of a part of it, in words."""
        return " and ".join(amount for amount, _ in self._said(factor))

    def __str__(self) -> str:
        return " and ".join(f"{where} with {amount}" for amount, where in self._said(1.0))

    def _said(self, factor: float) -> list[tuple[str, str]]:
        """Amount and direction of the force and of the moment, those that are no rounding errors."""
        force, moment = (float(np.linalg.norm(vector)) for vector in (self.force, self.moment))
        said = []
        if force > SMALL * self.size:
            said.append((f"{in_units(factor * force)}N", f"along {direction_in_words(self.force, SMALL)}"))
        if moment > SMALL * self.size * self.part.radius:
            place = ", ".join(f"{value:.4g}" for value in tidy(self.part.centre, self.part.radius))
            axis = direction_in_words(self.moment, SMALL)
            said.append((f"{in_units(factor * moment)}N m", f"around {axis} through ({place})"))
        return said


def in_units(value: float) -> str:
    """A number with three digits and the prefix of its unit, "7.3 M"."""
    for power, prefix in ((9, "G"), (6, "M"), (3, "k")):
        if abs(value) >= 0.9995 * 10.0**power:
            return f"{value / 10.0**power:.3g} {prefix}"
    return f"{value:.3g} "


def direction_in_words(vector: FloatArray, part: float = SMALL) -> str:
    """x, y, z, or the unit vector as (0.96, 0.29, 0), without components below a part of it."""
    unit = tidy(vector / (float(np.linalg.norm(vector)) or 1.0), part / SMALL)
    for axis, name in enumerate("xyz"):
        if np.count_nonzero(unit) == 1 and unit[axis] != 0.0:
            return name if unit[axis] > 0.0 else f"-{name}"
    return f"({', '.join(f'{value:.2g}' for value in unit)})"


def tidy(vector: FloatArray, size: float) -> FloatArray:
    """Without components that are rounding errors beside a size."""
    tidy: FloatArray = np.where(np.abs(vector) < SMALL * size, 0.0, vector) + 0.0
    return tidy
