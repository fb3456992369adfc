"""Values of DOLFINx's functions, and of expressions of UFL, at points of their mesh.

A function of any space is evaluated there as it is; an expression is interpolated in each cell by a polynomial of
second order, which is exact at vertices and at the middles of edges, faces and cells.  Where the values of the cells at
a point differ, as those of DG spaces, the mean of these cells counts, on any number of ranks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, Int32Array
from . import compat
from .cell_search import NEWER, ROUNDING, SIMPLICES, CellSearch, Near, lagrange
from .compat import fem, mesh, ufl

_CELLS: Final = (*SIMPLICES, "quadrilateral", "hexahedron")


class UflValues:
    """A fem.Constant, fem.Function, fem.Expression, or expression of UFL, evaluated on this rank; made collectively.

    Attributes:
        constant: Its value, shape `ufl_shape`, where it does not depend on place; else None.

    Raises:
        ValueError: If it has no values at points: arguments, facet normals, several meshes.
    """

    def __init__(self, given: Any):
        self._given = given.ufl_expression if isinstance(given, fem.Expression) else given
        self.shape = tuple(int(n) for n in self._given.ufl_shape)
        self.size = int(np.prod(self.shape, dtype=int))
        self.name = f"the function {given.name!r}" if isinstance(given, fem.Function) else "the expression"
        domains = [] if isinstance(given, fem.Constant) else ufl.domain.extract_domains(self._given)
        self.constant: FloatArray | None = None
        if isinstance(given, fem.Constant):
            self.constant = np.array(given.value, dtype=np.float64)
        elif not domains:
            numbers = [(self._given[i] if i else self._given)(()) for i in np.ndindex(*self.shape)]
            self.constant = np.array(numbers, dtype=np.float64).reshape(self.shape)
        elif len(domains) > 1:
            raise ValueError(f"{self.name} is on {len(domains)} meshes; it needs one")
        else:
            self._mesh = given.function_space.mesh if self._is_function else _mesh_of(domains[0])
            kind = self._mesh.topology.cell_type.name
            if kind not in _CELLS:
                raise ValueError(f"{self.name} is on cells of type {kind}, in which points are not looked for")
            for part in ufl.corealg.traversal.unique_pre_traversal(self._given):
                if isinstance(part, ufl.Argument):
                    raise ValueError(f"{self.name} has trial or test functions, and no values")
                if isinstance(part, ufl.Coefficient) and "uadrature" in repr(part.ufl_element()):
                    of = "" if self._is_function else "a function with "
                    raise ValueError(
                        f"{self.name} has {of}values at quadrature points alone: project it onto a space that has "
                        "values everywhere, such as DG of degree 0, the mean of each cell"
                    )
                if isinstance(part, ufl.geometry.GeometricFacetQuantity):
                    raise ValueError(
                        f"{self.name} has {part}, which has values on facets alone; coulomb.Pressure acts along the "
                        "normal, and a function of x, shape (3, k), may compute what it likes"
                    )
            self.cells = CellSearch(self._mesh)
            if not self._is_function:  # compiled by all ranks together, also by those without a point
                self._expression = fem.Expression(self._given, lagrange(kind, 2).points)

    @property
    def _is_function(self) -> bool:
        return isinstance(self._given, fem.Function)

    def sums(self, x: FloatArray, near: Near, outside: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sums of the values of this rank's own cells at points x (k, 3), shape (k, size), and the number of cells,
        shape (k,): of those that have the point, or are `outside` (k,) of it at most."""
        total, count = np.zeros((len(x), self.size)), np.zeros(len(x))
        taken = near.outside <= np.maximum(outside[near.point], ROUNDING)
        point, cell = near.point[taken], near.cell[taken]
        np.add.at(total, point, self._values(x[point], cell, near.X[taken]))
        np.add.at(count, point, 1.0)
        return total, count

    def _values(self, x: FloatArray, cell: Int32Array, X: FloatArray) -> FloatArray:
        """Values at points x (p, 3) in cells (p,), at reference coordinates X (p, d), shape (p, size)."""
        if not len(x):
            return np.empty((0, self.size))
        if self._is_function:
            return np.asarray(self._given.eval(x, cell), dtype=np.float64).reshape(len(x), self.size)
        element = lagrange(self._mesh.topology.cell_type.name, 2)
        cells, row = np.unique(cell, return_inverse=True)
        at_nodes = in_cells(self._expression, self._mesh, cells).reshape(len(cells), -1, self.size)
        return np.einsum("pn,pnj->pj", element.tabulate(0, X)[0, :, :, 0], at_nodes[row])


def present_values(given: object) -> list[FloatArray]:
    """The values that functions and constants have at present, on this rank, of an argument or those in it: fields of
    dataclasses, entries of lists and dictionaries, terms of expressions."""
    if isinstance(given, fem.Constant):
        return [np.array(given.value)]
    if isinstance(given, fem.Function):
        return [np.array(given.x.array)]
    parts: Iterable[object] = ()
    if isinstance(given, fem.Expression):
        parts = [given.ufl_expression]
    elif isinstance(given, ufl.core.expr.Expr):
        terms = ufl.corealg.traversal.unique_pre_traversal(given)
        parts = [term for term in terms if isinstance(term, fem.Function | fem.Constant)]
    elif isinstance(given, Mapping):
        parts = given.values()
    elif isinstance(given, list | tuple):
        parts = given
    elif is_dataclass(given):
        parts = [getattr(given, one.name) for one in fields(given)]
    return [value for part in parts for value in present_values(part)]


def _mesh_of(domain: Any) -> Any:
    """The mesh behind a domain of UFL."""
    return mesh.Mesh(compat.cpp_of(domain.ufl_cargo()), ufl.Mesh(domain.ufl_coordinate_element()))


def in_cells(expression: Any, domain: Any, cells: Int32Array) -> FloatArray:
    """Values of an `Expression` at its points of some cells, a row for each."""
    return np.asarray(expression.eval(*((domain, cells) if NEWER else (cells,))), dtype=np.float64)
