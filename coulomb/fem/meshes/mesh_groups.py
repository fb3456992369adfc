"""Which facets and cells of a distributed mesh are in groups that are given on any ranks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compat import mesh
from .exchange import Exchange, even_starts, fetched, owner_of
from .lagrange import corner_geometry
from .mesh_file import IntArray


def local_facets(domain: Any, groups: Mapping[str, IntArray]) -> dict[str, npt.NDArray[np.int32]]:
    """This rank's boundary facets of every group; collective.

    Args:
        domain: The mesh.
        groups: Facets by name, each a row of the sorted numbers of its points in the file, shape (k, corners); every
            rank gives the same names, and any of the rows.

    Returns:
        Numbers of facets; rows that are not boundary facets of this rank are left out.
    """
    if not groups:
        return {}
    comm = domain.comm
    domain.topology.create_connectivity(2, 3)
    boundary = np.sort(mesh.exterior_facet_indices(domain.topology)).astype(np.int32)
    in_file = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)  # without cells: empty, of any type
    mine = np.sort(in_file[corners_of(domain, boundary)], axis=1)
    largest = max(comm.allgather(int(max((rows.max(initial=0) for rows in (mine, *groups.values())), default=0))))
    hubs = even_starts(comm.size, largest + 1)
    ask = Exchange(comm, owner_of(hubs, mine[:, 0]))
    asked = ask.send(mine)
    faces = {}
    for name, rows in groups.items():
        given = Exchange(comm, owner_of(hubs, rows[:, 0])).send(rows)
        _, number = np.unique(np.vstack([given, asked]), axis=0, return_inverse=True)
        number = number.ravel()
        faces[name] = boundary[ask.reply(np.isin(number[len(given) :], number[: len(given)]))]
    return faces


def local_cells(domain: Any, starts: IntArray, groups: Mapping[str, IntArray]) -> dict[str, npt.NDArray[np.int32]]:
    """This rank's own cells of every group; collective.

    Args:
        domain: The mesh.
        starts: First cell of every rank, and the number of all, in the order in which the mesh was given.
        groups: Numbers of cells in this order, by name; every rank gives the same names, and any of the numbers.
    """
    comm = domain.comm
    first, last = starts[comm.rank], starts[comm.rank + 1]
    member = np.zeros((last - first, len(groups)), dtype=bool)
    for column, numbers in enumerate(groups.values()):
        member[Exchange(comm, owner_of(starts, numbers)).send(numbers) - first, column] = True
    original = np.asarray(domain.topology.original_cell_index, dtype=np.int64)[
        : domain.topology.index_map(3).size_local
    ]
    here = fetched(comm, starts, original, member) if groups else member
    return {name: np.flatnonzero(here[:, column]).astype(np.int32) for column, name in enumerate(groups)}


def corners_of(domain: Any, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    """The geometry nodes at the corners of facets of this rank, numbers of `domain.geometry.x`, shape (k, 3 or 4)."""
    topology = domain.topology
    for dim in ((2, 0), (3, 0)):
        topology.create_connectivity(*dim)
    vertices = topology.connectivity(3, 0).array
    of_vertex = np.empty(int(vertices.max(initial=-1)) + 1, dtype=np.int64)
    of_cell = corner_geometry(domain)  # there may be no cell on this rank
    of_vertex[vertices] = of_cell.ravel()
    of_facet = topology.connectivity(2, 0).array.reshape(-1, 3 if of_cell.shape[1] == 4 else 4)
    corners: npt.NDArray[np.int64] = of_vertex[of_facet[facets]]
    return corners
