"""Size and mesh of every body as rows of text."""

from __future__ import annotations

import numpy as np

from ...io.field_files import Block
from .files import Run
from .units import in_nodes, quantity

_CELLS = {
    **{"Hexahedron": "hexahedra", "Tetrahedron": "tetrahedra"},
    **{"Hexahedron_27": "27-node hexahedra", "Tetrahedron_10": "10-node tetrahedra"},
}


def bodies_and_meshes(run: Run) -> list[tuple[str, str]]:
    """Size and mesh of every body."""
    grid, case = run.steps[-1].grid("solution"), run.case or {}
    whole = Block("", slice(0, len(grid.points)), slice(0, len(grid.cells)), grid.cut or grid.cell, grid.pieces)
    tables = {body.get("name"): body for body in case.get("body") or ()}
    facts = []
    for block in grid.blocks or (whole,):
        of = f" {block.name}" if block.name else ""
        mesh = tables.get(block.name, {}) if of else case.get("mesh", {})
        source = f" ({' × '.join(map(str, mesh['cells']))})" if "cells" in mesh else ""
        source = f" from {str(mesh['file']).rsplit('/', 1)[-1]}" if "file" in mesh else source
        points = grid.points[block.points]
        count = (block.cells.stop - block.cells.start) // block.pieces
        facts += [
            (f"body{of}", " × ".join(quantity(length, "m") for length in np.ptp(points, axis=0))),
            (
                f"mesh{of and f' of{of}'}",
                f"{count} {_CELLS.get(block.kind, block.kind)}{source}, {in_nodes(len(points))}",
            ),
        ]
    return facts
