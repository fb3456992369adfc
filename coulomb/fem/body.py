"""A linear elastic body: displacements, stresses and internal nodal forces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..arrays import FloatArray
from . import compat
from .compat import fem, ufl
from .displacement_space import DisplacementSpace

LOCKING_ABOVE = 0.49
"""Poisson's ratio above which first-order elements lock: nearly constant volume prevents their bending."""


@dataclass(frozen=True)
class Material:
    """Isotropic, linear elastic.

    Attributes:
        young: Young's modulus in pascals, > 0.
        poisson: Poisson's ratio, in (-1, 0.5).
        density: Density in kg/m^3, > 0; only gravity needs it.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    young: float
    poisson: float
    density: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.young) and self.young > 0.0):
            raise ValueError(f"material: young must be a positive number of pascals, but is {self.young}")
        if not -1.0 < self.poisson < 0.5:
            raise ValueError(f"material: poisson must be in (-1, 0.5), but is {self.poisson}")
        if self.density is not None and not (math.isfinite(self.density) and self.density > 0.0):
            raise ValueError(f"material: density must be a positive number of kg/m^3, but is {self.density}")


class ElasticBody(DisplacementSpace):
    """Small strains, Hooke's law, elements of the order of the mesh.

    Args:
        domain: DOLFINx mesh, coordinates in metres.
        young: Young's modulus of this rank's own cells in pascals, shape (c,).
        poisson: Their Poisson's ratio, shape (c,).

    Attributes:
        young: Young's modulus, a function that is constant on every cell.
        poisson: Poisson's ratio, a function that is constant on every cell.
    """

    def __init__(self, domain: Any, young: FloatArray, poisson: FloatArray):
        super().__init__(compat.functionspace(domain, compat.geometry_degree(domain), (3,)))
        self._dx = cell_measure(domain)
        self.young, self.poisson = self._on_cells(young, "young"), self._on_cells(poisson, "poisson")
        self._mu = self._on_cells(young / (2.0 * (1.0 + poisson)), "mu")
        self._lame = self._on_cells(young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)), "lambda")
        self._u = fem.Function(self.V, name="displacement")
        self._internal_form = fem.form(ufl.inner(self._stress(self._u), strain(self._test)) * self._dx)

    def internal_force(self, u: FloatArray) -> FloatArray:
        """Internal nodal forces of u in newtons, assembled from the stress without K; shapes (k, 3)."""
        self._u.x.array[: 3 * self._owned] = u.ravel()
        self._u.x.scatter_forward()
        return self._assemble(self._internal_form)

    def von_mises(self, u: Any) -> Any:
        """Von Mises stress in pascals at the cells' midpoints, a DG0 Function; u is a Function of V."""
        s = self._stress(u)
        deviator = s - ufl.tr(s) / 3.0 * ufl.Identity(3)
        W = compat.functionspace(self.domain, 0, family="DG")
        stress = fem.Function(W, name="von_mises_stress")
        equivalent = ufl.sqrt(1.5 * ufl.inner(deviator, deviator))
        stress.interpolate(fem.Expression(equivalent, compat.interpolation_points(W)))
        return stress

    def _stress(self, u: Any) -> Any:
        return 2.0 * self._mu * strain(u) + self._lame * ufl.tr(strain(u)) * ufl.Identity(3)


def cell_measure(domain: Any) -> Any:
    """UFL's measure of the cells for products of stress and strain.

    In first order the points are UFL's choice.  In second order the rule is exact for a constant stress on curved
    cells (degree 3 on tetrahedra, in each direction 5 on hexahedra): UFL would take up to five times as many points.
    """
    if compat.geometry_degree(domain) == 1:
        return ufl.dx(domain=domain)
    degree = 3 if domain.topology.cell_type.name == "tetrahedron" else 5
    return ufl.dx(domain=domain, metadata={"quadrature_degree": degree})


def strain(u: Any) -> Any:
    return ufl.sym(ufl.grad(u))
