"""Meshes with smaller cells: tetrahedra bisected at their edges, all or round marked ones; hexahedra divided in eight.

Tetrahedra are divided as in A. Plaza and G. F. Carey, Local refinement of simplicial grids based on the skeleton, Appl.
Numer. Math. 32 (2000) 195-218: where an edge of a triangle is divided, its longest is, too; cells are bisected at these
edges, the longest first.  How a triangle is divided depends on its own edges alone, so that the cells on both sides of
it agree.  DOLFINx has this method, too, but names the parents of facets not in all versions, nor on all ranks.

In each of its cells a new node is at the mean of some corners of the old cell, perhaps some of them several times; the
sorted list of these corners is its key.  So no two nodes are confused, even those at one place on both sides of a cut.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray, IntArray
from .. import compat
from ..compat import basix
from ..geometry import evaluate_vectors, on_all_ranks
from .exchange import Exchange, fetched, owner_of, starts_of
from .lagrange import corner_geometry
from .mesh_parts import local_cells, local_facets, parts_of
from .meshes import refuse_flat_cells
from .named_mesh import NamedMesh


def refined(
    mesh: NamedMesh,
    marked: npt.NDArray[Any] | None = None,
    project: Mapping[str, Callable[[FloatArray], FloatArray]] | None = None,
) -> NamedMesh:
    """The mesh with smaller cells of the same body: eight for one, or fewer round marked ones; collective.

    The body keeps its shape: new nodes are on straight edges, in 10-node tetrahedra on the curved ones.  Cells are
    distributed among the ranks anew.

    Args:
        mesh: Tetrahedra of first or second order, or hexahedra of first order, with named faces and groups of cells,
            which are kept.
        marked: Tetrahedra to be divided in eight, this rank's own: their numbers, or True and False for each;
            neighbours are divided as it takes.  By default all cells.
        project: Of first-order meshes, maps new nodes x (3, k) of faces, by name, to their places, shape (3, k): onto
            the surface that the facets approximate.

    Raises:
        ValueError: On every rank, if the cells cannot be refined, are not cells of this rank, a face is unknown, or a
            cell becomes flat.
    """
    comm, old, tetrahedra = mesh.comm, mesh.domain, mesh.domain.topology.cell_type.name == "tetrahedron"
    project = project or {}
    if not tetrahedra and (marked is not None or mesh.degree == 2):
        what = "27-node hexahedra cannot be" if mesh.degree == 2 else "hexahedra cannot be marked: all are"
        raise ValueError(f"refined: {what} refined; tetrahedra can")
    if project and mesh.degree == 2:
        raise ValueError("refined: project is for first-order meshes: new nodes of a second-order one are on its cells")
    for face in project:
        mesh.facets(face, "refined: project")
    own = old.topology.index_map(3).size_local
    if tetrahedra:
        chosen = on_all_ranks(lambda: _chosen(marked, own), "refined: marked", comm)
        parent, corners = _bisected(_order_of_divided(old, chosen))
        nodes = _PAIRS[corners]
        if mesh.degree == 2:
            nodes = nodes[:, _PAIRS].reshape(-1, len(_PAIRS), 4)
    else:
        parent, nodes = np.repeat(np.arange(own), 8), np.tile(_octants(), (own, 1, 1))
    return _made(mesh, parent, nodes, project)


def _chosen(marked: npt.NDArray[Any] | None, own: int) -> npt.NDArray[np.bool_]:
    found = np.full(own, marked is None)
    if marked is None:
        return found
    given = np.asarray(marked)
    if given.dtype == bool and given.shape == (own,):
        return given
    if given.size == 0:
        return found
    if not (given.ndim == 1 and np.issubdtype(given.dtype, np.integer)):
        raise ValueError(f"must be numbers of cells, or True and False for each of this rank's {own}")
    if np.min(given) < 0 or np.max(given) >= own:
        raise ValueError(f"must be this rank's own cells, with numbers from 0 to {own - 1}")
    found[given] = True
    return found


_EDGES, _TRIANGLES = (np.array(basix.topology(basix.CellType.tetrahedron)[dim]) for dim in (1, 2))
_PAIRS = np.vstack([np.arange(4).repeat(2).reshape(4, 2), _EDGES])
"""The corners in whose middle each node of a 10-node tetrahedron is, shape (10, 2); of a corner twice itself."""

_NONE = len(_EDGES)
_EDGE_OF = np.full((len(_PAIRS),) * 2, _NONE)
_EDGE_OF[_EDGES[:, 0], _EDGES[:, 1]] = _EDGE_OF[_EDGES[:, 1], _EDGES[:, 0]] = np.arange(_NONE)
_AROUND = _EDGE_OF[_TRIANGLES, np.roll(_TRIANGLES, 1, axis=1)]
"""The edges around each triangle of a tetrahedron, shape (4, 3)."""


def _order_of_divided(domain: Any, marked: npt.NDArray[np.bool_]) -> IntArray:
    """Whole numbers for the six edges of this rank's own tetrahedra: larger for longer edges, on all ranks in the same
    order; -1 where an edge is not divided.  Collective."""
    comm, topology, own = domain.comm, domain.topology, len(marked)
    topology.create_entities(1)
    topology.create_connectivity(3, 1)
    edges = topology.index_map(1)
    of_cell = topology.connectivity(3, 1).array.reshape(-1, _NONE)
    number = edges.local_to_global(np.arange(edges.size_local + edges.num_ghosts, dtype=np.int32)).astype(np.int64)
    starts = starts_of(comm, edges.size_local)

    ends = domain.geometry.x[corner_geometry(domain)][:, _EDGES]
    key = np.empty((len(number), 4))  # of equal length: by place
    key[of_cell, 0] = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    key[of_cell, 1:] = ends.mean(axis=2)
    key = fetched(comm, starts, number, key[: edges.size_local])  # since roundings can be others on another rank
    order = np.empty(len(number), dtype=np.int64)
    order[np.lexsort(key.T[::-1])] = np.arange(len(number))

    of_cell = of_cell[:own]
    triangles = of_cell[:, _AROUND]
    longest = np.take_along_axis(triangles, np.argmax(order[triangles], axis=2)[..., None], axis=2)[..., 0]
    divided = np.zeros(len(number), dtype=bool)
    divided[of_cell[marked]] = True
    owners = Exchange(comm, owner_of(starts, number))
    at = owners.send(number) - starts[comm.rank]
    while True:
        here = np.zeros(edges.size_local, dtype=bool)
        here[at[owners.send(divided)]] = True
        divided = owners.reply(here[at])
        wanted = longest[np.any(divided[triangles], axis=2)]
        more = not np.all(divided[wanted])
        divided[wanted] = True
        if not comm.allreduce(more, op=MPI.LOR):
            return np.where(divided, order, -1)[of_cell]


def _bisected(order: IntArray) -> tuple[IntArray, IntArray]:
    """Tetrahedra bisected at their edges with the largest numbers, as long as some >= 0 are left: the old cell of each
    new one, shape (k,), and its corners, shape (k, 4), which are nodes 0 to 9 of the old cell with 10."""
    order = np.column_stack([order, np.full(len(order), -1)])
    parent, nodes = np.arange(len(order)), np.tile(np.arange(4), (len(order), 1))
    while True:
        edge = _EDGE_OF[nodes[:, _EDGES[:, 0]], nodes[:, _EDGES[:, 1]]]
        of_edge = order[parent[:, None], edge]
        column = np.argmax(of_edge, axis=1)
        every = np.arange(len(parent))
        cut = of_edge[every, column] >= 0
        if not np.any(cut):
            return parent, nodes
        middle = 4 + edge[every, column][cut]
        halves = nodes[cut], nodes[cut]
        for half, end in zip(halves, _EDGES[column[cut]].T, strict=True):
            half[np.arange(len(half)), end] = middle
        parent = np.concatenate([parent[~cut], parent[cut], parent[cut]])
        nodes = np.concatenate([nodes[~cut], *halves])


@functools.cache
def _octants() -> IntArray:
    """The corners of a hexahedron in whose middle the corners of its eight parts are, shape (8, 8, 8): one eight times,
    two four times, four twice, or eight."""
    bit = np.array(basix.geometry(basix.CellType.hexahedron)).astype(np.int64)
    of_corner = {tuple(map(int, x)): corner for corner, x in enumerate(bit)}
    choice = bit[None, None]  # of two ends along each axis
    nodes = np.where(choice == 0, bit[:, None, None], bit[None, :, None])
    return np.array([[[of_corner[tuple(map(int, x))] for x in node] for node in part] for part in nodes])


def _weights(nodes: IntArray, corners: int, degree: int) -> FloatArray:
    """Values of the Lagrange functions of cells at the means of their corners `nodes` (k, n, m), shape (k, n,
    functions); exact, as they are multiples of 1/8 or more."""
    share = np.eye(corners)[nodes].mean(axis=2)
    if degree == 1:  # of hexahedra, too: the corners are those of an edge, a face or the cell
        return share
    first, second = share[..., _EDGES[:, 0]], share[..., _EDGES[:, 1]]
    return np.concatenate([share * (2.0 * share - 1.0), 4.0 * first * second], axis=2)


def _made(
    mesh: NamedMesh, parent: IntArray, nodes: IntArray, project: Mapping[str, Callable[[FloatArray], FloatArray]]
) -> NamedMesh:
    """The mesh of cells that are parts of this rank's own cells `parent` (k,), with nodes at the means of their corners
    `nodes` (k, n, m); collective."""
    comm, old, degree = mesh.comm, mesh.domain, mesh.degree
    topology, corners = old.topology, corner_geometry(old).shape[1]
    topology.create_connectivity(3, 0)
    topology.create_connectivity(3, 2)
    vertices = topology.index_map(0)
    number = vertices.local_to_global(np.arange(vertices.size_local + vertices.num_ghosts, dtype=np.int32))
    of_cell = number.astype(np.int64)[topology.connectivity(3, 0).array.reshape(-1, corners)]
    x = np.einsum("kni,kij->knj", _weights(nodes, corners, degree), old.geometry.x[compat.cell_geometry(old)][parent])
    cells, points, starts, added = _numbered(comm, of_cell[parent[:, None, None], nodes], x)

    sides = np.array(basix.topology(getattr(basix.CellType, topology.cell_type.name))[2])
    on_side = np.any(sides == np.arange(corners)[:, None, None], axis=2)
    part_of = np.all(np.all(on_side[nodes], axis=2)[:, sides], axis=2)  # (cells, their facets, those of the old ones)
    old_facets = topology.connectivity(3, 2).array.reshape(-1, len(sides))[parent]
    rows = {}
    for name, facets in mesh.faces.items():
        member = np.zeros(topology.index_map(2).size_local + topology.index_map(2).num_ghosts, dtype=bool)
        member[facets] = True
        child, side = np.nonzero(np.any(part_of & member[old_facets][:, None], axis=2))
        rows[name] = np.sort(cells[child[:, None], sides[side]], axis=1)
    for name, surface in project.items():
        given = np.unique(rows[name])
        at = np.unique(Exchange(comm, owner_of(starts, given)).send(given) - starts[comm.rank])
        at = at[added[at]]
        points[at] = evaluate_vectors(surface, points[at], f"refined: project {name!r}", comm)

    if project:
        refuse_flat_cells(fetched(comm, starts, cells, points), "refined: project", comm, x)
    domain = compat.create_mesh(comm, topology.cell_type.name, cells, points, degree)
    first = starts_of(comm, len(parent))
    groups = {name: first[comm.rank] + np.flatnonzero(np.isin(parent, own)) for name, own in mesh.cells.items()}
    components, touching = parts_of(domain, "refined") if mesh.components > 1 else (1, mesh.touching)
    return replace(
        mesh,
        domain=domain,
        faces=local_facets(domain, rows),
        cells=local_cells(domain, first, groups),
        components=components,
        touching=touching,
        coarser=lambda: mesh,
    )


def _numbered(
    comm: MPI.Comm, names: IntArray, x: FloatArray
) -> tuple[IntArray, FloatArray, IntArray, npt.NDArray[np.bool_]]:
    """Numbers of nodes that are called by corners `names` (k, n, m) and are at x (k, n, 3), the same for the same
    corners on all ranks, shape (k, n); places of the nodes that this rank has, shape (j, 3), the first number of every
    rank, and which of this rank's nodes are no corners; collective."""
    mine, first, at = np.unique(
        np.sort(names, axis=2).reshape(-1, names.shape[2]), axis=0, return_index=True, return_inverse=True
    )
    hubs = Exchange(comm, mine[:, 0] % comm.size)
    there, places = hubs.send(mine), hubs.send(x.reshape(-1, 3)[first])
    distinct, first, number = np.unique(there, axis=0, return_index=True, return_inverse=True)
    starts = starts_of(comm, len(distinct))
    numbers = hubs.reply(starts[comm.rank] + number.ravel())[at.ravel()].reshape(names.shape[:2])
    return numbers, places[first], starts, distinct[:, 0] != distinct[:, -1]
