"""A linear elastic body: displacements, stresses and internal nodal forces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ...native import address, kernels
from .. import compat
from ..compat import fem, ufl
from .displacement_space import DisplacementSpace
from .materials import PAIRS, UPPER, CellMaterials
from .mean_dilatation import MEAN_ABOVE, linear_hexahedra, mean_dilatation

# Internal nodal forces of linear hexahedra with an isotropic material, by a kernel in C for several cells at once.
#
# FFCx's kernel takes 25 to 38 times as long (p = 10 to 24): it treats one cell after the other, and does not use that
# shape functions are products.  Both integrate the same stress with the same points and agree to rounding.


class HexahedralForces:
    """Nodal forces of the cells that this rank owns, on linear hexahedra; mu and lame are constant on every cell,
    pascals."""

    def __init__(self, V: Any, mu: Any, lame: Any):
        self._V = V
        self._cells = int(V.mesh.topology.index_map(3).size_local)
        self._nodes, self._points = (
            np.ascontiguousarray(table[: self._cells], dtype=np.int32)
            for table in (compat.cell_dofs(V), compat.cell_geometry(V.mesh))
        )
        self._mu, self._lame = (
            of.x.array[compat.cell_dofs(of.function_space)[: self._cells, 0]].astype(np.float64) for of in (mu, lame)
        )

    def __call__(self, u: FloatArray) -> FloatArray:
        """What this rank's cells add at its nodes and ghosts, newtons, for displacements there, metres; shapes (n,)."""
        x, u = (np.ascontiguousarray(of, dtype=np.float64) for of in (self._V.mesh.geometry.x, u))
        forces = np.zeros(u.size)
        tables = (self._nodes, self._points, x, self._mu, self._lame, u, forces)
        kernels().hexahedral_forces(self._cells, *map(address, tables))
        return forces


STRESSES = (
    "von_mises_stress",
    *(f"stress_{'xyz'[i]}{'xyz'[j]}" for i, j in PAIRS),
    *(f"principal_stress_{number}" for number in (1, 2, 3)),
)
"""Names of the stresses of a cell: tension is positive, the first principal stress is the largest."""


class ElasticBody(DisplacementSpace):
    """Small strains, Hooke's law: stress = stiffness (strain - thermal strain); elements of the order of the mesh.

    Isotropic bodies have the stress 2 mu strain + lambda tr(strain) I; if a cell is orthotropic, all cells have the 21
    constants of a stiffness (`orthotropic`).  `constants` are those of the materials as functions that are constant on
    every cell, by their names in solution.xdmf.

    On isotropic hexahedra of first order near incompressibility the dilatation is its mean over the cell
    (`mean_dilatation`): the stress has bulk D I in place of bulk tr(strain) I.
    """

    def __init__(self, domain: Any, materials: CellMaterials):
        super().__init__(compat.functionspace(domain, compat.geometry_degree(domain), (3,)))
        self._dx = cell_measure(domain)
        self.constants = {name: self._on_cells(values, name) for name, values in materials.fields.items()}
        stiffness, self._mean = materials.stiffness, None
        if stiffness is None:
            young, poisson = materials.young, materials.poisson
            mu, lame = young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
            mean = (poisson > MEAN_ABOVE) & linear_hexahedra(domain)
            self._mean = mean_dilatation(self.V, self._dx, mean, lame + 2.0 / 3.0 * mu)
            lame = np.where(mean, -2.0 / 3.0 * mu, lame)
            self._mu, self._lame = self._on_cells(mu, "mu"), self._on_cells(lame, "lambda")
        self._stiffness = None if stiffness is None else self._on_cells(stiffness, "stiffness")
        thermal = materials.thermal_stress(stiffness)
        self._per_kelvin = None if thermal is None else self._on_cells(thermal[0], "thermal_stress")
        self._thermal_energy = None if thermal is None else self._on_cells(thermal[1], "thermal_energy")
        self._u = fem.Function(self.V, name="displacement")
        self._last_force: tuple[FloatArray, FloatArray] | None = None
        by_kernel = stiffness is None and linear_hexahedra(domain)
        self._forces = HexahedralForces(self.V, self._mu, self._lame) if by_kernel else None
        self._internal_form = fem.form(ufl.inner(self._stress(self._u), strain(self._test)) * self._dx)

    def internal_force(self, u: FloatArray) -> FloatArray:
        """Internal nodal forces of u in newtons, assembled from the stress without K; shapes (k, 3); collective.

        Without the thermal stress, of which the nodal forces are a load.  Those of the last u are kept: certificate,
        energies, reactions and strains of an answer ask for the same.
        """
        known = self._last_force is not None and np.array_equal(u, self._last_force[0])
        if self._last_force is None or not self.comm.allreduce(known, op=MPI.LAND):
            self._last_force = u.copy(), self._force_of(u)
        return self._last_force[1].copy()

    def _force_of(self, u: FloatArray) -> FloatArray:
        self._u.x.array[: 3 * self._owned] = u.ravel()
        self._u.x.scatter_forward()
        if self._forces is None:
            return self._assemble(self._internal_form)
        forces = self._forces(self._u.x.array)
        if self._mean is not None:
            forces += self._mean.times(self._u.x.array)
        return self._added(forces, self._internal_form)

    def work_in_cells(self, u: FloatArray, v: FloatArray, change: FloatArray | None = None) -> FloatArray:
        """Work of the stress of u along v in every cell of this rank, joules; u and v (k, 3) in metres, at a change of
        temperature (k,) in kelvin; collective."""
        of, along = (self.function(one, "displacement") for one in (u, v))
        stress = self._stress(of) if change is None else self._stress(of) - self._thermal_stress(change)
        work = self.integrals_in_cells(ufl.inner(stress, strain(along)), self._dx)
        if self._mean is not None:
            work[self._mean.cells] += self._mean.k * self._mean.of(of.x.array) * self._mean.of(along.x.array)
        return work

    def work_along_places(self, u: FloatArray, v: FloatArray, change: FloatArray | None = None) -> FloatArray:
        """Derivatives, along the places of this rank's nodes, of the work of the stress of u along v, whose values at
        nodes stay, newtons; all of shape (k, 3); collective.

        With s and t the stresses of u and v, and G and H their gradients, the integral of (s : H I - H^T s - G^T t) :
        grad w (J. D. Eshelby: The elastic energy-momentum tensor, J. Elasticity 5, 1975), at a change of temperature
        (k,) in kelvin with the thermal stress taken off s.
        """
        of, along = (self.function(one, "displacement") for one in (u, v))
        G, H, t, whole = ufl.grad(of), ufl.grad(along), self._stress(along), ufl.Identity(3)
        s = self._stress(of) if change is None else self._stress(of) - self._thermal_stress(change)
        tensor = ufl.inner(s, H) * whole - H.T * s - G.T * t
        if self._mean is not None:
            if change is not None:
                raise ValueError("derivatives along places are not known of mean dilatations with a temperature")
            D, E = (self._mean.of(one.x.array) for one in (of, along))
            p, q, energy = (self._in_mean_cells(self._mean.k * one) for one in (D, E, D * E / self._mean.volume))
            tensor += p * (ufl.tr(H) * whole - H.T) + q * (ufl.tr(G) * whole - G.T) - energy * whole
        return self._assemble(fem.form(ufl.inner(tensor, ufl.grad(self._test)) * self._dx))

    def _in_mean_cells(self, values: FloatArray) -> Any:
        """Function of numbers of the cells with a mean dilatation, 0 in others."""
        assert self._mean is not None
        in_cells = np.zeros(self.domain.topology.index_map(3).size_local)
        in_cells[self._mean.cells] = values
        return self._on_cells(in_cells, "mean")

    def thermal_force(self, change: FloatArray) -> FloatArray:
        """Nodal forces in newtons, shape (k, 3), that cause the thermal strain of a change of temperature (k,) in
        kelvin."""
        return self._assemble(fem.form(ufl.inner(self._thermal_stress(change), strain(self._test)) * self._dx))

    def thermal_work(self, u: FloatArray, v: FloatArray, change: FloatArray) -> FloatArray:
        """Derivatives, along a change of temperature (k,) of this rank's nodes, of the work of the forces that it
        exerts at u along v (k, 3), joules per kelvin, shape (k,), here whatever u and the change are; collective."""
        along = strain(self.function(v, "displacement"))
        per_kelvin = ufl.inner(self._stress_of_kelvin(1.0), along)
        if self._mean is not None:
            per_kelvin = self._mean_in_cells(per_kelvin)
        return self._assemble(fem.form(per_kelvin * self._test[0] * self._dx))[:, 0]

    def thermal_displacement(self, change: FloatArray) -> float:
        """Displacement in metres along which the `thermal_force` of a change (k,) does the energy of the thermal
        strain: the scale of displacements of a heated body, also where walls hold it; collective."""
        kelvin = self._kelvin(change)
        forces = np.linalg.norm(self.thermal_force(change), axis=1)
        energy = fem.assemble_scalar(fem.form(self._thermal_energy * kelvin**2 * self._dx))
        over = self.domain.comm.allreduce(np.array([energy, forces.sum()]))
        return float(2.0 * over[0] / (over[1] or 1.0))

    def nodal_displacement(self, load: FloatArray) -> float:
        """Mean displacement in metres of the nodes, each alone under its load (k, 3), weighted with these forces: the
        scale of displacements of a body that is pressed onto what holds it; collective.

        f^T f / f^T D f times f^T f / sum |f|, with D the diagonal of K by M. F. Hutchinson's estimate (Commun. Stat.
        Simul. Comput. 18, 1989): f^T D f ~ v^T K v, v the load with signs that vary from node to node.
        """
        comm = self.domain.comm
        largest = float(comm.allreduce(np.max(np.abs(load), initial=0.0), op=MPI.MAX))
        if largest == 0.0:
            return 0.0
        f = load / largest
        v = f * varying_signs(self.x, comm)
        sums = np.array([np.sum(v * self._force_of(v)), np.sum(f**2), np.sum(np.linalg.norm(f, axis=1))])
        energy, square, size = comm.allreduce(sums)
        return float(largest * square**2 / (energy * size)) if energy > 0.0 else 0.0

    def stresses(self, u: Any, change: FloatArray | None = None) -> list[Any]:
        """The `STRESSES` in pascals at the cells' midpoints, DG0 Functions, of a Function u of V and a change of
        temperature (k,) in kelvin."""
        self._u.x.array[:] = u.x.array
        if self._mean is not None:
            cells = compat.cell_dofs(self._tension.function_space)[self._mean.cells, 0]
            self._tension.x.array[cells] = self._mean.k * self._mean.of(u.x.array)
            self._tension.x.scatter_forward()
        if change is not None:
            thermal = self._thermal_stress(change)
            return self.stress_fields(self.at_midpoints(self._whole_stress(self._u) - thermal))
        return self.stress_fields(self._stress_at_midpoints)

    @cached_property
    def _stress_at_midpoints(self) -> Any:
        return self.at_midpoints(self._whole_stress(self._u))

    def dilatation(self, u: FloatArray) -> FloatArray | None:
        """Of displacements u at this rank's nodes and ghosts (n,), the mean dilatation of this rank's own cells whose
        stress has it, nan of others, shape (c,); None if there are none on any rank."""
        if self._mean is None:
            return None
        dilatation = np.full(len(compat.cell_dofs(self.V)), np.nan)
        dilatation[self._mean.cells] = self._mean.of(u) / self._mean.volume
        return dilatation[: self.domain.topology.index_map(3).size_local]

    @property
    def has_mean_dilatation(self) -> bool:
        """Whether the stress of nearly incompressible cells has their mean dilatation."""
        return self._mean is not None

    @cached_property
    def _tension(self) -> Any:
        """bulk D of the last displacement for stresses, 0 in cells without."""
        return self._on_cells(np.zeros(self.domain.topology.index_map(3).size_local), "tension")

    def _whole_stress(self, u: Any) -> Any:
        return self._stress(u) if self._mean is None else self._stress(u) + self._tension * ufl.Identity(3)

    def at_midpoints(self, s: Any) -> Any:
        """DOLFINx Expression of the components of a stress s of UFL, in the order of `PAIRS`, at the cells'
        midpoints."""
        midpoints = compat.interpolation_points(self._per_cell((6,)))
        return fem.Expression(ufl.as_vector([s[pair] for pair in PAIRS]), midpoints)

    def stress_fields(self, stress: Any) -> list[Any]:
        """The `STRESSES` as DG0 Functions, of a stress `at_midpoints`."""
        six = fem.Function(self._per_cell((6,)))
        six.interpolate(stress)
        of_cell = six.x.array.reshape(-1, 6)[compat.cell_dofs(six.function_space)[:, 0]]
        return [self._on_cells(values, name) for name, values in zip(STRESSES, _stresses(of_cell), strict=True)]

    def _stress(self, u: Any) -> Any:
        """Without that of mean dilatations."""
        e = strain(u)
        if self._stiffness is None:
            return 2.0 * self._mu * e + self._lame * ufl.tr(e) * ufl.Identity(3)
        C = {pair: self._stiffness[k] for k, pair in enumerate(UPPER)}
        doubled = [(1.0 if i == j else 2.0) * e[i, j] for i, j in PAIRS]
        return _tensor([sum(C[min(i, j), max(i, j)] * doubled[j] for j in range(6)) for i in range(6)])

    def _thermal_stress(self, change: FloatArray) -> Any:
        kelvin = self._kelvin(change)
        return self._stress_of_kelvin(kelvin if self._mean is None else self._mean_in_cells(kelvin))

    def _stress_of_kelvin(self, kelvin: Any) -> Any:
        assert self._per_kelvin is not None
        if self._stiffness is None:
            return self._per_kelvin * kelvin * ufl.Identity(3)
        return _tensor([self._per_kelvin[k] * kelvin for k in range(6)])

    def _mean_in_cells(self, kelvin: Any) -> Any:
        """The mean over each cell with the mean dilatation, so that these fit together; itself in others."""
        assert self._mean is not None
        test = ufl.TestFunction(self._per_cell(()))
        integrals = fem.petsc.assemble_vector(fem.form(kelvin * test * self._dx))
        mean, chosen = self._on_cells(integrals.array.copy(), "mean"), np.zeros(len(integrals.array))
        integrals.destroy()
        cells = compat.cell_dofs(mean.function_space)[self._mean.cells, 0]
        mean.x.array[cells] /= self._mean.volume
        chosen[self._mean.cells] = 1.0
        share = self._on_cells(chosen, "mean")
        return share * mean + (1.0 - share) * kelvin

    def _kelvin(self, change: FloatArray) -> Any:
        return self.function(np.repeat(change[:, None], 3, axis=1), "temperature_change")[0]


def cell_measure(domain: Any) -> Any:
    """UFL's measure of the cells for products of stress and strain.

    Hexahedra of first order have 2 x 2 x 2 points, exact up to degree 3 in each direction.  The nodal forces of a
    constant stress have degree 2 there on cells of any shape, so that patch tests hold to rounding; so has the
    stiffness of a parallelepiped.  On other cells the stiffness is rational, and 27 points, UFL's choice, change the
    answer by less than a hundredth of the error of the mesh (integration-points.csv).  8 points leave no motion but the
    rigid ones without energy, and take a third of the time.

    On linear tetrahedra the points are UFL's choice, one.  In second order the rule is exact for a constant stress on
    curved cells (degree 3 on tetrahedra, in each direction 5 on hexahedra): UFL would take up to five times as many
    points.
    """
    hexahedral, order = domain.topology.cell_type.name == "hexahedron", compat.geometry_degree(domain)
    if order == 1 and not hexahedral:
        return ufl.dx(domain=domain)
    degree = 5 if order == 2 and hexahedral else 3
    return ufl.dx(domain=domain, metadata={"quadrature_degree": degree})


def varying_signs(x: FloatArray, comm: MPI.Comm) -> FloatArray:
    """1 or -1 for every component of the nodes x (k, 3), varying from node to node, the same on any ranks;
    collective."""
    size = float(comm.allreduce(np.max(np.abs(x), initial=0.0), op=MPI.MAX)) or 1.0
    waves = np.array([[1e4, 2e4, 3e4], [5e4, 4e4, 7e4], [9e4, 8e4, 6e4]])
    return np.where(np.sin(x / size @ waves) > 0, 1.0, -1.0)


def strain(u: Any) -> Any:
    return ufl.sym(ufl.grad(u))


def _stresses(s: FloatArray) -> list[FloatArray]:
    """Of the components in the order of `PAIRS`, shape (c, 6), the stresses `STRESSES`; nan where these are."""
    with np.errstate(all="ignore"):
        deviator = s - np.repeat([1.0, 0.0], 3) * s[:, :3].mean(axis=1, keepdims=True)
        equivalent = np.sqrt(1.5 * deviator**2 @ np.repeat([1.0, 2.0], 3))
    finite, principal = np.all(np.isfinite(s), axis=1), np.full((len(s), 3), np.nan)
    principal[finite] = np.linalg.eigvalsh(s[finite][:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]])[:, ::-1]
    return [equivalent, *s.T, *principal.T]


def _tensor(s: Sequence[Any]) -> Any:
    return ufl.as_matrix([[s[0], s[5], s[4]], [s[5], s[1], s[3]], [s[4], s[3], s[2]]])
