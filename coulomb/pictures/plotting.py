"""Figures of the benchmarks' tables."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np


def table1(csv_file: str | Path) -> Path:
    """Products and seconds of every solver against the contact unknowns, log-log, from table1.csv into the same
    directory."""
    rows = _read_csv(csv_file)
    figure, axes = _axes(2)
    for name in dict.fromkeys(row["solver"] for row in rows):
        mine = [row for row in rows if row["solver"] == name]
        for axis, field in zip(axes, ("products", "seconds"), strict=True):
            axis.loglog([float(row["m"]) for row in mine], [float(row[field]) for row in mine], "o-", label=name)
            axis.set_ylabel("products by A" if field == "products" else "seconds")
    _finish(axes, "contact unknowns", [float(row["m"]) for row in rows])
    return _save(figure, csv_file)


def friction(csv_file: str | Path) -> Path:
    """Products and seconds of every method against friction, a line per size, from friction.csv into the same
    directory."""
    rows = _read_csv(csv_file)
    figure, axes = _axes(2)
    methods = list(dict.fromkeys(row["method"] for row in rows))
    sizes = list(dict.fromkeys(row["p"] for row in rows))
    for axis, field in zip(axes, ("products", "seconds"), strict=True):
        for k, name in enumerate(methods):
            for size, marker in zip(sizes, "os^dv" * len(sizes), strict=False):
                mine = [row for row in rows if row["method"] == name and row["p"] == size]
                x, y = [float(row["friction"]) for row in mine], [float(row[field]) for row in mine]
                if mine:
                    axis.semilogy(x, y, marker=marker, color=f"C{k}", label=f"{name}, p = {size}")
        axis.set_xlabel("friction")
        axis.set_ylabel("products by A" if field == "products" else "seconds")
    axes[1].legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return _save(figure, csv_file)


def scaling(csv_file: str | Path) -> Path:
    """Seconds of the contact problem and of the yardstick, and memory, against the unknowns, from scaling.csv into the
    same directory."""
    rows = _read_csv(csv_file)
    figure, axes = _axes(2)
    for ranks in dict.fromkeys(row["ranks"] for row in rows):
        mine = [row for row in rows if row["ranks"] == ranks]
        n = np.array([float(row["unknowns"]) for row in mine])
        label = f"{ranks} rank{'s' if ranks != '1' else ''}"
        for field, style, what in (("seconds", "o-", "Coulomb"), ("yardstick_seconds", "s--", "one linear solve")):
            axes[0].loglog(n, [float(row[field]) for row in mine], style, label=f"{what}, {label}")
        axes[1].loglog(n, [float(row["peak_memory_bytes"]) / 2**30 for row in mine], "o-", label=label)
    axes[0].set_ylabel("seconds")
    axes[1].set_ylabel("peak memory, GiB")
    _finish(axes, "displacement unknowns", [float(row["unknowns"]) for row in rows])
    axes[0].legend(fontsize="small")
    return _save(figure, csv_file)


def peers(csv_file: str | Path) -> Path:
    """Seconds and peak memory of every peer against the cells per metre, from peers.csv into the same directory."""
    rows = _read_csv(csv_file)
    figure, axes = _axes(2)
    for name in dict.fromkeys(row["peer"] for row in rows):
        mine = [row for row in rows if row["peer"] == name]
        p = [float(row["p"]) for row in mine]
        axes[0].loglog(p, [float(row["seconds"]) for row in mine], "o-", label=name)
        axes[1].loglog(p, [float(row["peak_memory_bytes"]) / 2**30 for row in mine], "o-", label=name)
    axes[0].set_ylabel("seconds")
    axes[1].set_ylabel("peak memory, GiB")
    _finish(axes, "cells per metre", [float(row["p"]) for row in rows])
    return _save(figure, csv_file)


def elements(csv_file: str | Path) -> Path:
    """Errors on Hertz's problem against unknowns and seconds, from elements.csv into the same directory."""
    rows = _read_csv(csv_file)
    figure, axes = _axes(2, 2)
    kinds = {"force_error": "error of the force", "centre_error": "error of the pressure at the centre"}
    for name in dict.fromkeys(row["element"] for row in rows):
        mine = [row for row in rows if row["element"] == name]
        pairs = [(field, against) for field in kinds for against in ("unknowns", "seconds")]
        for axis, (field, against) in zip(axes, pairs, strict=True):
            values = sorted((float(row[against]), float(row[field])) for row in mine)
            axis.loglog(*zip(*values, strict=True), "o-" if name.endswith("1") else "s--", label=name)
            axis.set_xlabel("unknowns" if against == "unknowns" else "processor seconds")
            axis.set_ylabel(kinds[field])
    axes[0].legend()
    return _save(figure, csv_file)


def conditioning(csv_file: str | Path) -> Path:
    """Condition numbers against the path-following step, from conditioning.csv into the same directory (the paper's
    Figure 1)."""
    rows = _read_csv(csv_file)
    figure, (axis,) = _axes(1)
    styles = {"J_AM": "s-", "J_SC": "o-", "P_AM^-1 J_AM": "s--", "P_SC^-1 J_SC": "o--", "bound": "k:"}
    for field, style in styles.items():
        steps, values = [int(row["iteration"]) for row in rows], [float(row[field]) for row in rows]
        axis.semilogy(steps, values, style, label=field, markerfacecolor="none")
    axis.set_xlabel("path-following step")
    axis.set_ylabel("condition number")
    axis.legend()
    return _save(figure, csv_file)


def fclib_profile(csv_file: str | Path) -> Path:
    """Performance profile from fclib_profile.csv into the same directory: problems solved within a multiple of the
    quickest solver's time."""
    rows = _read_csv(csv_file)
    figure, (axis,) = _axes(1)
    ratio = [float(row["ratio"]) for row in rows]
    for solver in list(rows[0])[1:]:
        axis.step(ratio, [float(row[solver]) for row in rows], where="post", label=solver)
    axis.set_xscale("log")
    axis.set_ylim(0.0, 1.02)
    axis.set_xlabel("time over that of the quickest solver")
    axis.set_ylabel("fraction of the problems solved")
    axis.legend()
    return _save(figure, csv_file)


def _finish(axes: Any, label: str, sizes: Sequence[float]) -> None:
    """A logarithmic axis with ticks at the measured sizes, and the legend beside the last picture."""
    shown = sorted(set(sizes))
    for axis in axes:
        axis.set_xscale("log")
        axis.set_xticks(shown, [f"{size:g}" for size in shown], rotation=30)
        axis.set_xticks([], minor=True)
        axis.set_xlabel(label)
    axes[-1].legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _read_csv(path: str | Path) -> list[dict[str, str]]:
    with Path(path).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _axes(count: int, rows: int = 1) -> tuple[Any, Any]:
    """A figure with so many pictures in each of its rows, and these, row by row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5 * count, 4.2 * rows), layout="constrained")
    axes = figure.subplots(rows, count, squeeze=False).ravel()
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes


def _save(figure: Any, csv_file: str | Path) -> Path:
    path = Path(csv_file).with_suffix(".png")
    figure.savefig(path, dpi=130)
    return path
