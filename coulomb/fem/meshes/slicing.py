"""Slices of meshes in 2D, of files and of DOLFINx (`slices` has what they are)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from mpi4py import MPI

from .. import compat, mesh_formats
from ..compat import cpp
from ..geometry import same_on_all_ranks
from .among_ranks import global_numbers, on_first_rank
from .cuts import cut
from .inspection import InspectedMesh, inspect
from .mesh_file import SectionFile
from .meshes import check_scale, from_first_rank, known_format
from .named_mesh import NamedMesh
from .slices import Slice, slice_of, sliced
from .user_groups import cells_of, faces_of, is_mesh, is_mesh_data


def slice(
    section: Any,
    kind: str,
    thickness: float | None = None,
    degree: int | None = None,
    *,
    faces: Any = None,
    cells: Any = None,
    scale: float = 1.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
    cuts: Sequence[str] = (),
    only: str | None = None,
    names: Mapping[str, int] | None = None,
    cell_names: Mapping[str, int] | None = None,
) -> NamedMesh:
    """A plane or axisymmetric body from a mesh of its section in 2D, as one layer of hexahedra; collective.

    Args:
        section: A file with triangles or quadrilaterals in a plane z = const, of a format of `read_mesh` but Exodus (in
            `.inp` elements CPS, CPE, CAX).  Its groups of lines become faces, those of surfaces groups of cells.  Or a
            mesh of DOLFINx of triangles or quadrilaterals, or the MeshData of dolfinx.io.gmsh.
        kind: "plane strain"; "generalised plane strain", of which the front stays plane and moves along z as it will;
            "plane stress"; or "axisymmetric", with x as the radius and the axis along y.
        thickness: Of the body of a plane problem, metres; by default 1.  Forces are for it.  Those of an axisymmetric
            one are for 360 degrees.
        degree: Order of the cells; by default that of the section.
        faces: Of a mesh of DOLFINx: names with lines, as of `NamedMesh`, which here are facets of dimension 1.
        cells: Of a mesh of DOLFINx: MeshTags of its cells.
        scale: Metres per unit of length of the file.
        comm: The ranks that share the mesh of a file.
        cuts: Groups of lines inside the section along which it is cut, as of `read_mesh`.
        only: The group of cells that is read, in `.inp` files the set of elements; by default all.
        names: Names of groups of lines with their number, in formats with numbers (XDMF and those by meshio); others
            are called by the number, as in "3".
        cell_names: Names of groups of cells with their number, in the same formats.

    Returns:
        The mesh, with the faces "front" and "back" beside those of the lines, and of a body on its axis "axis".  They
        are held as the kind says, without supports of the user.

    Raises:
        ValueError: On every rank, if the file cannot be read or used, with the reason.
    """
    data = section if is_mesh_data(section) else None
    domain = section if data is None else data[0]
    file = None if is_mesh(domain) else str(section)
    what, comm = ("slice", domain.comm) if file is None else (file, comm)
    numbers = names or {}, cell_names or {}
    given = {"names": numbers, "section": file, "kind": kind, "thickness": thickness, "degree": degree, "scale": scale}
    same_on_all_ranks({f"slice: {name}": value for name, value in given.items()}, comm)
    made = slice_of(kind, thickness, what)
    if degree not in (None, 1, 2):
        raise ValueError(f"{what}: degree must be 1 or 2, but is {degree!r}")
    check_scale(what, scale)
    if file is None:
        named = (data if one is None else one for one in (faces, cells))
        gathered, refused = _of_dolfinx(domain, *named)
        read = partial(_layer, gathered, made, scale, degree, cuts)
        mesh = _distributed(comm, what, on_first_rank(comm, what, read))
        return replace(mesh, refused={**mesh.refused, **refused})
    if faces is not None or cells is not None:
        raise ValueError(f"{what}: faces and cells are for meshes of DOLFINx: a file has its groups")
    end = known_format(what, any(numbers))
    if end not in mesh_formats.SECTIONS:
        raise ValueError(
            f"{what}: a mesh of a section is read from {mesh_formats.listed(mesh_formats.SECTIONS)}, not from {end}"
        )

    def read_file() -> tuple[InspectedMesh, Slice]:
        module = import_module(f".{mesh_formats.FORMATS[end][1]}_format", __package__)  # a run needs one of them
        if end == ".inp":  # its elements of 4 nodes may be of either kind
            section = module.read_section(file, only)
        else:
            section = module.read_section(file, *(numbers if end in mesh_formats.NUMBERED else ())).of_group(only)
        return _layer(section, made, scale, degree, cuts)

    return _distributed(comm, what, on_first_rank(comm, what, read_file))


def _of_dolfinx(domain: Any, faces: Any, cells: Any) -> tuple[SectionFile | None, dict[str, str]]:
    """The whole mesh on rank 0, None on the others, and why groups of lines are no faces; ValueError on every rank if
    it is none of a section, or faces or groups of cells are none; collective."""
    comm, topology = domain.comm, domain.topology
    if topology.dim != 2 or topology.cell_type.name not in ("triangle", "quadrilateral"):
        raise ValueError(
            f"slice: the mesh of a section has triangles or quadrilaterals, but this one has cells of type "
            f"{topology.cell_type.name}"
        )
    if not 1 <= compat.geometry_degree(domain) <= 2:
        raise ValueError("slice: the mesh of a section is of first or second order")
    on_faces, refused = ({}, {}) if faces is None else faces_of(domain, faces, "slice")
    of_cells = cells_of(domain, cells, "slice")
    own, nodes = topology.index_map(2).size_local, domain.geometry.index_map()
    geometry = compat.cell_geometry(domain)
    width, corners = geometry.shape[1], 3 if topology.cell_type.name == "triangle" else 4
    topology.create_connectivity(1, 0)
    topology.create_connectivity(2, 0)
    vertices = topology.connectivity(2, 0).array
    of_vertex = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=np.int32)
    of_vertex[vertices] = geometry[:, :corners].ravel()
    ends = topology.connectivity(1, 0).array.reshape(-1, 2)
    order = np.argsort(cpp.io.perm_vtk(topology.cell_type, width))
    number = global_numbers(nodes)
    first = topology.index_map(2).local_range[0]
    mine = (
        domain.geometry.x[: nodes.size_local],
        number[geometry[:own][:, order]],
        {name: number[of_vertex[ends[facets]]] for name, facets in on_faces.items()},
        {name: first + rows.astype(np.int64) for name, rows in of_cells.items()},
    )
    every = comm.gather(mine)
    if every is None:
        return None, refused
    points, rows, lines, groups = zip(*every, strict=True)

    def joined(parts: Any) -> dict[str, Any]:
        return {name: np.concatenate([part[name] for part in parts if name in part]) for name in parts[0]}

    return SectionFile("slice", np.vstack(points), {width: np.vstack(rows)}, joined(groups), joined(lines)), refused


def _layer(
    file: SectionFile | None, made: Slice, scale: float, degree: int | None, cuts: Sequence[str]
) -> tuple[InspectedMesh, Slice]:
    assert file is not None  # on rank 0
    layer, of = sliced(file, made, scale, degree)
    return inspect(cut(layer, cuts), scale, MPI.COMM_SELF), of


def _distributed(comm: MPI.Comm, path: str, inspected: tuple[InspectedMesh, Slice] | None) -> NamedMesh:
    sound, of = inspected or (None, None)
    return replace(from_first_rank(comm, path, sound), slice=comm.bcast(of))
