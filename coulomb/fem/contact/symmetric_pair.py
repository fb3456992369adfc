"""Planes of symmetry through a pair: both faces end on the plane, and their nodes there are held across it.

The whole face is the given half and its mirror image.  So at a slave node in the plane

- the mean normal is in the plane; that of the given facets alone, where the face is curved, is inclined to it, and a
  row of B along the held direction would have a part of the approach of the two bodies, against which friction would
  act; so are the normals of smooth faces, between which gaps are measured;
- averages of displacements have no part across the plane; those over the given half have a small one where meshes do
  not match, or where the slave is partly covered.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ..bodies import Deformable, HeldDirections
from ..meshes import Exchange, fetched, owner_of
from .contact_points import ContactPoints
from .facet_patch import FacetPatch
from .near_facets import normals_at_nodes

_OBLIQUE = 0.5
"""Part of a unit normal along held directions beyond which the face does not meet a plane of symmetry."""

_BEYOND = 1e-6
"""Part of the extent of the facets around a node that counts as beyond its plane."""

_HELD_OPPOSITE = 0.1
"""Part of the weight of the opposite nodes that must be held: those of the master's edge have a half and more."""


def planes_of_symmetry(n: FloatArray, held: FloatArray, nodes: npt.NDArray[np.int64], patch: FacetPatch) -> FloatArray:
    """Projectors on the held directions across which a face ends, shape (m, 3, 3), 0 for other nodes; from unit normals
    n (m, 3), projectors on the held directions, numbers of nodes, and the facets around them."""
    across = np.linalg.norm(np.einsum("mij,mj->mi", held, n), axis=1)
    chosen = np.flatnonzero((np.einsum("mii->m", held) > 0.5) & (across < _OBLIQUE))
    found = np.zeros_like(held)
    row = np.full(patch.size, -1)
    row[nodes[chosen]] = np.arange(len(chosen))
    facet, corner = np.nonzero(row[patch.nodes] >= 0)
    at = row[patch.nodes[facet, corner]]
    sizes, directions = np.linalg.eigh(held[chosen])
    offset = patch.x[facet] - patch.x[facet, corner][:, None]
    along = np.einsum("kwi,kia->kwa", offset, directions[at])
    lowest, highest, extent = np.zeros((len(chosen), 3)), np.zeros((len(chosen), 3)), np.zeros(len(chosen))
    np.minimum.at(lowest, at, along.min(axis=1))
    np.maximum.at(highest, at, along.max(axis=1))
    np.maximum.at(extent, at, np.abs(along).max(axis=(1, 2)))
    beyond = _BEYOND * extent[:, None]
    ends = np.any((sizes > 0.5) & ((lowest >= -beyond) | (highest <= beyond)), axis=1)
    found[chosen[ends]] = held[chosen[ends]]
    return found


def within(n: FloatArray, planes: FloatArray) -> FloatArray:
    """Unit normals n (m, 3) without their parts along the projectors (m, 3, 3)."""
    inside = n - np.einsum("mij,mj->mi", planes, n)
    length = np.linalg.norm(inside, axis=1)[:, None]
    return np.where(np.any(planes != 0.0, axis=(1, 2))[:, None], inside / length, n)


def smooth_normals(
    patch: FacetPatch, held: HeldDirections, starts: npt.NDArray[np.int64], comm: MPI.Comm
) -> FloatArray:
    """`normals_at_nodes`, within the planes of symmetry on which the face ends, shape (f, n, 3); collective."""
    nodes, width = patch.nodes.ravel(), patch.kind.width
    n = normals_at_nodes(patch, starts, comm).reshape(-1, 3)
    to = Exchange(comm, owner_of(starts, nodes))
    around = replace(
        patch, nodes=to.send(np.repeat(patch.nodes, width, axis=0)), x=to.send(np.repeat(patch.x, width, axis=0))
    )
    node, which = np.unique(to.send(nodes), return_index=True)
    own = to.send(n)[which]
    own = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300)
    local = node - starts[comm.rank]
    planes = np.zeros((int(starts[comm.rank + 1] - starts[comm.rank]), 3, 3))
    planes[local] = planes_of_symmetry(own, held.projector_at(local), node, around)
    return within(n, fetched(comm, starts, nodes, planes)).reshape(-1, width, 3)


def mirrored(
    points: ContactPoints, planes: FloatArray, opposite: scipy.sparse.csr_matrix, elasticity: Deformable
) -> FloatArray | None:
    """The directions among the `planes_of_symmetry` (m, 3, 3) along which the nodes opposite are held as well, by the
    averages (m, nodes) over these, as projectors of this shape; None if no rank has any; collective."""
    every = elasticity.held.projector_at(np.arange(len(elasticity.x))).reshape(-1, 9)
    share = replace(points, weights=shares(opposite), nodal=False, opposite=None)
    both = held_on_both(planes, share.average(every).reshape(-1, 3, 3))
    return both if elasticity.comm.allreduce(bool(np.any(both)), op=MPI.LOR) else None


def shares(opposite: scipy.sparse.csr_matrix) -> scipy.sparse.csr_matrix:
    """Sizes of the weights of the master's nodes, every row with the sum 1."""
    size = abs(opposite)
    return (scipy.sparse.diags(1.0 / np.maximum(np.asarray(size.sum(axis=1)).ravel(), 1e-300)) @ size).tocsr()


def held_on_both(planes: FloatArray, there: FloatArray) -> FloatArray:
    """The directions among `planes` (m, 3, 3) that are held on the master, too, by the means of its projectors there
    (m, 3, 3) with `shares`, as projectors of this shape."""
    sizes, directions = np.linalg.eigh(planes @ there @ planes)
    both: FloatArray = np.einsum("mia,ma,mja->mij", directions, (sizes > _HELD_OPPOSITE).astype(np.float64), directions)
    return both
