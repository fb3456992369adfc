"""Forms, spaces, boundary conditions and tags of the user's scripts, for every DOLFINx version: see `compat`."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import cffi
import numpy as np

from ..arrays import FloatArray
from .compat import NUMBERS, basix, cell_dofs, cell_geometry, coordinate_element, cpp, fem, functionspace, mesh, ufl


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
    compiled = getattr(form, "_cpp_object", form)
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
    address = int(cffi.FFI().cast("uintptr_t", function))
    coefficients = next(iter(cpp.fem.pack_coefficients(compiled).values()))
    return CellKernel(address, packed_constants(form), coefficients)


def cell_matrices(form: Any, V: Any) -> FloatArray:
    """The matrices of this rank's own cells of a compiled bilinear form over all cells, shape (cells, n, n).

    Raises:
        ValueError: If the form has integrals over parts, or none of double precision.
    """
    kernel = cell_kernel(form)
    if kernel is None:
        raise ValueError("the matrices of cells are only known of one integral over all cells")
    width = 3 * cell_dofs(V).shape[1]
    tabulate = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 7)(kernel.address)
    cells = int(V.mesh.topology.index_map(3).size_local)
    matrices = np.zeros((cells, width, width))
    points = np.ascontiguousarray(V.mesh.geometry.x[cell_geometry(V.mesh)[:cells]])
    constants, coefficients = kernel.constants, np.ascontiguousarray(kernel.coefficients, dtype=np.float64)
    for matrix, coefficient, corners in zip(matrices, coefficients, points, strict=False):
        tabulate(matrix.ctypes.data, coefficient.ctypes.data, constants.ctypes.data, corners.ctypes.data, 0, 0, 0)
    return matrices


def is_compiled(form: Any) -> bool:
    """Whether a form has been compiled by `fem.form`."""
    return hasattr(form, "integral_types") and hasattr(form, "function_spaces")


def functions_in(form: Any) -> list[Any]:
    """The functions in a compiled form, with their values in `x.array`."""
    return list(getattr(form, "_cpp_object", form).coefficients)


def packed_constants(form: Any) -> FloatArray:
    """A copy of the values of the constants in a compiled form."""
    return np.array(cpp.fem.pack_constants(getattr(form, "_cpp_object", form)), dtype=np.float64)


def cpp_of(thing: Any) -> Any:
    """The C++ object of a mesh, or itself."""
    return getattr(thing, "_cpp_object", getattr(thing, "_mesh", thing))  # the second in 0.5


def space_of(space: Any) -> Any:
    """A Python function space for the C++ space of vectors of a compiled form; its functions have the same dofs."""
    element = space.element.basix_element
    cell, degree = space.mesh.topology.cell_type.name, int(element.degree)
    if not hasattr(basix, "ufl"):  # until 0.6
        kind = ufl.Mesh(ufl.VectorElement("Lagrange", cell, int(coordinate_element(space.mesh).degree)))
        return fem.FunctionSpace(mesh.Mesh(space.mesh, kind), ufl.VectorElement("Lagrange", cell, degree, 3), space)
    kind = ufl.Mesh(basix.ufl.element("Lagrange", cell, int(coordinate_element(space.mesh).degree), shape=(3,)))
    domain = mesh.Mesh(space.mesh, kind)
    return fem.FunctionSpace(domain, basix.ufl.element("Lagrange", cell, degree, shape=(3,)), space)


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
    return bool(V._cpp_object.contains(getattr(space, "_cpp_object", space)))


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


def tensor_space(domain: Any, degree: int, shape: tuple[int, ...], family: str) -> Any:
    """Lagrange or DG space of scalars, vectors or tensors."""
    if hasattr(fem, "functionspace") or len(shape) < 2:  # the first from 0.7 on
        return functionspace(domain, degree, shape, family)
    return fem.TensorFunctionSpace(domain, (family, degree), shape=shape)
