"""A linear elastic body: displacements, stresses and internal nodal forces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from ..arrays import FloatArray
from . import compat
from .compat import fem, ufl

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


class ElasticBody:
    """Small strains, Hooke's law, first-order elements.

    Args:
        domain: DOLFINx mesh, coordinates in metres.
        young: Young's modulus of this rank's own cells in pascals, shape (c,).
        poisson: Their Poisson's ratio, shape (c,).

    Attributes:
        V: Space of displacements.
        x: Coordinates of this rank's nodes in metres, shape (k, 3).
        young: Young's modulus, a function that is constant on every cell.
        poisson: Poisson's ratio, a function that is constant on every cell.
    """

    def __init__(self, domain: Any, young: FloatArray, poisson: FloatArray):
        self.domain = domain
        self.young, self.poisson = self._on_cells(young, "young"), self._on_cells(poisson, "poisson")
        self._mu = self._on_cells(young / (2.0 * (1.0 + poisson)), "mu")
        self._lame = self._on_cells(young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)), "lambda")
        self.V = compat.functionspace(domain, 1, (3,))
        self._test = ufl.TestFunction(self.V)
        self._owned = self.V.dofmap.index_map.size_local
        self.x = self._coordinates()
        self._u = fem.Function(self.V, name="displacement")
        self._internal_form = fem.form(ufl.inner(self._stress(self._u), strain(self._test)) * ufl.dx)

    def function(self, u: FloatArray, name: str = "displacement") -> Any:
        """DOLFINx Function of nodal vectors (k, 3) of this rank."""
        function = fem.Function(self.V, name=name)
        function.x.array[: 3 * self._owned] = u.ravel()
        function.x.scatter_forward()
        return function

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

    def largest_gradient(self, u: FloatArray) -> float:
        """Largest Frobenius norm of the displacement gradient at the cells' midpoints, over all ranks; u is (k, 3)."""
        W = compat.functionspace(self.domain, 0, family="DG")
        size, slope = fem.Function(W), ufl.grad(self.function(u))
        size.interpolate(fem.Expression(ufl.sqrt(ufl.inner(slope, slope)), compat.interpolation_points(W)))
        values = size.x.array
        # nan is propagated, which a reduction by MPI.MAX does not guarantee
        return float(np.max(self.domain.comm.allgather(float(np.max(values, initial=0.0)))))

    def nodes_of(self, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """This rank's nodes on boundary facets of any rank, sorted."""
        dofs = np.unique(fem.locate_dofs_topological(self.V, 2, facets))
        owned: npt.NDArray[np.int32] = dofs[dofs < self._owned].astype(np.int32)
        return owned

    def area_of(self, facets: npt.NDArray[np.int32]) -> FloatArray:
        """Integral of every hat function over boundary facets in m^2, this rank's nodes, shape (k,)."""
        one = self.function(np.ones((self._owned, 3)))
        return self._assemble(fem.form(ufl.inner(one, self._test) * self._ds(facets)))[:, 0]

    def normal_of(self, facets: npt.NDArray[np.int32]) -> FloatArray:
        """Integral of the outward normal against every hat function over boundary facets, m^2, shape (k, 3)."""
        n = ufl.FacetNormal(self.domain)
        return self._assemble(fem.form(ufl.inner(n, self._test) * self._ds(facets)))

    def surface_load(self, traction: FloatArray, facets: npt.NDArray[np.int32]) -> FloatArray:
        """Nodal forces in newtons of tractions in pascals on boundary facets; shapes (k, 3)."""
        return self._assemble(fem.form(ufl.inner(self.function(traction), self._test) * self._ds(facets)))

    def pressure_load(self, pressure: FloatArray, facets: npt.NDArray[np.int32]) -> FloatArray:
        """Nodal forces in newtons, shape (k, 3), of a pressure (k,) in pascals on boundary facets.

        The integral of -p n over each facet of the undeformed mesh; n, the outward normal, varies over a facet with
        four corners that is not plane.
        """
        p = self.function(np.repeat(pressure[:, None], 3, axis=1))[0]
        n = ufl.FacetNormal(self.domain)
        return self._assemble(fem.form(-p * ufl.inner(n, self._test) * self._ds(facets)))

    def volume_load(self, force: FloatArray) -> FloatArray:
        """Nodal forces in newtons of forces per volume in N/m^3; shapes (k, 3)."""
        return self._assemble(fem.form(ufl.inner(self.function(force), self._test) * ufl.dx))

    def weight(self, density: FloatArray, gravity: FloatArray) -> FloatArray:
        """Nodal forces in newtons, shape (k, 3).

        Args:
            density: Of this rank's own cells in kg/m^3, shape (c,).
            gravity: Acceleration in m/s^2, shape (3,).
        """
        g = self.function(np.broadcast_to(gravity, (self._owned, 3)))
        return self._assemble(fem.form(self._on_cells(density, "density") * ufl.inner(g, self._test) * ufl.dx))

    def _coordinates(self) -> FloatArray:
        """Of this rank's nodes, exactly those of the mesh: DOLFINx's tabulated ones have rounding errors, so that
        functions of place such as sqrt(x) have no value at x = 0."""
        x = np.empty((self._owned, 3))
        nodes = compat.cell_dofs(self.V).ravel()
        mine = nodes < self._owned
        x[nodes[mine]] = self.domain.geometry.x[compat.cell_geometry(self.domain).ravel()[mine]]
        return x

    def _ds(self, facets: npt.NDArray[np.int32]) -> Any:
        tags = compat.meshtags(self.domain, 2, facets, np.ones(len(facets), dtype=np.int32))
        return ufl.Measure("ds", domain=self.domain, subdomain_data=tags, subdomain_id=1)

    def _assemble(self, form: Any) -> FloatArray:
        vector = fem.petsc.assemble_vector(form)
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        values: FloatArray = vector.array.reshape(-1, 3).copy()
        vector.destroy()
        return values

    def _stress(self, u: Any) -> Any:
        return 2.0 * self._mu * strain(u) + self._lame * ufl.tr(strain(u)) * ufl.Identity(3)

    def _on_cells(self, values: FloatArray, name: str) -> Any:
        function = fem.Function(compat.functionspace(self.domain, 0, family="DG"), name=name)
        function.x.array[compat.cell_dofs(function.function_space)[: len(values), 0]] = values
        function.x.scatter_forward()
        return function


def strain(u: Any) -> Any:
    return ufl.sym(ufl.grad(u))
