"""What holds the planes of slices (`meshes.slices`): the user gives no supports for them."""

from __future__ import annotations

from ..meshes import SEPARATOR, JoinedMesh, NamedMesh, Slice
from .rigid_faces import RigidFace
from .supports import Support, SymmetryPlane


def _slices(mesh: object) -> dict[str, Slice]:
    """The slices among the bodies, by what their faces' names begin with; ValueError if bodies are of several kinds."""
    bodies = {f"{name}{SEPARATOR}": one for name, one in mesh.bodies.items()} if isinstance(mesh, JoinedMesh) else {}
    bodies |= {"": mesh} if isinstance(mesh, NamedMesh) else {}
    slice_of = {name: one.slice for name, one in bodies.items()}
    kinds = {"in 3D" if one is None else f"{one.kind}, for {one.said}" for one in slice_of.values()}
    if len(kinds) > 1:
        raise ValueError(
            f"bodies are of several kinds ({'; '.join(sorted(kinds))}): make all of them slices of one kind"
        )
    return {name: one for name, one in slice_of.items() if one is not None}


def supports_of_slices(mesh: object) -> list[Support]:
    """The planes of symmetry of the slices among the bodies of a mesh; ValueError if bodies are of several kinds."""
    return [SymmetryPlane(f"{body}{face}") for body, one in _slices(mesh).items() for face in one.held]


def rigid_faces_of_slices(mesh: object) -> list[RigidFace]:
    """The fronts that stay plane, and move along their normal (generalised plane strain)."""
    fronts = [body for body, one in _slices(mesh).items() if one.kind == "generalised plane strain"]
    return [RigidFace(f"{body}front", rotation=(0.0, 0.0, None), along="free") for body in fronts]
