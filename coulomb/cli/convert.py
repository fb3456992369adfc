"""`coulomb convert`: write a mesh of any format as XDMF, which several ranks read in parts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .console import FAILED, bad_input, console, errors, refuse_ranks


def convert(
    mesh: Annotated[Path, typer.Argument(help="Mesh file of any format that a case can name.", metavar="MESH")],
    file: Annotated[Path, typer.Argument(help="File to write; the arrays are written beside it.", metavar="FILE.xdmf")],
    force: Annotated[bool, typer.Option("--force", help="Replace the files if they exist.")] = False,
) -> None:
    """Write a mesh file as XDMF, with the names of its faces and groups of cells: ranks then read it in parts.

    Coordinates stay in the unit of the file.  The mesh is checked as before a run, on one rank, which needs the memory
    for all of it.
    """
    refuse_ranks("coulomb convert")
    with bad_input():
        if file.suffix != ".xdmf":
            raise ValueError(f"{file}: the name of the file to write must end in .xdmf")
        for target in (file, file.with_suffix(".h5")):
            if target.exists() and not force:
                raise ValueError(f"{target}: already exists; --force replaces it")
        if file.resolve() == mesh.resolve():
            raise ValueError(f"{file}: is the mesh file itself; give another name")
        if not file.absolute().parent.is_dir():
            raise ValueError(f"{file}: there is no folder {file.parent}; create it first")

    from mpi4py import MPI

    from ..fem.meshes import inspect, known_format, read_file, write

    with bad_input():
        known_format(mesh)
        try:
            found = inspect(read_file(str(mesh), {}, {}), 1.0, MPI.COMM_SELF)
        except OSError as error:
            raise ValueError(f"{error.filename or mesh}: cannot be read: {error.strerror or error}") from None
    for reason in found.refused.values():
        errors.print(f"warning: not converted: {reason}", markup=False, soft_wrap=True)
    try:
        write(found, file)
    except OSError as error:
        errors.print(f"error: {file}: cannot be written: {error.strerror or error}", markup=False)
        raise typer.Exit(FAILED) from None
    faces, groups = (", ".join(of) or "none" for of in (found.face_groups, found.cell_groups))
    console.print(
        f"{file} and {file.with_suffix('.h5').name} written: {len(found.cells)} cells; faces: {faces}; "
        f"groups of cells: {groups}",
        markup=False,
        soft_wrap=True,
    )
