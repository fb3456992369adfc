"""The components of a mesh from a file: whether hinges join them, and where they touch without sharing nodes; and rows
of whole numbers, such as the corners of facets: the distinct ones, where some are among others, and sets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, distinct, in_words, rows_among
from ...exchange import Exchange, even_starts, fetched, owner_of
from ...nearest import tree_of
from .. import compat
from ..compat import mesh
from .among_ranks import Slabs, bounds
from .lagrange import corner_geometry


def local_facets(domain: Any, groups: Mapping[str, IntArray]) -> dict[str, Int32Array]:
    """Numbers of this rank's boundary facets of every group; collective.

    A group has a row for each facet, the sorted numbers of its points in the file, shape (k, corners); every rank gives
    the same names, and any of the rows.
    """
    if not groups:
        return {}
    comm = domain.comm
    boundary = boundary_facets(domain)
    in_file = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)  # without cells: empty, of any type
    mine = np.sort(in_file[corners_of(domain, boundary)], axis=1)
    largest = max(comm.allgather(int(max((rows.max(initial=0) for rows in (mine, *groups.values())), default=0))))
    hubs = even_starts(comm.size, largest + 1)
    ask = Exchange(comm, owner_of(hubs, mine[:, 0]))
    asked = ask.send(mine)
    faces = {}
    for name, rows in groups.items():
        given = Exchange(comm, owner_of(hubs, rows[:, 0])).send(rows)
        faces[name] = boundary[ask.reply(rows_among(given, asked))]
    return faces


def local_cells(domain: Any, starts: IntArray, groups: Mapping[str, IntArray]) -> dict[str, Int32Array]:
    """This rank's own cells of every group; collective.

    Groups have numbers of cells in the order in which the mesh was given, of which every rank had those between its
    `starts`; every rank gives the same names, and any of the numbers.
    """
    own = domain.topology.index_map(3).size_local
    return _members(domain.comm, starts, groups, domain.topology.original_cell_index[:own])


def local_nodes(domain: Any, starts: IntArray, groups: Mapping[str, IntArray]) -> dict[str, Int32Array]:
    """The nodes of a mesh's geometry on this rank, ghosts included, of every group of points, as of `local_cells`;
    collective."""
    return _members(domain.comm, starts, groups, domain.geometry.input_global_indices)


def _members(comm: MPI.Comm, starts: IntArray, groups: Mapping[str, IntArray], numbers: Any) -> dict[str, Int32Array]:
    """Where numbers (k,) of this rank are in every group, of which every rank gives some numbers; collective."""
    if not groups:
        return {}
    first, last = starts[comm.rank], starts[comm.rank + 1]
    member = np.zeros((last - first, len(groups)), dtype=bool)
    for column, given in enumerate(groups.values()):
        member[Exchange(comm, owner_of(starts, given)).send(given) - first, column] = True
    here = fetched(comm, starts, np.asarray(numbers, dtype=np.int64), member)
    return {name: np.flatnonzero(here[:, column]).astype(np.int32) for column, name in enumerate(groups)}


def boundary_facets(domain: Any) -> Int32Array:
    """This rank's facets on the boundary of a mesh, ascending."""
    dim = domain.topology.dim
    domain.topology.create_connectivity(dim - 1, dim)
    return np.sort(mesh.exterior_facet_indices(domain.topology)).astype(np.int32)


def corners_of(domain: Any, facets: Int32Array) -> IntArray:
    topology = domain.topology
    for dim in ((2, 0), (3, 0)):
        topology.create_connectivity(*dim)
    vertices = topology.connectivity(3, 0).array
    of_vertex = np.empty(int(vertices.max(initial=-1)) + 1, dtype=np.int64)
    of_cell = corner_geometry(domain)  # there may be no cell on this rank
    of_vertex[vertices] = of_cell.ravel()
    of_facet = topology.connectivity(2, 0).array.reshape(-1, 3 if of_cell.shape[1] == 4 else 4)
    return of_vertex[of_facet[facets]]


def neighbours(corners: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of facets with a common edge, by the nodes of their corners (f, c)."""
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edge, facet = distinct(edges)[1], np.arange(len(edges)) // corners.shape[1]
    order = np.argsort(edge, kind="stable")
    both = np.flatnonzero(np.diff(edge[order]) == 0)
    return facet[order[both]], facet[order[both + 1]]


SAME_PLACE: Final = 1e-6
"""Distance of two nodes at the same place, relative to the extent of the mesh."""


def parts_of(domain: Any, path: str) -> tuple[int, FloatArray]:
    """How many components the cells of a mesh make by their common facets, and the places in metres at which corners of
    several components coincide, those found on this rank, shape (k, 3); collective.

    Raises:
        ValueError: On every rank, if components share an edge or a corner.
    """
    comm, topology = domain.comm, domain.topology
    own = topology.index_map(3).size_local
    parts, part = _components(domain, own)
    if parts == 1:
        return 1, np.empty((0, 3))
    rows = compat.cell_geometry(domain)[:own]
    numbers = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    shared = _hinges(numbers[rows], part, comm)
    bad = np.any(shared, axis=1)
    place = None
    if np.any(bad):
        original = np.asarray(topology.original_cell_index, dtype=np.int64)[:own]
        first = np.flatnonzero(bad)[np.argmin(original[bad])]
        place = (int(original[first]), domain.geometry.x[rows[first]].mean(axis=0))
    seen = comm.allgather((int(bad.sum()), own, place))
    count = sum(count_of_rank for count_of_rank, *_ in seen)
    if count:
        first_place = min((place for *_, place in seen if place is not None), key=lambda one: one[0])[1]
        where = in_words(first_place)
        raise ValueError(
            f"{path}: {count} of {sum(of for _, of, _ in seen)} cells (first seen at x = {where}) "
            f"{'has' if count == 1 else 'have'} edges or corners in common with a part of the mesh with which they "
            "share no facet: the parts would turn about them freely; join them with matching nodes (in gmsh: "
            "BooleanFragments or Coherence), or give each part nodes of its own"
        )
    of_node = np.zeros(len(numbers), dtype=np.int64)
    of_node[rows] = part[:, None]
    corners = np.unique(corners_of(domain, boundary_facets(domain)))
    return parts, _touching(domain.geometry.x[corners], numbers[corners], of_node[corners], comm)


def _components(domain: Any, own: int) -> tuple[int, IntArray]:
    """How many components there are, and that of each of this rank's own cells; collective.

    Every rank labels the components of its own cells; labels that meet at a facet of two ranks are then joined on every
    rank alike.
    """
    comm, topology = domain.comm, domain.topology
    topology.create_connectivity(2, 3)
    of_facet = topology.connectivity(2, 3)
    facet = np.repeat(np.arange(len(of_facet.offsets) - 1), np.diff(of_facet.offsets))
    mine = of_facet.array < own
    facet, cell = facet[mine], of_facet.array[mine]
    both = np.flatnonzero(facet[1:] == facet[:-1])
    graph = coo_matrix((np.ones(len(both), dtype=np.int8), (cell[both], cell[both + 1])), shape=(own, own))
    count, label = connected_components(graph, directed=False)
    counts = comm.allgather(int(count))
    label = sum(counts[: comm.rank]) + label.astype(np.int64)
    at = np.bincount(facet, minlength=1) == 1
    at[mesh.exterior_facet_indices(topology)] = False
    single = np.flatnonzero(at)
    of_single = np.empty(len(at), dtype=np.int64)
    of_single[facet] = cell
    rows = np.sort(
        np.asarray(domain.geometry.input_global_indices, dtype=np.int64)[corners_of(domain, single.astype(np.int32))],
        axis=1,
    )
    hubs = even_starts(comm.size, 1 + max(comm.allgather(int(rows.max(initial=0)))))
    exchange = Exchange(comm, owner_of(hubs, rows[:, 0]))
    rows, there = exchange.send(rows), exchange.send(label[of_single[single]])
    order = np.lexsort(rows.T)
    same = np.flatnonzero(np.all(rows[order][1:] == rows[order][:-1], axis=1))
    met = np.unique(np.column_stack([there[order[same]], there[order[same + 1]]]), axis=0)
    pairs = np.concatenate(comm.allgather(met))
    whole = coo_matrix((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(sum(counts),) * 2)
    parts, joined = connected_components(whole, directed=False)
    return int(parts), joined.astype(np.int64)[label]


def _hinges(cells: IntArray, part: IntArray, comm: MPI.Comm) -> BoolArray:
    """Which nodes of cells (c, n) several components share, although they share no facet; collective."""
    nodes, parts = cells.ravel(), np.repeat(part, cells.shape[1])
    rows = np.column_stack([nodes, parts])
    first, pair = distinct(rows)
    exchange = Exchange(comm, rows[first, 0] % comm.size)
    there = exchange.send(rows[first])
    first, number = distinct(there)
    _, of_pair, times = np.unique(there[first, 0], return_inverse=True, return_counts=True)
    shared = exchange.reply((times > 1)[of_pair[number]])
    return np.asarray(shared[pair].reshape(cells.shape), dtype=bool)


def _touching(x: FloatArray, numbers: IntArray, part: IntArray, comm: MPI.Comm) -> FloatArray:
    """Places at which nodes of several components coincide, those found on this rank, from its nodes x (k, 3) at
    corners on the boundary, their numbers in the file and their components; collective."""
    near = SAME_PLACE * float(np.linalg.norm(np.ptp(bounds(comm, x), axis=0)))
    slabs = Slabs(comm, x)
    point, slab = slabs.near(x, near)
    exchange = Exchange(comm, slab)
    x, numbers, part = (exchange.send(rows[point]) for rows in (x, numbers, part))
    numbers, first = np.unique(numbers, return_index=True)  # nodes of several ranks
    x, part = x[first], part[first]
    pairs = tree_of(x).query_pairs(near, output_type="ndarray") if len(x) else np.empty((0, 2), dtype=np.int64)
    pairs = pairs[part[pairs[:, 0]] != part[pairs[:, 1]]]
    one_each = np.setdiff1d(pairs.min(axis=1, initial=len(x)), pairs.max(axis=1, initial=-1))
    return x[one_each][slabs.of(x[one_each]) == comm.rank]


def places(rows: IntArray, some: IntArray) -> IntArray:
    """Where some rows are among distinct rows."""
    first, number = distinct(np.vstack([rows, some]))
    return first[number[len(rows) :]]


def sets(count: int, groups: Mapping[str, IntArray]) -> tuple[IntArray, BoolArray]:
    """Of so many things with groups of some, the number of the set of groups that each is in, shape (count,), and which
    groups are in each set, shape (sets, groups)."""
    member = np.zeros((count, len(groups)), dtype=bool)
    for k, some in enumerate(groups.values()):
        member[some, k] = True
    first, number = distinct(np.column_stack([np.zeros((count, 2), dtype=np.int64), member]))
    return number, member[first]
