"""The connected components of a mesh: parts of a body that share no node."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray
from .. import compat
from .displacement_space import DisplacementSpace

Numbers = npt.NDArray[np.int64]


def mesh_components(space: DisplacementSpace) -> Numbers:
    """The component of each of this rank's nodes, shape (k,), numbered from 0 by their smallest x, then y, then z;
    collective.

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


def _in_order(joined: Numbers, x: FloatArray, comm: MPI.Comm) -> Numbers:
    """Numbers of components in the order of their smallest nodes; collective."""
    order = np.lexsort(x.T[::-1])
    found, first = np.unique(joined[order], return_index=True)
    mine = [(*point, number) for point, number in zip(x[order][first].tolist(), found.tolist(), strict=True)]
    ranked: dict[int, int] = {}
    for *_, number in sorted(point for points in comm.allgather(mine) for point in points):
        ranked.setdefault(number, len(ranked))
    names = np.array([ranked[number] for number in found.tolist()], dtype=np.int64)
    return names[np.searchsorted(found, joined)] if len(found) else joined
