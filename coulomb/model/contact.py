"""What the user says of the contact: which face, which foundation, how it rubs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.elasticity import Elasticity
from ..fem.obstacles import Moved, RigidFoundation
from ..fem.surface import ContactSurface, Normals, contact_surface, joined
from ..fem.user_values import Coefficient, Motion, evaluate_motion, evaluate_numbers, on_all_ranks


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

    @property
    def coulomb(self) -> bool:
        """Whether friction is Coulomb's; else Tresca's."""
        return self.friction is not None


class ContactFaces:
    """The contact faces of a body: their foundations at any time, and the surface that they make together.

    Args:
        contacts: The faces.
        comm: The ranks.
        foundations: Those of the contacts, by default; None is the face's own plane.

    Attributes:
        foundations: Where they were given, before any motion.

    Raises:
        ValueError: If there is none, or two have different laws.
    """

    def __init__(
        self,
        contacts: Sequence[Contact],
        comm: MPI.Comm,
        foundations: Sequence[RigidFoundation | None] | None = None,
    ):
        if not contacts or len({contact.coulomb for contact in contacts}) > 1:
            raise ValueError("contact: give one face or several, all with friction (Coulomb) or all with slip_stress")
        self._contacts, self._comm = contacts, comm
        self.foundations = [contact.foundation for contact in contacts] if foundations is None else foundations

    def against(self, foundations: Sequence[RigidFoundation]) -> ContactFaces:
        """The same faces against other foundations."""
        return ContactFaces(self._contacts, self._comm, foundations)

    def motions(self, time: float) -> FloatArray:
        """Translations of the foundations at a time in metres, shape (faces, 3); collective."""
        motions: FloatArray = on_all_ranks(
            lambda: np.array([evaluate_motion(c.motion, time, "contact: foundation") for c in self._contacts]),
            "",
            self._comm,
        )
        return motions

    def surface(self, elasticity: Elasticity, motions: FloatArray) -> ContactSurface:
        """Nodes, frames and gaps with the foundations moved so far; collective."""
        moved = [Moved(f, m) if f and np.any(m) else f for f, m in zip(self.foundations, motions, strict=True)]
        faces = zip(self._contacts, moved, strict=True)
        return joined(elasticity, [contact_surface(elasticity, c.face, f, c.normals) for c, f in faces])

    def coefficient(self, surface: ContactSurface) -> FloatArray:
        """Friction, or slip stress in pascals, at this rank's contact nodes, shape (m,); collective."""
        values: FloatArray = np.empty(len(surface.nodes))
        for part, contact in enumerate(self._contacts):
            law, given = ("friction", contact.friction) if contact.coulomb else ("slip_stress", contact.slip_stress)
            assert given is not None
            here = surface.part == part
            values[here] = evaluate_numbers(given, surface.x[here], f"contact: {law}", self._comm)
        return values
