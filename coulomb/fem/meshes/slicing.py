"""Slices of meshes in 2D, of files and of DOLFINx (`slices` has what they are)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from mpi4py import MPI

from .. import mesh_formats
from ..geometry import same_on_all_ranks
from .cuts import cut
from .exchange import on_first_rank
from .inspection import InspectedMesh, inspect
from .mesh_file import SectionFile
from .meshes import check_scale, from_first_rank, known_format
from .named_mesh import NamedMesh
from .slices import Slice, slice_of, sliced


def slice(
    section: str | Path,
    kind: str,
    thickness: float | None = None,
    degree: int | None = None,
    *,
    scale: float = 1.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
    cuts: Sequence[str] = (),
    only: str | None = None,
) -> NamedMesh:
    """A plane or axisymmetric body from a mesh of its section in 2D, as one layer of hexahedra; collective.

    Args:
        section: A file with triangles or quadrilaterals in a plane z = const: `.msh` (gmsh).  Its groups of lines
            become faces, those of surfaces groups of cells.
        kind: "plane strain"; "generalised plane strain", of which the front stays plane and moves along z as it will;
            "plane stress"; or "axisymmetric", with x as the radius and the axis along y.
        thickness: Of the body of a plane problem, metres; by default 1.  Forces are for it.  Those of an axisymmetric
            one are for 360 degrees.
        degree: Order of the cells; by default that of the section.
        scale: Metres per unit of length of the file.
        comm: The ranks that share the mesh.
        cuts: Groups of lines inside the section along which it is cut, as of `read_mesh`.
        only: Of an `.inp` file the set of elements that are read.

    Returns:
        The mesh, with the faces "front" and "back" beside those of the lines, and of a body on its axis "axis".  They
        are held as the kind says, without supports of the user.

    Raises:
        ValueError: On every rank, if the file cannot be read or used, with the reason.
    """
    given = {"section": str(section), "kind": kind, "thickness": thickness, "degree": degree, "scale": scale}
    same_on_all_ranks({f"slice: {name}": value for name, value in given.items()}, comm)
    made = slice_of(kind, thickness, str(section))
    if degree not in (None, 1, 2):
        raise ValueError(f"{section}: degree must be 1 or 2, but is {degree!r}")
    check_scale(section, scale)
    end = known_format(section)
    if end not in mesh_formats.SECTIONS:
        raise ValueError(
            f"{section}: a mesh of a section is read from {mesh_formats.listed(mesh_formats.SECTIONS)}, not from {end}"
        )

    def read() -> tuple[InspectedMesh, Slice]:
        module = import_module(
            f".{mesh_formats.FORMATS[end][1]}_format", __package__
        )  # a run needs at most one of them
        file = module.read_section(str(section), only) if end == ".inp" else module.read_section(str(section))
        return _layer(file, made, scale, degree, cuts)

    return _distributed(comm, str(section), on_first_rank(comm, str(section), read))


def _layer(
    file: SectionFile, made: Slice, scale: float, degree: int | None, cuts: Sequence[str]
) -> tuple[InspectedMesh, Slice]:
    layer, of = sliced(file, made, scale, degree)
    return inspect(cut(layer, cuts), scale, MPI.COMM_SELF), of


def _distributed(comm: MPI.Comm, path: str, found: tuple[InspectedMesh, Slice] | None) -> NamedMesh:
    sound, of = found or (None, None)
    return replace(from_first_rank(comm, path, sound), slice=comm.bcast(of))
