"""Meshes of Salome's MED files (HDF5), with their groups of volumes, faces and nodes.

Our own reader, not meshio's (tried: 5.3.5), which fails where the elements of one kind belong to no group: MED then
leaves out their families, for instance those of all volumes of a body of one material.  24 000 hexahedra take 0.02 s
with either.
(https://docs.salome-platform.org, MED file format; https://github.com/nschloe/meshio/pull/350)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import h5py
import numpy as np

from ...arrays import FloatArray, IntArray
from ...regular_file import refuse_irregular
from .lagrange import in_vtk_order
from .mesh_file import MeshFile, SectionFile, among_all, members_of, solid_nodes
from .one_kind import READ, of_one_kind

_SOLIDS = {
    **{"TE4": 4, "HE8": 8, "PE6": 6, "PY5": 5, "T10": 10, "H20": 20, "H27": 27, "P13": 13, "P15": 15, "P18": 18},
    "POE": 99,  # polyhedra, of any number
}
_FACES = {3: ("TR3", "TR6", "TR7"), 4: ("QU4", "QU8", "QU9")}
"""The kinds of facets by their corners."""

_SECTIONS, _LINES = {"TR3": 3, "QU4": 4, "TR6": 6, "QU8": 8, "QU9": 9}, ("SE2", "SE3")
"""Cells of a section in 2D with their nodes, and its edges."""

_SURFACES = ("TR3", "QU4", "TR6", "TR7", "QU8", "QU9", "POG")

Found = TypeVar("Found", MeshFile, SectionFile)


def read(path: str, only: str | None = None) -> MeshFile:
    """Read a file on this rank, or the cells of one group alone.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no MED file, or has several meshes or steps, or no cells that can be used.
    """
    return _read(path, partial(_mesh, only))


def read_section(path: str) -> SectionFile:
    """Read the triangles and quadrilaterals of a file, with the groups of its lines, on this rank.

    Raises:
        OSError, ValueError: As `read`.
    """
    return _read(path, _section)


def _read(path: str, of: Callable[[str, Any, Any, Any], Found]) -> Found:
    refuse_irregular(path)
    if not h5py.is_hdf5(path):
        raise ValueError(f"{path}: is not a MED file: it is not HDF5, or cut short")
    try:
        with h5py.File(path, "r") as file:
            name = _only(path, file["ENS_MAA"], "meshes")
            mesh = file["ENS_MAA"][name]
            if "NOE" not in mesh:  # since MED 3 by time steps
                mesh = mesh[_only(path, mesh, "time steps of the mesh")]
            return of(path, mesh, file["FAS"][name] if name in file.get("FAS", {}) else {}, mesh.get("MAI", {}))
    except (KeyError, OSError) as error:
        raise ValueError(f"{path}: is not a MED file, or damaged: {error}") from None


def _section(path: str, mesh: Any, families: Any, elements: Any) -> SectionFile:
    if solid := [kind for kind in elements if kind in _SOLIDS]:
        raise ValueError(f"{path}: has elements in 3D ({', '.join(solid)}), but a slice is made of a mesh in 2D")
    of_elements, points, nodes = _of_all(mesh, families)
    cells, of_cells = _blocks(elements, {kind: n for kind, n in _SECTIONS.items() if kind in elements}, of_elements)
    of_lines = {name: np.concatenate(parts) for name, parts in _facets(elements, _LINES, 2, of_elements).items()}
    return SectionFile(path, points, cells, of_cells, of_lines, *nodes)


def _mesh(only: str | None, path: str, mesh: Any, families: Any, elements: Any) -> MeshFile:
    of_elements, points, nodes = _of_all(mesh, families)
    if points.shape[1] != 3:
        raise ValueError(f"{path}: has points in {points.shape[1]}D, but a body in 3D is needed")
    counts = {_SOLIDS[kind]: count for kind in elements if kind in _SOLIDS and (count := _count(elements[kind]))}
    if not counts or set(counts) - READ - {27}:
        solid_nodes(path, counts, sum(_count(elements[kind]) for kind in elements if kind in _SURFACES))
    blocks, groups = _blocks(elements, {kind: n for kind, n in _SOLIDS.items() if n in counts}, of_elements)
    if 27 in blocks:
        blocks[27] = in_vtk_order(blocks[27], "med")
    cells = of_one_kind(path, points, blocks, members_of(path, groups, only))
    of_faces: dict[str, list[IntArray]] = {}
    for corners in cells.shapes:
        for group, parts in _facets(elements, _FACES[corners], corners, of_elements).items():
            of_faces.setdefault(group, []).extend(parts)
    return cells.file(path, groups, of_faces, *nodes)


_Nodes = tuple[dict[str, IntArray], IntArray | None]


def _of_all(mesh: Any, families: Any) -> tuple[dict[int, list[str]], FloatArray, _Nodes]:
    """The groups of families of elements; points, their groups, and their numbers if there are any."""
    of_elements, of_nodes = (_groups(families[of]) if of in families else {} for of in ("ELEME", "NOEUD"))
    nodes, points = mesh["NOE"], _table(mesh["NOE"]["COO"]).astype(np.float64)
    numbers = np.asarray(nodes["NUM"], dtype=np.int64) if "NUM" in nodes else None
    return of_elements, points, (_members(nodes, len(points), of_nodes), numbers)


def _blocks(
    elements: Any, kinds: Mapping[str, int], groups: dict[int, list[str]]
) -> tuple[dict[int, IntArray], dict[str, IntArray]]:
    """Elements of these kinds by their number of nodes, and the members of groups among all."""
    blocks = {width: _table(elements[kind]["NOD"]) - 1 for kind, width in kinds.items()}
    sizes = {kind: len(blocks[width]) for kind, width in kinds.items()}
    return blocks, among_all((count, _members(elements[kind], count, groups)) for kind, count in sizes.items())


def _facets(
    elements: Any, kinds: Sequence[str], corners: int, groups: dict[int, list[str]]
) -> dict[str, list[IntArray]]:
    """Corners of the elements of these kinds in every group."""
    facets: dict[str, list[IntArray]] = {}
    for kind in (one for one in kinds if one in elements):
        rows = _table(elements[kind]["NOD"])[:, :corners] - 1
        for name, members in _members(elements[kind], len(rows), groups).items():
            facets.setdefault(name, []).append(rows[members])
    return facets


def _only(path: str, group: Any, what: str) -> str:
    names = list(group)
    if len(names) != 1:
        raise ValueError(f"{path}: has {len(names)} {what} ({', '.join(names[:5])}), but needs one; export one only")
    return str(names[0])


def _count(elements: Any) -> int:
    return int(elements["NOD"].attrs["NBR"]) if "NOD" in elements else 0


def _table(data: Any) -> Any:
    """Rows of an array that MED writes column by column."""
    values = np.asarray(data)
    return values.reshape((int(data.attrs["NBR"]), -1), order="F")


def _groups(families: Any) -> dict[int, list[str]]:
    """The names of the groups of every family, by its number: an element has one family, but may be in many groups."""
    groups = {}
    for family in families.values():
        names = family["GRO"]["NOM"][()] if "GRO" in family else []
        groups[int(family.attrs["NUM"])] = [
            np.asarray(name, dtype=np.int8).tobytes().split(b"\0")[0].decode("utf-8", "replace").strip()
            for name in names
        ]
    return groups


def _members(entities: Any, count: int, groups: dict[int, list[str]]) -> dict[str, IntArray]:
    """The entities of every group; none where no families are written."""
    if "FAM" not in entities:
        return {}
    of_entity = np.asarray(entities["FAM"])
    if len(of_entity) != count:
        raise KeyError(f"FAM has {len(of_entity)} entries for {count} elements")
    names = sorted({name for number in np.unique(of_entity) for name in groups.get(int(number), [])})
    return {
        name: np.flatnonzero(np.isin(of_entity, [number for number, titles in groups.items() if name in titles]))
        for name in names
    }
