"""picture.png of a run, or of the end of a load history: contact pressure and zones, as `coulomb plot` draws them.

The process starts while the run still computes: it loads its libraries (0.5 s), draws a small warm-up picture, which
makes the first picture of the block 0.3 s faster, and waits for the directory on standard input.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...io.field_files import Grid
from ...io.run_directory import PICTURE, RunDirectory
from .fields import Bar, Limits, limits_of, named, zone_counts
from .files import Step, read_run
from .scene import Look, Shot, automatic_scale, camera_of, shoot
from .sheet import ALARM, BAR, INK, caption, colour_bar, directions, legend

DPI = 150

WIDE = 1.5
"""Aspect ratio of the body in the picture above which the two views are stacked."""

# inches
_BORDER, _HEAD, _BAR, _LEGEND = 0.25, 0.42, 0.78, 0.42
_ABOVE, _BESIDE = (8.3, 3.7), (5.4, 5.4)
"""Largest width and height of a view, stacked and side by side."""


def draw(directory: Path) -> Path:
    """Draw picture.png into the directory of a run.

    Args:
        directory: Directory of the run, with solution.xdmf, contact.xdmf and summary.json.

    Raises:
        ValueError: If the directory contains no run, or a file cannot be read.
    """
    run = read_run(directory)
    run = replace(run, steps=run.steps[-1:])  # the last step of a load history, which may be long
    step, scale = run.steps[-1], automatic_scale(run)
    pressure, status = named("pressure"), named("status")
    looks = [Look(field, limits_of(run, field), scale, "contact") for field in (pressure, status)]
    most = (round(DPI * _ABOVE[0]), round(DPI * _ABOVE[1]))
    camera = camera_of([step], looks[0], most)
    if camera.size[0] < WIDE * camera.size[1]:
        camera = camera_of([step], looks[0], (round(DPI * _BESIDE[0]), round(DPI * _BESIDE[1])))
    shots = [shoot(step, look, camera=camera) for look in looks]
    contact = step.grid("contact")
    bars = looks[0].limits.bars(pressure.values(contact), contact)
    figure = _composed(shots, bars, caption(run, step, scale), run.alarm, zone_counts(contact))
    partial = directory / f".{PICTURE}"
    figure.savefig(partial, dpi=DPI, format="png", pil_kwargs={"compress_level": 1})
    return partial.replace(RunDirectory(directory).picture)


def _composed(shots: list[Shot], bars: Sequence[Bar], words: str, alarm: str, zones: dict[str, int]) -> Any:
    """Both views with their legends, as a matplotlib figure."""
    from matplotlib.figure import Figure

    pixels, across = shots[0].pixels.shape, shots[0].pixels.shape[1] < WIDE * shots[0].pixels.shape[0]
    width, height = pixels[1] / DPI, pixels[0] / DPI
    column = max(width, 5.6 if across else 8.3)
    total = 2 * column + 3 * _BORDER if across else column + 2 * _BORDER
    head = _HEAD + (0.25 if alarm else 0.0)
    below = _BAR + BAR * (len(bars) - 1)
    tall = head + below + height + (0.0 if across else height + _LEGEND) + _BORDER
    figure = Figure(figsize=(total, tall), dpi=DPI, facecolor="white")

    def box(left: float, bottom: float, wide: float, high: float) -> tuple[float, float, float, float]:
        return left / total, bottom / tall, wide / total, high / tall

    figure.text(_BORDER / total, 1.0 - 0.26 / tall, words, fontsize=11, color=INK, va="center")
    if alarm:
        figure.text(_BORDER / total, 1.0 - 0.52 / tall, alarm, fontsize=11, color=ALARM, weight="bold", va="center")
    bottoms = [_BORDER + below] * 2 if across else [_BORDER + _LEGEND + height + below, _BORDER + _LEGEND]
    lefts = [_BORDER, 2 * _BORDER + column] if across else [_BORDER] * 2
    for shot, left, bottom in zip(shots, lefts, bottoms, strict=True):
        figure.figimage(shot.pixels, round(DPI * (left + 0.5 * (column - width))), round(DPI * bottom), origin="upper")
    for k, bar in enumerate(bars):
        place = box(_BORDER + 0.2 * column, bottoms[0] - 0.22 - BAR * k, 0.62 * column, 0.16)
        colour_bar(figure, named("pressure"), bar, place)
    named_below = (bottoms[1] - (0.36 if across else 0.26)) / tall
    legend(figure, zones, ((lefts[1] + 0.5 * column) / total, named_below), columns=2 if across else 4)
    directions(figure.add_axes(box(_BORDER, bottoms[0] - 0.8, 0.9, 0.8)), shots[0])
    return figure


class _Cube(Step):
    """A state with one cell, for the warm-up."""

    def grid(self, file: str) -> Grid:
        """A cube, or its lower face, with all fields that a view needs."""
        points = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
        if file == "solution":
            return Grid("Hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 6]]), points, {"displacement": 0.0 * points})
        down = np.tile([0.0, 0.0, -1.0], (4, 1))
        fields = {"normal": down, "pressure": np.arange(4.0), "status": np.arange(4.0), "area": np.full(4, 0.25)}
        return Grid("Quadrilateral", np.array([[0, 1, 3, 2]]), points[:4], fields)


def _warm_up() -> None:
    """Draw a small picture without a file, to load and compile everything that a picture needs."""
    cube = _Cube(Path(), None)
    looks = [Look(named(name), Limits(0.0, 3.0), 1.0, "contact") for name in ("pressure", "status")]
    shots = [shoot(cube, look, (60, 60)) for look in looks]
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(_composed(shots, [Bar(0.0, 3.0, 0.0, 3.0)], "0123", "", zone_counts(cube.grid("contact")))).draw()


def main(arguments: list[str]) -> str:
    """Without arguments: warm up, then draw the run in the directory given on standard input."""
    assert not arguments
    _warm_up()
    directory = sys.stdin.read()
    if not directory:  # no picture is needed, or the parent process has ended
        return ""
    return str(draw(Path(directory)))
