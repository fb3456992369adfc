"""Values of DOLFINx's functions, and of expressions of UFL, at points of their mesh.

A point is looked for in the cells by Newton's method, for all candidates of the bounding boxes at once.  A function of
any space is evaluated there as it is; an expression is interpolated in each cell by a polynomial of second order, which
is exact at vertices and at the middles of edges, faces and cells.  Where the values of the cells at a point differ, as
those of DG spaces, the mean of these cells counts, on any number of ranks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray
from . import compat
from .compat import basix, fem, geometry, mesh, ufl

SNAP: Final = 0.05
"""How far outside a cell, in its reference coordinates, a point has its values: other meshes have other chords of a
curved surface."""

ROUNDING: Final = 1e-9
"""How far outside a cell a point is still in it."""

_BEYOND: Final = 0.2
"""Part of its extent by which a curved cell may reach beyond its nodes."""

_STEPS: Final = 20
_AT_ONCE: Final = 5_000
"""Newton steps, and points that are located at a time, so that little memory is needed."""

_NEWER: Final = hasattr(geometry, "bb_tree")
"""Whether DOLFINx is 0.7 or newer."""

_SIMPLICES, _CUBES = ("interval", "triangle", "tetrahedron"), ("quadrilateral", "hexahedron")


class Near(NamedTuple):
    """Points and own cells that have them, or nearly: numbers of both, the reference coordinates, and how far outside
    the cell these are, shapes (p,), (p,), (p, d), (p,)."""

    point: IntArray
    cell: npt.NDArray[np.int32]
    X: FloatArray
    outside: FloatArray


class UflValues:
    """A fem.Constant, fem.Function, fem.Expression, or expression of UFL, evaluated on this rank; made collectively.

    Attributes:
        size: Number of its components.
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
            if kind not in (*_SIMPLICES, *_CUBES):
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
            degree = int(compat.coordinate_element(self._mesh).degree)
            self._simplex, self._curved, self._element = kind in _SIMPLICES, degree > 1, _lagrange(kind, degree)
            if not self._is_function:  # compiled by all ranks together, also by those without a point
                self._expression = fem.Expression(self._given, _lagrange(kind, 2).points)

    @property
    def _is_function(self) -> bool:
        return isinstance(self._given, fem.Function)

    def near(self, x: FloatArray) -> Near:
        """The points x (k, 3) in this rank's own cells, and beside them by `SNAP` at most."""
        parts = [
            self._in_boxes(x[first : first + _AT_ONCE], first)
            for first in (range(0, len(x), _AT_ONCE) if self._tree is not None else ())
        ]
        nothing = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int32), np.empty((0, 3)), np.empty(0)
        return Near(*map(np.concatenate, zip(*parts, strict=True))) if parts else Near(*nothing)

    def sums(self, x: FloatArray, near: Near, outside: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sums of the values of this rank's own cells at points x (k, 3), shape (k, size), and the number of cells,
        shape (k,): of those that have the point, or are `outside` (k,) of it at most."""
        total, count = np.zeros((len(x), self.size)), np.zeros(len(x))
        taken = near.outside <= np.maximum(outside[near.point], ROUNDING)
        point, cell = near.point[taken], near.cell[taken]
        np.add.at(total, point, self._values(x[point], cell, near.X[taken]))
        np.add.at(count, point, 1.0)
        return total, count

    def _values(self, x: FloatArray, cell: npt.NDArray[np.int32], X: FloatArray) -> FloatArray:
        """Values at points x (p, 3) in cells (p,), at reference coordinates X (p, d), shape (p, size)."""
        if not len(x):
            return np.empty((0, self.size))
        if self._is_function:
            return np.asarray(self._given.eval(x, cell), dtype=np.float64).reshape(len(x), self.size)
        element = _lagrange(self._mesh.topology.cell_type.name, 2)
        cells, row = np.unique(cell, return_inverse=True)
        at_nodes = self._in_cells(cells).reshape(len(cells), -1, self.size)
        return np.einsum("pn,pnj->pj", element.tabulate(0, X)[0, :, :, 0], at_nodes[row])

    def _in_cells(self, cells: npt.NDArray[np.int32]) -> FloatArray:
        return in_cells(self._expression, self._mesh, cells)

    @cached_property
    def _tree(self) -> Any:
        rows, x = compat.cell_geometry(self._mesh), self._mesh.geometry.x
        own = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        if not own:
            return None
        extent = float(np.max(np.ptp(x[rows[:own]], axis=1)))
        return _boxes(self._mesh, own, (_BEYOND if self._curved else SNAP) * extent)

    def _in_boxes(self, x: FloatArray, first: int) -> Near:
        """Of points x (k, 3), whose numbers begin with `first`."""
        cell, offsets = _cells_near(self._tree, x)
        point = np.repeat(np.arange(len(x)), np.diff(offsets))
        X, outside = self._reference(cell, x[point])
        here = outside <= SNAP
        return Near(first + point[here], cell[here], X[here], outside[here])

    def _reference(self, cell: npt.NDArray[np.int32], x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Reference coordinates of points x (p, 3) in cells (p,), shape (p, d), and how far outside these are (p,)."""
        nodes = self._mesh.geometry.x[compat.cell_geometry(self._mesh)[cell]]
        size = np.max(np.ptp(nodes, axis=1), axis=1, initial=0.0)
        X = np.full((len(x), self._mesh.topology.dim), 0.25 if self._simplex else 0.5)
        off = np.zeros(len(x))
        going = np.arange(len(x))
        if not len(x):  # Basix tabulates no empty set of points
            return X, off
        for _ in range(_STEPS):
            table = self._element.tabulate(1, X[going])[..., 0]
            residual = x[going] - np.einsum("pn,pni->pi", table[0], nodes[going])
            off[going] = np.max(np.abs(residual), axis=1, initial=0.0) / size[going]
            more = off[going] > 1e-14
            going, residual = going[more], residual[more]
            if not len(going):
                break
            slopes = np.einsum("dpn,pni->pid", table[1:, more], nodes[going])
            X[going] = np.clip(X[going] + _solved(slopes, residual), -2.0, 3.0)
        beyond = (np.sum(X, axis=1) if self._simplex else np.max(X, axis=1, initial=0.0)) - 1.0
        return X, np.maximum(np.maximum(-np.min(X, axis=1, initial=1.0), beyond), np.where(off > ROUNDING, off, 0.0))


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
        parts = [one for one in terms if isinstance(one, fem.Function | fem.Constant)]
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


def in_cells(expression: Any, domain: Any, cells: npt.NDArray[np.int32]) -> FloatArray:
    """Values of an `Expression` at its points of some cells, a row for each."""
    return np.asarray(expression.eval(*((domain, cells) if _NEWER else (cells,))), dtype=np.float64)


def _boxes(domain: Any, count: int, padding: float) -> Any:
    """The tree of the boxes around the first cells of this rank."""
    cells = np.arange(count, dtype=np.int32)
    if _NEWER:
        return geometry.bb_tree(domain, domain.topology.dim, entities=cells, padding=padding)
    return geometry.BoundingBoxTree(domain, domain.topology.dim, cells, padding)


def _cells_near(boxes: Any, x: FloatArray) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """The cells whose boxes have the points x (k, 3), one point after the other, and where those of each begin."""
    find = geometry.compute_collisions_points if _NEWER else geometry.compute_collisions
    near = find(boxes, np.ascontiguousarray(x))
    return near.array, near.offsets


def _solved(slopes: FloatArray, residual: FloatArray) -> FloatArray:
    """Newton's steps, shape (p, d), by derivatives (p, 3, d) along the reference coordinates."""
    if slopes.shape[2] == 3:
        try:
            return np.linalg.solve(slopes, residual[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:  # a point far outside a distorted cell
            pass
    return np.einsum("pdi,pi->pd", np.linalg.pinv(slopes), residual)


def _lagrange(kind: str, degree: int) -> Any:
    variant = basix.LagrangeVariant.equispaced if degree < 3 else basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, getattr(basix.CellType, kind), degree, variant)
