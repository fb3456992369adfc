"""Pictures of the cases: the formula as a line, computed values as dots."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

from matplotlib.figure import Figure

from .table import Panel

COLOURS = ("#2166ac", "#b2182b", "#4d9221", "#8073ac", "#e08214")
LINES = ("-", "--", ":", "-.")
DOTS = "os^D"


def draw(panels: Sequence[Panel], path: Path) -> None:
    """Draw the panels side by side into a PNG file."""
    figure = Figure(figsize=(5.2 * len(panels), 4.4), layout="constrained")
    for axis, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        lines, dots, colours = cycle(LINES), cycle(DOTS), cycle(COLOURS)
        style = "-"
        for curve in panel.curves:
            if curve.formula and curve.line:
                style = next(lines) if curve.label else style  # without a label: continues the curve before
                axis.plot(curve.x, curve.y, "k" + style, linewidth=1.2, label=curve.label, zorder=2)
            else:
                mark, colour = ("+", "k") if curve.formula else (next(dots), next(colours))
                size = 80 if curve.formula else 14
                axis.scatter(
                    curve.x, curve.y, size, colour, marker=mark, label=curve.label, zorder=4 if curve.formula else 3
                )
        if panel.logarithmic:
            axis.set_xscale("log")
            axis.set_yscale("log")
        axis.set_title(panel.title)
        axis.set_xlabel(panel.xlabel)
        axis.set_ylabel(panel.ylabel)
        axis.grid(alpha=0.3)
        outside = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)} if len(panel.curves) > 8 else {}
        axis.legend(fontsize="small", **outside)
    figure.savefig(path, dpi=110)
