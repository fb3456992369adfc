"""Components of a mesh that touch without sharing nodes, where no contact is between them: perhaps a tear."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ...arrays import FloatArray, IntArray
from ...nearest import tree_of
from ..meshes import SAME_PLACE, Exchange, NamedMesh, Slabs, corners_of
from .deformable import Deformable


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
        if mesh.components == 1:
            continue
        corners = [corners_of(mesh.domain, facets) for one, facets in faces if one.name == member.name]
        places = _beside(mesh, np.concatenate([np.empty(0, dtype=np.int64), *(found.ravel() for found in corners)]))
        seen = mesh.comm.allgather((len(places), *places[:1]))
        if any(count for count, *_ in seen):
            at = ", ".join(f"{coordinate:.6g}" for coordinate in next(place[0] for count, *place in seen if count))
            of = f"body {member.name!r}: " if member.name else ""
            total = sum(count for count, *_ in seen)
            said.append(
                f"{of}the mesh has {mesh.components} components that touch at {total} places without sharing nodes "
                f"(one is x = {at}): contact between them needs a contact with against; to glue them, merge the nodes "
                "(in gmsh: Coherence)"
            )
    return said


def _beside(mesh: NamedMesh, corners: IntArray) -> FloatArray:
    """This rank's places at which components touch that are not at these nodes of the geometry, of any rank;
    collective."""
    x, comm = mesh.domain.geometry.x, mesh.comm
    ends = np.array([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    near = 2.0 * SAME_PLACE * float(np.linalg.norm(np.min(comm.allgather(ends), axis=0).sum(axis=0)))
    slabs, on_faces = Slabs(comm, mesh.touching), x[np.unique(corners)]
    point, slab = slabs.near(on_faces, near)
    on_faces = Exchange(comm, slab).send(on_faces[point])
    ask = Exchange(comm, slabs.of(mesh.touching))
    asked = ask.send(mesh.touching)
    distance = tree_of(on_faces).query(asked)[0] if len(on_faces) else np.full(len(asked), np.inf)
    places: FloatArray = mesh.touching[ask.reply(distance > near)]
    return places
