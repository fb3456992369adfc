"""Pictures from the files of a run.  Knows neither DOLFINx nor the solvers: it draws in a process apart."""

from __future__ import annotations

import csv
import ctypes.util
import json
import os
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

ZONES = {0: ("open", "#bdbdbd"), 1: ("stick", "#2166ac"), 2: ("slip", "#f4a582"), 3: ("held", "#4d4d4d")}
"""Name and colour of every status in contact.xdmf; told apart by the colour-blind too."""

_VTK_TYPES = {"Hexahedron": 12, "Tetrahedron": 10, "Quadrilateral": 9, "Triangle": 5}


class Grid(NamedTuple):
    """What an XDMF file holds: cells (k, nodes a cell), points (n, 3), fields on points or cells by name."""

    cell: str
    cells: npt.NDArray[np.int64]
    points: FloatArray
    fields: dict[str, FloatArray]


def read_grid(path: str | Path) -> Grid:
    """Read an XDMF file of a run with its HDF5 file."""
    path = Path(path)
    grid = ElementTree.parse(path).getroot().find("Domain/Grid")
    if grid is None:
        raise ValueError(f"{path}: there is no grid in this file")

    def data(element: Any) -> Any:
        file, _, dataset = element.find("DataItem").text.strip().partition(":")
        with h5py.File(path.with_name(file), "r") as h5:
            return h5[dataset][()]

    topology, geometry = grid.find("Topology"), grid.find("Geometry")
    assert topology is not None and geometry is not None
    fields = {str(attribute.get("Name")): np.squeeze(data(attribute)) for attribute in grid.findall("Attribute")}
    return Grid(str(topology.get("TopologyType")), data(topology), data(geometry), fields)


def picture(directory: str | Path) -> Path:
    """Draw picture.png: the deformed body from below, its contact pressure, and the stick, slip and open zones.

    Args:
        directory: Of a run, with solution.xdmf, contact.xdmf and summary.json (where it is there already).

    Returns:
        The picture's path.
    """
    pyvista = renderer()
    directory = Path(directory)
    body, contact = read_grid(directory / "solution.xdmf"), read_grid(directory / "contact.xdmf")
    displacement = body.fields["displacement"]
    size = float(np.linalg.norm(np.ptp(body.points, axis=0)))
    greatest = float(np.linalg.norm(displacement, axis=1).max())
    scale = nice(0.05 * size / greatest) if greatest > 0.0 else 1.0

    in_contact = match(contact.points, body.points)
    lower = contact.points + scale * displacement[in_contact]
    face = pyvista.PolyData(lower, polygons(contact.cells))
    face.point_data["pressure"] = contact.fields["pressure"] / 1e6
    skin = without(skin_of(pyvista, body, body.points + scale * displacement), in_contact)
    normal = np.mean(face.compute_normals(auto_orient_normals=False)["Normals"], axis=0)
    normal *= np.sign(normal @ (face.center_of_mass() - np.mean(skin.points, axis=0)))

    plotter = pyvista.Plotter(off_screen=True, window_size=(1400, 1300), shape=(2, 1), border=False)
    plotter.set_background("white")
    for row in range(2):
        plotter.subplot(row, 0)
        plotter.add_mesh(skin, color="#f2f0eb", show_edges=True, edge_color="#c8c5be", ambient=0.45, diffuse=0.6)
        plotter.add_axes(color="black")

    plotter.subplot(0, 0)
    bar = {"title": "pressure, MPa", "vertical": True, "title_font_size": 20, "label_font_size": 18}
    bar |= {"position_x": 0.9, "position_y": 0.15, "height": 0.7, "width": 0.05, "color": "black", "fmt": "%.3g"}
    shown = {"cmap": "viridis", "clim": (0.0, max(float(face["pressure"].max()), 1e-12)), "scalar_bar_args": bar}
    plotter.add_mesh(face, scalars="pressure", lighting=False, show_edges=True, edge_color="#8a8a8a", **shown)
    plotter.add_text(f"{_caption(directory)}; displacement x {scale:g}", font_size=12, color="black")
    _look_at(plotter, normal)

    plotter.subplot(1, 0)
    legend = []
    status = np.rint(contact.fields["status"]).astype(int)
    for code, (name, colour) in ZONES.items():
        chosen = status == code
        if chosen.any():
            plotter.add_mesh(patches(pyvista, contact.cells, lower, chosen), color=colour, lighting=False)
            legend.append([f"{name}: {np.count_nonzero(chosen)} nodes", colour])
    lines = face.extract_all_edges().translate(1e-3 * size * normal)  # in front of the zones
    plotter.add_mesh(lines, color="#8a8a8a", line_width=1)
    plotter.add_legend(legend, bcolor="white", face="rectangle", size=(0.17, 0.2), loc="upper right")
    _look_at(plotter, normal)

    path = directory / "picture.png"
    plotter.screenshot(str(path))
    plotter.close()
    return path


def renderer() -> Any:
    """pyvista, set to draw without a display where there is none."""
    if not os.environ.get("DISPLAY"):
        window = "vtkOSOpenGLRenderWindow" if ctypes.util.find_library("OSMesa") else "vtkEGLRenderWindow"
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", window)
    import pyvista

    return pyvista


def polygons(cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Cells (k, corners) in VTK's way: the number of corners, then the corners."""
    return np.column_stack([np.full(len(cells), cells.shape[1]), cells]).ravel()


def skin_of(pyvista: Any, body: Grid, points: FloatArray) -> Any:
    """Boundary of the body."""
    types = np.full(len(body.cells), _VTK_TYPES[body.cell], dtype=np.uint8)
    solid = pyvista.UnstructuredGrid(polygons(body.cells), types, points)
    solid.point_data["node"] = np.arange(len(points))
    return solid.extract_surface(algorithm=None)


def match(points: FloatArray, nodes: FloatArray) -> npt.NDArray[np.int64]:
    """The node of the body at every point of the contact face."""
    from scipy.spatial import cKDTree

    found: npt.NDArray[np.int64] = cKDTree(nodes).query(points)[1]
    return found


def without(skin: Any, nodes: npt.NDArray[np.int64]) -> Any:
    """The skin but for the faces whose corners are all among these nodes."""
    corners = skin.regular_faces
    inside = np.isin(skin.point_data["node"], nodes)[corners].all(axis=1)
    return type(skin)(skin.points, polygons(corners[~inside]))


def patches(pyvista: Any, cells: npt.NDArray[np.int64], points: FloatArray, chosen: npt.NDArray[np.bool_]) -> Any:
    """The part of the surface nearest to the chosen nodes: every facet is cut into a piece for each corner."""
    corners = points[cells]
    middle = 0.5 * (corners + np.roll(corners, -1, axis=1))
    centre = np.broadcast_to(corners.mean(axis=1, keepdims=True), corners.shape)
    pieces = np.stack([corners, middle, centre, np.roll(middle, 1, axis=1)], axis=2)[chosen[cells]]
    return pyvista.PolyData(pieces.reshape(-1, 3), polygons(np.arange(4 * len(pieces)).reshape(-1, 4)))


def _look_at(plotter: Any, normal: FloatArray) -> None:
    """At the contact face from outside the body, along its normal and a little from two sides."""
    along = np.eye(3)[np.argmin(np.abs(normal))]
    across = np.cross(normal, along)
    plotter.view_vector(normal + 0.25 * along + 0.6 * across, viewup=-across)
    # pyvista shows the ball round the body whole; closer, as far as the corners of its box stay inside
    low, high = np.array(plotter.bounds).reshape(3, 2).T
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T - 0.5 * (low + high)
    up = np.array(plotter.camera.up)
    right = np.cross(plotter.camera.direction, up)
    reach = max(np.abs(corners @ up).max(), np.abs(corners @ right).max() / 1.5)
    plotter.camera.zoom(float(min(1.5, 0.85 * np.linalg.norm(corners, axis=1).max() / reach)))


def _caption(directory: Path) -> str:
    path = directory / "summary.json"
    if not path.exists():
        return "contact"
    contents = json.loads(path.read_text(encoding="utf-8"))
    friction = contents["friction"]
    values = [friction["min"], friction["max"]] if isinstance(friction, dict) else [friction]
    shown = " to ".join(f"{value:g}" for value in values if value is not None)
    law = f"Coulomb friction {shown}" if contents["law"] == "coulomb" else "Tresca friction"
    warning = alarm(contents)
    return f"{law}: {warning}" if warning else law


def alarm(contents: dict[str, Any]) -> str:
    """What a picture must say in red of a run with this summary.json; empty if its answer counts."""
    if not contents["certificate"]["passed"]:
        return "NOT CERTIFIED"
    return "" if contents.get("valid", True) else "OUTSIDE THE THEORY"


def nice(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten below."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1.0 + 1e-12)))


def table1(csv_file: str | Path) -> Path:
    """Products and seconds of every solver against the contact unknowns, log-log, beside its table1.csv."""
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
    """Products and seconds of every method against friction, a line for each size, beside its friction.csv."""
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
    """Seconds of the contact problem and of the yardstick, and memory, against the unknowns, beside its scaling.csv."""
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
    """Seconds and peak memory of every peer against the cells a metre, beside its peers.csv."""
    rows = _read_csv(csv_file)
    figure, axes = _axes(2)
    for name in dict.fromkeys(row["peer"] for row in rows):
        mine = [row for row in rows if row["peer"] == name]
        p = [float(row["p"]) for row in mine]
        axes[0].loglog(p, [float(row["seconds"]) for row in mine], "o-", label=name)
        axes[1].loglog(p, [float(row["peak_memory_bytes"]) / 2**30 for row in mine], "o-", label=name)
    axes[0].set_ylabel("seconds")
    axes[1].set_ylabel("peak memory, GiB")
    _finish(axes, "cells a metre", [float(row["p"]) for row in rows])
    return _save(figure, csv_file)


def conditioning(csv_file: str | Path) -> Path:
    """Condition numbers against the path-following step, beside its conditioning.csv (the paper's Figure 1)."""
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


def _finish(axes: Any, label: str, sizes: Sequence[float]) -> None:
    """A logarithmic axis that names the sizes measured, and the legend beside the last picture."""
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


def _axes(count: int) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5 * count, 4.2), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes


def _save(figure: Any, csv_file: str | Path) -> Path:
    path = Path(csv_file).with_suffix(".png")
    figure.savefig(path, dpi=130)
    return path


if __name__ == "__main__":
    picture(sys.argv[1])
