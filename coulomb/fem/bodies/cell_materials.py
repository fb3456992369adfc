"""Elastic constants of the cells of a body, and their names in the files of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from .orthotropic import perpendicular, refuse_indefinite, stiffness, stress_of, thermal_strain

ISOTROPIC = ("young", "poisson")
"""Fields of a body without orthotropic cells: numbers."""

ORTHOTROPIC = ("orthotropic_young", "orthotropic_poisson", "orthotropic_shear", "direction_1", "direction_2")
"""Fields of a body with orthotropic cells: three numbers along the directions; and these."""

EXPANSION, ORTHOTROPIC_EXPANSION = "expansion", "orthotropic_expansion"
"""Fields of a body with a temperature: a number, or with orthotropic cells three."""

VECTORS = (*ORTHOTROPIC, ORTHOTROPIC_EXPANSION)
"""Fields with three numbers per cell; the others have one."""

FIELDS = (*ISOTROPIC, EXPANSION, *VECTORS)


@dataclass(frozen=True)
class Directional:
    """Orthotropic constants of c cells; isotropic cells have three equal ones.

    Attributes:
        young: E1, E2, E3 in pascals, shape (c, 3).
        poisson: nu12, nu13, nu23, shape (c, 3).
        shear: G12, G13, G23 in pascals, shape (c, 3).
        axes: The directions as rows, perpendicular unit vectors, shape (c, 3, 3).
    """

    young: FloatArray
    poisson: FloatArray
    shear: FloatArray
    axes: FloatArray


@dataclass(frozen=True)
class CellMaterials:
    """Elastic constants of this rank's own c cells.

    Attributes:
        young: Young's modulus in pascals, shape (c,); of an orthotropic cell E1.
        poisson: Poisson's ratio, shape (c,); of an orthotropic cell nu12.
        directional: Orthotropic constants of all cells; None if no cell of any rank is orthotropic.
        expansion: Coefficient of thermal expansion in 1/K, shape (c,), or with orthotropic cells along their
            directions, shape (c, 3); None without a temperature.
    """

    young: FloatArray
    poisson: FloatArray
    directional: Directional | None = None
    expansion: FloatArray | None = None

    @property
    def stiffness(self) -> FloatArray | None:
        """The 21 constants of the stiffness in space, pascals, shape (c, 21); None without orthotropic cells."""
        given = self.directional
        return None if given is None else stiffness(given.young, given.poisson, given.shear, given.axes)

    def thermal_stress(self, constants: FloatArray | None) -> tuple[FloatArray, FloatArray] | None:
        """Stiffness times thermal strain, per kelvin, in Pa/K: the pressure, shape (c,), or with orthotropic cells the
        stress, shape (c, 6); and this times the thermal strain, J/(m^3 K^2), shape (c,).  None without a temperature.

        Args:
            constants: `stiffness`.
        """
        if self.expansion is None:
            return None
        if self.directional is None or constants is None:
            pressure: FloatArray = self.young * self.expansion / (1.0 - 2.0 * self.poisson)
            return pressure, 3.0 * pressure * self.expansion
        strain = thermal_strain(self.expansion, self.directional.axes)
        stress = stress_of(constants, strain)
        return stress, np.einsum("ci,ci->c", stress, strain)

    @property
    def fields(self) -> dict[str, FloatArray]:
        """As in solution.xdmf."""
        given = self.directional
        if given is None:
            found = dict(zip(ISOTROPIC, (self.young, self.poisson), strict=True))
        else:
            values = (given.young, given.poisson, given.shear, given.axes[:, 0], given.axes[:, 1])
            found = dict(zip(ORTHOTROPIC, values, strict=True))
        if self.expansion is not None:
            found[EXPANSION if given is None else ORTHOTROPIC_EXPANSION] = self.expansion
        return found

    @staticmethod
    def of_fields(fields: Mapping[str, FloatArray]) -> CellMaterials:
        """The constants from `fields`.

        Raises:
            KeyError: If one is missing.
            ValueError: If orthotropic constants have no positive strain energy, or directions are parallel.
        """
        if ORTHOTROPIC[0] not in fields:
            return CellMaterials(fields["young"], fields["poisson"], None, fields.get(EXPANSION))
        young, poisson, shear, first, second = (fields[name] for name in ORTHOTROPIC)
        if not (np.all(young > 0.0) and np.all(shear > 0.0)):
            raise ValueError("material: Young's and shear moduli must be positive")
        refuse_indefinite(young, poisson)
        given = Directional(young, poisson, shear, perpendicular(first, second))
        return CellMaterials(young[:, 0], poisson[:, 0], given, fields.get(ORTHOTROPIC_EXPANSION))
