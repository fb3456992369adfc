"""What the work of loads owes to the places of nodes, whose values stay."""

from __future__ import annotations

from typing import Final

import numpy as np

from ...arrays import FloatArray, Int32Array
from ..compat import fem, ufl
from ..meshes import NamedMesh
from .displacement_space import DisplacementSpace
from .loads import BodyForce, NodalForce, Pressure, ThermalLoad, Timed, TotalForce, Traction, VolumeForce, Weight


class _OfWork(DisplacementSpace):
    """A space where loads are integrated to the derivatives, along places, of their work along v (k, 3)."""

    def __init__(self, space: DisplacementSpace, v: FloatArray):
        vars(self).update(vars(space))
        self._along = space.function(v)

    def surface_load(self, traction: FloatArray, facets: Int32Array) -> FloatArray:
        return self.along_places(ufl.inner(self.function(traction), self._along), self.measure(facets))

    def pressure_load(self, pressure: FloatArray, facets: Int32Array) -> FloatArray:
        """That of n da is (div w n - grad w^T n) da."""
        p = self.function(np.repeat(pressure[:, None], 3, axis=1))[0]
        n, way = ufl.FacetNormal(self.domain), ufl.grad(self._test)
        turned = ufl.tr(way) * n - ufl.dot(way.T, n)
        return self._assemble(fem.form(-p * ufl.inner(turned, self._along) * self.measure(facets)))

    def volume_load(self, force: FloatArray, of_cells: FloatArray | None = None) -> FloatArray:
        density = 1.0 if of_cells is None else self._on_cells(of_cells, "density")
        return self.along_places(density * ufl.inner(self.function(force), self._along), ufl.dx)


_INTEGRATED: Final = Traction | Pressure | BodyForce | Weight | VolumeForce


def load_along_places(load: Timed, space: DisplacementSpace, mesh: NamedMesh, v: FloatArray) -> FloatArray:
    """Derivatives, along the places of nodes, of the work of a load along v at its factor 1, newtons, both of shape (k,
    3), where its values at nodes stay; 0 of thermal loads, which are of the stress; collective.

    Raises:
        ValueError: On every rank, if they are not known of such a load.
    """
    if isinstance(load, NodalForce | ThermalLoad):
        return np.zeros_like(v)
    if isinstance(load, TotalForce):  # as its area stretches, the traction falls
        area = space.area_of(mesh.facets(load.face, load.kind))
        sums: FloatArray = mesh.comm.allreduce(np.append(area @ v, area.sum()))
        traction = np.asarray(load.force, dtype=np.float64) / (mesh.copies * sums[3])
        return Traction(load.face, tuple(traction)).nodal_force(_OfWork(space, v - sums[:3] / sums[3]), mesh)
    if isinstance(load, _INTEGRATED):
        return load.nodal_force(_OfWork(space, v), mesh)
    raise ValueError(f"derivatives along places are not known of a {load.kind}")
