"""XDMF meshes with numbered groups of facets and cells, as DOLFINx and meshio write them (XML and HDF5)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..nearest import tree_of
from ..regular_file import read_bytes, refuse_irregular
from .mesh_file import IntArray, MeshFile, refuse_cells
from .numbered_groups import members_by_name, only_set

_WIDTH = {
    **{"tetrahedron": 4, "hexahedron": 8, "tetrahedron_10": 10, "hexahedron_27": 27},
    **{"triangle": 3, "quadrilateral": 4, "triangle_6": 6, "quadrilateral_9": 9},
}
_CORNERS = {"tetrahedron": 4, "hexahedron": 8, "triangle": 3, "quadrilateral": 4}
_FACE_OF = {
    **{"tetrahedron": ("triangle",), "hexahedron": ("quadrilateral",)},
    **{"tetrahedron_10": ("triangle_6", "triangle"), "hexahedron_27": ("quadrilateral_9", "quadrilateral")},
}
_LONG = {"tet": "tetrahedron", "hex": "hexahedron", "tri": "triangle", "quad": "quadrilateral"}
_OTHER_CELLS = {"wedge": 6, "pyramid": 5, "mixed": 0}


@dataclass(frozen=True)
class _Grid:
    """A Grid of a file: its cells or facets, the points to which they refer, and the whole numbers on its cells."""

    where: str
    kind: str
    rows: IntArray
    points: FloatArray
    numbers: dict[str, IntArray]


def read(
    path: str,
    facets: str | None,
    cells: str | None,
    names: Mapping[str, int],
    cell_names: Mapping[str, int],
) -> MeshFile:
    """Read a mesh on this rank.

    Args:
        path: The mesh; the first Grid of tetrahedra or hexahedra.
        facets: File with numbers on facets; by default the same file, if it has such.
        cells: File with numbers on cells; by default the same file, if it has such.
        names: Names of groups of facets, with their numbers.
        cell_names: Names of groups of cells.

    Raises:
        OSError: If a file cannot be read.
        ValueError: If a file is not XDMF, is incomplete, or lacks the requested numbers.
    """
    mesh, *others = _grids(path, tuple(_FACE_OF), "cells in 3D")
    refuse_cells(path, {grid.kind: _WIDTH[grid.kind] for grid in (mesh, *others)})
    numbered = [grid for grid in (mesh, *others) if grid.kind == mesh.kind and grid.numbers]
    if cells is not None:
        numbered = _grids(cells, (mesh.kind,), "cells of the mesh's kind", mesh)
    cell_groups = _groups(numbered, cells, cell_names, "cell_names", _rows_of_cells, mesh)
    marked = _grids(facets or path, _FACE_OF[mesh.kind], "facets", mesh, optional=facets is None)
    face_groups = _groups([grid for grid in marked if grid.numbers], facets, names, "names", _corners_in_mesh, mesh)
    return MeshFile(path, mesh.points, mesh.rows, cell_groups, face_groups)


_RowsOf = Callable[[_Grid, _Grid], IntArray]


def _groups(
    grids: list[_Grid], asked: str | None, names: Mapping[str, int], key: str, rows_of: _RowsOf, mesh: _Grid
) -> dict[str, IntArray]:
    """Rows of every group, by name or else by number."""
    sources = [(grid, name) for grid in grids for name in grid.numbers]
    if not sources:
        if asked is not None or names:
            raise ValueError(f"{asked or mesh.where}: has no whole numbers on its facets or cells, to go by {key}")
        return {}
    chosen = only_set(sources[0][0].where, [name for _, name in sources])
    grid = next(grid for grid, name in sources if name == chosen)
    rows, numbers = rows_of(grid, mesh), grid.numbers[chosen]
    if len(numbers) != len(grid.rows):
        raise ValueError(f"{grid.where}: {chosen} has {len(numbers)} numbers for {len(grid.rows)} entities")
    return {name: rows[members] for name, members in members_by_name(grid.where, numbers, names, key).items()}


def _in_mesh(grid: _Grid, mesh: _Grid) -> IntArray:
    """The grid's rows by points of the mesh; if the two number the points differently, they are matched by place."""
    if grid.points.shape == mesh.points.shape and np.array_equal(grid.points, mesh.points):
        return grid.rows
    used, inverse = np.unique(grid.rows, return_inverse=True)
    distance, number = tree_of(mesh.points).query(grid.points[used])
    if np.max(distance) > 1e-9 * float(np.max(np.ptp(mesh.points, axis=0))):
        raise ValueError(f"{grid.where}: has points that are none of the mesh {mesh.where}")
    return np.asarray(number, dtype=np.int64)[inverse].reshape(grid.rows.shape)


def _corners_in_mesh(grid: _Grid, mesh: _Grid) -> IntArray:
    """The corners of facets by points of the mesh."""
    return _in_mesh(grid, mesh)[:, : _CORNERS[grid.kind.partition("_")[0]]]


def _rows_of_cells(grid: _Grid, mesh: _Grid) -> IntArray:
    """Numbers of the mesh's cells for the cells of a grid."""
    if grid is mesh:
        return np.arange(len(mesh.rows))
    both = np.sort(np.vstack([mesh.rows, _in_mesh(grid, mesh)]), axis=1)
    _, first, number = np.unique(both, axis=0, return_index=True, return_inverse=True)
    cell: IntArray = first[number.ravel()][len(mesh.rows) :]
    if np.any(cell >= len(mesh.rows)):
        raise ValueError(f"{grid.where}: has cells that are none of the mesh {mesh.where}")
    return cell


def _grids(
    path: str, kinds: tuple[str, ...], what: str, mesh: _Grid | None = None, optional: bool = False
) -> list[_Grid]:
    """The Grids of these kinds in a file; without points of their own, they refer to those of the mesh."""
    try:
        tree = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not XDMF, or cut short: {error}") from None
    if tree.tag != "Xdmf":
        raise ValueError(f"{path}: is not XDMF: it begins with <{tree.tag}>")
    found: list[_Grid] = []
    seen: list[str] = []
    points: FloatArray = mesh.points if mesh is not None else np.empty((0, 3))
    for grid in tree.iter("Grid"):
        geometry, topology = grid.find("Geometry"), grid.find("Topology")
        if geometry is not None:
            points = array_of(path, geometry).astype(np.float64)
        if topology is None:
            continue
        kind, _, nodes = (topology.get("TopologyType") or topology.get("Type") or "").lower().partition("_")
        kind = "_".join(filter(None, (_LONG.get(kind, kind), nodes)))
        seen.append(kind)
        if kind.partition("_")[0] in (*_CORNERS, *_OTHER_CELLS) and kind not in _WIDTH:
            refuse_cells(path, {f"cells of kind {kind}": int(nodes) if nodes.isdigit() else _OTHER_CELLS.get(kind, 0)})
        if kind not in kinds:
            continue
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"{path}: has points in {points.shape[-1]}D, but a body in 3D is needed")
        rows = array_of(path, topology).astype(np.int64).reshape(-1, _WIDTH[kind])
        if len(rows) and not (0 <= rows.min() and rows.max() < len(points)):
            raise ValueError(f"{path}: has a cell or facet with a point that the file does not define")
        numbers: dict[str, IntArray] = {}
        for attribute in grid.findall("Attribute"):
            values = np.ravel(array_of(path, attribute))
            if attribute.get("Center") == "Cell" and values.dtype.kind in "iu":
                numbers[attribute.get("Name") or "unnamed"] = values.astype(np.int64)
        found.append(_Grid(path, kind, rows, points, numbers))
    if not found and not optional:
        raise ValueError(f"{path}: has no {what} ({', '.join(kinds)}); it has {', '.join(seen) or 'nothing'}")
    return found


def array_of(path: str, parent: ElementTree.Element) -> npt.NDArray[Any]:
    """The numbers of an element's DataItem.

    Raises:
        ValueError: If they cannot be read.
    """
    item = parent.find("DataItem")
    if item is None or item.text is None:
        raise ValueError(f"{path}: a {parent.tag} has no DataItem")
    form = (item.get("Format") or "XML").upper()
    try:
        if form == "HDF":
            name, _, inside = item.text.strip().partition(":")
            refuse_irregular(Path(path).parent / name)
            with h5py.File(Path(path).parent / name, "r") as file:
                return np.asarray(file[inside])
        if form == "XML":
            shape = [int(n) for n in (item.get("Dimensions") or "-1").split()]
            whole = (item.get("NumberType") or item.get("DataType") or "Float") in ("Int", "UInt", "Char", "UChar")
            return np.array(item.text.split(), dtype=np.int64 if whole else np.float64).reshape(shape)
    except (OSError, KeyError) as error:
        raise ValueError(f"{path}: the data {item.text.strip()} cannot be read: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}: a {parent.tag} is damaged: {error}") from None
    raise ValueError(f"{path}: has data in the format {form}; write HDF or XML")
