"""Meshes of Abaqus and CalculiX input files (.inp): elements, element sets, node sets and surfaces.

Our own reader, not meshio's (tried: 5.3.5), which loses or misreads the data of faces: it ignores *SURFACE; an
element set given by the names of others, or on an *ELEMENT after one without a set, goes to the wrong elements, without
a warning; a second *NODE replaces the first; *NODE's NSET, types in lower case and surface elements (SFM3D4, M3D4) are
not read.  Nor meshlane's (tried: 5.5.0), which ignores *SURFACE too, and without a warning reads no elements from lines
that end in a comma, and those of one part of two alone.  Formats with plain numbers on cells are read by meshio
(`meshio_format`).
24 000 hexahedra take 0.38 s here and 0.60 s in meshio.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ...arrays import FloatArray, IntArray
from ...regular_file import read_bytes
from .lagrange import CORNERS
from .mesh_file import FACETS, MeshFile, solid_nodes
from .mesh_parts import distinct

_SIDES = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    8: ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
"""Corners of the sides S1, S2, ... of C3D4 and C3D10, and of C3D8."""

_SOLID = re.compile(r"(?:C3D|DC3D|AC3D|SC)(\d+)")
_SURFACE = re.compile(r"(?:SFM3D|M3D|R3D|CPS|CPE|CAX|DS|S|STRI)([346])(?!\d)")
"""Those of 4 nodes are on hexahedra, of 3 or 6 on tetrahedra; STRI65 has 6 nodes and 5 degrees of freedom at each."""

_GENERATES = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM"}
_INCLUDES: Final = 10  # nested *INCLUDE


@dataclass
class _Block:
    """A keyword line with its parameters, names in upper case, and the data lines below."""

    keyword: str
    parameters: dict[str, str]
    lines: list[str] = field(default_factory=list)
    file: str = ""


@dataclass
class _Set:
    """A set of nodes or elements: their numbers, and the names of the sets it contains."""

    name: str
    numbers: list[IntArray] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    hidden: bool = False


class _Sets:
    """Sets by name, whose case does not matter."""

    def __init__(self, path: str, kind: str):
        self._path, self._kind = path, kind
        self.all: dict[str, _Set] = {}

    def get(self, name: str, hidden: bool = False) -> _Set:
        return self.all.setdefault(name.upper(), _Set(name, hidden=hidden))

    def members(self, name: str, within: tuple[str, ...] = ()) -> IntArray:
        """The numbers of a set and of those it contains."""
        key = name.upper()
        if key not in self.all or key in within:
            fault = "contains itself" if key in within else "is not defined"
            raise ValueError(f"{self._path}: the {self._kind} set {name!r} {fault}")
        found = self.all[key]
        parts = [*found.numbers, *(self.members(other, (*within, key)) for other in found.names)]
        return np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int64)


def read(path: str) -> MeshFile:
    """Read a file on this rank.

    Sets of solid elements become groups of cells; sets of surface elements (S3, S4, CPS3, SFM3D4, ...) and surfaces
    groups of facets; node sets and surfaces of nodes groups of nodes.

    Raises:
        OSError: If it, or a file it includes, cannot be read.
        ValueError: If it is damaged, or contains something that this reader does not support and cannot skip.
    """
    return _Reader(path).mesh()


class _Reader:
    def __init__(self, path: str):
        self.path = path
        self.tags: list[IntArray] = []
        self.points: list[FloatArray] = []
        self.solids: dict[int, list[IntArray]] = {}
        self.surface_elements: dict[int, list[IntArray]] = {}
        self.element_sets, self.node_sets = _Sets(path, "element"), _Sets(path, "node")
        # by the name in upper case: name, and of every line an element or a set of elements and the side, if any
        self.surfaces: dict[str, tuple[str, list[tuple[str, str]]]] = {}
        self.parts: list[str] = []
        for block in _blocks(path, _lines(path)):
            self._take(block)

    def _take(self, block: _Block) -> None:
        keyword, parameters = block.keyword, block.parameters
        if keyword in _GENERATES:
            raise self._fault(
                block, "coulomb does not read it: write the mesh with its nodes and elements in global coordinates"
            )
        if keyword == "NODE":
            if parameters.get("SYSTEM", "R").upper() != "R":
                raise self._fault(block, "coordinates are not Cartesian")
            rows = self._nodes(block)
            self.tags.append(rows[:, 0].astype(np.int64))
            self.points.append(rows[:, 1:])
            self._add(self.node_sets, parameters.get("NSET"), self.tags[-1])
        elif keyword == "ELEMENT":
            self._elements(block)
        elif keyword in ("NSET", "ELSET"):
            name = self._named(block, keyword)
            sets = self.node_sets if keyword == "NSET" else self.element_sets
            self._fill(block, sets.get(name, "INTERNAL" in parameters))
        elif keyword == "SURFACE":
            self._surface(block)
        elif keyword == "PART":
            self.parts.append(parameters.get("NAME", "unnamed"))
        elif keyword == "INSTANCE" and any(value for line in block.lines for value in self._numbers(block, [line])):
            raise self._fault(block, "the instance is moved: export it where it is, without a translation or rotation")

    def _fault(self, block: _Block, text: str) -> ValueError:
        return ValueError(f"{block.file}: *{block.keyword}: {text}")

    def _named(self, block: _Block, parameter: str) -> str:
        if not block.parameters.get(parameter):
            raise self._fault(block, f"{parameter} is missing")
        return block.parameters[parameter]

    def _numbers(self, block: _Block, lines: Iterable[str]) -> FloatArray:
        words = ",".join(line.rstrip(", \t") for line in lines).upper().replace("D", "E").split(",")
        try:
            return np.array(words, dtype=np.float64) if words != [""] else np.empty(0)
        except ValueError as error:
            raise self._fault(block, f"damaged: {error}") from None

    def _whole(self, block: _Block, lines: Iterable[str]) -> IntArray:
        values = self._numbers(block, lines)
        numbers = values.astype(np.int64) if np.all(np.abs(values) < 2.0**53) else np.zeros(1, dtype=np.int64)
        if not np.array_equal(numbers, values):
            raise self._fault(block, "damaged: numbers of nodes and elements must be whole")
        return numbers

    def _nodes(self, block: _Block) -> FloatArray:
        widths = {line.rstrip(", \t").count(",") for line in block.lines}
        if widths == {3}:
            return self._numbers(block, block.lines).reshape(-1, 4)
        rows = [self._numbers(block, [line])[:4] for line in block.lines]  # coordinates that are left out are 0
        if not all(len(row) for row in rows):
            raise self._fault(block, "damaged: a line without a number")
        return np.array([np.pad(row, (0, 4 - len(row))) for row in rows]).reshape(-1, 4)

    def _elements(self, block: _Block) -> None:
        kind = self._named(block, "TYPE").upper()
        solid, flat = _SOLID.match(kind), _SURFACE.match(kind)
        if not solid and not flat:  # beams, springs, masses, second-order shells: not part of a body
            return
        width = int((solid or flat)[1])  # type: ignore[index]
        numbers = self._whole(block, block.lines)
        if len(numbers) % (1 + width):
            raise self._fault(block, f"damaged: elements of type {kind} must have a number and {width} nodes each")
        rows = numbers.reshape(-1, 1 + width)
        (self.solids if solid else self.surface_elements).setdefault(width, []).append(rows)
        self._add(self.element_sets, block.parameters.get("ELSET"), rows[:, 0])

    def _add(self, sets: _Sets, name: str | None, numbers: IntArray) -> None:
        if name:
            sets.get(name).numbers.append(numbers)

    def _fill(self, block: _Block, into: _Set) -> None:
        if "GENERATE" in block.parameters:
            for line in block.lines:
                given: list[int] = list(map(int, self._whole(block, [line])))
                if len(given) not in (2, 3) or given[-1] < 1:
                    raise self._fault(block, f"GENERATE needs first, last and step, but has {line.strip()!r}")
                step = given[2] if len(given) == 3 else 1
                into.numbers.append(np.arange(given[0], given[1] + 1, step, dtype=np.int64))
            return
        words = [word.strip() for line in block.lines for word in line.split(",") if word.strip()]
        numbered = [word for word in words if word.lstrip("+-").isdigit()]
        into.numbers.append(self._whole(block, numbered))
        into.names += [word.strip('"') for word in words if not word.lstrip("+-").isdigit()]

    def _surface(self, block: _Block) -> None:
        name, kind = self._named(block, "NAME"), block.parameters.get("TYPE", "ELEMENT").upper()
        rows = [(*(word.strip().strip('"') for word in line.split(",")), "")[:2] for line in block.lines]
        if kind == "NODE":
            for word, _ in rows:
                into = self.node_sets.get(name)
                if word.isdigit():
                    into.numbers.append(np.array([int(word)]))
                elif word.upper() != name.upper():
                    into.names.append(word)
        elif kind == "ELEMENT":
            self.surfaces[name.upper()] = name, [(word, side.upper()) for word, side in rows]

    # --- the mesh -----------------------------------------------------------------------------------------------------

    def mesh(self) -> MeshFile:
        path = self.path
        if len(self.parts) > 1:
            raise ValueError(f"{path}: has {len(self.parts)} parts ({', '.join(self.parts[:5])}); export one body")
        flat = sum(len(rows) for blocks in self.surface_elements.values() for rows in blocks)
        width = solid_nodes(path, {n: sum(map(len, blocks)) for n, blocks in self.solids.items()}, flat)
        solids = np.vstack(self.solids[width])
        if width == 27:
            raise ValueError(
                f"{path}: has 27-node hexahedra, whose nodes programs order differently in this format; export them to "
                ".msh (gmsh), .med, .e (Exodus II) or .vtu"
            )
        side = 3 if CORNERS[width] == 4 else 4
        fitting = [nodes for nodes in ((3, 6) if side == 3 else (4,)) if nodes in self.surface_elements]
        flat_rows = [rows[:, : 1 + side] for nodes in fitting for rows in self.surface_elements[nodes]]
        shells = np.vstack([np.empty((0, 1 + side), dtype=np.int64), *flat_rows])
        elements, shell_numbers = solids[:, 0], shells[:, 0]
        if len(np.unique(elements)) != len(elements):
            raise ValueError(f"{path}: has two elements of the same number")
        self._solids, self._shells = solids, shells
        self._tags = np.concatenate(self.tags) if self.tags else np.empty(0, dtype=np.int64)
        self._order = np.argsort(self._tags, kind="stable")
        if len(np.unique(self._tags)) != len(self._tags):
            raise ValueError(f"{path}: has two nodes of the same number")
        cells, facets = self._points_of(solids[:, 1:]), self._points_of(shells[:, 1:])

        cell_groups, face_groups = {}, {}
        for found in self.element_sets.all.values():
            numbers = self.element_sets.members(found.name)
            rows, on_surface = np.isin(elements, numbers), np.isin(shell_numbers, numbers)
            if not found.hidden and np.any(rows):
                cell_groups[found.name] = np.flatnonzero(rows)
            if not found.hidden and np.any(on_surface):
                face_groups[found.name] = facets[on_surface]
        for name, lines in self.surfaces.values():
            parts = [self._facets(name, *line) for line in lines]
            empty = np.empty((0, side), dtype=np.int64)
            face_groups[name] = self._points_of(np.vstack([empty, *parts]))
        node_groups = {
            found.name: self._points_of(self.node_sets.members(found.name))
            for found in self.node_sets.all.values()
            if not found.hidden
        }
        points = np.concatenate(self.points)
        return MeshFile(path, points, cells, cell_groups, face_groups, node_groups, self._tags)

    def _points_of(self, nodes: IntArray) -> IntArray:
        tags, order = self._tags, self._order
        place = np.minimum(np.searchsorted(tags, nodes, sorter=order), len(tags) - 1)
        if nodes.size and (len(tags) == 0 or np.any(tags[order[place]] != nodes)):
            raise ValueError(f"{self.path}: an element or a set has a node that the file does not define; is it whole?")
        return order[place] if nodes.size else nodes

    def _facets(self, surface: str, what: str, side: str) -> IntArray:
        """Nodes of the facets that a line of a surface names."""
        numbers = np.array([int(what)]) if what.isdigit() else self.element_sets.members(what)
        on_surface = self._shells[np.isin(self._shells[:, 0], numbers), 1:]
        cells = self._solids[np.isin(self._solids[:, 0], numbers), 1:]
        nodes, width = cells.shape[1], CORNERS[cells.shape[1]]
        if side in ("", "SPOS", "SNEG"):
            return on_surface if len(on_surface) else self._free(cells)
        if side not in [f"S{k + 1}" for k in range(len(_SIDES[width]))]:
            raise ValueError(f"{self.path}: *SURFACE {surface}: elements of {nodes} nodes have no side {side!r}")
        return cells[:, list(_SIDES[width][int(side[1:]) - 1])]

    def _free(self, cells: IntArray) -> IntArray:
        """Facets of these cells that no other cell of the mesh has."""
        table = np.array(FACETS[CORNERS[cells.shape[1]]])
        mine, everyone = (c[:, table].reshape(-1, table.shape[1]) for c in (cells, self._solids[:, 1:]))
        _, number = distinct(np.sort(np.vstack([mine, everyone]), axis=1))
        return mine[np.bincount(number[len(mine) :])[number[: len(mine)]] == 1]


def _lines(path: str, depth: int = 0) -> Iterator[tuple[str, str]]:
    """Every line that is no comment with the file it is in, those of included files too."""
    if depth > _INCLUDES:
        raise ValueError(f"{path}: *INCLUDE: more than {_INCLUDES} files inside each other")
    for line in read_bytes(path).decode("utf-8-sig", "replace").splitlines():
        if line.startswith("**") or not line.strip():
            continue
        if re.match(r"\*\s*INCLUDE\b", line, re.IGNORECASE):
            name = line.partition("=")[2].strip().strip('"')
            yield from _lines(str(Path(path).parent / name), depth + 1)
        else:
            yield path, line


def _blocks(path: str, lines: Iterable[tuple[str, str]]) -> Iterator[_Block]:
    block: _Block | None = None
    going_on = False
    for file, line in lines:
        if line.startswith("*") or going_on:  # a keyword line that ends in a comma is continued
            words = [word.strip() for word in line.lstrip("*").split(",")]
            if not going_on:
                if block is not None:
                    yield block
                block = _Block(" ".join(words.pop(0).upper().split()), {}, file=file)
            assert block is not None
            for word in filter(None, words):
                key, _, value = word.partition("=")
                block.parameters[key.strip().upper()] = value.strip().strip('"')
            going_on = line.rstrip().endswith(",")
        elif block is None:
            raise ValueError(f"{path}: is not an input file of Abaqus: it does not begin with a keyword like *NODE")
        else:
            block.lines.append(line)
    if block is None:
        raise ValueError(f"{path}: is empty")
    yield block
