"""The results of a run as CalculiX writes them (.frd, ASCII), for CalculiX GraphiX, PrePoMax and FreeCAD:
displacements, stresses, reactions and contact at the nodes, with the numbers that the mesh file gives them.

Our own writer (110 lines), not pyvista-frd-reader's (tried: 0.3.1): it calls components DISP1, STRESS1, ..., where
PrePoMax and FreeCAD look for D1, SXX, ..., leaves out the lengths of vectors, and has one step per file.  Its reader
reads this file in the tests.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray, as_list

_KINDS: Final = {4: 3, 8: 1, 10: 6, 20: 4}
"""Numbers of kinds of elements, by their number of nodes."""

_FLAT: Final = {4: 9, 8: 10}
"""Those of flat ones."""

_ORDER: Final = {20: (*range(12), *range(16, 20), *range(12, 16))}
"""The edges between bottom and top come before those of the top."""

_COMPONENTS: Final = {
    "DISP": ("D1", "D2", "D3"),
    "FORC": ("F1", "F2", "F3"),
    "STRESS": ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX"),
    "CONTACT": ("COPEN", "CSLIP1", "CSLIP2", "CPRESS", "CSHEAR1", "CSHEAR2"),
    "NDTEMP": ("T",),
}
_ENTRIES: Final = ((1, 1), (2, 2), (3, 3), (1, 2), (2, 3), (3, 1))


@dataclass
class NodalResults:
    """Results at one time.

    Attributes:
        time: In seconds.
        fields: Values at the nodes, shape (k, components), by the name of the block.
    """

    time: float
    fields: Mapping[str, FloatArray]


def write_frd(
    path: Path,
    numbers: IntArray,
    points: FloatArray,
    blocks: Sequence[IntArray],
    steps: Iterable[NodalResults],
    flat: bool = False,
) -> None:
    """Write a file.

    Args:
        numbers: Of the nodes, shape (k,).
        points: Where they are, shape (k, 3).
        blocks: Cells by their nodes in VTK's order, shape (c, 4, 8, 10 or 27); of 27 nodes the first 20 are written.
        flat: Whether cells of 4 and 8 nodes are quadrilaterals.
    """
    used = np.zeros(len(points), dtype=bool)
    for cells in blocks:
        used[cells[:, :20]] = True
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write("    1C\n    1UPGM               coulomb\n")
        file.write(f"    2C{'':18}{used.sum():12d}{1:38d}\n")
        file.writelines(_rows(numbers[used], points[used]))
        count = sum(map(len, blocks))
        file.write(f" -3\n    3C{'':18}{count:12d}{1:38d}\n")
        number = 0
        for cells in blocks:
            width = min(cells.shape[1], 20)
            kind = (_FLAT if flat else _KINDS)[width]
            order = _ORDER.get(width, tuple(range(width)))
            for nodes in as_list(numbers[cells[:, order]]):
                number += 1
                file.write(f" -1{number:10d}{kind:5d}{0:5d}{1:5d}\n")
                for first in range(0, width, 10):
                    file.write(" -2" + "".join(f"{node:10d}" for node in nodes[first : first + 10]) + "\n")
        file.write(" -3\n")
        for index, step in enumerate(steps, 1):
            for name, values in step.fields.items():
                file.writelines(_block(index, step.time, name, numbers[used], values[used]))
        file.write(" 9999\n")


def _block(index: int, time: float, name: str, numbers: IntArray, values: FloatArray) -> Iterator[str]:
    """The lines of one result at one time."""
    components = _COMPONENTS[name]
    stamp = f"{time:.9f}"[:12] if 1.0 <= time < 1e10 else f"{time:12.5E}"
    yield f"    1PSTEP{index:26d}{1:12d}{index:12d}\n"
    yield f"  100CL{100 + index:5d}{stamp:>12}{len(numbers):12d}{'':20}{0:2d}{index:5d}{'':10}{1:2d}\n"
    vector, tensor = len(components) == 3, name == "STRESS"
    yield f" -4  {name:<8}{len(components) + vector:5d}{1:5d}\n"
    for k, component in enumerate(components):
        first, second = _ENTRIES[k] if tensor else (k + 1, 0)
        yield f" -5  {component:<8}{1:5d}{4 if tensor else 2 if vector else 1:5d}{first:5d}{second:5d}\n"
    if vector:
        yield f" -5  {'ALL':<8}{1:5d}{2:5d}{0:5d}{0:5d}{1:5d}ALL\n"
    yield from _rows(numbers, values)
    yield " -3\n"


def _rows(numbers: IntArray, values: FloatArray) -> Iterable[str]:
    """A line for each node: its number and values of twelve columns."""
    form = " -1%10d" + "%12.5E" * values.shape[1] + "\n"
    small = np.where(np.abs(values) < 1e-99, 0.0, values)  # exponents have two digits
    return (form % (number, *row) for number, row in zip(as_list(numbers), as_list(small), strict=True))
