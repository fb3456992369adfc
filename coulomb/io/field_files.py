"""The XDMF files of a run with their HDF5 files: reading of meshes, fields and time series.  Uses neither DOLFINx nor
MPI."""

from __future__ import annotations

import contextlib
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import h5py
import numpy as np

from ..arrays import FloatArray, IntArray

WHOLE = "mesh"
"""Name of the only grid of a file, and of its group with `geometry` and `topology` in `Mesh`."""

OPPOSITE = "opposite_of"
"""A field of contact.xdmf that only the faces opposite in pairs have: the number of the contact, the same at all
nodes."""

NODE = "node"
"""A field of contact.xdmf: the number of the point in solution.xdmf, of its body if there are several, from 0."""

_AT_ONCE: Final = 200_000  # points read at a time: no rank needs memory for the whole mesh


class Block(NamedTuple):
    """The grid of a body or a face among several in one `Grid`: its name, its points and its cells.

    `kind` is XDMF's name of its cells in the file, `pieces` how many each has been cut into.
    """

    name: str
    points: slice
    cells: slice
    kind: str
    pieces: int


class Grid(NamedTuple):
    """Contents of an XDMF file: cells (k, nodes per cell), points (n, 3), fields on points or cells by name.

    Fields with a value per cell are named in `on_cells`.  Where the cells are pieces of second-order ones, `cut` is the
    kind of these, and `pieces` how many each has.  Where it holds several grids, each is one of `blocks`; cells with
    fewer nodes than others repeat their last one.
    """

    cell: str
    cells: IntArray
    points: FloatArray
    fields: dict[str, FloatArray]
    on_cells: frozenset[str] = frozenset()
    cut: str = ""
    pieces: int = 1
    blocks: tuple[Block, ...] = ()


def data_of(path: str | Path) -> Path:
    """The HDF5 file of an XDMF file."""
    return Path(path).with_suffix(".h5")


def mesh_at(group: str = "") -> str:
    """The group of an HDF5 file with `geometry` and `topology` of a grid; by default of the only one."""
    return f"Mesh/{group or WHOLE}"


def function_at(name: str, group: str = "") -> str:
    """The data set of an HDF5 file with the values of a field of a grid; by default of the only one."""
    return f"{_function(name, group)}/0"


def _function(name: str, group: str) -> str:
    return f"Function/{group}/{name}" if group else f"Function/{name}"


def dataset(file: Any, name: str, group: str = "") -> Any:
    """The values of a field in an open HDF5 file, one row per point or cell."""
    values = file[_function(name, group)]
    return values[next(iter(values))]


def grids_of(path: Path) -> dict[str, str]:
    """By the names of the grids of an XDMF file the groups of their data; both are empty for the only grid of a file.

    Raises:
        ValueError: If the file cannot be read, or a grid refers to no mesh.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from None
    grids = {}
    for grid in uniform(root.find("Domain/Grid")):
        place = (grid.findtext("Geometry/DataItem") or "").strip()
        file, _, name = place.partition(":/Mesh/")
        group = name.removesuffix("/geometry")
        if file != data_of(path).name or not group or group == name:
            raise ValueError(f"{path}: shows {place or 'nothing'} as points")
        grids[str(grid.get("Name"))] = group
    return {"": ""} if list(grids.values()) == [WHOLE] else grids


def uniform(grid: ElementTree.Element | None) -> list[ElementTree.Element]:
    """The grids of a spatial collection, or the grid itself."""
    if grid is None:
        return []
    return grid.findall("Grid") if grid.get("GridType") == "Collection" else [grid]


def read_grids(path: str | Path) -> dict[str, Grid]:
    """Read the grids of an XDMF file from the HDF5 data sets to which it refers, by their names.

    Raises:
        ValueError: If there is no grid in the file, or a mesh is damaged.
        OSError, KeyError, SyntaxError: If a file cannot be read.
    """
    path = Path(path)
    grids = uniform(ElementTree.parse(path).getroot().find("Domain/Grid"))
    if not grids:
        raise ValueError(f"{path}: there is no grid in this file")
    return {str(grid.get("Name")): _read(path, grid) for grid in grids}


def _read(path: Path, grid: ElementTree.Element) -> Grid:
    with contextlib.ExitStack() as stack:
        files: dict[str, h5py.File] = {}

        def data(element: Any) -> Any:
            file, _, place = element.find("DataItem").text.strip().partition(":")
            if file not in files:  # most grids have one
                files[file] = stack.enter_context(h5py.File(path.with_name(file), "r"))
            return files[file][place][()]

        topology, geometry = grid.find("Topology"), grid.find("Geometry")
        assert topology is not None and geometry is not None
        x, cells, attributes = data(geometry), data(topology), grid.findall("Attribute")
        if x.ndim != 2 or x.shape[1] != 3 or not len(cells) or not 0 <= cells.min() <= cells.max() < len(x):
            raise ValueError(f"{path}: its mesh is damaged")
        rows = {str(attribute.get("Name")): data(attribute) for attribute in attributes}
        fields = {name: of[:, 0] if of.ndim == 2 and of.shape[1] == 1 else of for name, of in rows.items()}
        on_cells = frozenset(str(one.get("Name")) for one in attributes if one.get("Center") == "Cell")
        return Grid(str(topology.get("TopologyType")), cells, x, fields, on_cells)


def parts_of_field(path: Path, name: str, group: str = "") -> Iterator[tuple[IntArray, FloatArray]]:
    """Numbers of points in solution.xdmf (q,), and values (q, d) there, of a field of a grid in an HDF5 file, in parts.

    Raises:
        ValueError: If there are not as many values as points.
        OSError, KeyError: If the file cannot be read.
    """
    with h5py.File(path, "r") as file:
        field, count = dataset(file, name, group), len(file[f"{mesh_at(group)}/geometry"])
        node = dataset(file, NODE, group) if _function(NODE, group) in file else None
        if len(field) != count or (node is not None and len(node) != count):
            raise ValueError(f"{name} does not match the mesh")
        for first in range(0, count, _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            number = np.arange(first, min(first + _AT_ONCE, count)) if node is None else np.ravel(node[part])
            yield number.astype(np.int64), np.array(field[part])
