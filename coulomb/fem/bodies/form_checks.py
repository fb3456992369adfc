"""What the user's forms, spaces, boundary conditions and faces must be: refused otherwise, the same on every rank."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from petsc4py import PETSc

from ...arrays import FloatArray, in_words, short
from .. import compat
from ..compat import mesh, ufl
from ..meshes import FORMS_IN_2D, NamedMesh, faces_of

SYMMETRIC: Final = 1e-10
"""Largest difference of a(u, v) and a(v, u), relative to their size."""


def space_of_forms(a: Any, L: Any, space: Any) -> Any:
    """The Python function space of the forms: that given by the user, or their own.

    Raises:
        ValueError: If there are not one or two arguments, or the space is not one of displacements in 3D.
    """
    _refuse_rank(a, 2, "a")
    if L is not None:
        _refuse_rank(L, 1, "L")
    spaces = [*_spaces(a, "a"), *([] if L is None else _spaces(L, "L"))]
    python = [one for one in spaces if isinstance(one, ufl.FunctionSpace)]
    if space is not None and not isinstance(space, ufl.FunctionSpace):
        raise ValueError(f"Body: space must be a function space of DOLFINx, but is {short(space)}")
    chosen = space if space is not None else python[0] if python else None
    for one in spaces:
        if compat.cpp_of(one) is not compat.cpp_of(spaces[0]):
            raise ValueError(
                "Body: a and L must have one space: the same object V for trial and test functions of both, since two "
                "spaces that look alike may number their nodes differently"
            )
    _refuse_space(spaces[0])
    if chosen is None:
        chosen = compat.space_of(spaces[0])
    if compat.cpp_of(chosen) is not compat.cpp_of(spaces[0]):
        raise ValueError("Body: space is not the space of a")
    return chosen


_OTHER_UNKNOWNS: Final = (
    "eliminate or penalise other unknowns (a pressure near incompressibility is none in second order, nor on hexahedra "
    'with bulk * div(u) * div(v) * ufl.dx(metadata={"quadrature_degree": 1}), the rest with dev(strain))'
)

_ONE_SPACE: Final = f"a and L must have one space of displacements V, continuous Lagrange vectors: {_OTHER_UNKNOWNS}"


def _refuse_rank(form: Any, rank: int, what: str) -> None:
    if isinstance(form, ufl.Form):
        try:
            arguments = form.arguments()
        except Exception:
            raise ValueError(
                f"Body: {what} has trial or test functions of different spaces: a and L must have one space V, "
                "the same object everywhere"
            ) from None
        if any(argument.part() is not None for argument in arguments):
            raise ValueError(f"Body: {what} is on a MixedFunctionSpace; {_ONE_SPACE}")
        has_rank = len(arguments)
        if len(form.ufl_domains()) > 1:
            raise ValueError(f"Body: {what} is on {len(form.ufl_domains())} meshes; a body has one mesh")
        if len({len(ufl.algorithms.extract_arguments(one.integrand())) for one in form.integrals()}) > 1:
            raise ValueError(
                f"Body: {what} has terms with one argument and with two, as F = a - L: give Body(ufl.lhs(F), "
                "ufl.rhs(F), ...), or in large motions, where u is a Function, residual=F"
            )
    elif compat.is_compiled(form):
        has_rank = int(form.rank)
        if np.dtype(form.dtype) != np.float64:
            raise ValueError(f"Body: {what} is compiled for {np.dtype(form.dtype)}; compile it for float64")
    elif isinstance(form, list | tuple):
        raise ValueError(f"Body: {what} is {len(form)} blocks (a {type(form).__name__}); {_ONE_SPACE}")
    elif isinstance(form, ufl.equation.Equation):
        raise ValueError(f"Body: {what} is an equation: give its sides, Body(a, L, ...) for a == L")
    else:
        raise ValueError(f"Body: {what} must be a form of UFL, or one compiled by fem.form, but is {short(form)}")
    if has_rank != rank:
        kinds = {0: "no argument", 1: "one argument (linear)", 2: "two arguments (bilinear)"}
        has = kinds.get(has_rank, f"{has_rank} arguments")
        needed = "a bilinear form of a trial and a test function" if rank == 2 else "a linear form of a test function"
        raise ValueError(f"Body: {what} must be {needed}, but has {has}; exchange a and L?")


def _spaces(form: Any, what: str) -> list[Any]:
    if isinstance(form, ufl.Form):
        spaces = [argument.ufl_function_space() for argument in form.arguments()]
        if not all(hasattr(space, "_cpp_object") for space in spaces):
            raise ValueError(f"Body: {what} is on a space of UFL alone; make it of a function space of DOLFINx")
        return spaces
    if form.mesh is not form.function_spaces[0].mesh:
        raise ValueError(f"Body: {what} is integrated over another mesh than that of its space; a body has one mesh")
    return list(form.function_spaces)


def _refuse_space(space: Any) -> None:
    wanted = "a body needs continuous Lagrange vectors with three components, of degree 1 or 2"
    topology, geometry = space.mesh.topology, space.mesh.geometry
    if topology.dim != 3 or geometry.dim != 3:
        where = f"of dimension {topology.dim} in {geometry.dim}D space"
        raise ValueError(f"Body: the mesh is {where}; a 3D mesh is needed{FORMS_IN_2D if topology.dim == 2 else ''}")
    if space.mesh.geometry.x.dtype != np.float64:
        of = space.mesh.geometry.x.dtype
        raise ValueError(f"Body: the coordinates of the mesh are {of}; make mesh and forms with dtype=np.float64")
    kind = topology.cell_type
    if kind not in (mesh.CellType.tetrahedron, mesh.CellType.hexahedron):
        raise ValueError(f"Body: the cells are of type {kind.name}; only tetrahedra and hexahedra can be used")
    try:
        continuous, degree, size = compat.lagrange_vectors(space)
    except RuntimeError:
        raise ValueError(f"Body: the space of a is mixed; {wanted}: {_OTHER_UNKNOWNS}") from None
    if size != 3:
        kinds = {1: "of scalars, or no Lagrange space"}
        raise ValueError(f"Body: the space of a is {kinds.get(size, f'of {size} values per node')}; {wanted}")
    if not continuous:
        raise ValueError(f"Body: the space of a is discontinuous, or not Lagrange; {wanted}")
    if degree not in (1, 2):
        raise ValueError(f"Body: the space of a has degree {degree}; {wanted}")
    of_cells = compat.geometry_degree(space.mesh)
    if of_cells > 2:
        raise ValueError(f"Body: the cells of the mesh are of degree {of_cells}; only 1 and 2 can be used")
    if degree < of_cells:
        raise ValueError(
            f"Body: the space of a has degree {degree}, but the cells of the mesh are of degree 2: use a space of "
            "degree 2, or a first-order mesh"
        )


def refuse_bcs(bcs: Any, V: Any) -> list[Any]:
    """Boundary conditions as a list; ValueError unless they are DOLFINx's, on V or its components."""
    if hasattr(bcs, "dof_indices") or not isinstance(bcs, Iterable):
        raise ValueError(f"Body: bcs must be a list of dirichletbc of DOLFINx, but is {short(bcs)}")
    given = list(bcs)
    for number, bc in enumerate(given):
        if hasattr(bc, "slaves") or "mpc" in type(bc).__module__:
            raise ValueError(
                f"Body: bcs[{number}] is a multi-point constraint; these are not supported: write the condition as a "
                "term of a (a stiff spring or a penalty), or as a dirichletbc on V or V.sub(i)"
            )
        if not (hasattr(bc, "dof_indices") and hasattr(bc, "function_space")):
            raise ValueError(f"Body: bcs[{number}] must be a dirichletbc of DOLFINx, but is {short(bc)}")
        if not compat.contains(V, bc.function_space):
            raise ValueError(
                f"Body: bcs[{number}] is on another space than a: make it with the same V, or one of its components "
                "V.sub(i)"
            )
    return given


def named_mesh(domain: Any, faces: Any) -> NamedMesh:
    """The mesh of the user with the faces that he names, as of `Body`; collective.

    Raises:
        ValueError: On every rank, if facets are not on the boundary of the mesh, or the argument is something else.
    """
    if isinstance(faces, NamedMesh):
        if compat.cpp_of(faces.domain) is not compat.cpp_of(domain):
            raise ValueError("Body: faces is a NamedMesh of another mesh than that of a")
        kept = {name: getattr(faces, name) for name in ("node_sets", "node_numbers", "file", "slice")}
        return NamedMesh(domain, faces.faces, faces.cells, faces.refused, **kept)
    facets, refused = faces_of(domain, faces, "Body")
    return NamedMesh(domain, facets, {}, refused)


def refuse_unsymmetric(K: PETSc.Mat, x: FloatArray, suspects: str, definite: bool = True) -> None:
    """ValueError on every rank unless the matrix of a is symmetric and, if it must be `definite`, its diagonal
    positive; `suspects` ends the message; collective."""
    (u, image), other = K.createVecs(), K.createVecRight()
    size = float(np.max(np.abs(x), initial=0.0)) or 1.0
    u.array[:] = np.sin(x / size @ np.array([[11.0, 23.0, 35.0], [51.0, 43.0, 72.0], [93.0, 81.0, 64.0]]) + 1.0).ravel()
    K.mult(u, image)
    K.multTranspose(u, other)
    length = float(image.norm())
    other.axpy(-1.0, image)
    off = float(other.norm())
    diagonal = K.getDiagonal()
    row, least = diagonal.min()
    first, last = diagonal.getOwnershipRange()
    own = in_words(x[(row - first) // 3]) if first <= row < last else ""
    place = "".join(diagonal.comm.tompi4py().allgather(own))
    for done in (u, image, other, diagonal):
        done.destroy()
    if not np.isfinite(length):
        raise ValueError(f"Body: a has values that are not finite: look at its coefficients{suspects}")
    if not off <= SYMMETRIC * length:
        raise ValueError(
            f"Body: a is not symmetric: a(u, v) and a(v, u) differ by {off / (length or 1.0):.1e} of their size; "
            "contact with friction needs a symmetric positive definite a"
        )
    if definite and not least > 0.0:
        raise ValueError(
            f"Body: a is not positive definite: a(u, u) = {least:.3g} for the hat function at x = ({place}); "
            f"look at the signs of its terms and coefficients{suspects}"
        )
