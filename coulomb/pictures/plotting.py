"""Pictures from the files of a run, drawn in a separate process; imports neither DOLFINx nor the solvers."""

from __future__ import annotations

import ctypes.util
import os
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
