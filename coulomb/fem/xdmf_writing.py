"""Meshes written as XDMF with an HDF5 file, so that ranks can read them in parts; DOLFINx reads them too."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np

from ..arrays import FloatArray
from .inspection import InspectedMesh
from .mesh_file import IntArray
from .xdmf_data import NAMES

_KINDS = {4: "Tetrahedron", 8: "Hexahedron", 10: "Tetrahedron_10", 27: "Hexahedron_27"}
_FACETS = {3: "Triangle", 4: "Quadrilateral"}


def write(mesh: InspectedMesh, path: Path) -> None:
    """Write a mesh that one rank has; groups become numbers, whose names are in an Information element.

    Args:
        mesh: The mesh; points that belong to no cell are left out.
        path: The file, .xdmf; the arrays are written beside it, .h5.

    Raises:
        OSError: If a file cannot be written.
    """
    used, inverse = np.unique(mesh.cells, return_inverse=True)
    position = np.full(len(mesh.points), -1, dtype=np.int64)
    position[used] = np.arange(len(used))
    cells: IntArray = inverse.reshape(mesh.cells.shape).astype(np.int64)
    faces = {name: position[rows] for name, rows in mesh.face_groups.items()}
    numbers = {"faces": _numbered(faces), "cells": _numbered(mesh.cell_groups)}
    data = path.with_suffix(".h5")
    with h5py.File(data, "w") as file:

        def item(name: str, values: IntArray | FloatArray) -> str:
            file[name] = values
            kind = 'NumberType="Float" Precision="8"' if values.dtype.kind == "f" else 'NumberType="Int" Precision="8"'
            shape = " ".join(map(str, values.shape))
            return f'<DataItem Dimensions="{shape}" {kind} Format="HDF">{data.name}:/{name}</DataItem>'

        def grid(name: str, kind: str, rows: IntArray, values: IntArray | None) -> list[str]:
            geometry = f'<Geometry GeometryType="XYZ">{points}</Geometry>'
            size = f'NumberOfElements="{len(rows)}" NodesPerElement="{rows.shape[1]}"'
            topology = f'<Topology TopologyType="{kind}" {size}>{item(f"{name}/rows", rows)}</Topology>'
            attribute = []
            if values is not None:
                numbers_of_cells = item(f"{name}/numbers", values)
                center = f'Name="{name}" AttributeType="Scalar" Center="Cell"'
                attribute.append(f"<Attribute {center}>{numbers_of_cells}</Attribute>")
            return [f'<Grid Name="{name}" GridType="Uniform">', geometry, topology, *attribute, "</Grid>"]

        points = item("points", mesh.points[used])
        members = np.concatenate([np.empty(0, dtype=np.int64), *mesh.cell_groups.values()])
        on_cells = _repeated(mesh.cell_groups, numbers["cells"])
        lines = []
        if len(members) and len(members) == len(cells) == len(np.unique(members)):
            of_cell = np.empty(len(cells), dtype=np.int64)
            of_cell[members] = on_cells
            lines += grid("mesh", _KINDS[cells.shape[1]], cells, of_cell)
        else:  # cells in no group, or in several
            lines += grid("mesh", _KINDS[cells.shape[1]], cells, None)
            if len(members):
                lines += grid("cell_groups", _KINDS[cells.shape[1]], cells[members], on_cells)
        if faces:
            rows = np.concatenate(list(faces.values()))
            lines += grid("facets", _FACETS[rows.shape[1]], rows, _repeated(faces, numbers["faces"]))
    named = quoteattr(json.dumps(numbers))
    text = ['<?xml version="1.0"?>', '<Xdmf Version="3.0">', "<Domain>"]
    text += [f'<Information Name="{NAMES}" Value={named}/>', *lines, "</Domain>", "</Xdmf>", ""]
    path.write_text("\n".join(text), encoding="utf-8")


def _numbered(groups: Mapping[str, IntArray]) -> dict[str, int]:
    """A number for every group, its own if its name is one."""
    taken = {int(name) for name in groups if name.isdecimal()}
    free = (number for number in range(1, 2 * len(groups) + 1) if number not in taken)
    return {name: int(name) if name.isdecimal() else next(free) for name in groups}


def _repeated(groups: Mapping[str, IntArray], numbers: Mapping[str, int]) -> IntArray:
    """The number of the group of every member of all groups, in their order."""
    return np.repeat([numbers[name] for name in groups], [len(rows) for rows in groups.values()]).astype(np.int64)
