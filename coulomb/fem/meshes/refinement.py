"""Meshes with smaller cells: tetrahedra bisected at their edges, all or round marked ones; hexahedra divided in eight.

Tetrahedra are divided as in A. Plaza and G. F. Carey, Local refinement of simplicial grids based on the skeleton, Appl.
Numer. Math. 32 (2000) 195-218: where an edge of a triangle is divided, its longest is, too; cells are bisected at these
edges, the longest first.  How a triangle is divided depends on its own edges alone, so that the cells on both sides of
it agree.  DOLFINx's `refine` finds the same cells, of first order, but tells of their parents and those of facets in
another way in every version.

New corners are in the middle of corners of the old cell, which are their key: of one, or of those of an edge, a face or
the cell.  So no two nodes are confused, even those at one place on both sides of a cut.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray, distinct
from ...exchange import Exchange, fetched, owner_of, starts_of
from .. import compat
from ..compat import basix
from ..geometry import on_all_ranks
from .among_ranks import global_numbers
from .curving import put_on_surfaces
from .lagrange import corner_geometry, corners_to_nodes, jacobians, lagrange_points, lagrange_values
from .mesh_parts import local_cells, local_facets, parts_of
from .meshes import off_chords, refuse_flat_cells
from .named_mesh import NamedMesh, without_nodes


def refined(mesh: NamedMesh, marked: npt.NDArray[Any] | None = None, curved: bool = False) -> NamedMesh:
    """The mesh with smaller cells of the same body: eight for one, or fewer round marked ones; collective.

    The body keeps its shape: new nodes are where the map of the old cells has them, which may be curved in those of
    second order, and those of faces on their surfaces, where these are known (`NamedMesh.surfaces`).  Cells are
    distributed among the ranks anew.  The `coarser` of the result gives the mesh given here.

    Args:
        mesh: A mesh of any order with its named faces and groups of cells, which are kept.
        marked: Tetrahedra to be divided in eight, this rank's own: their numbers, or True and False for each;
            their neighbours are divided in fewer.  By default all cells.
        curved: Whether new nodes of first-order meshes are on the smooth surface for which the facets stand (`arcs`),
            but for those that would make a cell flat.

    Raises:
        ValueError: On every rank, if cells are marked that are no tetrahedra or not this rank's own, or a known surface
            makes a cell flat.
    """
    comm, old, tetrahedra = mesh.comm, mesh.domain, mesh.tetrahedra
    if not (tetrahedra or marked is None):
        raise ValueError("refined: hexahedra cannot be marked, as tetrahedra can: all of them are refined")
    own = old.topology.index_map(3).size_local
    if tetrahedra:
        chosen = on_all_ranks(lambda: _chosen(marked, own), "refined: marked", comm)
        parent, corners = _bisected(_order_of_divided(old, chosen))
        first, kind = distinct(corners)
        nodes = corners[first]
    else:
        parent, kind = np.divmod(np.arange(8 * own), 8)
        nodes = _octants(old.topology.cell_type)
    finer = _made(mesh, parent, kind, nodes, off_chords(mesh) if curved and mesh.degree == 1 else None)
    if mesh.surfaces:
        cells, x = compat.cell_geometry(finer.domain), finer.domain.geometry.x
        before = x[cells]
        put_on_surfaces(finer)
        refuse_flat_cells(x[cells], f"refined: the surface of {' or '.join(mesh.surfaces)}", comm, before)
    return finer


def _chosen(marked: npt.NDArray[Any] | None, own: int) -> BoolArray:
    chosen = np.full(own, marked is None)
    if marked is None:
        return chosen
    given = np.asarray(marked)
    if given.dtype == bool and given.shape == (own,):
        return given
    if given.size == 0:
        return chosen
    if not (given.ndim == 1 and np.issubdtype(given.dtype, np.integer)):
        raise ValueError(f"must be numbers of cells, or True and False for each of this rank's {own}")
    if np.min(given) < 0 or np.max(given) >= own:
        raise ValueError(f"must be this rank's own cells, with numbers from 0 to {own - 1}")
    chosen[given] = True
    return chosen


_LEAST_LEFT: Final = 0.2
"""Least part of the volume of a cell that is left where its nodes move to a curved surface."""

_EDGES, _TRIANGLES = (np.array(basix.topology(basix.CellType.tetrahedron)[dim]) for dim in (1, 2))
_NONE = len(_EDGES)
_EDGE_OF = np.full((4 + _NONE,) * 2, _NONE)
_EDGE_OF[_EDGES[:, 0], _EDGES[:, 1]] = _EDGE_OF[_EDGES[:, 1], _EDGES[:, 0]] = np.arange(_NONE)
_AROUND = _EDGE_OF[_TRIANGLES, np.roll(_TRIANGLES, 1, axis=1)]
"""The edges around each triangle of a tetrahedron, shape (4, 3)."""


def _order_of_divided(domain: Any, marked: BoolArray) -> IntArray:
    """Whole numbers for the six edges of this rank's own tetrahedra: larger for longer edges, on all ranks in the same
    order; -1 where an edge is not divided.  Collective."""
    comm, topology, own = domain.comm, domain.topology, len(marked)
    topology.create_entities(1)
    topology.create_connectivity(3, 1)
    edges = topology.index_map(1)
    of_cell = topology.connectivity(3, 1).array.reshape(-1, _NONE)
    number = global_numbers(edges)
    starts = starts_of(comm, edges.size_local)

    ends = domain.geometry.x[corner_geometry(domain)][:, _EDGES]
    key: FloatArray = np.empty((len(number), 4))  # of equal length: by place
    key[of_cell, 0] = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    key[of_cell, 1:] = ends.mean(axis=2)
    key = fetched(comm, starts, number, key[: edges.size_local])  # since roundings can be others on another rank
    order = np.empty(len(number), dtype=np.int64)
    order[np.lexsort(key.T[::-1])] = np.arange(len(number))

    of_cell = of_cell[:own]
    triangles = of_cell[:, _AROUND]
    longest = np.take_along_axis(triangles, np.argmax(order[triangles], axis=2)[..., None], axis=2)[..., 0]
    divided: BoolArray = np.zeros(len(number), dtype=bool)
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
def _middles(cell: Any) -> IntArray:
    """The corners of a cell in whose middle each node of its second-order Lagrange functions is: one, those of an edge,
    and in hexahedra also of a face or all, repeated to 2 or 8, shape (10, 2) or (27, 8)."""
    near = lagrange_values(cell, 1, lagrange_points(cell, 2)) > 1e-9
    most = int(near.sum(axis=1).max())
    return np.array([np.flatnonzero(row).repeat(most // row.sum()) for row in near])


def _octants(cell: Any) -> IntArray:
    """The second-order nodes that are corners of the eight parts of a hexahedron, shape (8, 8)."""
    corners, nodes = lagrange_points(cell, 1), lagrange_points(cell, 2)
    x = (corners[:, None] + corners) / 2.0
    return np.argmin(np.linalg.norm(x[:, :, None] - nodes, axis=3), axis=2)


def _made(mesh: NamedMesh, parent: IntArray, kind: IntArray, nodes: IntArray, off: FloatArray | None) -> NamedMesh:
    """The mesh of cells that are parts of this rank's own cells `parent` (k,), of the given kind (k,): with corners at
    their second-order nodes `nodes` (kinds, corners), which may be `off` (cells, second-order nodes, 3) the middles of
    their corners, metres; collective."""
    comm, topology, degree, cell = mesh.comm, mesh.domain.topology, mesh.degree, mesh.domain.topology.cell_type
    corners, kinds = lagrange_points(cell, 1), _middles(cell)[nodes]
    for dim in (0, 2):
        topology.create_connectivity(3, dim)
    of_cell = global_numbers(topology.index_map(0))[topology.connectivity(3, 0).array.reshape(-1, len(corners))]
    names, X = of_cell[parent[:, None, None], kinds[kind]], corners[kinds].mean(axis=2)
    if degree == 2:
        names = _numbered(comm, names)[0][:, _middles(cell)]
        X = corners_to_nodes(cell) @ X
    x = np.empty((*names.shape[:2], 3))
    for one, places in enumerate(X):
        at = kind == one
        weights = np.round(512.0 * lagrange_values(cell, degree, places)) / 512.0  # of quarters of edges: exact
        x[at] = weights @ mesh.domain.geometry.x[compat.cell_geometry(mesh.domain)[parent[at]]]
    cells, starts = _numbered(comm, names)
    given, first = np.unique(cells, return_index=True)
    owners = Exchange(comm, owner_of(starts, given))
    points = np.empty((starts[comm.rank + 1] - starts[comm.rank], 3))
    points[owners.send(given) - starts[comm.rank]] = owners.send(x.reshape(-1, 3)[first])
    if off is not None:
        shifted = off[parent[:, None], nodes[kind]].reshape(-1, 3)[first]
        at = owners.send(given) - starts[comm.rank]
        _shift(comm, points, at, owners.send(shifted), cells, starts)

    sides = np.array(basix.topology(getattr(basix.CellType, cell.name))[2])
    on_side = np.any(sides == np.arange(len(corners))[:, None, None], axis=2)
    part_of = np.all(np.all(on_side[kinds], axis=2)[:, sides], axis=2)  # (kinds, their facets, those of the old cells)
    facets = topology.connectivity(3, 2).array.reshape(-1, len(sides))[parent]
    rows = {}
    for name, mine in mesh.faces.items():
        member = np.zeros(topology.index_map(2).size_local + topology.index_map(2).num_ghosts, dtype=bool)
        member[mine] = True
        at = np.flatnonzero(np.any(member[facets], axis=1))
        child, side = np.nonzero(np.any(part_of[kind[at]] & member[facets[at], None], axis=2))
        rows[name] = np.sort(cells[at[child, None], sides[side]], axis=1)

    domain = compat.create_mesh(comm, cell.name, cells, points, degree)
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
        grid=None,
        curved=None,
        **without_nodes(mesh),
        node_numbers=None,
    )


def _shift(
    comm: MPI.Comm, points: FloatArray, place: IntArray, shifts: FloatArray, cells: IntArray, starts: IntArray
) -> None:
    """Shift those of this rank's points `at`, but for points of cells that would be flat then; collective."""
    before, moved = points.copy(), np.zeros_like(points)
    moved[place] = shifts
    owners = Exchange(comm, owner_of(starts, cells.ravel()))
    there = owners.send(cells.ravel()) - starts[comm.rank]
    straight = jacobians(fetched(comm, starts, cells, before))[0]
    while True:
        points[:] = before + moved
        left = jacobians(fetched(comm, starts, cells, points))[0] / straight
        flat = np.any(left < _LEAST_LEFT, axis=0)
        if not comm.allreduce(bool(np.any(flat)), op=MPI.LOR):
            return
        moved[there[owners.send(np.repeat(flat, cells.shape[1]))]] = 0.0


def _numbered(comm: MPI.Comm, names: IntArray) -> tuple[IntArray, IntArray]:
    """Numbers of nodes with the keys `names` (k, n, m), in any order, shape (k, n): the same for the same key on all
    ranks; and the first number of every rank; collective."""
    keys = np.sort(names, axis=2).reshape(-1, names.shape[2])
    first, at = distinct(keys)
    hubs = Exchange(comm, keys[first, 0] % comm.size)
    there = hubs.send(keys[first])
    first, number = distinct(there)
    starts = starts_of(comm, len(first))
    numbers = hubs.reply(starts[comm.rank] + number)[at].reshape(names.shape[:2])
    return numbers, starts
