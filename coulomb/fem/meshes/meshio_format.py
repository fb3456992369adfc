"""Meshes in formats that meshio reads: VTU and VTK, Nastran, Medit.  Whole numbers on their cells become groups.

These formats have numbers on cells only, which meshio (tried: 5.3.5) returns unchanged.  Files that it misreads are
refused here:  Nastran's elements in large fields, which it skips, and points in local coordinates.

Not by meshio, since it loses faces there: `abaqus_format`, `med_format`, `exodus_format`, `gmsh_format`.  Nor XDMF: it
cannot read files with several Grids, which DOLFINx writes.  Time is no reason: MSH 2.2 takes as long as ours, MSH 4.1
(binary, 12288 cells) takes 1 ms, ours 9 ms.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import IntArray
from ...regular_file import read_bytes
from .mesh_file import MeshFile, SectionFile, members_by_name, members_of, only_set, solid_nodes
from .one_kind import of_one_kind

_MODULES = {".vtu": "vtu", ".vtk": "vtk", ".xdmf": "xdmf", ".bdf": "nastran", ".nas": "nastran", ".mesh": "medit"}
"""meshio's name of the format, by the end of the file's name."""

_SOLIDS = {
    **{"tetra": 4, "tetra10": 10, "VTK_LAGRANGE_TETRAHEDRON": 10, "wedge": 6, "wedge15": 15, "pyramid": 5},
    **{"pyramid13": 13, "hexahedron": 8, "hexahedron20": 20, "hexahedron27": 27, "VTK_LAGRANGE_HEXAHEDRON": 27},
}
"""meshio's types of cells, with their numbers of nodes."""

_FACES = {
    3: {"triangle": 3, "triangle6": 6, "VTK_LAGRANGE_TRIANGLE": 6},
    4: {"quad": 4, "quad8": 8, "quad9": 9, "VTK_LAGRANGE_QUADRILATERAL": 9},
}
"""Its types of facets by the number of their corners, with their numbers of nodes."""

_SECTIONS = _FACES[3] | _FACES[4]
_LINES = {"line": 2, "line3": 3, "VTK_LAGRANGE_CURVE": 3}
"""Cells of a section in 2D with their nodes, and its edges."""

_OWN_NUMBERS = re.compile(
    r"(?i)(vtk|global|pedigree|original).*|.*\bghost.*"
)  # written by programs, not chosen by users
_GRID = re.compile(rb"^GRID(?:\*?\s*,\s*(\d+)|\*[ ]{3}([ \d]{16})|[ ]{4}([ \d]{8}))", re.MULTILINE)
_LARGE = re.compile(rb"^(?:CTETRA|CHEXA|CPENTA|CPYRAM?|CTRIA3|CQUAD4)\*", re.MULTILINE)


def read(path: str, names: Mapping[str, int], cell_names: Mapping[str, int], only: str | None = None) -> MeshFile:
    """Read a file on this rank, or the cells of one group alone; its extension determines the format; names as of
    `read_mesh`.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is damaged, or has no cells or not the numbers that are asked for; or if meshio is missing.
    """
    data = read_bytes(path)
    mesh = by_meshio(path, data, _MODULES[Path(path).suffix.lower()])
    solids: dict[int, int] = {}
    flat = 0
    for block in mesh.cells:
        if block.type.startswith(("tetra", "hexa", "wedge", "pyramid", "polyhedron", "VTK_LAGRANGE")):
            solids[block.data.shape[1]] = solids.get(block.data.shape[1], 0) + len(block.data)
        elif block.type.startswith(("tri", "quad", "polygon")):
            flat += len(block.data)
    read = set(solids) <= set(_SOLIDS.values()) and bool(solids)
    widths = sorted(solids) if read else [solid_nodes(path, solids, flat)]
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: has points in {points.shape[-1]}D, but a body in 3D is needed")
    given = [_blocks(mesh, {kind: n for kind, n in _SOLIDS.items() if n == width}, width) for width in widths]
    shared = set.intersection(*(set(sets) for _, sets in given))
    cell_numbers = {name: np.concatenate([sets[name] for _, sets in given]) for name in given[0][1] if name in shared}
    groups = _groups(path, cell_numbers, cell_names, "cell_names")
    blocks = {width: rows for width, (rows, _) in zip(widths, given, strict=True)}
    kinds = of_one_kind(path, points, blocks, members_of(path, groups, only))
    of_faces: dict[str, list[IntArray]] = {}
    for shape in kinds.shapes:
        facets, sets = _blocks(mesh, _FACES[shape], shape)
        here = np.concatenate([np.empty(0, dtype=np.int64), *sets.values()])
        mine = {name: number for name, number in names.items() if number in here} if kinds.split else names
        for name, rows in _groups(path, sets, mine, "names").items():
            of_faces.setdefault(name, []).append(facets[rows])
    if lost := names.keys() - of_faces.keys():
        raise ValueError(f"{path}: names has {min(lost)!r} = {names[min(lost)]}, but no facet has this number")
    numbers = _grid_numbers(data, len(points)) if Path(path).suffix.lower() in (".bdf", ".nas") else None
    return kinds.file(path, groups, of_faces, {}, numbers)


def read_section(path: str, names: Mapping[str, int], cell_names: Mapping[str, int]) -> SectionFile:
    """Read the triangles and quadrilaterals of a file, with the numbers on its lines, on this rank.

    Raises:
        OSError, ValueError: As `read`; if it has cells in 3D.
    """
    mesh = by_meshio(path, read_bytes(path), _MODULES[Path(path).suffix.lower()])
    if solid := sorted({block.type for block in mesh.cells} & set(_SOLIDS)):
        raise ValueError(f"{path}: has cells in 3D ({', '.join(solid)}), but a slice is made of a mesh in 2D")
    given = {
        width: _blocks(mesh, {kind: n for kind, n in _SECTIONS.items() if n == width}, width)
        for width in sorted({_SECTIONS[block.type] for block in mesh.cells if block.type in _SECTIONS})
    }
    shared = set.intersection(*(set(sets) for _, sets in given.values())) if given else set()
    on_cells = {name: np.concatenate([sets[name] for _, sets in given.values()]) for name in sorted(shared)}
    lines, on_lines = _blocks(mesh, _LINES, 2)
    return SectionFile(
        path,
        np.asarray(mesh.points, dtype=np.float64),
        {width: rows for width, (rows, _) in given.items()},
        _groups(path, on_cells, cell_names, "cell_names"),
        {name: lines[rows] for name, rows in _groups(path, on_lines, names, "names").items()},
    )


def by_meshio(path: str, data: bytes, form: str) -> Any:
    try:
        import meshio  # when a file needs it: it takes 0.1 s to load, and may be missing
    except ImportError:
        raise ValueError(
            f"{path}: this format is read by meshio, which is not installed: ./install.sh, or pip install meshio"
        ) from None
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):  # meshio prints its warnings
            if form == "nastran":
                mesh = meshio.read(io.StringIO(_nastran(path, data)), form)
            else:
                mesh = getattr(meshio, form).read(path)
    except _Refused:
        raise
    except Exception as error:  # a damaged file may cause any exception in meshio
        fault = " ".join(str(error).split()) or "it is damaged, or of a kind that meshio does not know"
        raise ValueError(f"{path}: cannot be read as {form} (by meshio {meshio.__version__}): {fault}") from None
    if form == "nastran" and np.any(mesh.point_data.get("nastran:ref", 0)):
        raise ValueError(f"{path}: has GRID points in a local coordinate system; export them in the basic one")
    return mesh


class _Refused(ValueError):
    """What meshio would misread."""


def _nastran(path: str, data: bytes) -> str:
    """The file as meshio reads it: with BEGIN BULK, which gmsh leaves out, and nothing that it would skip."""
    if _LARGE.search(data):
        raise _Refused(f"{path}: has elements in large fields (CHEXA*, CTETRA*); export small fields or free format")
    if re.search(rb"^INCLUDE\b", data, re.MULTILINE | re.IGNORECASE):
        raise _Refused(f"{path}: refers to other files by INCLUDE; export one file")
    if b"\nBEGIN BULK" not in b"\n" + data:
        data = b"BEGIN BULK\n" + data
    return data.decode("utf-8-sig", "replace")


def _grid_numbers(data: bytes, count: int) -> IntArray | None:
    """The numbers of GRID points in Nastran's file, in its order, in which meshio has the points without them; None if
    they are not as many."""
    fields = _GRID.findall(data)
    numbers = np.array([int(free or large or small) for free, large, small in fields], dtype=np.int64)
    return numbers if len(numbers) == count else None


def _blocks(mesh: Any, kinds: Mapping[str, int], width: int) -> tuple[IntArray, dict[str, IntArray]]:
    """The first `width` nodes of all cells of these kinds, and the whole numbers on them by the name of the set."""
    mine = [
        number
        for number, block in enumerate(mesh.cells)
        if block.type in kinds and block.data.shape[1] == kinds[block.type]
    ]
    rows = np.vstack([np.empty((0, width), dtype=np.int64), *(mesh.cells[number].data[:, :width] for number in mine)])
    sets = {}
    for name, values in mesh.cell_data.items():
        found = [np.asarray(values[number]) for number in mine]
        if found and not _OWN_NUMBERS.fullmatch(name) and all(v.size == len(v) and v.dtype.kind in "iu" for v in found):
            sets[name] = np.concatenate(found).ravel().astype(np.int64)
    return rows.astype(np.int64), sets


def _groups(path: str, sets: dict[str, IntArray], names: Mapping[str, int], key: str) -> dict[str, IntArray]:
    if not sets:
        if names:
            raise ValueError(f"{path}: has no whole numbers on its facets or cells, to go by {key}")
        return {}
    return members_by_name(path, sets[only_set(path, list(sets))], names, key)
