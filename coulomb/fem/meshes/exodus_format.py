"""Meshes of Exodus II files (Cubit, MOOSE, SEACAS): element blocks, side sets and node sets.

Our own reader, not meshio's (tried: 5.3.5), which reads no side sets and no names of blocks, fails on the block type
TET4, and needs the package netCDF4.  Here scipy reads NetCDF's classic files, h5py those that are HDF5.
(https://sandialabs.github.io/seacas-docs; Schoof and Yarberry 1994)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, IntArray
from ...regular_file import refuse_irregular
from .lagrange import CORNERS, in_vtk_order
from .mesh_file import MeshFile, solid_nodes

_SIDES = {
    4: ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    8: ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
}
"""Corners of the sides 1, 2, ... of a tetrahedron and a hexahedron."""

_SOLID, _SURFACE = ("TET", "HEX", "WEDGE", "PYR"), ("SHELL", "TRI", "QUAD")

_Variables = Mapping[str, tuple[npt.NDArray[Any], str]]
"""Of every variable its values and, of the nodes of a block, the type of the elements."""


def read(path: str) -> MeshFile:
    """Read a file on this rank.

    Blocks of solid elements become groups of cells; side sets and blocks of shells groups of facets; node sets groups
    of nodes.  What has no name is called by its number, as in "3".

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no Exodus file, damaged, or has no cells that can be used.
    """
    refuse_irregular(path)
    with open(path, "rb") as file:
        start = file.read(8)
    if start.startswith(b"CDF\5"):
        raise ValueError(f"{path}: is NetCDF of the kind CDF-5; convert it: nccopy -k nc4 {path} NEW.e")
    try:
        variables = _hdf5(path) if start.startswith(b"\x89HDF") else _classic(path)
        return _mesh(path, variables)
    except (KeyError, IndexError, OSError, TypeError) as error:
        raise ValueError(f"{path}: is not an Exodus file, or damaged: {error}") from None


def _classic(path: str) -> _Variables:
    from scipy.io import netcdf_file  # takes time to load, and few meshes are of this kind

    with netcdf_file(path, "r", mmap=False) as file:
        return {
            name: (np.array(variable[...]), _text(getattr(variable, "elem_type", b"")))
            for name, variable in file.variables.items()
            if _needed(name)
        }


def _hdf5(path: str) -> _Variables:
    with h5py.File(path, "r") as file:
        return {
            name: (np.asarray(data), _text(data.attrs.get("elem_type", b"")))
            for name, data in file.items()
            if isinstance(data, h5py.Dataset) and _needed(name)
        }


def _needed(name: str) -> bool:
    starts = ("coord", "connect", "eb_", "ss_", "ns_", "elem_ss", "side_ss", "node_ns", "node_num_map")
    return name.startswith(starts) and name != "coor_names"


def _text(value: Any) -> str:
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return text.split("\0")[0].strip()


def _mesh(path: str, variables: _Variables) -> MeshFile:
    points = _points(path, variables)
    blocks: list[tuple[str, int, IntArray]] = []
    shells: list[tuple[str, int, IntArray]] = []
    kinds: dict[int, int] = {}
    element = 0  # blocks number their elements one after another
    for name, number in _titles(variables, "eb"):
        if f"connect{number}" not in variables:  # an empty block
            continue
        nodes, kind = variables[f"connect{number}"]
        rows, kind = nodes.astype(np.int64) - 1, kind.upper()
        if kind.startswith(_SOLID):
            kinds[rows.shape[1]] = kinds.get(rows.shape[1], 0) + len(rows)
            blocks.append((name, element, rows))
        elif kind.startswith(_SURFACE):
            shells.append((name, element, rows))
        element += len(rows)
    width = solid_nodes(path, kinds, sum(len(rows) for *_, rows in shells))
    side = 3 if CORNERS[width] == 4 else 4
    fitting = (3, 6) if side == 3 else (4, 8, 9)
    shells = [(name, first, rows[:, :side]) for name, first, rows in shells if rows.shape[1] in fitting]

    cells = np.vstack([rows for *_, rows in blocks])
    row = np.full(element, -1, dtype=np.int64)  # of every element in `cells`
    cell_groups: dict[str, IntArray] = {}
    at = 0
    for name, first, rows in blocks:
        cell_groups[name] = np.arange(at, at + len(rows), dtype=np.int64)
        row[first : first + len(rows)] = cell_groups[name]
        at += len(rows)
    corners = np.full((element, side), -1, dtype=np.int64)  # of every shell
    face_groups: dict[str, IntArray] = {}
    for name, first, rows in shells:
        face_groups[name] = corners[first : first + len(rows)] = rows
    for name, number in _titles(variables, "ss"):
        if f"elem_ss{number}" in variables:
            of_elements = variables[f"elem_ss{number}"][0].astype(np.int64) - 1
            sides = variables[f"side_ss{number}"][0].astype(np.int64) - 1
            face_groups[name] = _side_set(path, name, cells, row[of_elements], sides, corners[of_elements])
    node_groups = {
        name: variables[f"node_ns{number}"][0].astype(np.int64) - 1
        for name, number in _titles(variables, "ns")
        if f"node_ns{number}" in variables
    }
    numbers = variables["node_num_map"][0].astype(np.int64) if "node_num_map" in variables else None
    return MeshFile(path, points, in_vtk_order(cells, "exodus"), cell_groups, face_groups, node_groups, numbers)


def _points(path: str, variables: _Variables) -> FloatArray:
    if "coord" in variables:
        points = variables["coord"][0].T
    else:
        points = np.column_stack([variables[f"coord{axis}"][0] for axis in "xyz" if f"coord{axis}" in variables])
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: has points in {points.shape[-1]}D, but a body in 3D is needed")
    return np.ascontiguousarray(points, dtype=np.float64)


def _titles(variables: _Variables, kind: str) -> list[tuple[str, int]]:
    """Of every block ("eb"), side set ("ss") or node set ("ns") its name, or else its number; and its place."""
    numbers = variables[f"{kind}_prop1"][0] if f"{kind}_prop1" in variables else np.empty(0, dtype=np.int64)
    names: Any = variables[f"{kind}_names"][0] if f"{kind}_names" in variables else []
    titles = [_text(b"".join(np.asarray(name).astype("S1").ravel().tolist())) for name in names]
    count = max(len(numbers), len(titles))
    titles += [""] * (count - len(titles))
    return [
        (title or str(int(numbers[place]) if place < len(numbers) else place + 1), place + 1)
        for place, title in enumerate(titles)
    ]


def _side_set(path: str, name: str, cells: IntArray, rows: IntArray, sides: IntArray, shells: IntArray) -> IntArray:
    """Points of the facets of a side set: sides, from 0, of the cells in these rows; where a row is -1, either face of
    shells, of which the points are given."""
    table = np.array(_SIDES[CORNERS[cells.shape[1]]])
    solid = rows >= 0
    limit = np.where(solid, len(table), np.where(shells[:, 0] >= 0, 2, 0))  # further sides of shells are edges
    if np.any((sides < 0) | (sides >= limit)):
        raise ValueError(f"{path}: the side set {name!r} has sides that are no facets of its elements")
    facets = shells.copy()
    facets[solid] = cells[rows[solid][:, None], table[sides[solid]]]
    return facets
