"""Elements compared on Hertz's problem: errors against unknowns and seconds for P1, P2, Q1 and Q2."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from verification.hertz_elements import ELEMENTS, errors, problem

SIZES = (2, 3, 4, 6, 8)
"""Second-order cells on 1.2 a; first order has twice as many, and the same unknowns."""


class Row(NamedTuple):
    """A row of the table.

    Errors are root mean squares over four loads: of the force, over Hertz's at the same displacement of the sphere, and
    of the pressure at the centre, over Hertz's largest.  The seconds are processor time of one load, from the mesh to
    the certified answer.
    """

    element: str
    cells: int
    unknowns: int
    contact_points: int
    force_error: float
    centre_error: float
    seconds: float


def measure(sizes: Iterable[int] = SIZES, elements: Iterable[str] = tuple(ELEMENTS)) -> Iterator[Row]:
    """Rows as they are measured."""
    for element in elements:
        for n in sizes:
            started = time.process_time()
            block = problem(element, n)
            block.solve()
            seconds = time.process_time() - started
            found = errors(block)
            points = block.unknowns["contact"] // 3
            yield Row(element, n, found.unknowns, points, found.force, found.centre, seconds)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Both errors against unknowns and against seconds, as a PNG file: the picture of docs/elements.md."""
    figure = Figure(figsize=(11.0, 8.4), layout="constrained")
    kinds = {"force_error": "error of the force", "centre_error": "error of the pressure at the centre"}
    costs = {"unknowns": "unknowns", "seconds": "processor seconds"}
    pairs = [(error, cost) for error in kinds for cost in costs]
    axes = figure.subplots(2, 2).ravel()
    for axis, (error, cost) in zip(axes, pairs, strict=True):
        for name in dict.fromkeys(row.element for row in rows):
            values = sorted((getattr(row, cost), getattr(row, error)) for row in rows if row.element == name)
            axis.loglog(*zip(*values, strict=True), "o-" if name.endswith("1") else "s--", label=name)
        axis.set_xlabel(costs[cost])
        axis.set_ylabel(kinds[error])
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.savefig(path, dpi=130)
