"""The tables of a case file about several bodies: each has its mesh, its material and its place."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import AfterValidator, model_validator

from ..fem.mesh_formats import BOX_FACES
from .body import MeshTable
from .material import MaterialTable, MaterialTables, materials_of, refuse_groups
from .values import Name, Number, Table, Vector

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..fem.bodies import AnyMaterial
    from ..fem.geometry import Rotation
    from ..fem.meshes import JoinedMesh, NamedMesh


def _identifier(name: str) -> str:
    if not name.isidentifier():
        raise ValueError("should be an identifier: letters, digits and _, no digit first")
    return name


BodyName = Annotated[Name, AfterValidator(_identifier)]
"""Name of a body, before the ":" of "lower:top"."""


class RotateTable(Table):
    """A rotation: a point of the axis in metres, by default the origin, its direction, and the angle in radians."""

    axis: Vector
    angle: Number
    point: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _direction(self) -> RotateTable:
        if not any(self.axis):
            raise ValueError("axis must not be zero")
        return self

    def rotation(self) -> Rotation:
        """What it describes."""
        from ..fem.geometry import Rotation

        return Rotation(self.point, self.axis, self.angle)


class BodyTable(MeshTable):
    """One of several bodies: the keys of a mesh, its material, where it is (rotated, then translated), and its gravity,
    in place of that of the case."""

    name: BodyName
    material: MaterialTables
    translate: Vector = (0.0, 0.0, 0.0)
    rotate: RotateTable | None = None
    gravity: Vector | None = None

    _of: ClassVar[str] = ""

    @model_validator(mode="after")
    def _groups_of_the_mesh(self) -> BodyTable:
        refuse_groups(self.material, self.box is not None, "[body.material]")
        return self

    def mesh(self, comm: MPI.Comm) -> NamedMesh:
        """The mesh of the body at its place.

        Raises:
            ValueError: On every rank, if the file cannot be read or used.
        """
        from ..fem.meshes import moved

        try:
            mesh = super().mesh(comm)
        except ValueError as error:
            raise ValueError(f"body {self.name!r}: {error}") from None
        if self.rotate is None and not any(self.translate):
            return mesh
        return moved(mesh, self.translate, None if self.rotate is None else self.rotate.rotation())

    def materials(self) -> dict[str, AnyMaterial]:
        """Its materials, by the names of the body or of its groups of cells, as in "lower:steel"."""
        if isinstance(self.material, MaterialTable):
            return {self.name: self.material.material()}
        return {f"{self.name}:{group}": given for group, given in materials_of(self.material).items()}


def joined_mesh(bodies: Sequence[BodyTable], comm: MPI.Comm) -> JoinedMesh:
    """The meshes of all bodies, each at its place.

    Raises:
        ValueError: On every rank, if one cannot be read or used.
    """
    from ..fem.meshes import JoinedMesh

    return JoinedMesh({body.name: body.mesh(comm) for body in bodies})


def refuse_equal_names(bodies: Sequence[BodyTable]) -> None:
    """Raises ValueError if two bodies have the same name."""
    for name, count in Counter(body.name for body in bodies).items():
        if count > 1:
            numbers = [f"body.{k}" for k, body in enumerate(bodies) if body.name == name]
            raise ValueError(f"{' and '.join(numbers)} have the name {name!r}; give each body its own")


def fault_of_face(face: str, bodies: Sequence[BodyTable], box: bool) -> str:
    """What is wrong with the name of a face as far as it can be known before files are read; "" if nothing is.

    Args:
        face: The name.
        bodies: The bodies; empty for a case with one [mesh].
        box: Whether that [mesh] is a box.
    """
    if not bodies:
        return _no_face_of_a_box(face) if box else ""
    names = [body.name for body in bodies]
    of, colon, own = face.partition(":")
    if not colon:
        begins = [name for name in names if face.startswith(name) and not face[len(name) :].isidentifier()]
        body = max(begins, key=len, default="")
        example = f"{body}:{face[len(body) + 1 :]}" if body else f"{names[0]}:{face}"
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
    if face in BOX_FACES:
        return ""
    *most, last = (repr(f"{of}{name}") for name in BOX_FACES)
    return f"should be {', '.join(most)} or {last}"
