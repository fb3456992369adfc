"""Decks of three kinds whose contacts are a cell or two wide, with 1, 8 and 64 cells for each: what differs from
CalculiX by elements, by ties at nodes and by the edges of a contact goes with the cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

DIVIDED: Final = (1, 2, 4)

_CELLS: Final = {"C3D8": [[0, 1, 2, 3, 4, 5, 6, 7]], "C3D6": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]]}
"""Cells of a block by its corners; the first side of both is below, the second above."""

Triple = tuple[float, float, float]


class _Deck:
    """A deck of blocks, in millimetres, newtons and megapascals; the sets of the lowest and highest nodes and cells of
    a block, and the surfaces there, have its name with LOW and TOP."""

    def __init__(self) -> None:
        self._nodes = self._cells = 0
        self.lines: list[str] = []

    def block(self, name: str, kind: str, counts: tuple[int, int, int], low: Triple, high: Triple) -> None:
        grid = np.stack(np.meshgrid(*map(np.arange, np.add(counts, 1)), indexing="ij"), axis=3)
        number = self._nodes + 1 + np.arange(grid[..., 0].size).reshape(grid.shape[:3])
        places = np.array(low) + grid * (np.subtract(high, low) / counts)
        self.lines += ["*NODE, NSET=ALL"]
        self.lines += [
            f"{n}, {x:.9g}, {y:.9g}, {z:.9g}"
            for n, (x, y, z) in zip(number.ravel(), places.reshape(-1, 3), strict=True)
        ]
        ways = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
        nx, ny, nz = counts
        corners = np.stack([number[i : nx + i, j : ny + j, k : nz + k] for i, j, k in ways], axis=3)
        cells = np.stack([corners[..., of] for of in _CELLS[kind]], axis=3)
        order = self._cells + 1 + np.arange(cells[..., 0].size).reshape(cells.shape[:4])
        self.lines += [f"*ELEMENT, TYPE={kind}, ELSET={name}"]
        self.lines += [
            ", ".join(map(str, [n, *nodes]))
            for n, nodes in zip(order.ravel(), cells.reshape(order.size, -1), strict=True)
        ]
        for end, k in (("LOW", 0), ("TOP", -1)):
            self._set("NSET", name + end, number[:, :, k].ravel())
            self._set("ELSET", name + end, order[:, :, k].ravel())
        for end, side in (("LOW", 1), ("TOP", 2)):
            self.lines += [f"*SURFACE, NAME={name}{end}", f"{name}{end}, S{side}"]
        self._nodes, self._cells = int(number.max()), int(order.max())

    def cells_at(self, name: str, numbers: Sequence[int], side: int) -> None:
        """A surface of cells, by their numbers before the last ones."""
        self.lines += [f"*SURFACE, NAME={name}", *(f"{self._cells + 1 - n}, S{side}" for n in numbers)]

    def node(self, x: Triple) -> int:
        self._nodes += 1
        self.lines += ["*NODE", f"{self._nodes}, {x[0]}, {x[1]}, {x[2]}"]
        return self._nodes

    def steel(self, *names: str) -> None:
        self.lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", "210000., 0.3"]
        self.lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL=STEEL" for name in names]
        self.lines += ["*SURFACE INTERACTION, NAME=DRY", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", "1.E6"]
        self.lines += ["*FRICTION", "0.3, 1.E5"]

    def pair(self, slave: str, master: str) -> None:
        self.lines += ["*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE", f"{slave}, {master}"]

    def step(self, *loads: str) -> str:
        return "\n".join([*self.lines, "*STEP", "*STATIC", ".2, 1.", *loads, "*END STEP"]) + "\n"

    def _set(self, kind: str, name: str, numbers: npt.NDArray[np.integer[Any]]) -> None:
        self.lines += [f"*{kind}, {kind}={name}", *(f"{n}," for n in numbers)]


def prisms(k: int) -> str:
    """A cube of hexahedra on one of prisms, which become tetrahedra here."""
    deck = _Deck()
    deck.block("BASE", "C3D6", (2 * k, 2 * k, 2 * k), (0.0, 0.0, 0.0), (10.0, 10.0, 5.0))
    deck.block("CUBE", "C3D8", (2 * k, 2 * k, 2 * k), (0.0, 0.0, 5.0), (10.0, 10.0, 10.0))
    deck.steel("BASE", "CUBE")
    deck.pair("CUBELOW", "BASETOP")
    return deck.step("*BOUNDARY", "BASELOW, 1, 3", "*DLOAD", "CUBETOP, P2, 30.")


def tie(k: int) -> str:
    """A finer plate tied to a coarse one, CalculiX at its nodes, and a cube on it."""
    deck = _Deck()
    deck.block("BASE", "C3D8", (2 * k, 2 * k, k), (0.0, 0.0, 0.0), (10.0, 10.0, 4.0))
    deck.block("PLATE", "C3D8", (3 * k, 3 * k, k), (0.0, 0.0, 4.0), (10.0, 10.0, 7.0))
    deck.block("CUBE", "C3D8", (2 * k, 2 * k, 2 * k), (0.0, 0.0, 7.0), (10.0, 10.0, 11.0))
    deck.steel("BASE", "PLATE", "CUBE")
    deck.lines += ["*TIE, NAME=GLUE, POSITION TOLERANCE=.1", "PLATELOW, BASETOP"]
    deck.pair("CUBELOW", "PLATETOP")
    return deck.step("*BOUNDARY", "BASELOW, 1, 3", "CUBETOP, 1, 2", "*DLOAD", "CUBETOP, P2, 30.")


def bolt(k: int) -> str:
    """Two plates, pressed by a strut that is lengthened until it carries 3 kN."""
    deck = _Deck()
    for name, z in (("BASE", 0.0), ("LID", 4.0)):
        deck.block(name, "C3D8", (4 * k, 4 * k, 2 * k), (0.0, 0.0, z), (20.0, 20.0, z + 4.0))
    deck.block("STRUT", "C3D8", (k, k, 6 * k), (7.5, 7.5, 8.0), (12.5, 12.5, 20.0))
    above = np.arange(6 * k * k * k).reshape(k, k, 6 * k)[:, :, 3 * k]  # cells above the middle
    deck.cells_at("CUT", (6 * k**3 - above.ravel()).tolist(), 1)
    point = deck.node((0.0, 0.0, 0.0))
    deck.steel("BASE", "LID", "STRUT")
    deck.pair("LIDLOW", "BASETOP")
    deck.pair("STRUTLOW", "LIDTOP")
    deck.lines += [f"*PRE-TENSION SECTION, SURFACE=CUT, NODE={point}", "0., 0., 1."]
    return deck.step("*BOUNDARY", "BASELOW, 1, 3", "STRUTTOP, 1, 3", "*CLOAD", f"{point}, 1, 3000.")


def write(folder: Path) -> None:
    """Write the decks into an empty folder."""
    for kind in (prisms, tie, bolt):
        for k in DIVIDED:
            (folder / f"{kind.__name__}-{k**3}.inp").write_text(kind(k))
