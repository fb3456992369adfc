"""Depends on the DOLFINx version, as nothing else does: 0.5 (Debian 12) to 0.9 (Debian 13), and 0.11.

A comment names the version up to which, or from which, a branch is needed: it can go when that is no longer supported.
Other modules import DOLFINx's `mesh`, `fem`, `io`, `cpp` and Basix from here, so that this module is imported first.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from _cffi_backend import FFI  # cffi.FFI loads a parser of C, which takes 25 ms

from ..arrays import FloatArray, Int32Array, IntArray
from ..installation import COMPLEX, Unusable, dolfinx_import, loaded_libraries, why_mpi_does_not_fit, why_not_imported
from .compilation import watch_compilation

# Scotch 7.0.3 was seen to wait without end on 4 ranks, each in another step of the same graph.  All take the same steps
# by its sequential algorithms; those of threads need not be repeatable.
os.environ.setdefault("SCOTCH_PTHREAD_NUMBER", "1")
try:
    with dolfinx_import():
        import dolfinx
        import dolfinx.fem.petsc
        import dolfinx.jit
        from mpi4py import MPI
        from petsc4py import PETSc
except (ImportError, AssertionError) as error:  # the second without petsc4py, since 0.8
    raise Unusable(why_not_imported(error, os.environ)) from error
import basix
import ufl
from dolfinx import cpp, fem, geometry, io, mesh

__all__ = ["basix", "cpp", "fem", "geometry", "io", "mesh", "ufl"]

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
    if len(shape) == 2:
        return fem.TensorFunctionSpace(domain, (family, degree), shape=shape)
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


def cell_dofs(V: Any) -> Int32Array:
    """Block dofs of every local cell, ghosts included, shape (cells, dofs per cell)."""
    table = V.dofmap.list  # an AdjacencyList before 0.7, possibly empty
    return table if isinstance(table, np.ndarray) else table.array.reshape(-1, V.dofmap.dof_layout.num_dofs)


def geometry_degree(domain: Any) -> int:
    """Degree of the map from the reference cell to the cells of a mesh: 1, or 2 with nodes on edges."""
    return int(coordinate_element(domain).degree)


def coordinate_element(domain: Any) -> Any:
    maps = getattr(domain.geometry, "cmaps", None)
    return maps[0] if isinstance(maps, Sequence) else domain.geometry.cmap  # a list in 0.6, and from 0.11 on


def cell_geometry(domain: Any) -> Int32Array:
    """Geometry nodes of every local cell, ghosts included, shape (cells, nodes per cell); the corners come first."""
    dofmaps = getattr(domain.geometry, "dofmaps", None)
    table = dofmaps[0] if isinstance(dofmaps, Sequence) else domain.geometry.dofmap
    if isinstance(table, np.ndarray):
        return table
    return table.array.reshape(-1, coordinate_element(domain).create_dof_layout().num_dofs)


def interpolation_points(V: Any) -> Any:
    points = V.element.interpolation_points  # a method until 0.9
    return points() if callable(points) else points


def meshtags(domain: Any, dim: int, entities: Int32Array, values: Int32Array) -> Any:
    """MeshTags of entities in any order; a repeated entity keeps its first value."""
    unique, first = np.unique(entities, return_index=True)
    return mesh.meshtags(domain, dim, unique.astype(np.int32), values[first].astype(np.int32))


def create_mesh(comm: Any, cell: str, cells: IntArray, x: FloatArray, degree: int = 1) -> Any:
    """Distributed mesh of degree 1 or 2 of the cells and points given on this rank, in DOLFINx's order of points."""
    kind = ufl.Mesh(_vectors(cell, degree))
    if not hasattr(basix, "ufl"):  # until 0.6
        return mesh.create_mesh(comm, cells, x, kind)
    return mesh.create_mesh(comm, cells=cells, x=x, e=kind)


def _vectors(cell: str, degree: int) -> Any:
    """The Lagrange element of vectors (3,)."""
    if not hasattr(basix, "ufl"):  # until 0.6
        return ufl.VectorElement("Lagrange", cell, degree, 3)
    return basix.ufl.element("Lagrange", cell, degree, shape=(3,))


def copied_mesh(domain: Any) -> Any:
    """A mesh with the same topology, the numbers of its facets included, and its own coordinates."""
    topology = domain.topology
    for dim in range(1, topology.dim):
        topology.create_entities(dim)
    whole, topology, geometry = (cpp_of(part) for part in (domain, topology, domain.geometry))
    return mesh.Mesh(
        type(whole)(domain.comm, topology, geometry), ufl.Mesh(domain.ufl_domain().ufl_coordinate_element())
    )


def cpp_of(thing: Any) -> Any:
    """The object of DOLFINx's C++ library behind one of Python; itself where there is no wrapper."""
    return getattr(thing, "_cpp_object", getattr(thing, "_mesh", thing))  # the second in 0.5


class CellKernel(NamedTuple):
    """What FFCx has compiled for the integral of a form over a cell.

    Attributes:
        address: Of its function `tabulate_tensor`.
        constants: Of the form, packed.
        coefficients: Of every cell of this rank, packed, shape (cells, width).
    """

    address: int
    constants: FloatArray
    coefficients: FloatArray


def cell_kernel(form: Any) -> CellKernel | None:
    """The kernel of a form with one integral over all cells and no other; None if it has others, or is not found."""
    ufcx = getattr(form, "ufcx_form", None)
    compiled = cpp_of(form)
    if ufcx is None or [kind.name for kind in compiled.integral_types] != ["cell"]:
        return None
    integrals: Any
    if hasattr(ufcx, "form_integrals"):  # from 0.7 on
        count, integrals = int(ufcx.form_integral_offsets[1]), ufcx.form_integrals
    elif callable(getattr(ufcx, "integrals", None)):
        count, integrals = int(ufcx.num_integrals(0)), ufcx.integrals(0)
    else:
        return None
    function = getattr(integrals[0], "tabulate_tensor_float64", None) if count == 1 else None
    if not function:
        return None
    address = int(FFI().cast("uintptr_t", function))
    coefficients = next(iter(cpp.fem.pack_coefficients(compiled).values()))
    return CellKernel(address, packed_constants(form), coefficients)


def is_compiled(form: Any) -> bool:
    """Whether a form has been compiled by `fem.form`."""
    return hasattr(form, "integral_types") and hasattr(form, "function_spaces")


def functions_in(form: Any) -> list[Any]:
    """The functions in a compiled form, with their values in `x.array`."""
    return list(cpp_of(form).coefficients)


def packed_constants(form: Any) -> FloatArray:
    """A copy of the values of the constants in a compiled form."""
    return np.array(cpp.fem.pack_constants(cpp_of(form)), dtype=np.float64)


def space_of(space: Any) -> Any:
    """A Python function space for the C++ space of vectors of a compiled form; its functions have the same dofs."""
    cell = space.mesh.topology.cell_type.name
    domain = mesh.Mesh(space.mesh, ufl.Mesh(_vectors(cell, int(coordinate_element(space.mesh).degree))))
    return fem.FunctionSpace(domain, _vectors(cell, int(space.element.basix_element.degree)), space)


def lagrange_vectors(space: Any) -> tuple[bool, int, int]:
    """Whether a space (Python's or C++'s) is of continuous Lagrange elements, their degree, and the values per node.

    Raises:
        RuntimeError: If it is mixed.
    """
    element = space.element.basix_element
    continuous = element.family == basix.ElementFamily.P and not element.discontinuous
    return continuous, int(element.degree), int(space.dofmap.bs)


def contains(V: Any, space: Any) -> bool:
    """Whether a space of C++ is V, or a component of it."""
    return bool(V._cpp_object.contains(cpp_of(space)))


def create_vector(form: Any, V: Any) -> Any:
    """PETSc vector of a linear form on V, ghosts included."""
    return fem.petsc.create_vector(form if NUMBERS < (0, 10) else V)


def set_values(bc: Any, values: FloatArray) -> None:
    """Set the entries of an array of all dofs of this rank to the values that a boundary condition prescribes."""
    if hasattr(bc, "set"):  # after 0.5
        bc.set(values, None, 1.0)
    else:
        fem.set_bc(values, [bc])


def mesh_of_tags(tags: Any) -> Any:
    """The C++ topology that MeshTags belong to."""
    return tags.topology if hasattr(tags, "topology") else tags.mesh.topology  # the second in 0.5
