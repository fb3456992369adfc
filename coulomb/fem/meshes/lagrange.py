"""The Lagrange functions of cells of degree 1 and 2, and the nodes of a mesh with cells of that degree."""

from __future__ import annotations

import functools
from typing import Any, Literal

import numpy as np
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from ...exchange import Exchange
from .. import compat
from ..cell_search import lagrange
from ..compat import basix, cpp, mesh

# Second-order cells in mesh files: the orders of their nodes, and the faults that only they can have.
#
# A `MeshFile` has the nodes of 10-node tetrahedra and 27-node hexahedra in VTK's order, which is also that of Abaqus,
# Nastran, Exodus II and MED except for the faces (and some edges) of hexahedra; corners come first.  The permutations
# between VTK, gmsh and DOLFINx are DOLFINx's own.


CORNERS = {4: 4, 8: 8, 10: 4, 27: 8}
"""Corners of a cell, by the number of its nodes."""

_HEXAHEDRON_IN_VTK = {
    "exodus": (*range(12), *range(16, 20), *range(12, 16), 23, 24, 25, 26, 21, 22, 20),
    "med": (*range(20), 24, 22, 21, 23, 20, 25, 26),
}
"""Columns of a 27-node hexahedron that make VTK's order: Exodus II has the edges between bottom and top before those of
the top, then the middles of the cell, bottom, top, -x, +x, -y, +y (Schoof and Yarberry 1994, and libMesh's map); MED
bottom, -y, +x, +y, -x, top and the cell (gmsh's map).  VTK has -x, +x, -y, +y, bottom, top and the cell."""


def is_second_order(width: int) -> bool:
    """Whether cells with so many nodes have nodes beside their corners."""
    return CORNERS[width] != width


def in_vtk_order(cells: IntArray, of: Literal["dolfinx", "gmsh", "exodus", "med"]) -> IntArray:
    """Cells (c, 4, 8, 10 or 27) with the order of nodes of a format, or DOLFINx's, in VTK's order."""
    width = cells.shape[1]
    if of == "dolfinx":
        return cells[:, np.argsort(cpp.io.perm_vtk(_kind(width), width))]
    if not is_second_order(width):
        return cells
    if of == "gmsh":
        from_gmsh, from_vtk = (np.asarray(table(_kind(width), width)) for table in (cpp.io.perm_gmsh, cpp.io.perm_vtk))
        return cells[:, from_gmsh[np.argsort(from_vtk)]]
    return cells[:, list(_HEXAHEDRON_IN_VTK[of])] if width == 27 else cells


def in_dolfinx_order(cells: IntArray) -> IntArray:
    """Cells (c, 4, 8, 10 or 27) with VTK's order of nodes, in DOLFINx's."""
    width = cells.shape[1]
    return cells[:, np.asarray(cpp.io.perm_vtk(_kind(width), width))]


def nodes_between(width: int) -> list[tuple[int, tuple[int, ...]]]:
    """Column of every node that is no corner, and the columns of the corners in whose middle it is, VTK's order: two
    for an edge, four for a face, eight for the cell."""
    kind, order = _kind(width), np.asarray(cpp.io.perm_vtk(_kind(width), width))
    weights = lagrange_values(kind, 1, lagrange_points(kind, 2))
    corners = CORNERS[width]
    return [
        (int(order[node]), tuple(sorted(int(order[corner]) for corner in np.flatnonzero(weights[node] > 1e-9))))
        for node in range(corners, width)
    ]


@functools.cache
def nodes_of_facets(width: int, facets: tuple[tuple[int, ...], ...]) -> tuple[tuple[int, ...], ...]:
    """Columns of all nodes on each facet that is given by the columns of its corners, these first."""
    if not is_second_order(width):
        return facets
    between = nodes_between(width)
    return tuple((*facet, *(node for node, of in between if set(of) <= set(facet))) for facet in facets)


def jacobians(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Determinant of the Jacobian, and the longest derivative, at all nodes of cells with nodes x (c, nodes, 3) in
    DOLFINx's order, shape (nodes, c) each; of 4-node tetrahedra, where it is constant, at one."""
    width, count = x.shape[1], len(x)
    kind, degree = _kind(width), 2 if is_second_order(width) else 1
    nodes = lagrange_points(kind, degree)[: 1 if width == 4 else width]
    edges = (x - x[:, :1]).swapaxes(0, 1).reshape(width, -1)  # so that cells shrunk to a point have exactly 0
    sizes = np.empty((2, len(nodes), count))
    for node, slopes in enumerate(lagrange_slopes(kind, degree, nodes).transpose(1, 0, 2)):
        derivatives = (slopes @ edges).reshape(3, count, 3).swapaxes(0, 1)
        sizes[:, node] = np.linalg.det(derivatives), np.max(np.linalg.norm(derivatives, axis=2), axis=1, initial=0.0)
    return sizes[0], sizes[1]


def torn(cells: IntArray, comm: MPI.Comm) -> BoolArray:
    """This rank's cells with a node in the middle of an edge or face where a neighbour has another one, or that is
    elsewhere in another cell; collective.  A wrong order of nodes shows here too."""
    corners = CORNERS[cells.shape[1]]
    at_corners = cells[:, :corners].ravel()
    of_cell: list[IntArray] = [np.repeat(np.arange(len(cells)), corners)]
    nodes: list[IntArray] = [at_corners]
    keys: list[IntArray] = [np.column_stack([np.full((at_corners.size, 3), -1), at_corners])]  # a corner is its own key
    for column, of in nodes_between(cells.shape[1]):
        if len(of) < 8:
            around = np.sort(cells[:, list(of)], axis=1)
            keys.append(np.column_stack([*[np.full(len(cells), -1)] * (4 - len(of)), around]))
            nodes.append(cells[:, column])
            of_cell.append(np.arange(len(cells)))
    key, node, cell = np.concatenate(keys), np.concatenate(nodes)[:, None], np.concatenate(of_cell)
    bad = _ambiguous(key, node, comm) | _ambiguous(node, key, comm)
    torn_cells = np.zeros(len(cells), dtype=bool)
    torn_cells[cell[bad]] = True
    return torn_cells


def _ambiguous(one: IntArray, other: IntArray, comm: MPI.Comm) -> BoolArray:
    """Where a row of `one` occurs with different rows of `other`; collective."""
    exchange = Exchange(comm, one.sum(axis=1) % comm.size)
    first, second = (np.unique(exchange.send(rows), axis=0, return_inverse=True)[1].ravel() for rows in (one, other))
    pairs = np.unique(np.column_stack([first, second]), axis=0)
    several = np.bincount(pairs[:, 0])[first] > 1
    return np.asarray(exchange.reply(several), dtype=bool)


def _kind(width: int) -> mesh.CellType:
    return mesh.CellType.tetrahedron if CORNERS[width] == 4 else mesh.CellType.hexahedron


def corner_geometry(domain: Any) -> Int32Array:
    """Geometry nodes at the corners of every local cell, ghosts included, shape (cells, 4 or 8)."""
    return compat.cell_geometry(domain)[:, : len(lagrange_points(domain.topology.cell_type, 1))]


def lagrange_points(cell: Any, degree: int) -> FloatArray:
    """Nodes of the Lagrange functions of a cell in the reference cell, in DOLFINx's order, shape (functions, dim)."""
    return np.asarray(lagrange(cell.name, degree).points, dtype=np.float64)


def lagrange_values(cell: Any, degree: int, X: FloatArray) -> FloatArray:
    """Values of the Lagrange functions of a cell at reference points X (p, dim), shape (p, functions)."""
    element = lagrange(cell.name, degree)
    if not len(X):  # of which basix 0.5 aborts the process
        return np.empty((0, len(element.points)))
    return np.asarray(element.tabulate(0, X))[0, :, :, 0]


def functions_of_nodes(cell: Any, count: int, X: FloatArray) -> FloatArray:
    """Values at reference points X (p, dim) of the functions of a cell's first nodes, shape (p, count): Lagrange's,
    and of 20 nodes of a hexahedron, without those in the middles of faces and cell, the serendipity functions."""
    if count != 20:
        return np.round(8.0 * lagrange_values(cell, 1 if count in (4, 8) else 2, X)) / 8.0

    def monomials(x: FloatArray) -> FloatArray:
        powers = [p for p in np.ndindex(3, 3, 3) if p.count(2) < 2]
        return np.column_stack([np.prod(x**p, axis=1) for p in powers])

    return monomials(X) @ np.linalg.inv(monomials(lagrange_points(cell, 2)[:20]))


def lagrange_slopes(cell: Any, degree: int, X: FloatArray) -> FloatArray:
    """Derivatives of the Lagrange functions at reference points X (p, dim), shape (dim, p, functions)."""
    return np.asarray(lagrange(cell.name, degree).tabulate(1, X))[1:, :, :, 0]


def corners_to_nodes(cell: Any) -> FloatArray:
    """Matrix from values at the corners of a cell to those at the nodes of its second-order Lagrange functions, shape
    (nodes, corners): exactly 1, 1/2, 1/4 or 1/8."""
    return np.round(8.0 * lagrange_values(cell, 1, lagrange_points(cell, 2))) / 8.0


@functools.cache
def facet_columns(cell: Any, degree: int) -> IntArray:
    """Columns of a cell's nodes that are on each of its facets, shape (facets, nodes of a facet): a facet's nodes in
    VTK's order, those of the cell and the facets themselves in DOLFINx's."""
    kind = {"tetrahedron": mesh.CellType.triangle, "hexahedron": mesh.CellType.quadrilateral}[cell.name]
    nodes, on_facet = lagrange_points(cell, degree), lagrange_points(kind, degree)
    order = np.argsort(cpp.io.perm_vtk(kind, len(on_facet)))
    columns = []
    for corners in basix.topology(getattr(basix.CellType, cell.name))[2]:
        x = lagrange_values(kind, 1, on_facet) @ lagrange_points(cell, 1)[corners]
        distance = np.linalg.norm(nodes[None] - x[:, None], axis=2)
        columns.append(np.argmin(distance, axis=1)[order])
    return np.array(columns)
