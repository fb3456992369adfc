"""The connected components of a mesh: parts of a body that share no node."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray, IntArray, in_words
from ...nearest import tree_of
from .. import compat
from ..meshes import SAME_PLACE, Exchange, NamedMesh, Slabs, bounds, corners_of
from .deformable import Deformable
from .displacement_space import DisplacementSpace


def unjoined_parts(bodies: Deformable, pairs: Iterable[tuple[str, str]]) -> list[str]:
    """A message on every mesh with components that touch where no pair of faces is; ValueError if a face is unknown;
    collective."""
    faces = [bodies.face(name, "contact") for pair in pairs for name in pair]
    said = []
    for member in bodies.members:
        mesh = member.body.mesh
        if mesh.components == 1:
            continue
        corners = [corners_of(mesh.domain, facets) for one, facets in faces if one.name == member.name]
        places = _beside(mesh, np.concatenate([np.empty(0, dtype=np.int64), *(nodes.ravel() for nodes in corners)]))
        seen = mesh.comm.allgather((len(places), *places[:1]))
        if any(count for count, *_ in seen):
            at = in_words(next(place[0] for count, *place in seen if count))
            of = f"body {member.name!r}: " if member.name else ""
            total = sum(count for count, *_ in seen)
            said.append(
                f"{of}the mesh has {mesh.components} components that touch at {total} places without sharing nodes "
                f"(one is x = {at}): contact between them needs a contact with against; to glue them, merge the nodes "
                "(in gmsh: Coherence)"
            )
    return said


def _beside(mesh: NamedMesh, corners: IntArray) -> FloatArray:
    """This rank's places at which components touch that are not at these nodes of any rank; collective."""
    x, comm = mesh.domain.geometry.x, mesh.comm
    near = 2.0 * SAME_PLACE * float(np.linalg.norm(np.ptp(bounds(comm, x), axis=0)))
    slabs, on_faces = Slabs(comm, mesh.touching), x[np.unique(corners)]
    point, slab = slabs.near(on_faces, near)
    on_faces = Exchange(comm, slab).send(on_faces[point])
    ask = Exchange(comm, slabs.of(mesh.touching))
    asked = ask.send(mesh.touching)
    distance = tree_of(on_faces).query(asked)[0] if len(on_faces) else np.full(len(asked), np.inf)
    return mesh.touching[ask.reply(distance > near)]


def mesh_components(space: DisplacementSpace) -> IntArray:
    """The component of each of this rank's nodes, shape (k,), numbered by their smallest x, then y, then z; collective.

    Every rank labels the components of its own cells; labels that meet at a node of two ranks are then joined on every
    rank alike, so that no mesh is gathered.
    """
    comm, cells = space.domain.comm, compat.cell_dofs(space.V)
    sizes = space.V.dofmap.index_map
    here, everywhere = sizes.size_local, sizes.size_local + sizes.num_ghosts
    ends = cells[:, 1:]
    starts = np.broadcast_to(cells[:, :1], ends.shape)
    edges = (np.ones(ends.size, dtype=np.int8), (starts.ravel(), ends.ravel()))
    count, label = connected_components(scipy.sparse.coo_matrix(edges, shape=(everywhere, everywhere)), directed=False)
    counts = comm.allgather(int(count))
    first = sum(counts[: comm.rank])
    label = first + label.astype(np.int64)
    owners = np.round(space.function(np.repeat(label[:here, None], 3, axis=1).astype(np.float64)).x.array[::3])
    met = np.unique(np.column_stack([label, owners.astype(np.int64)]), axis=0)
    pairs = np.concatenate(comm.allgather(met))
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(sum(counts),) * 2)
    joined = connected_components(graph, directed=False)[1].astype(np.int64)[label[:here]]
    return _in_order(joined, space.x, comm)


def _in_order(joined: IntArray, x: FloatArray, comm: MPI.Comm) -> IntArray:
    """IntArray of components in the order of their smallest nodes; collective."""
    order = np.lexsort(x.T[::-1])
    numbers, first = np.unique(joined[order], return_index=True)
    mine = [(*point, number) for point, number in zip(x[order][first].tolist(), numbers.tolist(), strict=True)]
    ranked: dict[int, int] = {}
    for *_, number in sorted(point for points in comm.allgather(mine) for point in points):
        ranked.setdefault(number, len(ranked))
    names = np.array([ranked[number] for number in numbers.tolist()], dtype=np.int64)
    return names[np.searchsorted(numbers, joined)] if len(numbers) else joined
