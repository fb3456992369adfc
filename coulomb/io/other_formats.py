"""The fields of a run in other formats, from its XDMF files, on one rank: VTKHDF, which ParaView and PyVista open with
its time steps, CalculiX's .frd, and a table of the contact nodes.

VTKHDF 2.0, an unstructured grid (docs.vtk.org, VTK File Formats): bodies, or faces, are one grid, with their number in
the cells; a mesh that does not change is there once.  Not by VTK's writer: clusters install no VTK (565 MB).
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import scipy.sparse.csgraph

from ..arrays import FloatArray, IntArray
from ..fem.meshes import AXISYMMETRIC
from .field_files import WHOLE, Grid, read_grids
from .frd import NodalResults, write_frd
from .run_directory import CONTACT, FIELDS, FRD, SOLUTION, RunDirectory

_CELLS: Final = {SOLUTION: {4: 10, 8: 12, 10: 24, 27: 29}, CONTACT: {3: 5, 4: 9, 6: 22, 9: 28}}
"""VTK's numbers of the kinds of cells, by file and number of nodes."""


def write_formats(directory: Path, formats: tuple[str, ...]) -> None:
    """Write the fields of a run or a load history in these formats beside its XDMF files.

    Raises:
        OSError: If a file cannot be written.
        ValueError: If a file of the run cannot be read.
    """
    if "vtkhdf" in formats:
        for name in FIELDS:
            _write_vtkhdf(directory, name)
    if "csv" in formats:
        _write_table(directory)
    if "frd" in formats:
        _write_frd(directory)


def _steps(directory: Path, name: str) -> Iterator[tuple[float, dict[str, Grid]]]:
    """Time and grids of a run, or of every step of a load history."""
    files = RunDirectory(directory)
    steps = [files.step(number) for number in files.begun_steps] if files.is_history else [files]
    for step in [one for one in steps if one.summary.is_file()]:  # an unfinished last one has none
        yield float(step.read_summary().get("step", {}).get("time", 0.0)), read_grids(step.path / name)


def _write_vtkhdf(directory: Path, name: str) -> None:
    """FILE.vtkhdf of FILE.xdmf."""
    with h5py.File((directory / name).with_suffix(".vtkhdf"), "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0], dtype=np.int64)
        root.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", len("UnstructuredGrid")))

        def append(place: str, rows: Any) -> int:
            """Append rows to a data set; returns how many there were."""
            rows = np.asarray(rows)
            if place not in root:
                shape = rows.shape[1:]
                root.create_dataset(place, (0, *shape), rows.dtype, maxshape=(None, *shape), chunks=True)
            data, count = root[place], len(root[place])
            data.resize(count + len(rows), axis=0)
            data[count:] = rows
            return int(count)

        before, starts = list[Grid](), dict[str, int]()
        for time, grids in _steps(directory, name):
            pieces = list(grids.values())
            append("Steps/Values", [time])
            append("Steps/NumberOfParts", [1])
            if not _same_mesh(before, pieces):
                first = np.cumsum([0, *(len(piece.points) for piece in pieces)])
                cells = [piece.cells + start for piece, start in zip(pieces, first, strict=False)]
                nodes, widths = np.concatenate([cell.ravel() for cell in cells]), [cell.shape[1] for cell in cells]
                each = np.repeat(widths, [len(cell) for cell in cells])
                starts = {
                    "PartOffsets": append("NumberOfPoints", [first[-1]]),
                    "PointOffsets": append("Points", np.concatenate([piece.points for piece in pieces])),
                    "CellOffsets": append("Types", np.array([_CELLS[name][int(k)] for k in each], dtype=np.uint8)),
                    "ConnectivityIdOffsets": append("Connectivity", nodes.astype(np.int64)),
                }
                append("NumberOfCells", [len(each)])
                append("NumberOfConnectivityIds", [len(nodes)])
                append("Offsets", np.concatenate([[0], np.cumsum(each)]).astype(np.int64))
            for place, row in starts.items():
                append(f"Steps/{place}", [row] if place in ("PartOffsets", "PointOffsets") else [[row]])
            number = {"part": np.repeat(np.arange(len(pieces)), [len(piece.cells) for piece in pieces])}
            for of, own in (("PointData", {}), ("CellData", number)):
                fields = dict.fromkeys(field for piece in pieces for field in piece.fields)
                mine = [field for field in fields if any(field in piece.on_cells for piece in pieces) == bool(own)]
                for field, values in {**{field: _together(pieces, field) for field in mine}, **own}.items():
                    append(f"Steps/{of}Offsets/{field}", [append(f"{of}/{field}", values)])
            before = pieces
        root["Steps"].attrs["NSteps"] = len(root["Steps/Values"])


def _same_mesh(before: list[Grid], now: list[Grid]) -> bool:
    return len(before) == len(now) and all(
        np.array_equal(one.points, other.points) and np.array_equal(one.cells, other.cells)
        for one, other in zip(before, now, strict=True)
    )


def _together(pieces: list[Grid], field: str) -> FloatArray:
    """A field of all pieces, nan on those without it."""
    one = next(piece for piece in pieces if field in piece.fields)
    sizes = [len(piece.cells if field in one.on_cells else piece.points) for piece in pieces]
    none = [np.full((count, *one.fields[field].shape[1:]), np.nan) for count in sizes]
    return np.concatenate([piece.fields.get(field, nan) for piece, nan in zip(pieces, none, strict=True)])


_SAME: Final = 1e-8
"""Points of the section that are nearer to each other, over its largest coordinate, are the same."""

_STRESS: Final = ("xx", "yy", "zz", "xy", "yz", "xz")


def _write_frd(directory: Path) -> None:
    """results.frd, on the mesh of the first step."""
    steps = list(zip(_steps(directory, SOLUTION), _steps(directory, CONTACT), strict=True))
    mesh = steps[0][0][1]
    starts = np.cumsum([0, *(len(body.points) for body in mesh.values())])
    first = dict(zip(mesh, starts.tolist(), strict=False))
    given = [body.fields.get("node_number", np.zeros(len(body.points))) for body in mesh.values()]
    numbers = np.concatenate(given).astype(np.int64)
    blocks = [body.cells + start for body, start in zip(mesh.values(), starts, strict=False)]
    points = np.concatenate([body.points for body in mesh.values()])
    files = RunDirectory(directory)
    layer = (files.step(files.begun_steps[0]) if files.is_history else files).read_summary().get("slice")
    section = None if layer is None else _Section(layer, points, numbers, blocks)
    if section is not None:
        numbers, points, blocks = numbers[section.first], section.points, section.blocks
    order = np.argsort(numbers, kind="stable")
    again = np.flatnonzero((np.diff(numbers[order]) == 0) & (numbers[order[1:]] > 0))
    one, other = order[again], order[again + 1]
    if np.any(np.abs(points[one] - points[other]) > 1e-9 * np.abs(points).max()):  # of bodies of several files
        numbers[:] = 0
    numbers[other] = 0  # the second side of a cut
    numbers[numbers == 0] = numbers.max(initial=0) + 1 + np.arange(np.sum(numbers == 0))

    def results() -> Iterator[NodalResults]:
        for (time, bodies), (_, faces) in steps:
            fields = {"DISP": np.concatenate([body.fields["displacement"] for body in bodies.values()])}
            fields["STRESS"] = np.concatenate([_at_nodes(body) for body in bodies.values()])
            fields["FORC"] = np.concatenate([body.fields["reaction"] for body in bodies.values()])
            fields["CONTACT"] = contact = np.zeros((starts[-1], 6))
            for name, face in faces.items():
                if "tangent_1" in face.fields:  # of a slave
                    start = first[name.rpartition(":")[0]] if len(first) > 1 else 0
                    contact[start + face.fields["node"].astype(np.int64)] = _contact(face.fields)
            yield NodalResults(time, fields if section is None else section.of(fields))

    write_frd(directory / FRD, numbers, points, blocks, results(), flat=section is not None)


class _Section:
    """The section of a slice, where CalculiX has the results of plane and axisymmetric elements.

    Attributes:
        first: Of every point of the section the one of the layer that is nearest to it, shape (k,).
        points: Where they are, in the plane z = 0, shape (k, 3).
        blocks: Quadrilaterals of 4 or 8 points.
    """

    def __init__(self, layer: Mapping[str, Any], points: FloatArray, numbers: IntArray, blocks: Sequence[IntArray]):
        wedge = layer["kind"] == AXISYMMETRIC
        self._copies = float(layer["layers"])
        self._angle = np.arctan2(points[:, 2], points[:, 0]) if wedge else np.zeros(len(points))
        across = np.hypot(points[:, 0], points[:, 2]) if wedge else points[:, 0]
        size = float(np.abs(points).max())
        at = np.rint(np.column_stack([across, points[:, 1]]) / (_SAME * size)).astype(np.int64)
        keys = np.column_stack(
            [at, numbers, _components(blocks, len(points))]
        )  # bodies that touch have points of theirs
        self._of = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
        order = np.lexsort((np.rint(np.abs(points[:, 2]) / (_SAME * size)), self._of))
        self.first = order[np.searchsorted(self._of[order], np.arange(self._of.max() + 1))]
        self.points = np.column_stack([across, points[:, 1], np.zeros(len(points))])[self.first]
        columns = {8: range(4), 27: (*range(4), *range(8, 12))}
        self.blocks = [self._of[cells[:, list(columns[cells.shape[1]])]] for cells in blocks]

    def of(self, fields: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """The values at its points; forces are for all layers."""
        values_of = {name: values[self.first] for name, values in fields.items()}
        cos, sin = np.cos(self._angle), np.sin(self._angle)
        for name in ("DISP", "FORC"):
            x, y, z = fields[name].T
            turned = np.column_stack([cos * x + sin * z, y, cos * z - sin * x])
            values_of[name] = turned[self.first]
        total = np.zeros_like(values_of["FORC"])
        np.add.at(total, self._of, turned)
        return values_of | {"FORC": self._copies * total}


def _components(blocks: Sequence[IntArray], count: int) -> IntArray:
    """Of every point the number of the body that it is in, shape (count,)."""
    pairs = np.vstack([np.column_stack([cells[:, 0].repeat(cells.shape[1]), cells.ravel()]) for cells in blocks])
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs), dtype=bool), pairs.T), shape=(count, count))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)


def _at_nodes(body: Grid) -> FloatArray:
    """The stress of the cells at their nodes, the mean of those around, in the order of CalculiX, shape (k, 6)."""
    of_cells = np.column_stack([body.fields[f"stress_{entry}"] for entry in _STRESS])
    nodes, width = body.cells.ravel(), body.cells.shape[1]
    times = np.bincount(nodes, minlength=len(body.points))
    sums = [np.bincount(nodes, np.repeat(column, width), len(body.points)) for column in of_cells.T]
    return np.column_stack(sums) / np.maximum(times, 1)[:, None]


def _contact(own: dict[str, FloatArray]) -> FloatArray:
    """Gap, slip, pressure and shear of the slave on the master at contact nodes, in CalculiX's directions: the first is
    x, or z, projected on the face, the second the normal of the master times that, shape (k, 6)."""
    normal = own["normal"]
    x = np.eye(3)[np.where(np.abs(normal[:, 0]) > 1.0 - 1e-6, 2, 0)]
    first = x - normal * np.einsum("ki,ki->k", x, normal)[:, None]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(first, normal)], axis=1)  # the normal is that of the slave
    slip, shear = (np.einsum("kai,ki->ka", tangents, own[name]) for name in ("slip", "friction_traction"))
    return np.column_stack([own["gap"], slip, own["pressure"], -shear])


def _write_table(directory: Path) -> None:
    """contact.csv: a row for every node of a contact face at every step, vectors by components."""
    tables = []
    for time, grids in _steps(directory, CONTACT):
        for of, grid in grids.items():
            columns: dict[str, Any] = {"time": time, "name": "" if list(grids) == [WHOLE] else of}
            for name, values in (("", grid.points), *grid.fields.items()):
                if values.ndim == 1:
                    columns[name] = values
                else:
                    columns |= {f"{name}_{axis}".strip("_"): values[:, k] for k, axis in enumerate("xyz")}
            tables.append(columns)
    names = list(dict.fromkeys(name for columns in tables for name in columns))
    with (directory / CONTACT).with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for columns in tables:
            count = (len(columns["x"]),)
            writer.writerows(zip(*(np.broadcast_to(columns.get(name, ""), count) for name in names), strict=True))
