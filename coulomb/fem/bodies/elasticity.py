"""Linear elasticity of one body: stiffness K, load f, near-nullspace."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ...native import address, kernels
from .. import compat, compat_forms
from ..compat import fem, ufl
from .body import strain
from .deformable import SingleBody
from .loaded_body import LoadedBody
from .rigid_modes import component_modes, of_components

# The stiffness matrix on one rank, from the cells' matrices of FFCx's kernel, without PETSc's insertion of entries.
#
# PETSc searches the place of each entry of each cell: two thirds of the time of DOLFINx's assembly.  Here the places of
# a cell's nodes in the rows are found by one pass over each row, and matrices of cells with the same edges to rounding
# are computed once.

_KEPT = 6  # KEPT of native/assembly.c


def assembled_matrix(form: Any, V: Any) -> PETSc.Mat:
    """The matrix of a form with integrals over all cells only, on V x V, without boundary conditions; collective."""
    kernel = compat_forms.cell_kernel(form)
    if kernel is None or V.mesh.comm.size > 1 or np.dtype(PETSc.IntType) != np.int32:
        return compat.assemble_matrix(form)
    nodes, points = _table(compat.cell_dofs(V)), _table(compat.cell_geometry(V.mesh))
    cells, width = nodes.shape
    indptr, indices = _coupled(nodes, int(V.dofmap.index_map.size_local))
    values = np.zeros(9 * int(indptr[-1]))
    x = np.ascontiguousarray(V.mesh.geometry.x, dtype=np.float64)
    matrices, places = np.empty((_KEPT + 1, (3 * width) ** 2)), np.empty((_KEPT + 1, 3 * points.shape[1]))
    constants, coefficients = kernel.constants, np.ascontiguousarray(kernel.coefficients, dtype=np.float64)
    kernels().assemble_cells(
        *(cells, width, address(nodes), points.shape[1], address(points), address(x), address(constants)),
        *(coefficients.shape[1], address(coefficients), kernel.address),
        *(address(indptr), address(indices), address(values), address(matrices), address(places)),
    )
    count = len(indptr) - 1
    rows, columns = np.empty(3 * count + 1, dtype=np.int32), np.empty(len(values), dtype=np.int32)
    kernels().displacements(count, *map(address, (indptr, indices, rows, columns)))
    K = PETSc.Mat().createAIJWithArrays((3 * count, 3 * count), (rows, columns, values), comm=V.mesh.comm)
    K.setBlockSize(3)
    K.assemble()
    K.setAttr("mesh", V.mesh)  # keeps the communicator alive
    return K


def _coupled(nodes: npt.NDArray[np.int32], count: int) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """The nodes that are in a cell with each node, ascending, in compressed form."""
    cells, width = nodes.shape
    begin, of, mark = np.zeros(count + 1, np.int32), np.empty(nodes.size, np.int32), np.full(count, -1, np.int32)
    indptr = np.empty(count + 1, dtype=np.int32)
    kernels().cells_of_nodes(count, cells, width, *map(address, (nodes, begin, of)))
    given = (count, width, *map(address, (nodes, begin, of, mark, indptr)))
    kernels().neighbours(*given, None)
    indices = np.empty(int(indptr[-1]), dtype=np.int32)
    kernels().neighbours(*given, address(indices))
    return indptr, indices


def _table(rows: Any) -> npt.NDArray[np.int32]:
    return np.ascontiguousarray(rows, dtype=np.int32)


class Elasticity(LoadedBody, SingleBody):
    """K u = f on hexahedra or tetrahedra of first or second order, with prescribed displacements and springs.

    Held directions are eliminated (`HeldSpace.eliminated`); f, which depends on time, has the prescribed values, so
    that K u = f holds them exactly.  Springs (Winkler foundations) are integrated over their faces with the functions
    of the elements: exact for every displacement that these have.

    Raises:
        ValueError: As `LoadedBody`, or if the springs that hold the body are too soft in comparison with rounding
            errors.
    """

    def _stiffen(self) -> None:
        trial = ufl.TrialFunction(self.V)
        form = fem.form(ufl.inner(self._stress(trial), strain(self._test)) * self._dx)
        self._K = assembled_matrix(form, self.V)
        self._add_springs(trial)
        self._K, self._held_diagonal = self.eliminated(self._K)

    @property
    def K(self) -> PETSc.Mat:
        return self._K

    @property
    def held_diagonal(self) -> FloatArray:
        return self._held_diagonal

    @property
    def anchoring(self) -> FloatArray:
        return self._anchoring

    def _add_springs(self, trial: Any) -> None:
        """Add springs to K, and those at the anchors of free motions (`FreeMotions`)."""
        comm = self.mesh.comm
        for spring in self.springs:
            S = compat.assemble_matrix(fem.form(self.spring_form(spring, trial)))
            self._K.axpy(1.0, S, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            S.destroy()
        diagonal = self._K.getDiagonal()
        stiff = comm.allreduce(float(np.max(diagonal.array, initial=0.0)), op=MPI.MAX)
        anchored = self.free.anchored(self.x.shape)
        # As stiff as K there: multigrid then takes as many iterations as for a clamped body; with 1e3 times K's
        # diagonal up to twice as many.
        self._anchoring: FloatArray = anchored * diagonal.array.reshape(-1, 3)
        diagonal.array[:] += self._anchoring.ravel()
        self._K.setDiagonal(diagonal)
        diagonal.destroy()
        limit = 1e-12 * comm.allreduce(self._owned, op=MPI.SUM)
        component = self.free.component
        modes, parts = component_modes(self.x, component, comm)
        forces = anchored[:, :, None] * modes
        if self.ground is not None:
            forces += of_components(self.ground / stiff, self.x, component, parts, comm)
        soft = self._motions_without(component, modes, forces, limit)
        if soft.motions and not self.springs:
            ends = (np.max(side * self.x, axis=0, initial=-np.inf) for side in (1.0, -1.0))
            lengths = sum(np.max(comm.allgather(end), axis=0) for end in ends)
            raise ValueError(
                f"the body is {np.max(lengths):g} m long and {np.min(lengths):g} m thin: supports and contact resist "
                f"that it {' or '.join(map(str, soft.motions))} by no more than rounding errors of its stiffness; "
                "check the lengths and the unit of the mesh"
            )
        if soft.motions:
            raise ValueError(
                "the springs are too soft in comparison with rounding errors: they hardly resist that the body "
                f"{' or '.join(map(str, soft.motions))}; against that the nodes have less than 1e-12 of the body's own "
                "stiffness; make the springs stiffer, or leave them out where contact holds the body"
            )
