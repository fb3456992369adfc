"""The stiffness matrix on one rank, from the cells' matrices of FFCx's kernel, without PETSc's insertion of entries.

PETSc searches the place of each entry of each cell: two thirds of the time of DOLFINx's assembly.  Here the places of a
cell's nodes in the rows are found by one pass over each row, and matrices of cells with the same edges to rounding are
computed once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from ...native import address, kernels
from .. import compat, compat_forms

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
