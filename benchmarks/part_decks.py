"""Parts as decks for coulomb, CalculiX and GetFEM: parts/decks/NAME.inp with the mesh that gmsh makes of NAME.geo.

Millimetres, newtons, megapascals, one load step.  Physical volumes are sets of elements, physical surfaces sets
of nodes and surfaces.  In place of a line "traction, SURFACE, X, Y, Z" among the *CLOAD come its nodal forces.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from coulomb.arrays import FloatArray, IntArray
from coulomb.decks.geometry import SIDES
from coulomb.fem.meshes.gmsh_format import read

from .peers.calculix import numbered

DECKS: Final = Path(__file__).parent / "parts" / "decks"

_KINDS: Final = {4: "C3D4", 8: "C3D8", 10: "C3D10"}
_MIDDLES: Final = {(0, 1): 4, (1, 2): 5, (0, 2): 6, (0, 3): 7, (1, 3): 8, (2, 3): 9}
"""Of the edges of a 10-node tetrahedron."""


def write(part: Path, scale: float, order: int, folder: Path) -> Path:
    """The deck of a part, with all sizes of its mesh multiplied by a scale, of first or second order.

    Raises:
        RuntimeError: If gmsh fails.
    """
    mesh = folder / "mesh.msh"
    command = [
        "gmsh",
        "-3",
        str(part.with_suffix(".geo")),
        "-clscale",
        f"{scale:g}",
        "-order",
        str(order),
        "-optimize_ho",
    ]
    done = subprocess.run([*command, "-o", str(mesh)], capture_output=True, text=True, check=False)
    if done.returncode or not mesh.is_file():
        raise RuntimeError(f"gmsh: {done.stderr.strip()[-500:] or 'no mesh was made'}")
    deck = folder / f"{part.stem}.inp"
    deck.write_text(deck_of(mesh, part.with_suffix(".inp").read_text()))
    return deck


def deck_of(mesh: Path, cards: str) -> str:
    """The deck of a mesh file of gmsh and the other cards."""
    return "\n".join([*_lines(mesh, cards), ""])


def _lines(path: Path, cards: str) -> Iterator[str]:
    mesh = read(str(path))
    kind = mesh.cells.shape[1]
    yield from ("*NODE, NSET=ALL", *numbered(mesh.points.round(9)))  # 20 columns at most
    for name, cells in mesh.cell_groups.items():
        yield f"*ELEMENT, TYPE={_KINDS[kind]}, ELSET={name}"
        yield from (f"{cell + 1},{','.join(map(str, mesh.cells[cell] + 1))}" for cell in cells)
    facets = {}
    for name, corners in mesh.face_groups.items():
        cells, sides = _located(mesh.cells, corners)
        facets[name] = nodes = _nodes(mesh.cells, cells, sides)
        yield from (f"*NSET, NSET={name}", *(f"{node + 1}," for node in np.unique(nodes)))
        yield from (f"*SURFACE, NAME={name}", *(f"{c + 1}, S{s + 1}" for c, s in zip(cells, sides, strict=True)))
    for line in cards.splitlines():
        if found := re.match(r"traction,\s*(\w+),(.*)", line):
            value = np.array([float(word) for word in found[2].split(",")])
            for node, area in _areas(mesh.points, facets[found[1]]):
                yield from (f"{node + 1},{k + 1},{area * value[k]:.12g}" for k in np.flatnonzero(value))
        else:
            yield line


def _located(cells: IntArray, corners: IntArray) -> tuple[IntArray, IntArray]:
    """The cell of every facet, given by its corners, and its side of it."""
    sides = SIDES[4 if cells.shape[1] in (4, 10) else 8]
    whole = np.sort(cells[:, np.array(sides)], axis=2).reshape(-1, len(sides[0]))
    both, number = np.unique(np.concatenate([whole, np.sort(corners, axis=1)]), axis=0, return_inverse=True)
    where = np.full(len(both), -1)
    where[number[: len(whole)]] = np.arange(len(whole))
    at = where[number[len(whole) :]]
    return at // len(sides), at % len(sides)


def _nodes(cells: IntArray, of: IntArray, sides: IntArray) -> IntArray:
    """Nodes of the facets, shape (f, 3, 4 or 6): corners, then middles."""
    table = [list(side) for side in SIDES[4 if cells.shape[1] in (4, 10) else 8]]
    if cells.shape[1] == 10:
        for side in table:
            a, b, c = side
            side += [_MIDDLES[min(i, j), max(i, j)] for i, j in ((a, b), (b, c), (c, a))]
    nodes: IntArray = cells[of[:, None], np.array(table)[sides]]
    return nodes


def _areas(points: FloatArray, facets: IntArray) -> list[tuple[int, float]]:
    """Integrals of the shape functions of the nodes of flat triangles."""
    a, b, c = (points[facets[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1) / 3.0
    loaded = facets[:, -3:]  # of second order, those at the corners are zero
    sums = np.bincount(loaded.ravel(), np.repeat(area, 3))
    return [(int(node), float(sums[node])) for node in np.unique(loaded)]
