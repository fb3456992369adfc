"""Hyperelastic materials: strain energies per undeformed volume, as expressions of UFL, and as materials of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..arrays import is_number
from ..fem.bodies import Material
from ..fem.compat import ufl


def neo_hookean(displacement: Any, mu: Any, lame: Any) -> Any:
    """Compressible neo-Hookean energy, mu/2 (I1 - 3 - 2 ln J) + lame/2 (ln J)^2 (Bonet and Wood 2008, eq. 6.27).

    Args:
        displacement: A function; or the deformation gradient F, 3 x 3.
        mu, lame: Lame's constants in pascals: numbers, constants or functions.
    """
    F = _gradient(displacement)
    J = ufl.det(F)
    return 0.5 * mu * (ufl.inner(F, F) - 3.0 - 2.0 * ufl.ln(J)) + 0.5 * lame * ufl.ln(J) ** 2


def mooney_rivlin(displacement: Any, c1: Any, c2: Any, bulk: Any) -> Any:
    """Mooney-Rivlin energy c1 (J^(-2/3) I1 - 3) + c2 (J^(-4/3) I2 - 3) + bulk/2 (J - 1)^2; constants in pascals."""
    F = _gradient(displacement)
    J, C = ufl.det(F), F.T * F
    first = ufl.tr(C)
    second = 0.5 * (first**2 - ufl.tr(C * C))
    return (
        c1 * (J ** (-2.0 / 3.0) * first - 3.0) + c2 * (J ** (-4.0 / 3.0) * second - 3.0) + 0.5 * bulk * (J - 1.0) ** 2
    )


def st_venant_kirchhoff(displacement: Any, mu: Any, lame: Any) -> Any:
    """Energy mu E : E + lame/2 (tr E)^2 of Green's strain E = (F^T F - I)/2: for large rotations and small strains."""
    F = _gradient(displacement)
    E = 0.5 * (F.T * F - ufl.Identity(3))
    return mu * ufl.inner(E, E) + 0.5 * lame * ufl.tr(E) ** 2


def _gradient(displacement: Any) -> Any:
    """F = I + grad u."""
    return displacement if displacement.ufl_shape == (3, 3) else ufl.Identity(3) + ufl.grad(displacement)


class NeoHookean(Material):
    """A neo-Hookean material (`neo_hookean`) by Young's modulus in pascals and Poisson's ratio of small strains;
    density in kg/m^3.  Arguments and errors as of `Material`."""

    law: ClassVar[str] = "neo-hookean"

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants of `energy` in pascals."""
        mu = self.young / (2.0 * (1.0 + self.poisson))
        return {"mu": mu, "lame": 2.0 * mu * self.poisson / (1.0 - 2.0 * self.poisson)}

    @staticmethod
    def energy(F: Any, mu: Any, lame: Any) -> Any:
        return neo_hookean(F, mu, lame)


class StVenantKirchhoff(NeoHookean):
    """Hooke's law between Green's strain and the second Piola-Kirchhoff stress (`st_venant_kirchhoff`): for large
    rotations and small strains.  It is what a `Material` becomes in large motions."""

    law = "st-venant-kirchhoff"

    @staticmethod
    def energy(F: Any, mu: Any, lame: Any) -> Any:
        return st_venant_kirchhoff(F, mu, lame)


@dataclass(frozen=True, init=False)
class MooneyRivlin(Material):
    """A Mooney-Rivlin material (`mooney_rivlin`).

    Attributes:
        c1, c2: In pascals, >= 0, not both 0; the shear modulus of small strains is 2 (c1 + c2).
        bulk: Bulk modulus in pascals, > 0.
        density: In kg/m^3, > 0; only gravity needs it.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    c1: float = 0.0
    c2: float = 0.0
    bulk: float = 0.0

    law: ClassVar[str] = "mooney-rivlin"

    def __init__(self, c1: float, c2: float, bulk: float, density: float | None = None):
        for name, value in (("c1", c1), ("c2", c2), ("bulk", bulk)):
            if not is_number(value, 0.0):
                raise ValueError(f"material: {name} must be a number of pascals, not negative, but is {value!r}")
        mu = 2.0 * (c1 + c2)
        if not 0.0 < mu < 1.5e3 * bulk:
            raise ValueError(f"material: c1 + c2 must be > 0, and small beside bulk, but is {c1 + c2:g} Pa")
        young, poisson = 9.0 * bulk * mu / (3.0 * bulk + mu), (3.0 * bulk - 2.0 * mu) / (6.0 * bulk + 2.0 * mu)
        super().__init__(young, poisson, density)
        for name, value in (("c1", c1), ("c2", c2), ("bulk", bulk)):
            object.__setattr__(self, name, value)

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants of `energy` in pascals."""
        return {"c1": self.c1, "c2": self.c2, "bulk": self.bulk}

    @staticmethod
    def energy(F: Any, c1: Any, c2: Any, bulk: Any) -> Any:
        return mooney_rivlin(F, c1, c2, bulk)


Hyperelastic = NeoHookean | MooneyRivlin
"""A material with a `law`, its constants and the energy of these."""


def hyperelastic(material: object) -> Hyperelastic:
    """A material of large motions; of small strains, isotropic, with Green's strain; ValueError if it is none."""
    if isinstance(material, Hyperelastic):
        return material
    if type(material) is Material:
        return StVenantKirchhoff(material.young, material.poisson, material.density)
    raise ValueError(
        "material of large motions must be NeoHookean, MooneyRivlin, StVenantKirchhoff or an isotropic Material, but "
        f"is {material!r}; for others give a NonlinearBody with your own energy"
    )
