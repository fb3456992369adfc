"""Gmsh's MSH files, versions 2.2 and 4.1, in ASCII and binary (https://gmsh.info/doc/texinfo/gmsh.html).

Our own reader, not meshio's (tried: 5.3.5), which of MSH 4.1 refuses files with elements in no group or with parametric
nodes, has one of several groups without names, and of a face and a body with one name the body alone, returns no tags
of nodes, and accepts 9 of 82 files that are cut short.  Nor gmsh's own module (tried: 4.15.2), which accepts 81 of
these, takes a second to start, needs the libraries of OpenGL, and is under the GPL.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, IntArray
from ...regular_file import read_bytes
from .lagrange import CORNERS, in_vtk_order
from .mesh_file import A_SLICE, MeshFile, SectionFile, among_all, members_of, refuse_cells
from .one_kind import of_one_kind

NODES = {
    **{1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 8: 3, 9: 6, 10: 9, 11: 10, 12: 27, 13: 18, 14: 14, 15: 1, 16: 8},
    **{17: 20, 18: 15, 19: 13, 20: 9, 21: 10, 22: 12, 23: 15, 24: 15, 25: 21, 26: 4, 27: 5, 28: 6, 29: 20, 30: 35},
    **{31: 56, 36: 16, 37: 25, 38: 36, 92: 64, 93: 125},
}
"""Nodes of an element, by gmsh's number of its type."""

_READ = (4, 5, 6, 7, 11, 12, 17, 18, 19)
"""Types of cells that are read: tetrahedra, hexahedra, prisms and pyramids, of first and second order."""

_IN_VTK = {
    17: (*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
    18: (*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11),
    19: (*range(5), 5, 8, 10, 6, 7, 9, 11, 12),
}
"""Nodes of 20-node hexahedra, 15-node prisms and 13-node pyramids in VTK's order."""

_FACES = {3: (2, 9), 4: (3, 10, 16)}
"""Types of facets by their corners."""

_NAMES = {
    **{4: "tetrahedra", 5: "hexahedra", 6: "prisms", 7: "pyramids"},
    **{11: "10-node tetrahedra", 12: "27-node hexahedra", 17: "20-node hexahedra", 13: "18-node prisms"},
    **{18: "15-node prisms", 14: "14-node pyramids", 19: "13-node pyramids", 29: "20-node tetrahedra"},
    **{30: "35-node tetrahedra", 31: "56-node tetrahedra", 92: "64-node hexahedra", 93: "125-node hexahedra"},
}
_FLAT = {2: "triangles", 3: "quadrilaterals", 9: "6-node triangles", 10: "9-node quadrilaterals"}

_SECTIONS, _LINES = (2, 3, 9, 16, 10), (1, 8)
"""Types of the cells and of the edges of a section in 2D."""

_Elements = dict[int, list[tuple[tuple[int, ...], IntArray]]]
"""By type: blocks of elements with their physical groups and the tags of their nodes."""


def read(path: str, only: str | None = None) -> MeshFile:
    """Read a file on this rank, or the cells of one group alone.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no such file, cut short, or has no cells that can be used.
    """
    names, tags, points, elements = _parsed(path)
    numbers = partial(_places, path, tags)
    joined = {kind: _join(elements[kind], NODES[kind], names, 3) for kind in _cell_types(path, elements)}
    blocks = {NODES[kind]: _in_vtk_order(numbers(cells), kind) for kind, (cells, _) in joined.items()}
    groups_of = among_all((len(cells), members) for cells, members in joined.values())
    kinds = of_one_kind(path, points, blocks, members_of(path, groups_of, only))
    of_faces: dict[str, list[IntArray]] = {}
    for width in kinds.shapes:
        given = [(groups, rows[:, :width]) for kind in _FACES[width] for groups, rows in elements.get(kind, [])]
        faces, members = _join(given, width, names, 2)
        for name, mine in members.items():
            of_faces.setdefault(name, []).append(numbers(faces[mine]))
    for (dimension, _), name in names.items():  # groups of nothing, or of elements no cell has a side like
        if dimension == 2:
            of_faces.setdefault(name, [])
    return kinds.file(path, groups_of, of_faces, {}, tags)


def read_section(path: str) -> SectionFile:
    """Read the triangles and quadrilaterals of a file, with the groups of its lines, on this rank.

    Raises:
        OSError, ValueError: As `read`.
    """
    names, tags, points, elements = _parsed(path)
    if solid := sorted(kind for kind in elements if kind in _NAMES):
        raise ValueError(f"{path}: has {_NAMES[solid[0]]}, but a slice is made of a mesh in 2D")
    joined = {NODES[kind]: _join(elements[kind], NODES[kind], names, 2) for kind in _SECTIONS if kind in elements}
    ends = [(groups, rows[:, :2]) for kind in _LINES for groups, rows in elements.get(kind, [])]
    lines, on_lines = _join(ends, 2, names, 1)
    return SectionFile(
        path,
        points,
        {width: _places(path, tags, cells) for width, (cells, _) in joined.items()},
        among_all((len(cells), members) for cells, members in joined.values()),
        {name: _places(path, tags, lines[mine]) for name, mine in on_lines.items()},
        numbers=tags,
    )


def _parsed(path: str) -> tuple[dict[tuple[int, int], str], IntArray, FloatArray, _Elements]:
    """Names of physical groups, tags and places of nodes, and elements."""
    stream = _Stream(path, read_bytes(path).removeprefix(codecs.BOM_UTF8))
    if stream.version not in ("2.2", "4.1"):
        raise ValueError(f"{path}: is of MSH version {stream.version}; save it as 4.1 or 2.2 (gmsh -format msh41)")
    names = stream.physical_names()
    return names, *(_read_22(stream) if stream.version == "2.2" else _read_41(stream))


def _places(path: str, tags: IntArray, nodes: IntArray) -> IntArray:
    """Where nodes of these tags are among all."""
    order = np.argsort(tags)
    place = np.minimum(np.searchsorted(tags, nodes, sorter=order), len(tags) - 1)
    if len(tags) == 0 or np.any(tags[order[place]] != nodes):
        raise ValueError(f"{path}: an element has a node that the file does not define; is it whole?")
    return order[place]


def _in_vtk_order(cells: IntArray, kind: int) -> IntArray:
    if kind in _IN_VTK:
        return cells[:, list(_IN_VTK[kind])]
    return in_vtk_order(cells, "gmsh") if cells.shape[1] in CORNERS else cells


def _cell_types(path: str, elements: _Elements) -> list[int]:
    present = sorted(kind for kind in elements if kind in _NAMES)
    if not present:
        flat = ", ".join(f"{sum(len(n) for _, n in elements[k])} {_FLAT[k]}" for k in elements if k in _FLAT)
        raise ValueError(
            f"{path}: has no cells in 3D{f' (it has {flat}: {A_SLICE})' if flat else ''}; mesh the volume (gmsh -3), "
            "and where there are physical groups, put the volume in one too: gmsh saves nothing else"
        )
    if set(present) - set(_READ):
        refuse_cells(path, {_NAMES[kind]: NODES[kind] for kind in present})
    return present


def _join(
    blocks: list[tuple[tuple[int, ...], IntArray]], width: int, names: dict[tuple[int, int], str], dimension: int
) -> tuple[IntArray, dict[str, IntArray]]:
    """The distinct elements of all blocks, and those of each group; an element may be in several (2.2 repeats it)."""
    if not blocks:
        return np.empty((0, width), dtype=np.int64), {}
    rows = np.vstack([nodes for _, nodes in blocks])
    _, first, number = np.unique(np.sort(rows, axis=1), axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    number = np.searchsorted(kept, first[number.ravel()])
    members: dict[str, list[IntArray]] = {}
    row = 0
    for groups, nodes in blocks:
        for group in groups:
            members.setdefault(names.get((dimension, group), str(group)), []).append(number[row : row + len(nodes)])
        row += len(nodes)
    return rows[kept], {name: np.unique(np.concatenate(parts)) for name, parts in members.items()}


# --- version 2.2 ----------------------------------------------------------------------------------------------------


def _read_22(stream: _Stream) -> tuple[IntArray, FloatArray, _Elements]:
    stream.enter("Nodes")
    count = stream.count()
    if stream.binary:
        table = stream.records(np.dtype([("tag", stream.int32), ("x", stream.float64, 3)]), count)
        tags, points = table["tag"].astype(np.int64), table["x"].astype(np.float64)
    else:
        rows = stream.take(stream.float64, 4 * count).reshape(-1, 4)
        tags, points = rows[:, 0].astype(np.int64), rows[:, 1:]
    stream.leave()

    stream.enter("Elements")
    collected: dict[tuple[int, int], list[IntArray]] = {}
    for kind, groups, nodes in _blocks_22(stream, stream.count()):
        for group in np.unique(groups):
            collected.setdefault((kind, int(group)), []).append(nodes[groups == group])
    stream.leave()
    elements: _Elements = {}
    for (kind, group), parts in collected.items():
        elements.setdefault(kind, []).append(((group,) if group else (), np.vstack(parts)))
    return tags, points, elements


def _blocks_22(stream: _Stream, count: int) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Type, first tags (the physical groups) and nodes of elements, many at a time."""
    if stream.binary:
        while count > 0:
            kind, number, tag_count = (int(v) for v in stream.take(stream.int32, 3))
            width = 1 + tag_count + stream.width(kind)
            if number < 1 or tag_count < 0:
                raise stream.damaged()
            rows = stream.take(stream.int32, number * width).reshape(number, width).astype(np.int64)
            groups = rows[:, 1] if tag_count else np.zeros(number, dtype=np.int64)
            yield kind, groups, rows[:, 1 + tag_count :]
            count -= number
        return
    words = stream.rest()
    values: Any = words.tolist()  # integers; numpy 2 would not rule out nested lists
    row = 0
    starts: dict[tuple[int, int], list[int]] = {}
    for _ in range(count):
        if row + 3 > len(values):
            raise stream.damaged()
        kind, tag_count = values[row + 1], values[row + 2]
        starts.setdefault((kind, tag_count), []).append(row)
        row += 3 + tag_count + stream.width(kind)
    if row != len(values) or any(tag_count < 0 for _, tag_count in starts):
        raise stream.damaged()
    for (kind, tag_count), places in starts.items():
        rows = words[np.array(places)[:, None] + np.arange(3 + tag_count + stream.width(kind))]
        groups = rows[:, 3] if tag_count else np.zeros(len(rows), dtype=np.int64)
        yield kind, groups, rows[:, 3 + tag_count :]


# --- version 4.1 ----------------------------------------------------------------------------------------------------


def _read_41(stream: _Stream) -> tuple[IntArray, FloatArray, _Elements]:
    if stream.has("PartitionedEntities"):
        raise ValueError(f"{stream.path}: is partitioned; save it in one piece, it is distributed over the ranks here")
    physical: dict[tuple[int, int], tuple[int, ...]] = {}
    if stream.has("Entities"):
        stream.enter("Entities")
        for dimension, entities in enumerate(stream.sizes(4)):
            for _ in range(entities):
                tag = int(stream.take(stream.int32, 1)[0])
                stream.take(stream.float64, 6 if dimension else 3)
                groups = stream.take(stream.int32, stream.sizes(1)[0])
                physical[dimension, tag] = tuple(abs(int(group)) for group in groups)
                if dimension:
                    stream.take(stream.int32, stream.sizes(1)[0])
        stream.leave()

    stream.enter("Nodes")
    tags: list[IntArray] = [np.empty(0, dtype=np.int64)]
    points: list[FloatArray] = [np.empty((0, 3))]
    blocks, _, _, _ = stream.sizes(4)
    for _ in range(blocks):
        dimension, _, parametric = (int(v) for v in stream.take(stream.int32, 3))
        count = stream.sizes(1)[0]
        tags.append(stream.take(stream.uint64, count).astype(np.int64))
        columns = 3 + (dimension if parametric else 0)
        points.append(stream.take(stream.float64, columns * count).reshape(count, columns)[:, :3])
    stream.leave()

    stream.enter("Elements")
    elements: _Elements = {}
    blocks, _, _, _ = stream.sizes(4)
    for _ in range(blocks):
        dimension, tag, kind = (int(v) for v in stream.take(stream.int32, 3))
        count, width = stream.sizes(1)[0], stream.width(kind)
        rows = stream.take(stream.uint64, count * (1 + width)).reshape(count, 1 + width).astype(np.int64)
        elements.setdefault(kind, []).append((physical.get((dimension, tag), ()), rows[:, 1:]))
    stream.leave()
    return np.concatenate(tags), np.concatenate(points).astype(np.float64), elements


class _Stream:
    """The numbers of a file, section by section, alike for ASCII and binary."""

    def __init__(self, path: str, data: bytes):
        self.path, self._data, self._section, self._at = path, data, "MeshFormat", 0
        header = re.match(rb"\s*\$MeshFormat\s+(\S+)\s+([01])\s+(\d+)\s*?\n", data)
        if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise ValueError(f"{path}: is text in UTF-16; save it as plain text (ASCII or UTF-8)")
        if header is None:
            raise ValueError(f"{path}: is not a MSH file of gmsh's: it does not begin with $MeshFormat")
        self.version, self.binary = header[1].decode("ascii", "replace"), header[2] == b"1"
        if self.version == "2":
            self.version = "2.2"
        order = "<"
        if self.binary:
            one = data[header.end() : header.end() + 4]
            order = "<" if one == b"\x01\0\0\0" else ">"
            if header[3] != b"8" or one not in (b"\x01\0\0\0", b"\0\0\0\x01"):
                raise self.damaged()
        self.int32, self.uint64, self.float64 = (np.dtype(order + code) for code in ("i4", "u8", "f8"))
        self._words: FloatArray = np.empty(0)

    def damaged(self) -> ValueError:
        return ValueError(f"{self.path}: is damaged or cut short, in section ${self._section}")

    def has(self, section: str) -> bool:
        return f"\n${section}".encode() in self._data

    def enter(self, section: str) -> None:
        self._section = section
        start = re.search(rb"\n\$" + section.encode() + rb"[ \t\r]*\n", self._data)
        if start is None:
            raise ValueError(f"{self.path}: has no section ${section}; is it whole?")
        self._at = start.end()
        if not self.binary:
            end = self._data.find(f"$End{section}".encode(), self._at)
            if end < 0:
                raise self.damaged()
            try:
                self._words = np.array(self._data[self._at : end].split(), dtype=np.float64)
            except ValueError:
                raise self.damaged() from None
            self._at = 0

    def leave(self) -> None:
        if self.binary:
            end = f"$End{self._section}".encode()
            if not self._data[self._at : self._at + len(end) + 2].lstrip().startswith(end):
                raise self.damaged()
        elif self._at != len(self._words):
            raise self.damaged()

    def take(self, kind: np.dtype[Any], count: int) -> npt.NDArray[Any]:
        """The next numbers; words of an ASCII file have no kind."""
        if self.binary:
            return self.records(kind, count)
        if count < 0 or self._at + count > len(self._words):
            raise self.damaged()
        self._at += count
        return self._words[self._at - count : self._at]

    def rest(self) -> IntArray:
        """All that is left of a section in ASCII."""
        return self.take(self.float64, len(self._words) - self._at).astype(np.int64)

    def records(self, kind: np.dtype[Any], count: int) -> npt.NDArray[Any]:
        end = self._at + count * kind.itemsize
        if count < 0 or end > len(self._data):
            raise self.damaged()
        values: npt.NDArray[Any] = np.frombuffer(self._data, kind, count, self._at)
        self._at = end
        return values

    def sizes(self, count: int) -> list[int]:
        return [int(value) for value in self.take(self.uint64, count)]

    def count(self) -> int:
        """The number in the first line of a section of 2.2, text in binary files too."""
        if not self.binary:
            return self.sizes(1)[0]
        line = re.compile(rb"\s*(\d+)[ \t\r]*\n").match(self._data, self._at)
        if line is None:
            raise self.damaged()
        self._at = line.end()
        return int(line[1])

    def width(self, kind: int) -> int:
        if kind not in NODES:
            raise ValueError(f"{self.path}: has an element of type {kind}, which is not known, or is damaged")
        return NODES[kind]

    def physical_names(self) -> dict[tuple[int, int], str]:
        """Names by dimension and number; text in binary files too."""
        section = re.search(rb"\n\$PhysicalNames\s*\n(.*?)\$EndPhysicalNames", self._data, re.DOTALL)
        entries = re.findall(rb'(\d+)\s+(\d+)\s+"(.*)"', section[1]) if section else []
        return {(int(dim), int(tag)): name.decode("utf-8", "replace") for dim, tag, name in entries}
