"""What the user says of the contact: which face, which foundation, how it rubs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .fem.fields import Coefficient, Motion
from .fem.obstacles import RigidFoundation
from .fem.surface import Normals


@dataclass(frozen=True)
class Contact:
    """Which face may touch which foundation, and how it rubs there; exactly one of the two friction laws.

    Attributes:
        face: Name of the contact face.
        friction: Coulomb's coefficient F >= 0, constant or a function of place.
        slip_stress: Tresca friction: the shear stress in pascals at which the face slips, whatever the pressure;
            constant or a function of place.
        foundation: Rigid foundation; by default the plane of the face itself (gap 0).
        normals: Whose normals the contact frames take, "foundation" or "body" (`contact_surface`).
        motion: Translation of the foundation in the course of time, metres.

    Raises:
        ValueError: If not exactly one law is given, or its number is negative or not finite.
    """

    face: str
    friction: Coefficient | None = None
    slip_stress: Coefficient | None = None
    foundation: RigidFoundation | None = None
    normals: Normals = "foundation"
    motion: Motion | None = None

    def __post_init__(self) -> None:
        if (self.friction is None) == (self.slip_stress is None):
            raise ValueError("contact: give either friction (Coulomb) or slip_stress (Tresca), one of the two")
        for name, value in (("friction", self.friction), ("slip_stress", self.slip_stress)):
            if value is not None and not callable(value) and not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"contact: {name} must be a number >= 0, but is {value}")
