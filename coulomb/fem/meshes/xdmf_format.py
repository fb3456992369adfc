"""XDMF meshes with numbered groups of facets and cells, as DOLFINx, meshio and `coulomb convert` write them.

The arrays are in HDF5 files, of which every rank reads its share: no rank has the whole mesh.  DOLFINx's XDMFFile reads
numbers only on a mesh that is made already, whose faults are to be found before, and knows no names of them.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray, IntArray, distinct
from ...exchange import Exchange, even_starts, fetched, owner_of, starts_of
from ...nearest import tree_of
from ...regular_file import read_bytes, refuse_irregular
from ..geometry import on_all_ranks
from .among_ranks import Slabs, bounds, on_first_rank
from .mesh_file import MeshFile, SectionFile, only_set, refuse_cells, titles

NAMES = "coulomb:names"
"""Name of the Information element with the names of numbers, as {"faces": {"sole": 3}, "cells": {"steel": 1}}: the XDMF
format has elements for data of a program, but no names for numbers on cells."""

NODE_NUMBER: Final = "node_number"
"""Name of the field on nodes with their numbers in the mesh file, 0 where it has no such node."""

SOLIDS = {4: "Tetrahedron", 8: "Hexahedron", 10: "Tetrahedron_10", 27: "Hexahedron_27"}
"""XDMF's names of cells by the number of their nodes."""

FACETS = {3: "Triangle", 4: "Quadrilateral", 6: "Triangle_6", 9: "Quadrilateral_9"}
"""XDMF's names of facets by the number of their nodes."""

_WHOLE = ("Int", "UInt", "Char", "UChar")


@dataclass(frozen=True)
class XdmfArray:
    """An array of a file, the same on every rank.

    Attributes:
        place: HDF5 file and the dataset's path in it; None if the numbers are in the XML.
        number: Of those in the XML, which array it is.
        shape: Of the whole.
        whole: Whether the numbers are whole ones.
    """

    place: tuple[str, str] | None
    number: int
    shape: tuple[int, ...]
    whole: bool


@dataclass(frozen=True)
class XdmfGrid:
    """A Grid of a file.

    Attributes:
        kind: Of its cells, as in the XML in lower case.
        topology: Points of every cell.
        geometry: The last one up to this Grid; None if there is none.
        numbers: Attributes on the cells that are whole numbers, by name.
        of_nodes: The attribute `NODE_NUMBER` on the points, if there is one.
    """

    kind: str
    topology: XdmfArray
    geometry: XdmfArray | None
    numbers: dict[str, XdmfArray]
    of_nodes: XdmfArray | None = None


_BY_MESHIO: Final = frozenset(("mixed", "wedge", "wedge_15", "pyramid", "pyramid_13", "hexahedron_20"))
"""Kinds of cells that become others."""


def has_mixed_cells(path: str) -> bool:
    """Whether a Grid has cells of several kinds, prisms, pyramids or 20-node hexahedra, which rank 0 reads by meshio;
    errors as of `XdmfFile`."""
    kinds = (one.get("TopologyType") or one.get("Type") or "" for one in xml_of(path).iter("Topology"))
    return any(kind.lower() in _BY_MESHIO for kind in kinds)


class XdmfFile:
    """An XDMF file; rank 0 reads the XML, and every rank its share of the rows of the HDF5 datasets; collective.

    Attributes:
        grids: Its Grids that have cells.
        names: Names of the numbers on facets ("faces") and on cells ("cells") in its Information element, if any.

    Raises:
        ValueError: On every rank, if the file cannot be read or is not XDMF.
    """

    def __init__(self, path: str, comm: MPI.Comm):
        self.path, self.comm = path, comm
        self._texts: list[npt.NDArray[Any]] = []
        described = comm.bcast(on_first_rank(comm, path, self._described))
        self.grids: list[XdmfGrid] = described[0]
        self.names: dict[str, dict[str, int]] = described[1]

    def part(self, array: XdmfArray, width: int | None = None) -> npt.NDArray[Any]:
        """This rank's rows, of `width` numbers, by default those that the array has: shared evenly; those in the XML
        are all on rank 0; ValueError on every rank if they cannot be read; collective."""

        def read() -> npt.NDArray[Any]:
            if array.place is None:
                rest = array.shape[1:] if width is None else (width,)
                if self.comm.rank == 0:
                    return self._texts[array.number].reshape(-1, *rest)
                return np.empty((0, *rest), dtype=np.int64 if array.whole else np.float64)
            per_row = int(np.prod(array.shape[1:])) if width is None else width
            share = even_starts(self.comm.size, int(np.prod(array.shape)) // max(per_row, 1))
            first, last = int(share[self.comm.rank]), int(share[self.comm.rank + 1])
            with h5py.File(array.place[0], "r") as file:
                data = file[array.place[1]]
                if width is None or array.shape[1:] == (width,):
                    return np.asarray(data[first:last])
                if len(array.shape) == 1:
                    return np.asarray(data[first * width : last * width]).reshape(-1, width)
                return np.asarray(data).reshape(-1, width)[first:last]

        where = "numbers in the XML" if array.place is None else f"the data {array.place[0]}:{array.place[1]}"
        return on_all_ranks(read, f"{self.path}: {where} cannot be read", self.comm)

    def beside(self, values: XdmfArray, rows: int) -> npt.NDArray[Any]:
        """The values of an array with one number per row of another one, of which this rank has so many rows;
        collective."""
        values_here = np.ravel(self.part(values, 1))
        theirs, ours = starts_of(self.comm, len(values_here)), starts_of(self.comm, rows)
        if np.array_equal(theirs, ours):
            return values_here
        mine = np.arange(ours[self.comm.rank], ours[self.comm.rank + 1])
        return fetched(self.comm, theirs, mine, values_here)

    def _described(self) -> tuple[list[XdmfGrid], dict[str, dict[str, int]]]:
        tree = xml_of(self.path)
        grids: list[XdmfGrid] = []
        geometry: XdmfArray | None = None
        for grid in tree.iter("Grid"):
            points, topology = grid.find("Geometry"), grid.find("Topology")
            if points is not None:
                geometry = self._array(points)
            if topology is None:
                continue
            kind = (topology.get("TopologyType") or topology.get("Type") or "").lower()
            numbers, of_nodes = {}, None
            for attribute in grid.findall("Attribute"):
                if attribute.get("Center") == "Node" and attribute.get("Name") == NODE_NUMBER:
                    of_nodes = self._array(attribute)
                if attribute.get("Center") == "Cell" and (values := self._array(attribute)).whole:
                    numbers[attribute.get("Name") or "unnamed"] = values
            grids.append(XdmfGrid(kind, self._array(topology), geometry, numbers, of_nodes))
        return grids, self._names(tree)

    def _names(self, tree: ElementTree.Element) -> dict[str, dict[str, int]]:
        for entry in tree.iter("Information"):
            if entry.get("Name") == NAMES:
                try:
                    given = json.loads(entry.get("Value") or "")
                    return {of: {str(name): int(number) for name, number in given[of].items()} for of in given}
                except (ValueError, TypeError, AttributeError) as error:
                    raise ValueError(f"{self.path}: the Information {NAMES} is damaged: {error}") from None
        return {}

    def _array(self, parent: ElementTree.Element) -> XdmfArray:
        item = _item(self.path, parent)
        if _form(item) != "HDF":
            self._texts.append(array_of(self.path, parent))
            text = self._texts[-1]
            return XdmfArray(None, len(self._texts) - 1, text.shape, text.dtype.kind in "iu")
        file, inside = _place(self.path, item)
        with _opened(self.path, item) as data:
            return XdmfArray((file, inside), 0, data[inside].shape, data[inside].dtype.kind in "iu")


def array_of(path: str, parent: ElementTree.Element) -> npt.NDArray[Any]:
    """All numbers of an element's DataItem; ValueError if they cannot be read."""
    item = _item(path, parent)
    if _form(item) == "HDF":
        with _opened(path, item) as file:
            return np.asarray(file[_place(path, item)[1]])
    if _form(item) == "XML":
        shape = [int(n) for n in (item.get("Dimensions") or "-1").split()]
        whole = (item.get("NumberType") or item.get("DataType") or "Float") in _WHOLE
        try:
            return np.array((item.text or "").split(), dtype=np.int64 if whole else np.float64).reshape(shape)
        except ValueError as error:
            raise ValueError(f"{path}: a {parent.tag} is damaged: {error}") from None
    raise ValueError(f"{path}: has data in the format {_form(item)}; write HDF or XML")


def xml_of(path: str) -> ElementTree.Element:
    """The root of an XDMF file; ValueError if it is none."""
    try:
        tree = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not XDMF, or cut short: {error}") from None
    if tree.tag != "Xdmf":
        raise ValueError(f"{path}: is not XDMF: it begins with <{tree.tag}>")
    return tree


def _item(path: str, parent: ElementTree.Element) -> ElementTree.Element:
    item = parent.find("DataItem")
    if item is None or item.text is None:
        raise ValueError(f"{path}: a {parent.tag} has no DataItem")
    return item


def _form(item: ElementTree.Element) -> str:
    return (item.get("Format") or "XML").upper()


def _place(path: str, item: ElementTree.Element) -> tuple[str, str]:
    text = (item.text or "").strip()
    name, colon, inside = text.rpartition(":/")  # the name of a file may have a colon
    if not colon:
        name, _, inside = text.partition(":")
    return str(Path(path).parent / name), f"/{inside}" if colon else inside


def _opened(path: str, item: ElementTree.Element) -> h5py.File:
    """The HDF5 file of an item, in which its dataset is."""
    name, inside = _place(path, item)
    try:
        refuse_irregular(Path(name))
        file = h5py.File(name, "r")
        if not isinstance(file.get(inside), h5py.Dataset):
            file.close()
            raise KeyError(f"there is no dataset {inside!r}")
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(f"{path}: the data {(item.text or '').strip()} cannot be read: {error}") from None
    return file


_WIDTH = {name.lower(): nodes for names in (SOLIDS, FACETS) for nodes, name in names.items()}
_LINES: Final = {"polyline": 2, "edge_3": 3}
_WIDTH |= _LINES
_CORNERS = {"tetrahedron": 4, "hexahedron": 8, "triangle": 3, "quadrilateral": 4, "polyline": 2, "edge": 2}
_FACE_OF = {
    **{"tetrahedron": ("triangle",), "hexahedron": ("quadrilateral",)},
    **{"tetrahedron_10": ("triangle_6", "triangle"), "hexahedron_27": ("quadrilateral_9", "quadrilateral")},
}
_LONG = {"tet": "tetrahedron", "hex": "hexahedron", "tri": "triangle", "quad": "quadrilateral"}
_OTHER_CELLS = {"wedge": 6, "pyramid": 5, "mixed": 0}

_MOST_GROUPS: Final = 1000
"""More different numbers on cells or facets are no groups, but numbers of the cells."""


@dataclass(frozen=True, eq=False)
class _Grid:
    """This rank's cells or facets of a Grid, with its share of the points to which they refer."""

    file: XdmfFile
    kind: str
    rows: IntArray
    geometry: tuple[str, XdmfArray]
    points: FloatArray
    numbers: dict[str, XdmfArray]
    of_nodes: XdmfArray | None


def read(
    path: str,
    facets: str | None,
    cells: str | None,
    names: Mapping[str, int],
    cell_names: Mapping[str, int],
    comm: MPI.Comm,
) -> MeshFile:
    """Read a mesh, the first Grid of tetrahedra or hexahedra, every rank a part; arguments as of `read_xdmf`;
    collective.

    Returns:
        Of points, cells and facets those of this rank, of groups of cells the numbers of cells on any rank; cells and
            points are numbered rank after rank, as in the file.

    Raises:
        ValueError: On every rank, if a file cannot be read, is not XDMF, is incomplete, or lacks the requested numbers.
    """
    file = XdmfFile(path, comm)
    mesh, *others = _grids(file, tuple(_FACE_OF), "cells in 3D")
    refuse_cells(path, {grid.kind: _WIDTH[grid.kind] for grid in (mesh, *others)})
    numbered = [grid for grid in (mesh, *others) if grid.kind == mesh.kind and grid.numbers]
    if cells is not None:
        numbered = _grids(
            file if cells == path else XdmfFile(cells, comm), (mesh.kind,), "cells of the mesh's kind", mesh
        )
    cell_groups = _groups(numbered, cells, cell_names, "cell_names", _rows_of_cells, mesh)
    on_facets = file if facets is None or facets == path else XdmfFile(facets, comm)
    marked = _grids(on_facets, _FACE_OF[mesh.kind], "facets", mesh, optional=facets is None)
    face_groups = _groups([grid for grid in marked if grid.numbers], facets, names, "names", _corners_in_mesh, mesh)
    of_nodes = None if mesh.of_nodes is None else file.beside(mesh.of_nodes, len(mesh.points)).astype(np.int64)
    return MeshFile(path, mesh.points, mesh.rows, cell_groups, face_groups, numbers=of_nodes)


def read_section(path: str, names: Mapping[str, int], cell_names: Mapping[str, int]) -> SectionFile:
    """Read a section in 2D, Grids of triangles or quadrilaterals of one kind, with the numbers on Grids of lines, on
    this rank; ValueError as of `read`."""
    file = XdmfFile(path, MPI.COMM_SELF)
    mesh, *others = _grids(file, tuple(name.lower() for name in FACETS.values()), "cells of a section in 2D", flat=True)
    numbered = [grid for grid in (mesh, *others) if grid.kind == mesh.kind and grid.numbers]
    cell_groups = _groups(numbered, None, cell_names, "cell_names", _rows_of_cells, mesh)
    marked = [grid for grid in _grids(file, tuple(_LINES), "lines", mesh, optional=True, flat=True) if grid.numbers]
    line_groups = _groups(marked, None, names, "names", _corners_in_mesh, mesh)
    return SectionFile(path, mesh.points, {mesh.rows.shape[1]: mesh.rows}, cell_groups, line_groups)


_RowsOf = Callable[[_Grid, _Grid], IntArray]


def _groups(
    grids: list[_Grid], asked: str | None, names: Mapping[str, int], key: str, rows_of: _RowsOf, mesh: _Grid
) -> dict[str, IntArray]:
    """This rank's rows of every group, by name or else by number; collective."""
    sources = [(grid, name) for grid in grids for name in grid.numbers]
    if not sources:
        if asked is not None or names:
            where = asked or mesh.file.path
            raise ValueError(f"{where}: has no whole numbers on its facets or cells, to go by {key}")
        return {}
    file = sources[0][0].file
    chosen = only_set(file.path, [name for _, name in sources])
    grid = next(grid for grid, name in sources if name == chosen)
    count, entities = int(np.prod(grid.numbers[chosen].shape)), file.comm.allreduce(len(grid.rows))
    if count != entities:
        raise ValueError(f"{file.path}: {chosen} has {count} numbers for {entities} entities")
    numbers = file.beside(grid.numbers[chosen], len(grid.rows)).astype(np.int64)
    present = np.unique(np.concatenate(file.comm.allgather(np.unique(numbers)[: _MOST_GROUPS + 1])))
    if len(present) > _MOST_GROUPS and not names:
        return {}
    stored = {name: n for name, n in file.names.get(_KEPT[key], {}).items() if n in present and n not in names.values()}
    rows = rows_of(grid, mesh)
    called = titles(file.path, [int(n) for n in present], {**stored, **names}, key)
    return {name: rows[numbers == number] for name, number in called.items()}


_KEPT = {"names": "faces", "cell_names": "cells"}


def _in_mesh(grid: _Grid, mesh: _Grid) -> IntArray:
    """The grid's rows by points of the mesh; matched by place if the two number the points differently; collective."""
    comm = mesh.file.comm
    equal = grid.points.shape == mesh.points.shape and np.array_equal(grid.points, mesh.points)
    if grid.geometry == mesh.geometry or comm.allreduce(equal, op=MPI.LAND):
        return grid.rows
    near = 1e-9 * float(np.max(np.ptp(bounds(comm, mesh.points), axis=0)))
    slabs = Slabs(comm, mesh.points)
    point, slab = slabs.near(mesh.points, near)
    to = Exchange(comm, slab)
    x, number = to.send(mesh.points[point]), to.send(starts_of(comm, len(mesh.points))[comm.rank] + point)
    used, inverse = np.unique(grid.rows, return_inverse=True)
    wanted = fetched(comm, starts_of(comm, len(grid.points)), used, grid.points)
    ask = Exchange(comm, slabs.of(wanted))
    asked = ask.send(wanted)
    place: IntArray = np.full(len(asked), -1, dtype=np.int64)
    if len(x):
        distance, nearest = tree_of(x).query(asked, k=2)
        place = np.where(distance[:, 0] <= near, number[nearest[:, 0]], -1)
        place[distance[:, 1] <= near] = -2
    place = ask.reply(place)
    least = comm.allreduce(int(np.min(place, initial=0)), op=MPI.MIN)
    if least == -2:
        raise ValueError(
            f"{grid.file.path}: has points at which the mesh {mesh.file.path} has several nodes, of parts that touch, "
            "and does not say which: write the groups with the points of the mesh, or give the parts as bodies"
        )
    if least < 0:
        raise ValueError(f"{grid.file.path}: has points that are none of the mesh {mesh.file.path}")
    return place[inverse.ravel()].reshape(grid.rows.shape)


def _corners_in_mesh(grid: _Grid, mesh: _Grid) -> IntArray:
    """The corners of facets by points of the mesh; collective."""
    return _in_mesh(grid, mesh)[:, : _CORNERS[grid.kind.partition("_")[0]]]


def _rows_of_cells(grid: _Grid, mesh: _Grid) -> IntArray:
    """Numbers of the mesh's cells for this rank's cells of a grid; collective."""
    comm = mesh.file.comm
    starts = starts_of(comm, len(mesh.rows))
    numbers = np.arange(starts[comm.rank], starts[comm.rank + 1])
    if grid is mesh:
        return numbers
    ours, theirs = np.sort(mesh.rows, axis=1), np.sort(_in_mesh(grid, mesh), axis=1)
    hubs = even_starts(comm.size, comm.allreduce(len(mesh.points)))
    here = Exchange(comm, owner_of(hubs, ours[:, 0]))
    there, number = here.send(ours), here.send(numbers)
    ask = Exchange(comm, owner_of(hubs, theirs[:, 0]))
    first, which = distinct(np.vstack([there, ask.send(theirs)]))
    row = first[which][len(there) :]
    known = row < len(there)
    cell = ask.reply(np.where(known, np.append(number, -1)[np.where(known, row, -1)], -1))
    if comm.allreduce(bool(np.any(cell < 0)), op=MPI.LOR):
        raise ValueError(f"{grid.file.path}: has cells that are none of the mesh {mesh.file.path}")
    return np.asarray(cell, dtype=np.int64)


def _grids(
    file: XdmfFile,
    kinds: tuple[str, ...],
    what: str,
    mesh: _Grid | None = None,
    optional: bool = False,
    flat: bool = False,
) -> list[_Grid]:
    """The Grids of these kinds in a file; without points of their own, they refer to those of the mesh; points may be
    in 2D if `flat`; collective."""
    path, comm = file.path, file.comm
    grids: list[_Grid] = []
    seen: list[str] = []
    for grid in file.grids:
        kind, _, nodes = grid.kind.partition("_")
        kind = "_".join(filter(None, (_LONG.get(kind, kind), nodes)))
        seen.append(kind)
        if kind.partition("_")[0] in (*_CORNERS, *_OTHER_CELLS) and kind not in _WIDTH:
            refuse_cells(path, {f"cells of kind {kind}": int(nodes) if nodes.isdigit() else _OTHER_CELLS.get(kind, 0)})
        if kind not in kinds:
            continue
        geometry, points = _points(file, grid.geometry, mesh, grids, flat)
        rows = file.part(grid.topology, _WIDTH[kind]).astype(np.int64)
        count = comm.allreduce(len(points))
        unknown = bool(len(rows) and not (0 <= rows.min() and rows.max() < count))
        if comm.allreduce(unknown, op=MPI.LOR):
            raise ValueError(f"{path}: has a cell or facet with a point that the file does not define")
        grids.append(_Grid(file, kind, rows, geometry, points, grid.numbers, grid.of_nodes))
    if not grids and not optional:
        raise ValueError(f"{path}: has no {what} ({', '.join(kinds)}); it has {', '.join(seen) or 'nothing'}")
    return grids


def _points(
    file: XdmfFile, geometry: XdmfArray | None, mesh: _Grid | None, before: list[_Grid], flat: bool
) -> tuple[tuple[str, XdmfArray], FloatArray]:
    for other in (*before, *([mesh] if mesh is not None else [])):
        if geometry is None or other.geometry == (file.path, geometry):
            return other.geometry, other.points
    width = 0 if geometry is None or len(geometry.shape) != 2 else geometry.shape[1]
    if geometry is None or not (width == 3 or (flat and width == 2)):
        raise ValueError(f"{file.path}: has points in {width}D, but a body in 3D is needed")
    points = file.part(geometry).astype(np.float64)
    return (file.path, geometry), np.column_stack([points, np.zeros((len(points), 3 - width))])
