"""Second-order cells as first-order ones with the same nodes, which show curved edges and all values."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from ...io.field_files import OPPOSITE, Block, Grid

_LATTICE = {
    **{(0, 0, 0): 0, (2, 0, 0): 1, (2, 2, 0): 2, (0, 2, 0): 3, (0, 0, 2): 4, (2, 0, 2): 5, (2, 2, 2): 6, (0, 2, 2): 7},
    **{(1, 0, 0): 8, (2, 1, 0): 9, (1, 2, 0): 10, (0, 1, 0): 11, (1, 0, 2): 12, (2, 1, 2): 13, (1, 2, 2): 14},
    **{(0, 1, 2): 15, (0, 0, 1): 16, (2, 0, 1): 17, (2, 2, 1): 18, (0, 2, 1): 19, (0, 1, 1): 20, (2, 1, 1): 21},
    **{(1, 0, 1): 22, (1, 2, 1): 23, (1, 1, 0): 24, (1, 1, 2): 25, (1, 1, 1): 26},
}
"""The nodes of a 27-node hexahedron in VTK's order, by their places."""

_AROUND = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))

_PIECES = {
    "Triangle_6": ("Triangle", ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))),
    "Quadrilateral_9": ("Quadrilateral", ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))),
    "Tetrahedron_10": (
        "Tetrahedron",
        (
            *((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3)),  # at the corners
            *((6, 8, 4, 5), (6, 8, 5, 9), (6, 8, 9, 7), (6, 8, 7, 4)),  # the octahedron between them
        ),
    ),
    "Hexahedron_27": (
        "Hexahedron",
        tuple(
            tuple(_LATTICE[i + a, j + b, k + c] for a, b, c in _AROUND)
            for i, j, k in itertools.product((0, 1), repeat=3)
        ),
    ),
}
"""By XDMF's name of a cell that of its pieces, and their nodes; all in VTK's order."""


def first_order(grid: Grid) -> Grid:
    """A grid with every second-order cell cut into first-order ones at its nodes; others as they are."""
    if grid.cell not in _PIECES:
        return grid
    kind, pieces = _PIECES[grid.cell]
    cells = grid.cells[:, np.array(pieces)].reshape(-1, len(pieces[0]))
    fields = {
        name: np.repeat(values, len(pieces), axis=0) if len(values) == len(grid.cells) != len(grid.points) else values
        for name, values in grid.fields.items()
    }
    return Grid(kind, cells, grid.points, fields, grid.cell, len(pieces))


def contact_points(contact: Grid) -> npt.NDArray[np.bool_]:
    """Which nodes of the contact faces have contact conditions, shape (n,): on cut quadratic triangles the vertices,
    and none on faces opposite in pairs."""
    if OPPOSITE in contact.fields:
        mine = np.asarray(contact.fields[OPPOSITE] < 0.0)
    else:
        mine = np.ones(len(contact.points), dtype=bool)
    everything = Block("", slice(0, len(contact.points)), slice(0, len(contact.cells)), contact.cut, contact.pieces)
    for block in contact.blocks or (everything,):
        if block.kind == "Triangle_6":
            corners = contact.cells[block.cells].reshape(-1, 4, contact.cells.shape[1])[:, [0, 1, 2], [0, 1, 2]]
            mine[block.points] &= np.isin(np.arange(len(contact.points))[block.points], corners)
    return mine
