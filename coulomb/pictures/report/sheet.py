"""A picture with caption, axes, and a colour bar with its unit or the names of the zones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt

from .fields import ZONES, Bar, Field
from .files import Run, Step
from .scene import Shot
from .units import friction_in_words, in_nodes, in_seconds, number, scale_of

BAR = 0.72
"""Height of a colour bar with its numbers and title, inches: of 150 pixels, a whole and, for films, even number."""

Pixels = npt.NDArray[np.uint8]

SIZE = (8.8, 6.4)
"""Size of a sheet in inches of 150 pixels; even numbers of pixels, as films require."""

AXES = ("#d55e00", "#009e73", "#0b84d8")
"""Colours of x, y and z."""

INK, ALARM, EDGE = "#202020", "#b3261e", "#8a8a8a"


def sheet(
    shot: Shot,
    field: Field,
    bars: Sequence[Bar],
    caption: str,
    alarm: str,
    zones: dict[str, int],
) -> Any:
    """A matplotlib figure with the cropped picture: caption and alarm above, the colour bars of the field below, or the
    zones with their numbers of nodes."""
    from matplotlib.figure import Figure

    width, high = SIZE
    below = BAR * (len(bars) - 1)
    tall = high + below
    figure = Figure(figsize=(width, tall), facecolor="white")
    stage = figure.add_axes((0.03, (0.19 * high + below) / tall, 0.94, 0.71 * high / tall))
    stage.imshow(shot.pixels, interpolation="antialiased")
    stage.set_axis_off()
    figure.text(0.03, 1.0 - 0.045 * high / tall, caption, fontsize=11, color=INK, va="center")
    if alarm:
        figure.text(0.03, 1.0 - 0.085 * high / tall, alarm, fontsize=11, color=ALARM, weight="bold", va="center")
    directions(figure.add_axes((0.02, 0.02 * high / tall, 0.11, 0.15 * high / tall)), shot)
    if field.zones:
        legend(figure, zones, (0.55, 0.08), columns=2)
        return figure
    for k, bar in enumerate(bars):
        bottom = (0.085 * high + below - BAR * k) / tall
        colour_bar(figure, field, bar, (0.2, bottom, 0.66, 0.03 * high / tall))
    return figure


def colour_bar(
    figure: Any,
    field: Field,
    bar: Bar,
    box: tuple[float, float, float, float],
) -> None:
    """Colour bar with round numbers, the field and its unit below, beside it the largest value, of signed values the
    smallest as well; `box`: left, bottom, width and height over those of the figure."""
    from matplotlib.ticker import MaxNLocator

    factor, unit = scale_of(bar.high, field.unit)
    norm = matplotlib.colors.Normalize(bar.low / factor, bar.high / factor)
    drawn = figure.colorbar(
        matplotlib.cm.ScalarMappable(norm, field.colours),
        cax=figure.add_axes(box),
        orientation="horizontal",
        ticks=MaxNLocator(6, steps=[1, 2, 5, 10]),
    )
    title = f"{field.title}, {unit}" if unit else field.title
    drawn.set_label(f"{bar.of}: {title}" if bar.of else title, fontsize=11, color=INK)
    drawn.ax.spines["outline"].set_visible(False)
    if field.unit:
        place = (box[0] + box[2] + 0.01, box[1] + 0.5 * box[3])
        ends = f"max {number(bar.largest / factor)}"
        if bar.low < 0.0:
            ends += f"\nmin {number(bar.smallest / factor)}"
        figure.text(*place, ends, fontsize=10, color=INK, va="center")


def legend(figure: Any, zones: dict[str, int], middle: tuple[float, float], columns: int = 4) -> None:
    """Legend of the zones with their numbers of nodes, held nodes only if there are any; `middle` is its centre, over
    width and height of the figure."""
    from matplotlib.patches import Patch

    patches = [
        Patch(facecolor=colour, edgecolor=EDGE, linewidth=0.6, label=f"{name}: {in_nodes(zones[name])}")
        for name, colour in ZONES.values()
        if zones[name] or name != ZONES[3][0]
    ]
    columns = columns if len(patches) > 3 else 3
    figure.legend(handles=patches, loc="center", bbox_to_anchor=middle, ncols=columns, frameon=False, fontsize=11)


def directions(axes: Any, shot: Shot) -> None:
    """The axes x, y, z as seen by the camera."""
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.35, 1.35), aspect="equal")
    axes.set_axis_off()
    for name, (right, up), colour in zip("xyz", shot.axes, AXES, strict=True):
        if np.hypot(right, up) < 0.1:  # it points at the camera, or away
            axes.plot(0, 0, "o", color=colour, markersize=4)
            axes.text(0.14, 0.1, name, color=colour, fontsize=10)
            continue
        axes.annotate("", (right, up), (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4})
        reach = 1.0 + 0.22 / np.hypot(right, up)
        axes.text(reach * right, reach * up, name, color=colour, fontsize=10, ha="center", va="center")


def pixels_of(figure: Any) -> Pixels:
    """A sheet as pixels, (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(150)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[:, :, :3]


def caption(run: Run, step: Step, scale: float) -> str:
    """Name of the case, friction, time and the scale of the displacement in one line."""
    parts = [f"{run.title}: {friction_in_words(run.summary) if run.summary else 'friction unknown'}"]
    if step.time is not None:
        parts.append(f"time {in_seconds(step.time)}")
    return ", ".join([*parts, f"displacement × {number(scale)}"])
