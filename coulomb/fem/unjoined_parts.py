"""Components of a mesh that touch without sharing nodes, where no contact is between them: perhaps a tear."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays import FloatArray
from ..nearest import tree_of
from .deformable import Deformable
from .mesh_parts import SAME_PLACE, IntArray
from .named_mesh import NamedMesh, corners_of


def unjoined_parts(bodies: Deformable, pairs: Iterable[tuple[str, str]]) -> list[str]:
    """A message on every mesh with components that touch where no pair of faces is; collective.

    Args:
        bodies: The bodies.
        pairs: Names of the faces of all contacts against deformable faces.

    Raises:
        ValueError: If there is no such face.
    """
    faces = [bodies.face(name, "contact") for pair in pairs for name in pair]
    said = []
    for member in bodies.members:
        mesh = member.body.mesh
        if not len(mesh.touching):
            continue
        corners = [corners_of(mesh.domain, facets) for one, facets in faces if one.name == member.name]
        places = _beside(mesh, np.concatenate([np.empty(0, dtype=np.int64), *(found.ravel() for found in corners)]))
        if len(places):
            at = ", ".join(f"{coordinate:.6g}" for coordinate in places[0])
            of = f"body {member.name!r}: " if member.name else ""
            said.append(
                f"{of}the mesh has {mesh.components} components that touch at {len(places)} places without sharing "
                f"nodes (one is x = {at}): contact between them needs a contact with against; to glue them, merge the "
                "nodes (in gmsh: Coherence)"
            )
    return said


def _beside(mesh: NamedMesh, corners: IntArray) -> FloatArray:
    """The places at which components touch that are not at these nodes of the geometry; collective."""
    x = mesh.domain.geometry.x
    on_faces: FloatArray = np.concatenate(mesh.comm.allgather(x[np.unique(corners)]))
    if not len(on_faces):
        return mesh.touching
    lows, highs = (np.array(mesh.comm.allgather(end)) for end in (x.min(0, initial=np.inf), x.max(0, initial=-np.inf)))
    near = 2.0 * SAME_PLACE * float(np.linalg.norm(highs.max(axis=0) - lows.min(axis=0)))
    distance, _ = tree_of(on_faces).query(mesh.touching)
    places: FloatArray = mesh.touching[distance > near]
    return places
