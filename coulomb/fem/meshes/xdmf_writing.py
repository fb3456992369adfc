"""Meshes written as XDMF with an HDF5 file, so that ranks can read them in parts; DOLFINx reads them too.

Not by meshio (tried: 5.3.5): cells and facets become one Grid of kind Mixed there, which neither can read.
"""

from __future__ import annotations

import errno
import json
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ...arrays import FloatArray, IntArray
from ...regular_file import replacing
from .. import compat
from .among_ranks import global_numbers
from .inspection import InspectedMesh
from .lagrange import in_vtk_order
from .mesh_parts import corners_of
from .named_mesh import NamedMesh
from .xdmf_format import FACETS, NAMES, NODE_NUMBER, SOLIDS


class HDF5Target:
    """A file to be created or replaced, as `h5py.File` takes it; OSError if it cannot be opened.

    Errors are kept for the end: with one HDF5 could neither close the file nor end the process.
    """

    def __init__(self, path: Path):
        self._file, self._fault = path.open("w+b", buffering=0), ""

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and not self._fault:
            done += self._attempt(lambda: self._file.write(view[done:])) or 0  # noqa: B023
        return len(view)

    def read(self, size: int) -> bytes:
        content = self._attempt(lambda: self._file.read(size)) or b""
        return bytes(content).ljust(size, b"\0")  # what could not be written is missing

    def seek(self, *place: int) -> int:
        return self._file.seek(*place)

    def tell(self) -> int:
        return self._file.tell()

    def truncate(self, size: int) -> int:
        self._attempt(lambda: self._file.truncate(size))
        return size

    def flush(self) -> None:
        """Nothing is buffered."""

    def close(self) -> str:
        """Close the file; what went wrong since it was opened, or nothing."""
        self._attempt(self._file.close)
        return self._fault

    def _attempt(self, action: Callable[[], Any]) -> Any:
        try:
            return action()
        except OSError as error:
            self._fault = self._fault or error.strerror or str(error)
            return None


def gathered(mesh: NamedMesh) -> InspectedMesh:
    """A mesh on rank 0, for `write`; on the others without points, cells and facets; collective."""
    domain, comm = mesh.domain, mesh.comm
    own, points = domain.topology.index_map(3).size_local, domain.geometry.index_map()
    number = global_numbers(points)
    first = domain.topology.index_map(3).local_range[0]

    def whole(rows: Any) -> Any:
        parts = comm.gather(rows)
        return np.concatenate(parts) if parts is not None else rows[:0]

    rows = in_vtk_order(number[compat.cell_geometry(domain)[:own]], "dolfinx")
    of_faces = {name: np.sort(number[corners_of(domain, facets)], axis=1) for name, facets in mesh.faces.items()}
    return InspectedMesh(
        whole(domain.geometry.x[: points.size_local]),
        whole(rows),
        {name: whole(first + np.asarray(cells, dtype=np.int64)) for name, cells in mesh.cells.items()},
        {name: np.unique(whole(corners), axis=0) for name, corners in of_faces.items()},
        {},
        numbers=None if mesh.node_numbers is None else whole(mesh.node_numbers[: points.size_local]),
    )


def write(mesh: InspectedMesh, path: Path) -> None:
    """Write a mesh that one rank has, .xdmf with the arrays in .h5 beside it; groups become numbers, whose names are in
    an Information element; points that belong to no cell are left out, and the others keep their numbers
    (`NODE_NUMBER`).

    Raises:
        OSError: If a file cannot be written; earlier ones of these names are kept then, and no partial ones left.
    """
    data = path.with_suffix(".h5")
    with replacing(path) as description, replacing(data) as arrays:
        target = HDF5Target(arrays)
        with h5py.File(target, "w") as file:
            text = _filled(mesh, file, data.name)
        if fault := target.close():
            raise OSError(errno.EIO, fault, str(data))
        description.write_text(text, encoding="utf-8")


def _filled(mesh: InspectedMesh, file: h5py.File, name_of_file: str) -> str:
    """Write the arrays; what the XDMF file has to contain."""
    used, inverse = np.unique(mesh.cells, return_inverse=True)
    position = np.full(len(mesh.points), -1, dtype=np.int64)
    position[used] = np.arange(len(used))
    cells: IntArray = inverse.reshape(mesh.cells.shape).astype(np.int64)
    faces = {name: position[rows] for name, rows in mesh.face_groups.items()}
    numbers = {"faces": _numbered(faces), "cells": _numbered(mesh.cell_groups)}

    def item(name: str, values: IntArray | FloatArray) -> str:
        file[name] = values
        kind = 'NumberType="Float" Precision="8"' if values.dtype.kind == "f" else 'NumberType="Int" Precision="8"'
        shape = " ".join(map(str, values.shape))
        return f'<DataItem Dimensions="{shape}" {kind} Format="HDF">{escape(name_of_file)}:/{name}</DataItem>'

    def grid(name: str, kind: str, rows: IntArray, values: IntArray | None) -> list[str]:
        geometry = f'<Geometry GeometryType="XYZ">{points}</Geometry>'
        size = f'NumberOfElements="{len(rows)}" NodesPerElement="{rows.shape[1]}"'
        topology = f'<Topology TopologyType="{kind}" {size}>{item(f"{name}/rows", rows)}</Topology>'
        attribute = []
        if values is not None:
            numbers_of_cells = item(f"{name}/numbers", values)
            center = f'Name="{name}" AttributeType="Scalar" Center="Cell"'
            attribute.append(f"<Attribute {center}>{numbers_of_cells}</Attribute>")
        if name == "mesh":
            of_nodes = item(NODE_NUMBER, np.zeros(len(used), dtype=np.int64) if given is None else given[used])
            center = f'Name="{NODE_NUMBER}" AttributeType="Scalar" Center="Node"'
            attribute.append(f"<Attribute {center}>{of_nodes}</Attribute>")
        return [f'<Grid Name="{name}" GridType="Uniform">', geometry, topology, *attribute, "</Grid>"]

    points, given = item("points", mesh.points[used]), mesh.numbers
    members = np.concatenate([np.empty(0, dtype=np.int64), *mesh.cell_groups.values()])
    on_cells = _repeated(mesh.cell_groups, numbers["cells"])
    lines = []
    if len(members) and len(members) == len(cells) == len(np.unique(members)):
        of_cell = np.empty(len(cells), dtype=np.int64)
        of_cell[members] = on_cells
        lines += grid("mesh", SOLIDS[cells.shape[1]], cells, of_cell)
    else:  # cells in no group, or in several
        lines += grid("mesh", SOLIDS[cells.shape[1]], cells, None)
        if len(members):
            lines += grid("cell_groups", SOLIDS[cells.shape[1]], cells[members], on_cells)
    if faces:
        rows = np.concatenate(list(faces.values()))
        lines += grid("facets", FACETS[rows.shape[1]], rows, _repeated(faces, numbers["faces"]))
    named = escape(json.dumps(numbers))
    text = ['<?xml version="1.0"?>', '<Xdmf Version="3.0">', "<Domain>"]
    text += [f'<Information Name="{NAMES}" Value="{named}"/>', *lines, "</Domain>", "</Xdmf>", ""]
    return "\n".join(text)


def _numbered(groups: Mapping[str, IntArray]) -> dict[str, int]:
    """A number for every group, its own if its name is one."""
    taken = {int(name) for name in groups if name.isdecimal()}
    free = (number for number in range(1, 2 * len(groups) + 1) if number not in taken)
    return {name: int(name) if name.isdecimal() else next(free) for name in groups}


def _repeated(groups: Mapping[str, IntArray], numbers: Mapping[str, int]) -> IntArray:
    """The number of the group of every member of all groups, in their order."""
    return np.repeat([numbers[name] for name in groups], [len(rows) for rows in groups.values()]).astype(np.int64)
