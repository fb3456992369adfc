"""The XDMF files of a run with their HDF5 files: reading of meshes, fields and time series.  Uses neither DOLFINx nor
MPI."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from .run_directory import OLD

MESH = "Mesh/mesh"
"""The group of an HDF5 file with `geometry` and `topology`."""

_AT_ONCE = 200_000  # points read at a time: no rank needs memory for the whole mesh


class Grid(NamedTuple):
    """Contents of an XDMF file: cells (k, nodes per cell), points (n, 3), fields on points or cells by name.

    Where the cells are pieces of second-order ones, `cut` is the kind of these, and `pieces` how many each has.
    """

    cell: str
    cells: npt.NDArray[np.int64]
    points: FloatArray
    fields: dict[str, FloatArray]
    cut: str = ""
    pieces: int = 1


def data_of(path: str | Path) -> Path:
    """The HDF5 file of an XDMF file."""
    return Path(path).with_suffix(".h5")


def function_at(name: str) -> str:
    """The data set of an HDF5 file with the values of a field."""
    return f"Function/{name}/0"


def dataset(file: Any, name: str) -> Any:
    """The values of a field in an open HDF5 file, one row per point or cell."""
    group = file[f"Function/{name}"]
    return group[next(iter(group))]


def read_grid(path: str | Path) -> Grid:
    """Read the contents of an XDMF file from the HDF5 data sets to which it refers.

    Raises:
        ValueError: If there is no grid in the file.
        OSError, KeyError, SyntaxError: If a file cannot be read.
    """
    path = Path(path)
    grid = ElementTree.parse(path).getroot().find("Domain/Grid")
    if grid is None:
        raise ValueError(f"{path}: there is no grid in this file")

    def data(element: Any) -> Any:
        file, _, place = element.find("DataItem").text.strip().partition(":")
        with h5py.File(path.with_name(file), "r") as h5:
            return h5[place][()]

    topology, geometry = grid.find("Topology"), grid.find("Geometry")
    assert topology is not None and geometry is not None
    fields = {str(attribute.get("Name")): np.squeeze(data(attribute)) for attribute in grid.findall("Attribute")}
    return Grid(str(topology.get("TopologyType")), data(topology), data(geometry), fields)


def read_fields(
    path: Path, names: tuple[str, ...], optional: tuple[str, ...] = ()
) -> tuple[FloatArray, npt.NDArray[np.int64], dict[str, FloatArray]]:
    """Points (k, 3), cells and fields of an HDF5 file, those that are `optional` if they exist; scalars (k,), vectors
    (k, 3).

    Raises:
        ValueError: If a field is missing, or the mesh is damaged.
        OSError, KeyError: If the file cannot be read.
    """
    with h5py.File(path, "r") as file:
        points = np.array(file[f"{MESH}/geometry"], dtype=np.float64)
        cells = np.array(file[f"{MESH}/topology"], dtype=np.int64)
        fields: dict[str, FloatArray] = {}
        for name in (*names, *(name for name in optional if f"Function/{name}" in file)):
            if f"Function/{name}" not in file:
                raise ValueError(f"{path}: has no field {name!r}: {OLD}")
            values = np.array(dataset(file, name), dtype=np.float64)
            fields[name] = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if points.ndim != 2 or points.shape[1] != 3 or not len(cells) or not 0 <= cells.min() <= cells.max() < len(points):
        raise ValueError(f"{path}: its mesh is damaged")
    return points, cells, fields


def parts_of_field(path: Path, name: str) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Points (q, 3) and values (q, d) of a field of an HDF5 file, in parts.

    Raises:
        ValueError: If there are not as many values as points.
        OSError, KeyError: If the file cannot be read.
    """
    with h5py.File(path, "r") as file:
        points, field = file[f"{MESH}/geometry"], dataset(file, name)
        if len(field) != len(points):
            raise ValueError(f"{name} does not match the mesh")
        for first in range(0, len(points), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            yield np.array(points[part]), np.array(field[part])


def refuse_misnamed(path: Path, names: tuple[str, ...]) -> None:
    """Check that an XDMF file has every field, and that each refers to the HDF5 data set with its name.

    Raises:
        ValueError: If not.
    """
    try:
        grid = ElementTree.parse(path).getroot().find("Domain/Grid")
        attributes = {} if grid is None else {one.get("Name"): one for one in grid.iter("Attribute")}
    except (OSError, ElementTree.ParseError) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from None
    for name in names:
        if name not in attributes:
            raise ValueError(f"{path}: shows no field {name!r}: {OLD}")
        place = (attributes[name].findtext("DataItem") or "").strip()
        if not place.startswith(f"{data_of(path).name}:/Function/{name}/"):
            raise ValueError(f"{path}: shows {place or 'nothing'} as {name!r}")


def read_series(path: Path) -> list[tuple[str, float]]:
    """Directory and time of each step in a time series.

    Raises:
        ValueError: If it cannot be read.
    """
    try:
        grids = ElementTree.parse(path).getroot().findall("Domain/Grid/Grid")
        series = []
        for grid in grids:
            time, items = grid.find("Time"), {(item.text or "").strip() for item in grid.iter("DataItem")}
            places = {item.partition(":")[0].rpartition("/")[0] for item in items}
            series.append((" ".join(sorted(places)), float(time.get("Value", "nan")) if time is not None else np.nan))
        return series
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from None
