"""Several bodies as one: from their meshes, or from bodies of the user's forms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import overload

from ..meshes import JoinedMesh, NamedMesh
from .deformable import SingleBody
from .joined_bodies import JoinedBodies


@overload
def join(bodies: Mapping[str, NamedMesh] | None = None, /, **named: NamedMesh) -> JoinedMesh: ...


@overload
def join(bodies: Mapping[str, SingleBody] | None = None, /, **named: SingleBody) -> JoinedBodies: ...


def join(
    bodies: Mapping[str, NamedMesh] | Mapping[str, SingleBody] | None = None, /, **named: NamedMesh | SingleBody
) -> JoinedMesh | JoinedBodies:
    """Several bodies as one, for a problem of contact between them.

    Their meshes need not match where the bodies touch; they may have cells of different kinds and orders, and each may
    have several components.  Each body is where its mesh was made, or where `coulomb.moved` has put it.

    Args:
        bodies: By name the mesh of each body, then `ContactProblem` takes materials, supports and loads of all; or each
            as a `Body` of your own forms, or an `Elasticity`, which has them already.
        **named: The same, as in `join(lower=..., upper=...)`.

    Raises:
        ValueError: If there is no body, or one is neither mesh nor `Body`, or not what the others are; if a name is no
            identifier or occurs twice, a mesh is given twice, or meshes are on different communicators.
    """
    if bodies is not None and not isinstance(bodies, Mapping):
        raise ValueError(f"join: must be join(lower=..., upper=...), or a mapping of names to meshes, not {bodies!r}")
    first: dict[str, NamedMesh | SingleBody] = dict(bodies or {})
    twice = first.keys() & named.keys()
    if twice:
        raise ValueError(f"join: two bodies have the name {min(twice)!r}")
    given = {**first, **named}
    meshes = {name: one for name, one in given.items() if isinstance(one, NamedMesh)}
    singles = {name: one for name, one in given.items() if isinstance(one, SingleBody)}
    for name, one in given.items():
        if isinstance(one, JoinedMesh | JoinedBodies):
            inner = one.bodies if isinstance(one, JoinedMesh) else [member.name for member in one.members]
            raise ValueError(f"join: {name!r} has several bodies ({', '.join(inner)}) itself; join all of them at once")
        if name not in meshes and name not in singles:
            raise ValueError(
                f"join: {name!r} must be a mesh (coulomb.box, coulomb.read_mesh, NamedMesh) or a Body, but is {one!r}"
            )
    if meshes and singles:
        raise ValueError(
            f"join: {next(iter(meshes))!r} is a mesh, {next(iter(singles))!r} a body with its own loads and supports; "
            "coulomb.Elasticity makes such a body of a mesh"
        )
    return JoinedBodies(singles) if singles else JoinedMesh(meshes)
