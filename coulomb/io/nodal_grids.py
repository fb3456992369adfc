"""The meshes of the result files, with the nodes of the displacements as points, and the names of their fields; those
of the contact points are in `contact_fields`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..contact_fields import names
from ..fem import compat
from ..fem.bodies import FIELDS, HELD_OBLIQUE, STRESSES, TEMPERATURE, DisplacementSpace
from ..fem.meshes import FACETS, SOLIDS, fetched, in_vtk_order, nodes_between, starts_of
from ..model.master_fields import CARRIED
from .grid_file import GridPart

ON_CELLS = STRESSES
"""Fields of solution.h5, one number per cell; besides those of `cell_materials`."""

ON_BODY = ("displacement", "load", "held", "prescribed", "spring_force")
"""Fields of solution.h5, one vector per node."""

INTERNAL, ROUNDING = "internal_force", "rounding_force"
"""Fields of solution.h5 of a body of the user's forms, which are not in the files: its internal forces, and those of a
rounding error of the displacement (`rounding_forces`)."""

GROUND = tuple(f"rigid_force_{number}" for number in range(1, 7))
"""The nodal forces of the rigid motions of a body with springs or Robin terms: `Deformable.ground`."""

OURS = (*ON_CELLS, *ON_BODY, *FIELDS, *GROUND, HELD_OBLIQUE, INTERNAL, ROUNDING, TEMPERATURE)
"""All names of fields of solution.h5."""

ON_OPPOSITE = (*CARRIED, "status", "contact_force", "normal", "area")
"""Fields of contact.h5 on faces opposite in pairs, beside `OPPOSITE`."""


BETWEEN: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    **dict.fromkeys(names(between="least"), np.minimum),
    **dict.fromkeys(names(between="most"), np.maximum),
}
"""Fields that are whole numbers: their values between two vertices of 10-node tetrahedra; of others the means."""


def body_grid(space: DisplacementSpace) -> GridPart:
    """The cells of a body, whose order is that of the displacements."""
    own = space.domain.topology.index_map(3).size_local
    cells = in_vtk_order(_global(space, compat.cell_dofs(space.V)[:own]), "dolfinx")
    return GridPart(SOLIDS[cells.shape[1]], cells, space.x)


def cell_values(functions: Sequence[Any]) -> dict[str, FloatArray]:
    """By name, the values (c,) or (c, 3) of functions that are constant on every cell, in this rank's own cells."""
    found = {}
    for function in functions:
        W = function.function_space
        own = compat.cell_dofs(W)[: W.mesh.topology.index_map(3).size_local, 0]
        rows = function.x.array.reshape(-1, W.dofmap.bs)[own]
        found[function.name] = rows if rows.shape[1] > 1 else rows[:, 0]
    return found


def middle(one: FloatArray, other: FloatArray) -> FloatArray:
    """The mean of two values."""
    mean: FloatArray = 0.5 * (one + other)
    return mean


class FaceGrid:
    """The facets of contact faces with the nodes on them.

    Args:
        space: The displacements of the body.
        facets: This rank's facets of all faces.

    Attributes:
        grid: The mesh.
    """

    def __init__(self, space: DisplacementSpace, facets: npt.NDArray[np.int32]):
        self._space, self._nodes = space, space.nodes_of(facets)
        cell, columns = space.in_cells(facets)
        nodes = compat.cell_dofs(space.V)[cell[:, None], columns]
        comm = space.domain.comm
        position = np.full(len(space.x), -1, dtype=np.int64)  # of this rank's nodes among those of the faces
        position[self._nodes] = starts_of(comm, len(self._nodes))[comm.rank] + np.arange(len(self._nodes))
        cells = fetched(comm, starts_of(comm, len(space.x)), _global(space, nodes), position)
        self.grid = GridPart(FACETS[columns.shape[1]], cells, space.x[self._nodes])

    def at(self, field: FloatArray) -> FloatArray:
        """A field at this rank's nodes, shape (k,) or (k, 3), at those of the faces."""
        values: FloatArray = field[self._nodes]
        return values

    def values(self, field: FloatArray, between: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        """A field at this rank's nodes, shape (k,) or (k, 3), at those of the faces; collective.

        Args:
            field: The values; on 10-node tetrahedra those at vertices are used.
            between: On 10-node tetrahedra, the value in the middle of an edge by those at its two ends.
        """
        if self._space.positive:
            return field[self._nodes]
        width = 1 if field.ndim == 1 else 3
        columns = np.broadcast_to(field.reshape(-1, width), (len(field), 3)) if width == 1 else field
        everywhere = self._space.function(columns).x.array.reshape(-1, 3)[:, :width].copy()
        cells = in_vtk_order(compat.cell_dofs(self._space.V).astype(np.int64), "dolfinx")
        for column, (one, other) in nodes_between(cells.shape[1]):
            everywhere[cells[:, column]] = between(everywhere[cells[:, one]], everywhere[cells[:, other]])
        values: FloatArray = everywhere[self._nodes].reshape(-1, *field.shape[1:])
        return values


def _global(space: DisplacementSpace, nodes: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    numbers = space.V.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
    found: npt.NDArray[np.int64] = np.asarray(numbers, dtype=np.int64).reshape(nodes.shape)
    return found
