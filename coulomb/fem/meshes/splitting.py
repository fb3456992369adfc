"""A second-order mesh as a finer one of first order on the same nodes."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ...arrays import IntArray
from .. import compat
from .exchange import global_numbers, starts_of
from .lagrange import facet_columns, lagrange_points
from .mesh_parts import local_cells, local_facets
from .named_mesh import NamedMesh


def split(mesh: NamedMesh) -> NamedMesh:
    """The mesh with eight first-order cells in place of each, on its nodes, which are at curved faces; collective.

    Args:
        mesh: A second-order mesh with its named faces and groups of cells, which are kept.
    """
    old, comm = mesh.domain, mesh.comm
    parts, on_facets = _pattern(old.topology.cell_type)
    nodes, own = old.geometry.index_map(), old.topology.index_map(3).size_local
    of_cells = global_numbers(nodes)[compat.cell_geometry(old)]
    cells, x = of_cells[:own, parts].reshape(-1, parts.shape[1]), old.geometry.x[: nodes.size_local].copy()
    domain = compat.create_mesh(comm, old.topology.cell_type.name, cells, x)

    for dims in ((2, 3), (3, 2)):
        old.topology.create_connectivity(*dims)
    cell_of, facets_of = old.topology.connectivity(2, 3), old.topology.connectivity(3, 2)
    facets = facets_of.array.reshape(-1, len(on_facets))
    rows = {}
    for name, mine in mesh.faces.items():
        cell = cell_of.array[cell_of.offsets[mine]]
        place = np.argmax(facets[cell] == mine[:, None], axis=1)
        rows[name] = np.sort(of_cells[cell[:, None, None], on_facets[place]].reshape(-1, on_facets.shape[2]), axis=1)
    first, eight = 8 * old.topology.index_map(3).local_range[0], np.arange(8)
    groups = {
        name: first + (8 * np.asarray(mine, dtype=np.int64)[:, None] + eight).ravel()
        for name, mine in mesh.cells.items()
    }
    faces = local_facets(domain, rows)
    return NamedMesh(domain, faces, local_cells(domain, starts_of(comm, 8 * own), groups))


@functools.cache
def _pattern(cell: Any) -> tuple[IntArray, IntArray]:
    """Columns of the nodes of a second-order cell that are the corners of its eight parts, shape (8, corners), and the
    corners of the parts' facets on each of its facets, shape (facets, 4, corners of a facet)."""
    lattice = np.round(2.0 * lagrange_points(cell, 2)).astype(int)
    corners = np.round(lagrange_points(cell, 1)).astype(int)
    column = {tuple(place): k for k, place in enumerate(lattice)}
    if len(corners) == 8:
        parts = [[column[tuple(first + corner)] for corner in corners] for first in corners]
    else:
        middle = {(i, j): column[tuple(corners[i] + corners[j])] for i in range(4) for j in range(4)}
        at_corners = [[middle[i, j] for j in range(4)] for i in range(4)]
        around = [(0, 1), (0, 3), (2, 3), (1, 2)]  # of the octahedron in the middle, about its diagonal (0, 2)-(1, 3)
        inside = [
            [middle[0, 2], middle[1, 3], middle[one], middle[other]]
            for one, other in zip(around, [*around[1:], around[0]], strict=True)
        ]
        parts = at_corners + inside
    sides = facet_columns(cell, 1)
    on_facets = [
        [[part[k] for k in side] for part in parts for side in sides if {part[k] for k in side} <= set(nodes)]
        for nodes in facet_columns(cell, 2)
    ]
    return np.array(parts, dtype=np.int64), np.array(on_facets, dtype=np.int64)
