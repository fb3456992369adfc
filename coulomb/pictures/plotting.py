"""Pictures from the files of a run, drawn in a separate process; imports neither DOLFINx nor the solvers."""

from __future__ import annotations

import csv
import ctypes.util
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..io.field_files import Grid

ZONES = {0: ("open", "#dde6ea"), 1: ("stick", "#2159a8"), 2: ("slip", "#e68a1e"), 3: ("no contact point", "#2b2b2b")}
"""Name and colour of every status in contact.xdmf: a luminance contrast of 2 between any two, for greyscale,
and colours that the colour-blind can distinguish."""

_VTK_TYPES = {"Hexahedron": 12, "Tetrahedron": 10, "Quadrilateral": 9, "Triangle": 5}


def renderer() -> Any:
    """pyvista, configured to draw without a display if there is none."""
    if not os.environ.get("DISPLAY") and "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ:  # the search takes a while
        window = "vtkOSOpenGLRenderWindow" if ctypes.util.find_library("OSMesa") else "vtkEGLRenderWindow"
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window
    import pyvista

    return pyvista


def polygons(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Cells (k, corners) in VTK's format: the number of corners, then the corners; repeated last ones are left out."""
    count = corners_in(cells)
    return np.column_stack([count, cells])[np.arange(cells.shape[1] + 1) <= count[:, None]]


def corners_in(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Number of corners of every cell (k, corners): cells with fewer than others repeat their last one."""
    repeated = np.cumprod((cells[:, :0:-1] == cells[:, -2::-1]), axis=1).sum(axis=1)
    return cells.shape[1] - np.asarray(repeated, dtype=np.int64)


def skin_of(pyvista: Any, body: Grid, points: FloatArray) -> Any:
    """Boundary of the body, or of several bodies."""
    types = np.full(len(body.cells), _VTK_TYPES[body.cell], dtype=np.uint8)
    types[corners_in(body.cells) == 4] = _VTK_TYPES["Tetrahedron"]
    solid = pyvista.UnstructuredGrid(polygons(body.cells), types, points)
    solid.point_data["node"] = np.arange(len(points))
    return solid.extract_surface(algorithm=None)


def match(points: FloatArray, nodes: FloatArray) -> npt.NDArray[np.int64]:
    """The node of the body at every point of the contact face."""
    from scipy.spatial import cKDTree

    found: npt.NDArray[np.int64] = cKDTree(nodes).query(points)[1]
    return found


def without(skin: Any, facets: npt.NDArray[np.int64]) -> Any:
    """The skin without the faces that have the corners of one of these facets, numbers of nodes (f, corners)."""
    corners = _faces_of(skin)
    if not len(facets):
        return type(skin)(skin.points, polygons(corners))
    width = max(corners.shape[1], facets.shape[1])
    mine, others = (_as_sets(rows, width) for rows in (np.asarray(skin.point_data["node"])[corners], facets))
    number = np.unique(np.concatenate([others, mine]), axis=0, return_inverse=True)[1].ravel()
    inside = np.isin(number[len(others) :], number[: len(others)])
    return type(skin)(skin.points, polygons(corners[~inside]))


def _as_sets(rows: npt.NDArray[np.int64], width: int) -> npt.NDArray[np.int64]:
    """Rows of corners (f, corners) in ascending order, each once, filled with the last one; shape (f, width)."""
    ordered = np.sort(np.pad(rows, ((0, 0), (0, width - rows.shape[1])), mode="edge"), axis=1)
    again = np.column_stack([np.zeros(len(rows), dtype=bool), ordered[:, 1:] == ordered[:, :-1]])
    return np.sort(np.where(again, ordered[:, -1:], ordered), axis=1)


def _faces_of(skin: Any) -> npt.NDArray[np.int64]:
    """Corners of the faces of a skin, shape (k, corners); triangles among others repeat their last one."""
    flat: npt.NDArray[np.int64] = np.asarray(skin.faces, dtype=np.int64)
    if skin.is_all_triangles or len(flat) == 5 * skin.n_cells:
        found: npt.NDArray[np.int64] = np.asarray(skin.regular_faces, dtype=np.int64)
        return found
    rows = [[*face, face[-1]][:4] for face in skin.irregular_faces]
    return np.array(rows, dtype=np.int64)


def patches(pyvista: Any, cells: npt.NDArray[np.int64], points: FloatArray, chosen: npt.NDArray[np.bool_]) -> Any:
    """The part of the surface nearest to the chosen nodes: every facet is cut into a piece for each corner."""
    count = corners_in(cells)
    if np.any(count < cells.shape[1]):
        parts = [patches(pyvista, cells[count == n, :n], points, chosen) for n in np.unique(count)]
        return pyvista.MultiBlock(parts).combine().extract_surface(algorithm=None)
    corners = points[cells]
    middle = 0.5 * (corners + np.roll(corners, -1, axis=1))
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    pieces = np.stack([corners, middle, centre, np.roll(middle, 1, axis=1)], axis=2)[chosen[cells]]
    return pyvista.PolyData(pieces.reshape(-1, 3), polygons(np.arange(4 * len(pieces)).reshape(-1, 4)))


def alarm(contents: dict[str, Any]) -> str:
    """The alarm in red for a run with this summary.json; empty if its answer counts."""
    if not contents["certificate"]["passed"]:
        return "NOT CERTIFIED"
    return "" if contents.get("valid", True) else "OUTSIDE THE THEORY"


def nice(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten below."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1.0 + 1e-12)))


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
