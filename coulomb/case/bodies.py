"""The tables of a case file about meshes, and about several bodies: each has its mesh, its material and its place."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

from pydantic import AfterValidator, Discriminator, Field, PrivateAttr, Tag, model_validator

import coulomb

from ..fem import mesh_formats
from .curves import in_radians
from .material import MaterialTable, MaterialTables, materials_of, refuse_groups
from .synonyms import face_meant
from .values import TABLES, Cells, Direction, FileName, GroupNumber, Length, Name, Number, Table, Vector

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..fem.bodies import AnyMaterial


CellsValue = Annotated[
    Annotated[tuple[Cells, Cells, Cells], Tag("three numbers")] | Annotated[Name, Tag("a name")],
    Discriminator(lambda given: "a name" if isinstance(given, str) and given[:1] != "[" else "three numbers"),
]

SMALL: Final = 200_000
"""Number of cells up to which a waiting drawing process needs little memory in comparison."""


class MeshTable(Table):
    """A box, lengths in metres; or a mesh file (`mesh_formats`), and the metres per unit of length of the file.

    `degree` 2 gives second-order cells, of a first-order file too; by default they are as in the file, in a box 1, but
    tetrahedra of a nearly incompressible material are of second order.
    `cut` names groups of facets inside the body along which it is cut; `cells` of a file the group of cells that is
    read.  `slice` makes one layer of the section that a mesh in 2D is, of a plane problem with a `thickness`.
    """

    box: tuple[Length, Length, Length] | None = None
    cells: CellsValue | None = None
    cell: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    degree: Literal[1, 2] | None = None
    file: FileName | None = None
    scale: Length = 1.0
    facets: FileName | None = None
    cell_groups: FileName | None = None
    names: dict[Name, GroupNumber] = Field(default_factory=dict)
    cell_names: dict[Name, GroupNumber] = Field(default_factory=dict)
    cut: Annotated[tuple[Name, ...], Field(max_length=TABLES)] = ()
    slice: Literal["plane strain", "generalised plane strain", "plane stress", "axisymmetric"] | None = None
    thickness: Length | None = None

    _raised: str = PrivateAttr("")
    _of: ClassVar[str] = "mesh."
    """Before the name of a key in messages."""

    @property
    def _of_body(self) -> str:
        return ""

    @model_validator(mode="after")
    def _one_mesh(self) -> MeshTable:
        if (self.box is None) == (self.file is None):
            raise ValueError("give either box (with cells) or file, one of the two")
        kind = "box" if self.file is None else Path(self.file).suffix.lower()
        if kind != "box" and kind not in mesh_formats.FORMATS:
            raise ValueError(f"file must end in one of {mesh_formats.listed()}, but is {self.file!r}")
        fitting = {"degree", "box", "cells", "cell"} if kind == "box" else {"degree", "file", "scale", "cut"}
        if isinstance(self.cells, str):
            fitting |= {"cells"}
        if kind in mesh_formats.SECTIONS:
            fitting |= {"slice"} | ({"thickness"} if self.slice not in (None, "axisymmetric") else set())
        if kind in mesh_formats.NUMBERED:
            fitting |= {"names", "cell_names"}
        if kind == ".xdmf":
            fitting = fitting - {"cut"} | {"facets", "cell_groups"} if self.slice is None else fitting
        misplaced = (self.model_fields_set & MeshTable.model_fields.keys()) - fitting
        if misplaced:
            of = f"{self.slice} slice" if misplaced == {"thickness"} and self.slice else f"{kind} mesh"
            raise ValueError(f"{', '.join(sorted(misplaced))} does not go with a {of}")
        grouped = mesh_formats.BY_GROUP if self.slice is None else mesh_formats.SECTIONS
        if isinstance(self.cells, str) and kind not in grouped:
            raise ValueError(
                f"cells is the name of a group of cells, which goes with a file of {mesh_formats.listed(grouped)}"
            )
        if self.box is not None and self.cells is None:
            raise ValueError("cells is missing: a box needs the numbers of cells along x, y, z")
        return self

    @property
    def small(self) -> bool:
        """Whether it has at most about SMALL cells, estimated without reading it."""
        if self.file is None:
            return isinstance(self.cells, tuple) and math.prod(self.cells) <= SMALL
        try:
            return os.path.getsize(self.file) <= 100 * SMALL  # bytes per cell
        except OSError:
            return False

    @property
    def raised(self) -> str:
        """Why the last mesh made has tetrahedra of second order in place of first order; empty if it has not."""
        return self._raised

    def order_of_box(self, poisson: float) -> Literal[1, 2]:
        """Order of the cells of a box of a material with this Poisson's ratio."""
        from ..fem.bodies import LOCKING_ABOVE

        return self.degree or (2 if poisson > LOCKING_ABOVE and self.cell == "tetrahedron" else 1)

    def mesh(self, comm: MPI.Comm, poisson: float = 0.0) -> coulomb.NamedMesh:
        """What the table describes, for a material with this Poisson's ratio: tetrahedra of first order that would lock
        are made second order, unless `degree` says otherwise; ValueError on every rank, if the file cannot be read or
        used."""
        from ..fem.bodies import LOCKING_ABOVE
        from ..fem.meshes import read_xdmf

        table = "[[body]]" if isinstance(self, BodyTable) else "[mesh]"
        words = (
            f"tetrahedra{self._of_body} are made second order: at Poisson's ratio {poisson:.7g} those of first order "
            f"lock (degree = 1 in {table} keeps them)"
        )
        if self.file is None:
            assert self.box is not None and isinstance(self.cells, tuple)
            degree = self.order_of_box(poisson)
            self._raised = words if degree == 2 and self.degree is None else ""
            return coulomb.box(self.box, self.cells, self.cell, comm, degree=degree)
        chosen = self.cells if isinstance(self.cells, str) else None
        if self.slice is not None:
            how: dict[str, Any] = {"cuts": self.cut, "only": chosen, "names": self.names, "cell_names": self.cell_names}
            return coulomb.slice(self.file, self.slice, self.thickness, self.degree, scale=self.scale, comm=comm, **how)
        if self.facets is not None or self.cell_groups is not None:
            read = read_xdmf(self.file, self.facets, self.cell_groups, self.names, self.cell_names, self.scale, comm)
        else:
            read = coulomb.read_mesh(self.file, self.names, self.cell_names, self.scale, comm, self.cut, chosen)
        if self.degree == 1 and read.degree == 2:
            raise ValueError(
                f"{self._of}degree = 1, but {self.file} has second-order cells: leave degree out, or export "
                "first-order cells (in gmsh: Mesh.ElementOrder = 1)"
            )
        lock = self.degree is None and read.degree == 1 and read.tetrahedra and poisson > LOCKING_ABOVE
        self._raised = words if lock else ""
        return coulomb.second_order(read) if lock or (self.degree == 2 and read.degree == 1) else read


def _identifier(name: str) -> str:
    if not name.isidentifier():
        raise ValueError("should be an identifier: letters, digits and _, no digit first")
    return name


BodyName = Annotated[Name, AfterValidator(_identifier)]
"""Name of a body, before the ":" of "lower:top"."""


class RotateTable(Table):
    """A rotation: a point of the axis in metres, by default the origin, its direction, and the angle in radians, or
    degrees."""

    axis: Direction
    angle: Number
    point: Vector = (0.0, 0.0, 0.0)

    _in_radians = model_validator(mode="before")(in_radians)

    def rotation(self) -> coulomb.Rotation:
        return coulomb.Rotation(self.point, self.axis, self.angle)


class BodyTable(MeshTable):
    """One of several bodies: the keys of a mesh, its material, where it is (rotated, then translated), and its gravity,
    in place of that of the case."""

    name: BodyName
    material: MaterialTables
    translate: Vector = (0.0, 0.0, 0.0)
    rotate: RotateTable | None = None
    gravity: Vector | None = None

    _of: ClassVar[str] = ""

    @property
    def _of_body(self) -> str:
        return f" of body {self.name!r}"

    @model_validator(mode="after")
    def _groups_of_the_mesh(self) -> BodyTable:
        refuse_groups(self.material, self.box is not None, "[body.material]")
        return self

    def mesh(self, comm: MPI.Comm, poisson: float = 0.0) -> coulomb.NamedMesh:
        """The mesh of the body at its place."""
        try:
            mesh = super().mesh(comm, poisson)
        except ValueError as error:
            raise ValueError(f"body {self.name!r}: {error}") from None
        if self.rotate is None and not any(self.translate):
            return mesh
        return coulomb.moved(mesh, self.translate, None if self.rotate is None else self.rotate.rotation())

    def materials(self) -> dict[str, AnyMaterial]:
        """Its materials, by the names of the body or of its groups of cells, as in "lower:steel"."""
        if isinstance(self.material, MaterialTable):
            return {self.name: self.material.material()}
        return {f"{self.name}:{group}": given for group, given in materials_of(self.material).items()}


def fault_of_face(face: str, bodies: Sequence[BodyTable], box: bool) -> str:
    """What is wrong with the name of a face as far as it can be known before files are read; "" if nothing is.

    `bodies` is empty for a case with one [mesh], which is a box or not.
    """
    if not bodies:
        return _no_face_of_a_box(face) if box else ""
    names = [body.name for body in bodies]
    of, colon, own = face.partition(":")
    if not colon:
        begins = [name for name in names if face.startswith(name) and not face[len(name) :].isidentifier()]
        body = max(begins, key=len, default="")
        example = f"{body}:{face[len(body) + 1 :] or 'top'}" if body else f"{names[0]}:{face}"
        return f'should name body and face, as in "{example}"; the bodies are {", ".join(names)}'
    if of not in names:
        return fault_of_body(of, bodies)
    return _no_face_of_a_box(own, f"{of}:") if bodies[names.index(of)].box is not None else ""


def fault_of_body(name: str, bodies: Sequence[BodyTable]) -> str:
    """What is wrong with the name of a body; "" if nothing is."""
    names = [body.name for body in bodies]
    if not names:
        return "there are no [[body]] tables, so that it has no meaning"
    if name in names:
        return ""
    close = difflib.get_close_matches(name, names, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return f"there is no body {name!r}{hint}; the bodies are {', '.join(names)}"


def _no_face_of_a_box(face: str, of: str = "") -> str:
    if face in mesh_formats.BOX_FACES:
        return ""
    *most, last = (repr(f"{of}{name}") for name in mesh_formats.BOX_FACES)
    close = face_meant(face, mesh_formats.BOX_FACES)
    return f"should be {', '.join(most)} or {last}{f': write {of + close!r}' if close else ''}"
