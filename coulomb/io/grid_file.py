"""Writing of meshes with fields to XDMF files with HDF5 data, from several ranks through rank 0.

One mesh is a grid of its own; several, such as those of several bodies, are the grids of a spatial collection.

DOLFINx's own writer is not used: before 0.7 it evaluates functions at the points, where basis functions of other nodes
are zero only up to rounding; it writes one mesh per function; and its meshes of facets have no second order in 0.5.
"""

from __future__ import annotations

import errno
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray, IntArray
from ..contact_fields import unit_of
from ..fem.meshes import HDF5Target
from ..units import used
from .field_files import WHOLE, data_of, function_at, grids_of, mesh_at, uniform
from .run_directory import OLD, STEPS

KINDS = {1: "Scalar", 3: "Vector", 6: "Tensor6", 9: "Tensor"}
"""XDMF's names of fields by the number of values per point or cell."""

NOTE: Final = "nodal forces"
"""Name of the Information of a grid that says for what body its nodal forces are."""


@dataclass(frozen=True, eq=False)
class GridPart:
    """This rank's part of a mesh.

    Attributes:
        kind: XDMF's name of the cells.
        cells: Numbers of the points of this rank's cells among the points of all ranks, in VTK's order, shape (c, n).
        points: This rank's points in metres, shape (p, 3); they are numbered rank after rank.
    """

    kind: str
    cells: IntArray
    points: FloatArray


@dataclass(frozen=True)
class GridFields:
    """A mesh with fields on it.

    Attributes:
        on_points: By name, at the points of this rank, shapes (p,) or (p, 3).
        on_cells: By name, in the cells of this rank, shapes (c,) or (c, 3).
        name: Of a body or a contact face; empty for the only grid of a file.
        note: For what body its nodal forces are, in words; empty for the body itself.
    """

    grid: GridPart
    on_points: Mapping[str, FloatArray]
    on_cells: Mapping[str, FloatArray]
    name: str = ""
    note: str = ""


def write_grids(comm: MPI.Comm, path: Path, grids: Sequence[GridFields], time: float, collection: str = "") -> None:
    """Write meshes and fields on them, the same on every rank except for their parts, as an XDMF file and a .h5 file of
    the same name with the data; collective.

    A grid without a name is the only one of its file, with the groups `Mesh/mesh` and `Function` in the HDF5 file, in a
    temporal collection of one step: the form that both PyVista and meshio's `TimeSeriesReader` read.  Others have
    groups of their own, `Mesh/NAME` and `Function/NAME`, and are in a spatial collection of this name.

    Raises:
        OSError: On every rank, if a file cannot be written.
    """
    groups = groups_of([grid.name for grid in grids])
    tables: dict[str, npt.NDArray[Any]] = {}
    for one, group in zip(grids, groups, strict=True):
        mesh = mesh_at(group)
        tables |= {f"{mesh}/geometry": one.grid.points, f"{mesh}/topology": one.grid.cells}
        for fields in (one.on_points, one.on_cells):
            for name, values in fields.items():
                tables[function_at(name, group)] = values if values.ndim == 2 else values[:, None]
    sizes = [comm.allreduce(len(values)) for values in tables.values()]
    if comm.rank > 0:
        for values in tables.values():
            comm.send(np.ascontiguousarray(values), dest=0)
    else:
        fault = _written(comm, data_of(path), tables, sizes)
        if not fault:
            try:
                shapes = {name: (size, v.shape[1]) for (name, v), size in zip(tables.items(), sizes, strict=True)}
                document = ElementTree.ElementTree(_description(path, grids, shapes, time, collection))
                document.write(path, encoding="utf-8", xml_declaration=True)
            except Exception as error:
                fault = _in_words(path, error)
    fault = comm.bcast(fault if comm.rank == 0 else "")
    if fault:
        raise OSError(errno.EIO, fault)


def _written(comm: MPI.Comm, path: Path, tables: Mapping[str, npt.NDArray[Any]], sizes: Sequence[int]) -> str:
    """Write the tables of all ranks, which rank 0 receives in parts, so that it needs no memory for the whole; returns
    what went wrong.  What the other ranks send is received in any case: they wait until it is."""
    parts = (mine if rank == 0 else comm.recv(source=rank) for mine in tables.values() for rank in range(comm.size))
    try:
        target = HDF5Target(path)
        with h5py.File(target, "w") as file:
            for (name, mine), size in zip(tables.items(), sizes, strict=True):
                data, row = file.create_dataset(name, (size, mine.shape[1]), mine.dtype), 0
                for part in islice(parts, comm.size):
                    data[row : row + len(part)] = part
                    row += len(part)
        return target.close()
    except Exception as error:
        return _in_words(path, error)
    finally:
        for _ in parts:
            pass


def _in_words(path: Path, error: Exception) -> str:
    return f"{path.name}: {getattr(error, 'strerror', None) or str(error) or repr(error)}"


def groups_of(names: Sequence[str]) -> tuple[str, ...]:
    """The group of an HDF5 file for every grid by their names, each different: letters, digits, - and _."""
    groups: list[str] = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)
        group, number = plain, 2
        while group in groups or (group == WHOLE and name):
            group, number = f"{plain}_{number}", number + 1
        groups.append(group)
    return tuple(groups)


def described(path: Path, kinds: Mapping[int, str], collection: str) -> float:
    """The time that an XDMF file describes, if `write_grids` writes the same for the data in its HDF5 file; `kinds` are
    XDMF's names of the cells by the number of their nodes.

    Raises:
        ValueError: If it cannot be read, or is another one.
        OSError, KeyError: If the HDF5 file cannot be read, or has other cells.
    """
    groups, root = grids_of(path), ElementTree.parse(path).getroot()
    shapes: dict[str, tuple[int, int]] = {}
    with h5py.File(data_of(path), "r") as file:
        file.visititems(lambda name, one: shapes.update({name: one.shape} if isinstance(one, h5py.Dataset) else {}))
    grids, shown, none = [], set(), np.empty(0)
    for (name, group), grid in zip(groups.items(), uniform(root.find("Domain/Grid")), strict=False):
        centres = {str(one.get("Name")): one.get("Center") for one in grid.findall("Attribute")}
        mesh, of = mesh_at(group), {centre: function_at(centre, group) for centre in centres}
        shown |= {f"{mesh}/geometry", f"{mesh}/topology", *of.values()}
        if not shown <= shapes.keys():
            break
        (count, width), points = shapes[f"{mesh}/topology"], shapes[f"{mesh}/geometry"][0]
        on_cells = {
            one: none
            for one, centre in centres.items()
            if shapes[of[one]][0] == count and (count != points or centre == "Cell")
        }
        on_points = {centre: none for centre in centres if centre not in on_cells}
        cells = GridPart(kinds[width], none.astype(np.int64), none)
        said = [str(one.get("Value")) for one in grid.findall("Information") if one.get("Name") == NOTE]
        grids.append(GridFields(cells, on_points, on_cells, name, "".join(said[:1])))
    if lost := sorted(shown ^ shapes.keys()):
        raise ValueError(f"{path}: shows other data than {data_of(path).name} has: {', '.join(lost[:3])}: {OLD}")
    time = float(next(root.iter("Time")).get("Value", "nan"))
    expected = _description(path, grids, shapes, time, collection if any(groups) else "")
    for one, other in zip_longest(_elements(root), _elements(expected)):
        if one != other:
            raise ValueError(f"{path}: has {one}, but {other} describes the data in {data_of(path).name}")
    return time


def _elements(root: ElementTree.Element) -> list[str]:
    """All elements in a line each."""
    return [
        f"<{one.tag}{''.join(f' {name}={value!r}' for name, value in one.items())}> {(one.text or '').strip()}".strip()
        for one in root.iter()
    ]


def _description(
    path: Path, grids: Sequence[GridFields], shapes: Mapping[str, tuple[int, int]], time: float, collection: str
) -> ElementTree.Element:
    """The contents of the XDMF file."""
    root = ElementTree.Element("Xdmf", Version="3.0")
    parent = ElementTree.SubElement(root, "Domain")
    kind = "Spatial" if collection else "Temporal"
    attributes = {"Name": collection or STEPS, "GridType": "Collection", "CollectionType": kind}
    parent = ElementTree.SubElement(parent, "Grid", attributes)
    if collection:
        ElementTree.SubElement(parent, "Time", Value=repr(float(time)))
    for one, group in zip(grids, groups_of([one.name for one in grids]), strict=True):
        grid = ElementTree.SubElement(parent, "Grid", Name=one.name or "mesh", GridType="Uniform")
        _describe_grid(grid, data_of(path).name, one, group, shapes, time)
    ElementTree.indent(root)
    return root


def _describe_grid(
    grid: ElementTree.Element,
    file: str,
    contents: GridFields,
    group: str,
    shapes: Mapping[str, tuple[int, int]],
    time: float,
) -> None:
    """Describe a grid whose data are in a group of an HDF5 file."""

    def refer(parent: ElementTree.Element, name: str, **attributes: str) -> None:
        dimensions = " ".join(map(str, shapes[name]))
        item = ElementTree.SubElement(parent, "DataItem", {"Dimensions": dimensions, **attributes, "Format": "HDF"})
        item.text = f"{file}:/{name}"

    mesh = mesh_at(group)
    count, width = shapes[f"{mesh}/topology"]
    cells = {"TopologyType": contents.grid.kind, "NumberOfElements": str(count), "NodesPerElement": str(width)}
    refer(ElementTree.SubElement(grid, "Topology", cells), f"{mesh}/topology", NumberType="Int", Precision="8")
    double = {"NumberType": "Float", "Precision": "8"}
    if contents.note:
        ElementTree.SubElement(grid, "Information", Name=NOTE, Value=contents.note)
    refer(ElementTree.SubElement(grid, "Geometry", GeometryType="XYZ"), f"{mesh}/geometry", **double)
    ElementTree.SubElement(grid, "Time", Value=repr(float(time)))
    for fields, centre in ((contents.on_points, "Node"), (contents.on_cells, "Cell")):
        for name in fields:
            place = function_at(name, group)
            kind = KINDS.get(shapes[place][1], "Matrix")
            attributes = {"Name": name, "AttributeType": kind, "Center": centre}
            refer(ElementTree.SubElement(grid, "Attribute", attributes), place, **double)
            if unit := used().name(unit_of(name)):  # beside it: meshio reads no attribute with more than its data
                ElementTree.SubElement(grid, "Information", Name=f"unit of {name}", Value=unit)
