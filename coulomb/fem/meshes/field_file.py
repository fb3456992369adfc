"""Nodal fields in files: points, cells as tetrahedra, and the values of one field."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...regular_file import read_bytes
from .meshio_formats import by_meshio
from .xdmf_data import array_of

Ints = npt.NDArray[np.int64]
Parts = Sequence[tuple[str, Ints]]
"""Cells by kind: rows of node numbers, the corners first."""

_CUBE = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
_HALVED = (
    *((0, 4, 6, 7), (1, 5, 4, 8), (2, 6, 5, 9), (3, 8, 7, 9)),
    *((4, 9, 6, 7), (4, 9, 7, 8), (4, 9, 8, 5), (4, 9, 5, 6)),
)
_SPLIT = {
    "tet": ((0, 1, 2, 3),),
    "hex": _CUBE,
    "wed": ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)),
    "pyr": ((0, 1, 2, 4), (0, 2, 3, 4)),
}
"""Tetrahedra of a cell by the beginning of its kind's name, in VTK's order of nodes."""

_MESHIO = {".vtu": "vtu", ".vtk": "vtk", ".msh": "gmsh", ".med": "med", ".e": "exodus", ".exo": "exodus"}
"""meshio's name of the format, by the end of the file's name."""


def read_nodal_field(path: str, field: str) -> tuple[FloatArray, Ints, FloatArray]:
    """Points (n, 3) in the file's unit of length, tetrahedra (t, 4), and the values of a field (n,).

    Raises:
        ValueError: If the file cannot be read, or has no solid cells, or not one number per node by this name.
    """
    kind = Path(path).suffix.lower()
    if kind not in (".xdmf", *_MESHIO):
        raise ValueError(f"{path}: a field is read from files that end in .xdmf, {', '.join(_MESHIO)}")
    try:
        points, cells, values = _xdmf(path, field) if kind == ".xdmf" else _meshio(path, field, _MESHIO[kind])
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
    values = np.squeeze(values)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: has points in {points.shape[-1]}D, but a field in 3D is needed")
    if values.shape != (len(points),):
        raise ValueError(f"{path}: {field} must be one number per node, but has shape {values.shape}")
    split = [rows[:, part] for name, rows in cells for part in _parts(name, rows.shape[1])]
    if not split:
        listed = ", ".join(name for name, _ in cells) or "none"
        raise ValueError(f"{path}: has no solid cells, in which {field} could be interpolated (cells: {listed})")
    return points.astype(np.float64), np.concatenate(split).astype(np.int64), values.astype(np.float64)


def _parts(kind: str, width: int) -> Sequence[tuple[int, ...]]:
    """Tetrahedra of a kind of cell, none of a flat one."""
    return _HALVED if kind[:3] == "tet" and width == 10 else _SPLIT.get(kind[:3], ())


def _missing(path: str, field: str, there: Sequence[str]) -> ValueError:
    listed = ", ".join(map(repr, dict.fromkeys(there))) or "none"
    return ValueError(f"{path}: has no field {field!r} with values at nodes; it has {listed}")


def _meshio(path: str, field: str, form: str) -> tuple[FloatArray, Parts, FloatArray]:
    mesh = by_meshio(path, read_bytes(path), form)
    if field not in mesh.point_data:
        raise _missing(path, field, list(mesh.point_data))
    cells = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
    return np.asarray(mesh.points), cells, np.asarray(mesh.point_data[field], dtype=np.float64)


def _xdmf(path: str, field: str) -> tuple[FloatArray, Parts, FloatArray]:
    try:
        tree = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not XDMF, or cut short: {error}") from None
    nodal = [one for one in tree.iter("Attribute") if (one.get("Center") or "Node").lower() == "node"]
    named = [one for one in nodal if one.get("Name") == field]
    if not named:
        raise _missing(path, field, [str(one.get("Name")) for one in nodal])
    if len(named) > 1:
        raise ValueError(f"{path}: has {field!r} at {len(named)} times; write a file with one of them")
    geometry = next(tree.iter("Geometry"), None)
    topologies = [one for one in tree.iter("Topology") if one.find("DataItem") is not None]
    if geometry is None or not topologies:
        raise ValueError(f"{path}: has no mesh")
    kind = str(topologies[0].get("TopologyType") or topologies[0].get("Type")).lower()
    rows = array_of(path, topologies[0]).astype(np.int64)
    return array_of(path, geometry), [(kind, _rows(path, kind, rows))], array_of(path, named[0])


def _rows(path: str, kind: str, rows: npt.NDArray[Any]) -> Ints:
    if rows.ndim != 2:
        raise ValueError(f"{path}: has cells of kind {kind}, which are not read here; write tetrahedra or hexahedra")
    return rows
