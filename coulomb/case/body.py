"""The tables of a case file that describe the mesh and the loads of the body."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field, model_validator

from ..fem import mesh_formats
from .curves import AmplitudeTable, amplitude_of
from .place import NumberAt, VectorAt, coefficient, field
from .values import Cells, FileName, GroupNumber, Length, Name, Table, Vector

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..fem.bodies import Pressure, TotalForce, Traction
    from ..fem.meshes import NamedMesh


SMALL = 200_000
"""Number of cells up to which a waiting drawing process needs little memory in comparison."""


class MeshTable(Table):
    """A box, lengths in metres; or a mesh file (`mesh_formats`), and the metres per unit of length of the file.

    `degree` 2 gives second-order cells, of a first-order file too; by default they are as in the file, in a box 1.
    """

    box: tuple[Length, Length, Length] | None = None
    cells: tuple[Cells, Cells, Cells] | None = None
    cell: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    degree: Literal[1, 2] | None = None
    file: FileName | None = None
    scale: Length = 1.0
    facets: FileName | None = None
    cell_groups: FileName | None = None
    names: dict[Name, GroupNumber] = Field(default_factory=dict)
    cell_names: dict[Name, GroupNumber] = Field(default_factory=dict)

    _of: ClassVar[str] = "mesh."
    """Before the name of a key in messages."""

    @model_validator(mode="after")
    def _one_mesh(self) -> MeshTable:
        if (self.box is None) == (self.file is None):
            raise ValueError("give either box (with cells) or file, one of the two")
        kind = "box" if self.file is None else Path(self.file).suffix.lower()
        if kind != "box" and kind not in mesh_formats.FORMATS:
            raise ValueError(f"file must end in one of {mesh_formats.listed()}, but is {self.file!r}")
        fitting = {"degree", "box", "cells", "cell"} if kind == "box" else {"degree", "file", "scale"}
        if kind in mesh_formats.NUMBERED:
            fitting |= {"names", "cell_names"}
        if kind == ".xdmf":
            fitting |= {"facets", "cell_groups"}
        misplaced = (self.model_fields_set & MeshTable.model_fields.keys()) - fitting
        if misplaced:
            raise ValueError(f"{', '.join(sorted(misplaced))} does not go with a {kind} mesh")
        if self.box is not None and self.cells is None:
            raise ValueError("cells is missing: a box needs the numbers of cells along x, y, z")
        return self

    @property
    def small(self) -> bool:
        """Whether it has at most about SMALL cells, estimated without reading it."""
        if self.file is None:
            return self.cells is not None and math.prod(self.cells) <= SMALL
        try:
            return os.path.getsize(self.file) <= 100 * SMALL  # bytes per cell
        except OSError:
            return False

    def mesh(self, comm: MPI.Comm) -> NamedMesh:
        """What the table describes.

        Raises:
            ValueError: On every rank, if the file cannot be read or used.
        """
        from ..fem.meshes import box, raised, read_mesh, read_xdmf

        if self.file is None:
            assert self.box is not None and self.cells is not None
            return box(self.box, self.cells, self.cell, comm, degree=self.degree or 1)
        if self.facets is not None or self.cell_groups is not None:
            read = read_xdmf(self.file, self.facets, self.cell_groups, self.names, self.cell_names, self.scale, comm)
        else:
            read = read_mesh(self.file, self.names, self.cell_names, self.scale, comm)
        if self.degree == 1 and read.degree == 2:
            raise ValueError(
                f"{self._of}degree = 1, but {self.file} has second-order cells: leave degree out, or export "
                "first-order cells (in gmsh: Mesh.ElementOrder = 1)"
            )
        return raised(read) if self.degree == 2 and read.degree == 1 else read


class TractionTable(Table):
    """Surface load in pascals on a face."""

    face: Name
    value: VectorAt
    amplitude: AmplitudeTable | None = None

    def traction(self) -> Traction:
        """What the table describes."""
        from ..fem.bodies import Traction

        return Traction(self.face, field(self.value), amplitude_of(self.amplitude))


class PressureTable(Table):
    """Pressure in pascals normal to a face, positive where it presses on the body."""

    face: Name
    value: NumberAt
    amplitude: AmplitudeTable | None = None

    def pressure(self) -> Pressure:
        """What the table describes."""
        from ..fem.bodies import Pressure

        return Pressure(self.face, coefficient(self.value), amplitude_of(self.amplitude))


class TotalForceTable(Table):
    """Force in newtons, spread uniformly over the area of a face."""

    face: Name
    force: Vector
    amplitude: AmplitudeTable | None = None

    def total_force(self) -> TotalForce:
        """What the table describes."""
        from ..fem.bodies import TotalForce

        return TotalForce(self.face, self.force, amplitude_of(self.amplitude))
