"""Boxes, meshes of files, and meshes of first and second order with the same corners: the second has nodes on edges, in
hexahedra also on faces and in cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, Int32Array, IntArray, in_words, is_number
from ...exchange import fetched, starts_of
from .. import compat, mesh_formats
from ..compat import mesh
from ..geometry import evaluate_vectors, same_on_all_ranks
from ..mesh_formats import BOX_FACES
from .among_ranks import global_numbers, on_first_rank
from .curving import arcs, curved_faces, put_on_surfaces
from .cuts import cut
from .inspection import FLAT, InspectedMesh, inspect
from .lagrange import (
    CORNERS,
    corner_geometry,
    corners_to_nodes,
    facet_columns,
    in_dolfinx_order,
    is_second_order,
    jacobians,
)
from .mesh_file import MeshFile, not_empty
from .mesh_parts import boundary_facets, corners_of, local_cells, local_facets, local_nodes, parts_of
from .named_mesh import Grid, NamedMesh, Planes, volume, without_nodes
from .xdmf_format import has_mixed_cells
from .xdmf_format import read as read_parts


def second_order(mesh: NamedMesh, curved: bool = False) -> NamedMesh:
    """The mesh with 10-node tetrahedra or 27-node hexahedra of the same corners; collective.

    The shape of the body does not change: the new nodes are at the middles of the straight edges, and those of
    hexahedra also where the trilinear map has the middles of faces and cells.

    Args:
        mesh: A first-order mesh with its named faces and groups of cells, which are kept.
        curved: Whether the boundary becomes the smooth surface for which its facets stand (`arcs`), or a known one
            (`NamedMesh.surfaces`), and the new nodes in the middles of faces and cells follow its edges (as Coons's).

    Raises:
        ValueError: If the mesh is of second order already, or curved cells become flat.
    """
    old, comm = mesh.domain, mesh.comm
    if mesh.degree != 1:
        raise ValueError("second_order: the mesh has second-order cells already; it takes a first-order mesh")
    own = old.topology.index_map(3).size_local
    V = compat.functionspace(old, 2)
    dofs, nodes = compat.cell_dofs(V), V.dofmap.index_map
    number = global_numbers(nodes)
    kind = old.topology.cell_type
    points = _points(old, dofs, nodes.size_local)
    if curved:
        points[dofs[dofs < nodes.size_local]] += off_chords(mesh)[dofs < nodes.size_local]
    domain = compat.create_mesh(comm, kind.name, number[dofs[:own]], points, degree=2)

    corners = corner_geometry(old)
    of_point = np.zeros(len(old.geometry.x), dtype=np.int64)
    of_point[corners] = number[dofs[:, : corners.shape[1]]]
    mesh_of_second_order = _of_order(second_order, mesh, domain, of_point, nodes.size_local)
    if curved:
        put_on_surfaces(mesh_of_second_order)
        cells = domain.geometry.x[compat.cell_geometry(domain)]
        straight = corners_to_nodes(kind) @ cells[:, : corners.shape[1]]  # tetrahedra of files may be mirror images
        refuse_flat_cells(cells, "second_order: the curved boundary", comm, straight)
    return mesh_of_second_order


def smooth_second_order(mesh: NamedMesh) -> NamedMesh:
    """`second_order` with a smooth boundary, or with the given one if cells would become flat."""
    try:
        return second_order(mesh, curved=True)
    except ValueError:
        return second_order(mesh)


def first_order(mesh: NamedMesh) -> NamedMesh:
    """The mesh with 4-node tetrahedra or 8-node hexahedra of the same corners, where curved edges and faces become
    straight; collective.

    Args:
        mesh: A second-order mesh with its named faces and groups of cells, which are kept.

    Raises:
        ValueError: If the mesh is of first order already.
    """
    old, comm = mesh.domain, mesh.comm
    if mesh.degree != 2:
        raise ValueError("first_order: the mesh has first-order cells already; it takes a second-order mesh")
    old.topology.create_connectivity(3, 0)
    vertices, corners = old.topology.index_map(0), corner_geometry(old)
    of_cell = old.topology.connectivity(3, 0).array.reshape(corners.shape)
    number = global_numbers(vertices)
    x = np.empty((len(number), 3))
    x[of_cell] = old.geometry.x[corners]
    own = old.topology.index_map(3).size_local
    cell = old.topology.cell_type.name
    domain = compat.create_mesh(comm, cell, number[of_cell[:own]], x[: vertices.size_local])

    of_point = np.zeros(len(old.geometry.x), dtype=np.int64)
    of_point[corners] = number[of_cell]
    curved = curved_faces(mesh, facet_columns(old.topology.cell_type, 1)[:, None])
    return replace(_of_order(first_order, mesh, domain, of_point, vertices.size_local), curved=curved)


def _of_order(
    order: Callable[[NamedMesh], NamedMesh], mesh: NamedMesh, domain: Any, of_point: IntArray, given: int
) -> NamedMesh:
    """The mesh with a domain of another order, made of this rank's own cells in their order with the numbers `of_point`
    of its corners, and of `given` points of this rank; collective."""
    old = mesh.domain
    rows = {name: np.sort(of_point[corners_of(old, facets)], axis=1) for name, facets in mesh.faces.items()}
    first = old.topology.index_map(3).local_range[0]
    cells = {name: first + np.asarray(mine, dtype=np.int64) for name, mine in mesh.cells.items()}
    starts = starts_of(mesh.comm, old.topology.index_map(3).size_local)
    coarser, numbers = mesh.coarser, None
    if mesh.node_numbers is not None:
        corners = np.unique(corner_geometry(old))
        at, numbers = of_point[corners] - starts_of(mesh.comm, given)[mesh.comm.rank], np.zeros(given, dtype=np.int64)
        mine = (at >= 0) & (at < given)
        numbers[at[mine]] = mesh.node_numbers[corners[mine]]
    return replace(
        mesh,
        domain=domain,
        faces=local_facets(domain, rows),
        cells=local_cells(domain, starts, cells),
        coarser=None if coarser is None else lambda: order(coarser()),
        grid=None,
        curved=None,
        **without_nodes(mesh),
        node_numbers=None if numbers is None else _at_points(domain, numbers),
    )


def _at_points(domain: Any, values: IntArray) -> IntArray:
    """Values (k,) at the points of which this rank gave k to make a mesh, at the points that it has of the mesh;
    collective."""
    given = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)  # without cells: empty, of any type
    return fetched(domain.comm, starts_of(domain.comm, len(values)), given, values)


def _points(domain: Any, dofs: Int32Array, owned: int) -> FloatArray:
    """Places of this rank's own nodes, shape (owned, 3), the corners exactly those of the mesh."""
    weights = corners_to_nodes(domain.topology.cell_type)
    in_cells = np.einsum("nc,kci->kni", weights, domain.geometry.x[corner_geometry(domain)])
    points = np.empty((owned, 3))
    mine = dofs < owned
    points[dofs[mine]] = in_cells[mine]
    return points


def off_chords(mesh: NamedMesh) -> FloatArray:
    """How far the nodes of curved second-order cells are off those of straight ones, shape (cells, nodes, 3)."""
    domain = mesh.domain
    kind, corners = domain.topology.cell_type, corner_geometry(domain)
    edges, off = arcs(mesh)
    number = global_numbers(domain.geometry.index_map())[corners]
    largest = int(edges.max(initial=0)) + 1
    key = edges[:, 0] * largest + edges[:, 1]
    between = [frozenset(np.flatnonzero(w > 1e-9)) for w in corners_to_nodes(kind)]
    heights = np.zeros((len(corners), len(between), 3))
    for column, ends in enumerate(between):
        if len(ends) == 2:
            pair = np.sort(number[:, list(ends)], axis=1)
            wanted = np.where(pair[:, 1] < largest, pair[:, 0] * largest + pair[:, 1], -1)
            place = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
            heights[:, column] = np.where((key[place] == wanted)[:, None], off[place], 0.0)
    for size, parts in ((4, {2: 0.5}), (8, {4: 0.5, 2: -0.25})):
        for column, ends in enumerate(between):
            if len(ends) == size:
                of = [(k, parts[len(part)]) for k, part in enumerate(between) if len(part) in parts and part < ends]
                heights[:, column] = sum(weight * heights[:, k] for k, weight in of)
    return heights


def off_surface(mesh: NamedMesh) -> FloatArray:
    """Volume between the boundary facets of this rank's own cells and the smooth surface for which they stand (`arcs`),
    m^3, shape (k,): of first-order cells, and of second-order ones with nodes in the middles of chords; collective."""
    domain, kind = mesh.domain, mesh.domain.topology.cell_type
    own, off = domain.topology.index_map(3).size_local, off_chords(mesh)
    corners = domain.geometry.x[corner_geometry(domain)[:own]]
    off = off[:own]
    if mesh.degree == 2:
        there = domain.geometry.x[compat.cell_geometry(domain)[:own]] - corners_to_nodes(kind) @ corners
        off[np.linalg.norm(there, axis=(1, 2)) > 0.5 * np.linalg.norm(off, axis=(1, 2))] = 0.0
    domain.topology.create_connectivity(3, 2)
    boundary = np.zeros(domain.topology.index_map(2).size_local + domain.topology.index_map(2).num_ghosts, dtype=bool)
    boundary[boundary_facets(domain)] = True
    columns = facet_columns(kind, 2)
    at = boundary[domain.topology.connectivity(3, 2).array.reshape(-1, len(columns))[:own]]
    mean = {6: [0.0, 0.0, 0.0, 1 / 3, 1 / 3, 1 / 3], 9: [0.0] * 4 + [1 / 9] * 4 + [4 / 9]}[columns.shape[1]]
    bulge = np.einsum("cfni,n->cfi", off[:, columns], mean)
    ring = corners[:, columns[:, : 3 if len(columns) == 4 else 4]]
    area = 0.5 * np.cross(ring[:, :, 2] - ring[:, :, 0], ring[:, :, -1] - ring[:, :, 1])
    return np.where(at, np.abs(np.einsum("cfi,cfi->cf", bulge, area)), 0.0).sum(axis=1)


def polygon(mesh: NamedMesh) -> float:
    """`off_surface` of all cells over the volume of the body; 0 of plane and of curved faces; collective."""
    parts = np.array([float(off_surface(mesh).sum()), volume(mesh)])
    between, whole = mesh.comm.allreduce(parts)
    return float(between / whole)


CELLS = {"hexahedron": mesh.CellType.hexahedron, "tetrahedron": mesh.CellType.tetrahedron}


def box(
    lengths: Sequence[float],
    cells: Sequence[int],
    cell: str = "hexahedron",
    comm: MPI.Comm = MPI.COMM_WORLD,
    place: Callable[[FloatArray], FloatArray] | None = None,
    degree: int = 1,
) -> NamedMesh:
    """Box (0, lengths) with the faces left, right (x), front, back (y), bottom, top (z).

    Args:
        lengths: Edges in metres, three of them.
        cells: Cells along each edge.
        cell: "hexahedron", or "tetrahedron" (each hexahedron cut into six).
        comm: The ranks that share the mesh.
        place: Maps the nodes x (3, k) of the regular box to their positions, shape (3, k): for graded or curved meshes.
        degree: 1, or 2 for 27-node hexahedra or 10-node tetrahedra, whose edges and faces `place` can curve.

    Raises:
        ValueError: If a length or a number of cells is not positive, the cell or degree unknown, or a position not
            finite, or if a cell becomes flat.

    Examples:
        >>> from coulomb import box
        >>> list(box((0.1, 0.1, 0.05), (4, 4, 2)).faces)
        ['left', 'right', 'front', 'back', 'bottom', 'top']
    """
    same_on_all_ranks({"box: lengths": lengths, "box: cells": cells, "box: cell": cell, "box: degree": degree}, comm)
    if len(lengths) != 3 or not all(is_number(length) and length > 0.0 for length in lengths):
        raise ValueError(f"box: lengths must be three positive numbers in metres, but are {list(lengths)}")
    if len(cells) != 3 or not all(is_number(n, 1.0) and int(n) == n for n in cells):
        raise ValueError(f"box: cells must be three whole numbers of at least 1, but are {list(cells)}")
    if cell not in CELLS:
        raise ValueError(f"box: cell must be one of {', '.join(CELLS)}, but is {cell!r}")
    if degree not in (1, 2):
        raise ValueError(f"box: degree must be 1 or 2, but is {degree!r}")
    ends = zip(lengths, cells, strict=True)
    planes = [np.linspace(0.0, float(length), int(n) + 1) for length, n in ends]
    return _box((planes[0], planes[1], planes[2]), cell, comm, place, degree)


def _box(
    planes: Planes, cell: str, comm: MPI.Comm, place: Callable[[FloatArray], FloatArray] | None, degree: int
) -> NamedMesh:
    """The box with these planes between its cells; arguments as of `box`."""
    cells, corner = [len(along) - 1 for along in planes], np.array([along[-1] for along in planes])
    domain = mesh.create_box(comm, [np.zeros(3), corner], cells, cell_type=CELLS[cell])
    near = 1e-6 * corner / np.asarray(cells)
    faces = {}
    for name, (axis, end) in BOX_FACES.items():
        faces[name] = mesh.locate_entities_boundary(
            domain, 2, lambda x, i=axis, e=end: np.abs(x[i] - e * corner[i]) < near[i]
        )
    made = NamedMesh(domain, faces) if degree == 1 else second_order(NamedMesh(domain, faces))
    x, own = made.domain.geometry.x, made.domain.topology.index_map(3).size_local
    on_planes = np.rint(x[corner_geometry(made.domain)[:own]] / corner * cells).astype(np.int64)
    slabs = on_planes.min(axis=1)
    even = [np.linspace(0.0, along[-1], len(along)) for along in planes]
    if not all(map(np.array_equal, planes, even)):
        x[:] = np.stack([np.interp(x[:, k], even[k], planes[k]) for k in range(3)], axis=1)
    if place is not None:
        x[:] = evaluate_vectors(place, x.copy(), "box: place", comm)
        refuse_flat_cells(x[compat.cell_geometry(made.domain)], "box: place", comm)

    def make(planes: Planes) -> NamedMesh:
        return _box(planes, cell, comm, place, degree)

    coarser = None if max(cells) == 1 else lambda: make(resampled(planes, fewer(cells)))
    return replace(made, coarser=coarser, grid=Grid(planes, slabs.T, on_planes - slabs[:, None], make))


def fewer(cells: Sequence[int]) -> list[int]:
    """About half as many cells along each edge, as nearly as possible in the same proportion: only among similar meshes
    are errors a power of one cell size (Roache 1994; with 10 x 10 x 5 cells 6 x 6 x 3, since 5 x 5 x 3 are not).

    Args:
        cells: Along each edge, some of them more than 1.
    """

    def unlike(counts: list[int]) -> tuple[float, float]:
        ratios = [math.log(n / m) for n, m in zip(cells, counts, strict=True) if n > 1]
        return round(max(ratios) - min(ratios), 9), abs(sum(ratios) / len(ratios) - math.log(2.0))

    return min(
        ([max(math.floor(n / ratio + 0.5), 1) for n in cells] for ratio in np.linspace(1.5, 2.5, 101)), key=unlike
    )


def resampled(planes: Planes, cells: Sequence[int]) -> Planes:
    """Planes for other numbers of cells, graded as the given ones."""
    where_cut = [np.linspace(0.0, len(along) - 1.0, n + 1) for along, n in zip(planes, cells, strict=True)]
    planes_at = [np.interp(where, np.arange(len(along)), along) for where, along in zip(where_cut, planes, strict=True)]
    return planes_at[0], planes_at[1], planes_at[2]


_UNEVEN: Final = 1e-3
"""Least part of a curved cell's largest Jacobian that its Jacobian must have at all nodes: with less, the stiffness is
not positive definite to rounding."""


def refuse_flat_cells(cells: FloatArray, what: str, comm: MPI.Comm, before: FloatArray | None = None) -> None:
    """Raises ValueError, after `what`, on every rank if one of the cells with nodes (c, nodes, 3) is flat at one of
    them, or is turned inside out from where its nodes were before, by default from most of the others; collective."""
    jacobian, size = jacobians(cells)
    if before is not None:
        jacobian *= np.sign(jacobians(before)[0])
    elif comm.allreduce(float(np.sum(np.sign(jacobian)))) < 0.0:  # mirrored
        jacobian *= -1.0
    second = is_second_order(cells.shape[1])
    wrong = np.min(jacobian, axis=0, initial=np.inf) <= FLAT * np.max(size, axis=0, initial=0.0) ** 3
    if second:  # a node near the quarter of an edge: the slope is almost zero there
        wrong |= np.min(jacobian, axis=0, initial=np.inf) < _UNEVEN * np.max(jacobian, axis=0, initial=0.0)
    places = comm.allgather(cells[np.argmax(wrong)].mean(axis=0) if np.any(wrong) else None)
    flat = [place for place in places if place is not None]
    if flat:
        place_in_words = in_words(flat[0])
        middles = "; the nodes between corners must stay near the middle" if second else ""
        raise ValueError(f"{what} makes the cell at x = {place_in_words} flat, or turns it inside out{middles}")


def read_xdmf(
    path: str | Path,
    facets: str | Path | None = None,
    cells: str | Path | None = None,
    names: Mapping[str, int] | None = None,
    cell_names: Mapping[str, int] | None = None,
    scale: float = 1.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> NamedMesh:
    """Mesh of an XDMF file, of hexahedra or tetrahedra of first or second order, with numbers on facets and cells.

    Args:
        path: The mesh; every rank reads a part, and none has the whole.
        facets: File of the MeshTags on facets; by default those in the mesh's file, if there are any.
        cells: File of the MeshTags on cells; by default those in the mesh's file, if there are any.
        names: Names of faces, with the number of their facets.  Other numbers have the name that `coulomb convert` has
            written into the file, or else the number itself, as in "3".
        cell_names: Names of cell groups, with the number of their cells, likewise.
        scale: Metres per unit of length of the file.
        comm: The ranks that share the mesh.

    Raises:
        ValueError: On every rank, if a file cannot be read, or its mesh cannot be used, with the reason.
    """
    check_scale(path, scale)
    on_facets, on_cells = (str(file) if file is not None else None for file in (facets, cells))
    file = read_parts(str(path), on_facets, on_cells, names or {}, cell_names or {}, comm)
    return _named(comm, path, inspect(file, scale, comm))


def read_mesh(
    path: str | Path,
    names: Mapping[str, int] | None = None,
    cell_names: Mapping[str, int] | None = None,
    scale: float = 1.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
    cuts: Sequence[str] = (),
    only: str | None = None,
) -> NamedMesh:
    """Mesh of a file, of hexahedra or tetrahedra; the format is determined by the file name extension.

    Cells are of first order, or 10-node tetrahedra or 27-node hexahedra, which may be curved; 27-node hexahedra not in
    `.inp`, where programs number their nodes differently.  In `.inp` files 20-node hexahedra get the nodes that they
    lack, and prisms and pyramids are split into tetrahedra.

    - `.msh` (gmsh, MSH 2.2 or 4.1, ASCII or binary): physical surfaces become faces, physical volumes groups of cells,
      by their names; one without a name by its number, as in "3".  Gmsh itself is not needed.
    - `.xdmf`, as `read_xdmf` with the numbers in the same file.
    - `.inp` (Abaqus, CalculiX): surfaces and sets of surface elements become faces, sets of solid elements groups.
    - `.med` (Salome): groups of faces and of volumes.
    - `.e`, `.exo`, `.exii`, `.g` (Exodus II): side sets and blocks of shells become faces, blocks of solids groups.
    - `.vtu`, `.vtk`, `.bdf`, `.nas` (Nastran), `.mesh` (Medit), by meshio: elements in 2D become faces, those in 3D
      groups, by the whole number on them, in Nastran that of the property.

    In `.inp`, `.med` and Exodus files a set of nodes is a face too, where no face has its name and the boundary facets
    with all corners in the set have all of its nodes as corners.

    Args:
        path: The file; rank 0 reads it, and needs the memory for all of it, but for XDMF, of which every rank reads a
            part.
        names: Names of faces with the number of their facets, in formats with numbers (XDMF and those by meshio);
            others are called by the number, as in "3".
        cell_names: Names of cell groups with the number of their cells, in the same formats.
        scale: Metres per unit of length of the file: 1e-3 for millimetres.
        comm: The ranks that share the mesh.
        cuts: Groups of facets inside the body along which it is cut: nodes are doubled, and each is two faces, one with
            its name and one with "_opposite" after it, for a `Pretension`, a `Tied` or a `Contact`.  Not for XDMF.
        only: The group of cells that is read, in `.inp` files the set of elements; by default all.  Not of XDMF and
            Exodus files.

    Raises:
        ValueError: On every rank, if the format is not known or the file cannot be read or used, with the reason.
    """
    given = {"path": str(path), "names": names, "cell_names": cell_names, "scale": scale, "cuts": cuts}
    same_on_all_ranks({f"read_mesh: {name}": value for name, value in given.items()}, comm)
    end = known_format(path, bool(names or cell_names))
    if end == ".xdmf" and cuts:
        raise ValueError(f"{path}: cuts are not for XDMF, of which every rank reads a part: export .vtu or .msh")
    mixed = end == ".xdmf" and bool(comm.bcast(on_first_rank(comm, str(path), lambda: has_mixed_cells(str(path)))))
    if end == ".xdmf" and not mixed and only is None:
        return read_xdmf(path, names=names, cell_names=cell_names, scale=scale, comm=comm)
    check_scale(path, scale)
    sound = on_first_rank(
        comm,
        str(path),
        lambda: inspect(cut(read_file(str(path), names or {}, cell_names or {}, only), cuts), scale, MPI.COMM_SELF),
    )
    return from_first_rank(comm, path, sound)


def from_first_rank(comm: MPI.Comm, path: str | Path, sound: InspectedMesh | None) -> NamedMesh:
    """Distribute a mesh that rank 0 has, None on the others; errors begin with `path`; collective."""
    shape = None
    if sound is not None:
        corners = {name: rows.shape[1] for name, rows in sound.face_groups.items()}
        named = [sound.refused, list(sound.cell_groups), list(sound.node_groups)]
        shape = (sound.cells.shape[1], corners, named, sound.numbers is not None)
    width, corners, (refused, groups, sets), numbered = comm.bcast(shape)
    if sound is None:
        none: IntArray = np.empty((0, width), dtype=np.int64)
        faces = {name: none[:, :count] for name, count in corners.items()}
        of_groups, of_sets = ({name: none[:, 0] for name in names} for names in (groups, sets))
        numbers = none[:, 0] if numbered else None
        sound = InspectedMesh(np.empty((0, 3)), none, of_groups, faces, refused, of_sets, numbers)
    return _named(comm, path, sound)


def known_format(path: str | Path, named: bool = False) -> str:
    """The end of the name of a mesh file; ValueError if the format is not known, or names are given and it has no
    numbered groups."""
    end = Path(path).suffix.lower()
    if end not in mesh_formats.FORMATS:
        raise ValueError(f"{path}: the name of a mesh file must end in one of {mesh_formats.listed()}")
    if named and end not in mesh_formats.NUMBERED:
        raise ValueError(f"{path}: names and cell_names are for formats with numbered groups, but {end} has names")
    return end


def read_file(path: str, names: Mapping[str, int], cell_names: Mapping[str, int], only: str | None = None) -> MeshFile:
    """What a mesh file holds, read on this rank alone; arguments and errors as of `read_mesh`, and OSError."""
    end = Path(path).suffix.lower()
    if only is not None and end not in mesh_formats.BY_GROUP:
        raise ValueError(f"{path}: one group of cells is read from {mesh_formats.listed(mesh_formats.BY_GROUP)}")
    mixed = end == ".xdmf" and has_mixed_cells(path)
    if end == ".xdmf" and not mixed:
        return read_parts(path, None, None, names, cell_names, MPI.COMM_SELF)
    module = import_module(
        f".{'meshio' if mixed else mesh_formats.FORMATS[end][1]}_format", __package__
    )  # a run needs at most one of them
    given = (names, cell_names) if end in mesh_formats.NUMBERED else ()
    if only is None:
        return module.read(path, *given)
    file = module.read(path, *given, only)
    groups = {name: not_empty(getattr(file, name)) for name in ("cell_groups", "face_groups", "node_groups")}
    return replace(file, **groups)


def _named(comm: MPI.Comm, path: str | Path, sound: InspectedMesh) -> NamedMesh:
    """Distribute a mesh of which each rank has some points, cells and members of groups; collective."""
    domain = distributed(comm, sound.points, sound.cells)
    components, touching = parts_of(domain, str(path))
    faces = local_facets(domain, sound.face_groups)
    cells = local_cells(domain, starts_of(comm, len(sound.cells)), sound.cell_groups)
    sets = local_nodes(domain, starts_of(comm, len(sound.points)), sound.node_groups)
    numbers = None if sound.numbers is None else _at_points(domain, sound.numbers)
    mesh = NamedMesh(domain, faces, cells, sound.refused, components, touching, node_sets=sets)
    return replace(mesh, node_numbers=numbers, file=str(path))


def check_scale(path: str | Path, scale: float) -> None:
    """Raises ValueError unless a scale is positive and finite."""
    if not (math.isfinite(scale) and scale > 0.0):
        raise ValueError(f"{path}: scale must be a positive number of metres per unit, but is {scale}")


def distributed(comm: MPI.Comm, points: FloatArray, cells: IntArray) -> Any:
    """The DOLFINx mesh of the cells and points given on this rank, as in `MeshFile`; collective."""
    width = cells.shape[1]
    kind, degree = "tetrahedron" if CORNERS[width] == 4 else "hexahedron", 2 if is_second_order(width) else 1
    return compat.create_mesh(comm, kind, in_dolfinx_order(cells), points, degree)
