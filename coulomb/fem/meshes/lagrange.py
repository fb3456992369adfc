"""The Lagrange functions of cells of degree 1 and 2, and the nodes of a mesh with cells of that degree."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from .. import compat
from ..compat import basix, cpp, mesh


def corner_geometry(domain: Any) -> npt.NDArray[np.int32]:
    """Geometry nodes at the corners of every local cell, ghosts included, shape (cells, 4 or 8)."""
    return compat.cell_geometry(domain)[:, : len(lagrange_points(domain.topology.cell_type, 1))]


def lagrange_points(cell: Any, degree: int) -> FloatArray:
    """Nodes of the Lagrange functions of a cell in the reference cell, in DOLFINx's order, shape (functions, dim)."""
    points: FloatArray = np.asarray(_element(cell.name, degree).points, dtype=np.float64)
    return points


def lagrange_values(cell: Any, degree: int, X: FloatArray) -> FloatArray:
    """Values of the Lagrange functions of a cell at reference points X (p, dim), shape (p, functions)."""
    values: FloatArray = np.asarray(_element(cell.name, degree).tabulate(0, X))[0, :, :, 0]
    return values


def lagrange_slopes(cell: Any, degree: int, X: FloatArray) -> FloatArray:
    """Derivatives of the Lagrange functions at reference points X (p, dim), shape (dim, p, functions)."""
    slopes: FloatArray = np.asarray(_element(cell.name, degree).tabulate(1, X))[1:, :, :, 0]
    return slopes


@functools.cache
def facet_columns(cell: Any, degree: int) -> npt.NDArray[np.int64]:
    """Columns of a cell's nodes that are on each of its facets, shape (facets, nodes of a facet).

    The nodes of a facet are in VTK's order, those of the cell and the facets themselves in DOLFINx's.
    """
    kind = {"tetrahedron": mesh.CellType.triangle, "hexahedron": mesh.CellType.quadrilateral}[cell.name]
    nodes, on_facet = lagrange_points(cell, degree), lagrange_points(kind, degree)
    order = np.argsort(cpp.io.perm_vtk(kind, len(on_facet)))
    columns = []
    for corners in basix.topology(getattr(basix.CellType, cell.name))[2]:
        x = lagrange_values(kind, 1, on_facet) @ lagrange_points(cell, 1)[corners]
        distance = np.linalg.norm(nodes[None] - x[:, None], axis=2)
        columns.append(np.argmin(distance, axis=1)[order])
    return np.array(columns)


@functools.cache
def _element(cell: str, degree: int) -> Any:
    variant = basix.LagrangeVariant.equispaced
    return basix.create_element(basix.ElementFamily.P, getattr(basix.CellType, cell), degree, variant)
