"""Second-order meshes from first-order ones: nodes at the middles of edges, in hexahedra also of faces and cells."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, IntArray
from .. import compat
from .exchange import starts_of
from .lagrange import corner_geometry, lagrange_points, lagrange_values
from .mesh_parts import corners_of, local_cells, local_facets
from .named_mesh import NamedMesh


def raised(mesh: NamedMesh) -> NamedMesh:
    """The mesh with 10-node tetrahedra or 27-node hexahedra of the same corners; collective.

    The shape of the body does not change: the new nodes are at the middles of the straight edges, and those of
    hexahedra also where the trilinear map has the middles of faces and cells.

    Args:
        mesh: A first-order mesh with its named faces and groups of cells, which are kept.

    Raises:
        ValueError: If the mesh is of second order already.
    """
    old, comm = mesh.domain, mesh.comm
    if mesh.degree != 1:
        raise ValueError("raised: the mesh has second-order cells already; raised takes a first-order mesh")
    own = old.topology.index_map(3).size_local
    V = compat.functionspace(old, 2)
    dofs, number = compat.cell_dofs(V), _global_numbers(V.dofmap.index_map)
    kind = old.topology.cell_type
    points = _points(old, dofs, V.dofmap.index_map.size_local)
    domain = compat.create_mesh(comm, kind.name, number[dofs[:own]], points, degree=2)

    corners = corner_geometry(old)
    of_point = np.zeros(len(old.geometry.x), dtype=np.int64)
    of_point[corners] = number[dofs[:, : corners.shape[1]]]
    rows = {name: np.sort(of_point[corners_of(old, facets)], axis=1) for name, facets in mesh.faces.items()}
    first = old.topology.index_map(3).local_range[0]
    cells = {name: first + np.asarray(mine, dtype=np.int64) for name, mine in mesh.cells.items()}
    starts = starts_of(comm, own)
    return replace(mesh, domain=domain, faces=local_facets(domain, rows), cells=local_cells(domain, starts, cells))


def _global_numbers(index_map: Any) -> IntArray:
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    return np.asarray(index_map.local_to_global(local), dtype=np.int64)


def _points(domain: Any, dofs: npt.NDArray[np.int32], owned: int) -> FloatArray:
    """Places of this rank's own nodes, shape (owned, 3), the corners exactly those of the mesh."""
    kind = domain.topology.cell_type
    weights = np.round(8.0 * lagrange_values(kind, 1, lagrange_points(kind, 2))) / 8.0  # 1, 1/2, 1/4, 1/8
    in_cells = np.einsum("nc,kci->kni", weights, domain.geometry.x[corner_geometry(domain)])
    points = np.empty((owned, 3))
    mine = dofs < owned
    points[dofs[mine]] = in_cells[mine]
    return points
