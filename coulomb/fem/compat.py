"""Depends on the DOLFINx version, as `compat_forms` and nothing else: 0.5 (Debian 12) to 0.9 (Debian 13), and 0.11.

A comment names the version up to which, or from which, a branch is needed: it can go when that is no longer supported.
Other modules import DOLFINx's `mesh`, `fem`, `io`, `cpp` and Basix from here, so that this module is imported first.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..installation import COMPLEX, Unusable, loaded_libraries, why_mpi_does_not_fit, why_not_imported
from .compilation import watch_compilation

# Debian 12's DOLFINx sets RTLD_GLOBAL and does not reset it; VTK's wheels, imported later, then abort.
_setdlopenflags = sys.setdlopenflags
sys.setdlopenflags = lambda flags: None
try:
    import dolfinx
    import dolfinx.fem.petsc
    import dolfinx.jit
    from mpi4py import MPI
    from petsc4py import PETSc
except (ImportError, AssertionError) as error:  # the second without petsc4py, since 0.8
    raise Unusable(why_not_imported(error, os.environ)) from error
finally:
    sys.setdlopenflags = _setdlopenflags
import basix
import ufl
from dolfinx import cpp, fem, io, mesh

__all__ = ["basix", "cpp", "fem", "io", "mesh", "ufl"]

VERSION: str = dolfinx.__version__
NUMBERS = tuple(int(part) for part in VERSION.split(".")[:2])
if NUMBERS < (0, 5):
    raise Unusable(f"coulomb needs DOLFINx 0.5 or newer, but this is {VERSION}")
if np.dtype(PETSc.ScalarType).kind != "f":
    raise Unusable(COMPLEX)
_mpi = MPI.Get_library_version().split("\n")[0].strip("\0 ")
if _why := why_mpi_does_not_fit(loaded_libraries(), MPI.COMM_WORLD.size, _mpi, os.environ):
    raise Unusable(_why)

logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)  # 0.5's JIT logs the compiler's lines
for _name in ("JIT_OPTIONS", "JIT_PARAMETERS"):  # wait a minute for another process that compiles the same form
    getattr(dolfinx.jit, f"DOLFINX_DEFAULT_{_name}", {})["timeout"] = (60, "")
watch_compilation(dolfinx.jit, ufl.algorithms.check_arities.ArityMismatch)


def functionspace(domain: Any, degree: int, shape: tuple[int, ...] = (), family: str = "Lagrange") -> Any:
    """Lagrange (or DG) space of scalars, vectors or tensors."""
    if hasattr(fem, "functionspace"):  # 0.7 and newer
        return fem.functionspace(domain, (family, degree, shape) if shape else (family, degree))
    _settle(domain.ufl_domain())
    if family == "DG" and degree > 0 and domain.topology.cell_type == mesh.CellType.hexahedron:
        family = "DQ"  # as UFL calls it there, with a warning
    if not shape:
        return fem.FunctionSpace(domain, (family, degree))
    return fem.VectorFunctionSpace(domain, (family, degree), dim=shape[0])


def _settle(domain: Any) -> None:
    """FFCx 0.5 modifies the mesh's element when it compiles a form, and uses another cache name for the next one."""
    element = domain._ufl_coordinate_element
    if getattr(getattr(element, "_sub_element", None), "_variant", "") is None:
        shape = (element.family(), element.cell(), element.degree(), element.quadrature_scheme())
        domain._ufl_coordinate_element = ufl.VectorElement(ufl.FiniteElement(*shape, variant="equispaced"))


def assemble_matrix(form: Any, constants: FloatArray | None = None) -> PETSc.Mat:
    """Assembled matrix of a bilinear form without boundary conditions, with other values of its constants if given."""
    A = dolfinx.fem.petsc.assemble_matrix(form, constants=constants)
    A.assemble()
    A.setAttr("form", form)  # keeps the mesh alive, and with it the communicator, without which 0.9's matrices crash
    return A


def cell_dofs(V: Any) -> npt.NDArray[np.int32]:
    """Block dofs of every local cell, ghosts included, shape (cells, dofs per cell)."""
    table = V.dofmap.list  # an AdjacencyList before 0.7, possibly empty
    return table if isinstance(table, np.ndarray) else table.array.reshape(-1, V.dofmap.dof_layout.num_dofs)


def geometry_degree(domain: Any) -> int:
    """Degree of the map from the reference cell to the cells of a mesh: 1, or 2 with nodes on edges."""
    return int(coordinate_element(domain).degree)


def coordinate_element(domain: Any) -> Any:
    maps = getattr(domain.geometry, "cmaps", None)
    return maps[0] if isinstance(maps, Sequence) else domain.geometry.cmap  # a list in 0.6, and from 0.11 on


def cell_geometry(domain: Any) -> npt.NDArray[np.int32]:
    """Geometry nodes of every local cell, ghosts included, shape (cells, nodes per cell); the corners come first."""
    dofmaps = getattr(domain.geometry, "dofmaps", None)
    table = dofmaps[0] if isinstance(dofmaps, Sequence) else domain.geometry.dofmap
    if isinstance(table, np.ndarray):
        return table
    rows: npt.NDArray[np.int32] = table.array.reshape(-1, coordinate_element(domain).create_dof_layout().num_dofs)
    return rows


def interpolation_points(V: Any) -> Any:
    points = V.element.interpolation_points  # a method until 0.9
    return points() if callable(points) else points


def meshtags(domain: Any, dim: int, entities: npt.NDArray[np.int32], values: npt.NDArray[np.int32]) -> Any:
    """MeshTags of entities in any order; a repeated entity keeps its first value."""
    unique, first = np.unique(entities, return_index=True)
    return mesh.meshtags(domain, dim, unique.astype(np.int32), values[first].astype(np.int32))


def create_mesh(comm: Any, cell: str, cells: npt.NDArray[np.int64], x: FloatArray, degree: int = 1) -> Any:
    """Distributed mesh of degree 1 or 2 of the cells and points given on this rank, in DOLFINx's order of points."""
    if not hasattr(basix, "ufl"):  # until 0.6
        return mesh.create_mesh(comm, cells, x, ufl.Mesh(ufl.VectorElement("Lagrange", cell, degree)))
    return mesh.create_mesh(comm, cells=cells, x=x, e=ufl.Mesh(basix.ufl.element("Lagrange", cell, degree, shape=(3,))))


def copied_mesh(domain: Any) -> Any:
    """A mesh with the same topology, the numbers of its facets included, and its own coordinates."""
    topology = domain.topology
    for dim in range(1, topology.dim):
        topology.create_entities(dim)
    whole, topology, geometry = (_cpp(part) for part in (domain, topology, domain.geometry))
    return mesh.Mesh(
        type(whole)(domain.comm, topology, geometry), ufl.Mesh(domain.ufl_domain().ufl_coordinate_element())
    )


def _cpp(wrapped: Any) -> Any:
    """The object of DOLFINx's C++ library behind one of Python; itself where there is no wrapper."""
    for name in ("_cpp_object", "_mesh"):  # 0.6 and newer; 0.5
        wrapped = getattr(wrapped, name, wrapped)
    return wrapped
