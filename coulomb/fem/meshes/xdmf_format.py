"""XDMF meshes with numbered groups of facets and cells, as DOLFINx, meshio and `coulomb convert` write them.

The arrays are in HDF5 files, of which every rank reads its share: no rank has the whole mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ...nearest import tree_of
from .exchange import Exchange, Slabs, even_starts, fetched, owner_of, starts_of
from .mesh_file import IntArray, MeshFile, refuse_cells
from .numbered_groups import only_set, titles
from .xdmf_data import XdmfArray, XdmfFile

_WIDTH = {
    **{"tetrahedron": 4, "hexahedron": 8, "tetrahedron_10": 10, "hexahedron_27": 27},
    **{"triangle": 3, "quadrilateral": 4, "triangle_6": 6, "quadrilateral_9": 9},
}
_CORNERS = {"tetrahedron": 4, "hexahedron": 8, "triangle": 3, "quadrilateral": 4}
_FACE_OF = {
    **{"tetrahedron": ("triangle",), "hexahedron": ("quadrilateral",)},
    **{"tetrahedron_10": ("triangle_6", "triangle"), "hexahedron_27": ("quadrilateral_9", "quadrilateral")},
}
_LONG = {"tet": "tetrahedron", "hex": "hexahedron", "tri": "triangle", "quad": "quadrilateral"}
_OTHER_CELLS = {"wedge": 6, "pyramid": 5, "mixed": 0}

_MOST_GROUPS = 1000
"""More different numbers on cells or facets are no groups, but numbers of the cells."""


@dataclass(frozen=True)
class _Grid:
    """This rank's cells or facets of a Grid, with its share of the points to which they refer."""

    file: XdmfFile
    kind: str
    rows: IntArray
    geometry: tuple[str, XdmfArray]
    points: FloatArray
    numbers: dict[str, XdmfArray]


def read(
    path: str,
    facets: str | None,
    cells: str | None,
    names: Mapping[str, int],
    cell_names: Mapping[str, int],
    comm: MPI.Comm,
) -> MeshFile:
    """Read a mesh, every rank a part; collective.

    Args:
        path: The mesh; the first Grid of tetrahedra or hexahedra.
        facets: File with numbers on facets; by default the same file, if it has such.
        cells: File with numbers on cells; by default the same file, if it has such.
        names: Names of groups of facets, with their numbers; other numbers have the names in the file, if it has any.
        cell_names: Names of groups of cells, likewise.
        comm: The ranks.

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
    return MeshFile(path, mesh.points, mesh.rows, cell_groups, face_groups)


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
    """The grid's rows by points of the mesh; if the two number the points differently, they are matched by place;
    collective."""
    comm = mesh.file.comm
    equal = grid.points.shape == mesh.points.shape and np.array_equal(grid.points, mesh.points)
    if grid.geometry == mesh.geometry or comm.allreduce(equal, op=MPI.LAND):
        return grid.rows
    ends = np.array([mesh.points.min(0, initial=np.inf), -mesh.points.max(0, initial=-np.inf)])
    near = 1e-9 * float(np.max(-np.min(comm.allgather(ends), axis=0).sum(axis=0)))
    slabs = Slabs(comm, mesh.points)
    point, slab = slabs.near(mesh.points, near)
    to = Exchange(comm, slab)
    x, number = to.send(mesh.points[point]), to.send(starts_of(comm, len(mesh.points))[comm.rank] + point)
    used, inverse = np.unique(grid.rows, return_inverse=True)
    wanted = fetched(comm, starts_of(comm, len(grid.points)), used, grid.points)
    ask = Exchange(comm, slabs.of(wanted))
    asked = ask.send(wanted)
    found: IntArray = np.full(len(asked), -1, dtype=np.int64)
    if len(x):
        distance, nearest = tree_of(x).query(asked)
        found = np.where(distance <= near, number[nearest], -1)
    found = ask.reply(found)
    if comm.allreduce(bool(np.any(found < 0)), op=MPI.LOR):
        raise ValueError(f"{grid.file.path}: has points that are none of the mesh {mesh.file.path}")
    rows: IntArray = found[inverse.ravel()].reshape(grid.rows.shape)
    return rows


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
    both = np.vstack([there, ask.send(theirs)])
    _, first, which = np.unique(both, axis=0, return_index=True, return_inverse=True)
    found = first[which.ravel()][len(there) :]
    known = found < len(there)
    cell = ask.reply(np.where(known, np.append(number, -1)[np.where(known, found, -1)], -1))
    if comm.allreduce(bool(np.any(cell < 0)), op=MPI.LOR):
        raise ValueError(f"{grid.file.path}: has cells that are none of the mesh {mesh.file.path}")
    return np.asarray(cell, dtype=np.int64)


def _grids(
    file: XdmfFile, kinds: tuple[str, ...], what: str, mesh: _Grid | None = None, optional: bool = False
) -> list[_Grid]:
    """The Grids of these kinds in a file; without points of their own, they refer to those of the mesh; collective."""
    path, comm = file.path, file.comm
    found: list[_Grid] = []
    seen: list[str] = []
    for grid in file.grids:
        kind, _, nodes = grid.kind.partition("_")
        kind = "_".join(filter(None, (_LONG.get(kind, kind), nodes)))
        seen.append(kind)
        if kind.partition("_")[0] in (*_CORNERS, *_OTHER_CELLS) and kind not in _WIDTH:
            refuse_cells(path, {f"cells of kind {kind}": int(nodes) if nodes.isdigit() else _OTHER_CELLS.get(kind, 0)})
        if kind not in kinds:
            continue
        geometry, points = _points(file, grid.geometry, mesh, found)
        rows = file.part(grid.topology, _WIDTH[kind]).astype(np.int64)
        count = comm.allreduce(len(points))
        unknown = bool(len(rows) and not (0 <= rows.min() and rows.max() < count))
        if comm.allreduce(unknown, op=MPI.LOR):
            raise ValueError(f"{path}: has a cell or facet with a point that the file does not define")
        found.append(_Grid(file, kind, rows, geometry, points, grid.numbers))
    if not found and not optional:
        raise ValueError(f"{path}: has no {what} ({', '.join(kinds)}); it has {', '.join(seen) or 'nothing'}")
    return found


def _points(
    file: XdmfFile, geometry: XdmfArray | None, mesh: _Grid | None, found: list[_Grid]
) -> tuple[tuple[str, XdmfArray], FloatArray]:
    """Which points a Grid has, and this rank's share of them; collective."""
    for other in (*found, *([mesh] if mesh is not None else [])):
        if geometry is None or other.geometry == (file.path, geometry):
            return other.geometry, other.points
    if geometry is None or len(geometry.shape) != 2 or geometry.shape[1] != 3:
        flat = 0 if geometry is None else geometry.shape[-1]
        raise ValueError(f"{file.path}: has points in {flat}D, but a body in 3D is needed")
    return (file.path, geometry), file.part(geometry).astype(np.float64)
