"""Points of a body found in its mesh, where nodal fields are interpolated by the shape functions of their cells.

A point outside the mesh by less than `SNAP` of the cell beside it is taken for the nearest point of the boundary, so
that points of a curved surface, of which the mesh has the chords, are found.  A point as near to a contact face is on
that face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray, in_words
from ...units import amount
from ..cell_search import ROUNDING, CellSearch
from ..compat import cell_dofs, cell_geometry
from ..geometry import nearest_points
from ..meshes import boundary_facets, corner_geometry, lagrange_points, lagrange_values
from .displacement_space import DisplacementSpace

SNAP: Final = 0.05
"""Distance from the boundary that is none, relative to the shortest edge of the cell beside it."""

_ALONG: Final = np.array([1.0, 0.7548776662, 0.5698402910])
"""A direction of no mesh, along which cells beside each other have their middles at different places: by it the choice
between them is the same on any number of ranks."""


@dataclass(frozen=True, eq=False)
class Interpolation:
    """Nodes (p, n) among this rank's, ghosts included, and their weights, by which a nodal field is interpolated at
    points; 0 for points that another rank interpolates."""

    nodes: IntArray
    weights: FloatArray

    def of(self, values: FloatArray, comm: MPI.Comm) -> FloatArray:
        """Vectors at the points, shape (p, 3), on every rank, from those at the nodes, ghosts included; collective."""
        mine = np.einsum("pn,pnj->pj", self.weights, np.where(self.weights[:, :, None] != 0.0, values[self.nodes], 0.0))
        return comm.allreduce(mine)


@dataclass(frozen=True, eq=False)
class LocatedPoints:
    """Points of a body; the same on every rank, except the interpolations.

    Attributes:
        x: Where they are, shape (p, 3): as given, or at the boundary nearby.
        body: By the shape functions of a cell.
        faces: Number of the contact face that a point is on, -1 for none, shape (p,).
        surface: By the shape functions of a facet of that face; only zeros for other points.
    """

    x: FloatArray
    body: Interpolation
    faces: IntArray
    surface: Interpolation


def locate(
    points: FloatArray, names: Sequence[str], body: DisplacementSpace, faces: Sequence[Int32Array]
) -> LocatedPoints:
    """Find points (p, 3), the same on every rank, in the mesh of a body; `faces` are this rank's facets of each contact
    face; collective.

    Raises:
        ValueError: On every rank, if a point is outside the mesh, with its name, the nearest point and its distance.
    """
    comm, cells = body.domain.comm, _Cells(body)
    boundary = cells.facets(boundary_facets(body.domain))
    contact = [cells.facets(np.asarray(facets)) for facets in faces]
    count, corners = len(points), cells.dofs.shape[1]
    x, on_face = points.copy(), np.full(count, -1)
    inside = Interpolation(np.zeros((count, corners), dtype=np.int64), np.zeros((count, corners)))
    on_surface = Interpolation(inside.nodes.copy(), inside.weights.copy())
    for k, point in enumerate(points):
        cell, X, along = cells.containing(point)
        along, owner = comm.allreduce((along, comm.rank), op=MPI.MINLOC)
        if not np.isfinite(along):
            at, distance, facet = boundary.nearest(point)
            outside, owner = comm.allreduce((distance, comm.rank), op=MPI.MINLOC)
            x[k], near = comm.bcast((at, distance <= SNAP * boundary.size[facet] if facet >= 0 else False), root=owner)
            if not near:
                raise ValueError(
                    f"{names[k]}: the point ({in_words(point)}) is outside the body; the nearest point of the body is "
                    f"({in_words(x[k])}), at a distance of {amount(outside)}"
                )
            if comm.rank == owner:
                cell = int(boundary.cell[facet])
                X = cells.reference(cell, x[k])
        if comm.rank == owner:
            inside.nodes[k], inside.weights[k] = cells.dofs[cell], _without_rounding(cells.shape(np.clip(X, 0.0, 1.0)))
        for number, face in enumerate(contact):
            at, distance, facet = face.nearest(x[k])
            distance = distance if facet >= 0 and distance <= SNAP * face.size[facet] else np.inf
            nearest, owner = comm.allreduce((distance, comm.rank), op=MPI.MINLOC)
            if np.isfinite(nearest) and on_face[k] < 0:
                on_face[k] = number
                beside = comm.bcast(distance <= ROUNDING * face.size[facet] if facet >= 0 else False, root=owner)
                if beside:  # where bodies touch, it is in that of the face
                    inside.weights[k] = 0.0
                if comm.rank == owner:
                    cell = int(face.cell[facet])
                    weights = cells.on_facet(cells.reference(cell, at), face.corners[facet])
                    on_surface.nodes[k], on_surface.weights[k] = cells.dofs[cell], _without_rounding(weights)
                    if beside:
                        inside.nodes[k], inside.weights[k] = on_surface.nodes[k], on_surface.weights[k]
    return LocatedPoints(x, inside, on_face, on_surface)


def _without_rounding(weights: FloatArray) -> FloatArray:
    """Weights that add up to 1, those of rounding errors 0: no open node has a pressure of 1e-20 Pa."""
    clean: FloatArray = np.where(np.abs(weights) > 1e-14, weights, 0.0)
    clean /= clean.sum()
    return clean


class _Cells:
    """The cells of this rank, hexahedra or tetrahedra; mesh and displacements are of first or second order."""

    def __init__(self, body: DisplacementSpace):
        domain = body.domain
        self._domain, self._kind = domain, domain.topology.cell_type
        self._degree, self._search = body.degree, CellSearch(domain)
        self._x: FloatArray = domain.geometry.x
        self._nodes, self._corners, self.dofs = cell_geometry(domain), corner_geometry(domain), cell_dofs(body.V)

    def containing(self, point: FloatArray) -> tuple[int, FloatArray, float]:
        """This rank's own cell that holds a point, of several, as where bodies touch, the first along `_ALONG`: its
        number, the reference coordinates, and where it is along it; infinite if there is none."""
        near = self._search.near(point[None])
        here = np.flatnonzero(near.outside <= ROUNDING)
        if not len(here):
            return -1, np.zeros(3), np.inf
        along = self._x[self._nodes[near.cell[here]]].mean(axis=1) @ _ALONG
        k = here[np.argmin(along)]
        return int(near.cell[k]), near.X[k], float(np.min(along))

    def reference(self, cell: int, point: FloatArray) -> FloatArray:
        """Reference coordinates of a point in a cell, those outside of it at its border."""
        X, _ = self._search.reference(np.array([cell], dtype=np.int32), point[None])
        return np.clip(X[0], 0.0, 1.0)

    def shape(self, X: FloatArray) -> FloatArray:
        """Shape functions of the displacements at reference coordinates X (3,)."""
        return lagrange_values(self._kind, self._degree, X[None])[0]

    def on_facet(self, X: FloatArray, corners: BoolArray) -> FloatArray:
        """The shape functions at X of the nodes on the facet with these corners of the cell, 0 for other nodes."""
        linear = lagrange_values(self._kind, 1, lagrange_points(self._kind, self._degree))
        beside = np.any(np.abs(linear[:, ~corners]) > 1e-9, axis=1)
        return np.where(beside, 0.0, self.shape(X))

    def facets(self, facets: npt.NDArray[Any]) -> _Facets:
        topology = self._domain.topology
        for dims in ((2, 0), (3, 0), (2, 3)):
            topology.create_connectivity(*dims)
        of_facet, of_cell, beside = (topology.connectivity(*dims) for dims in ((2, 0), (3, 0), (2, 3)))
        cell: IntArray = np.asarray(beside.array[beside.offsets[facets]], dtype=np.int64)
        vertices = of_cell.array.reshape(-1, self._corners.shape[1])[cell]
        own = of_facet.array.reshape(-1, 3 if self._corners.shape[1] == 4 else 4)[facets]
        corners = np.any(vertices[:, :, None] == own[:, None, :], axis=2)
        x = self._x[self._corners[cell]]
        i, j = np.triu_indices(x.shape[1], 1)
        return _Facets(x, cell, corners, np.linalg.norm(x[:, i] - x[:, j], axis=2).min(axis=1))


class _Facets:
    """Boundary facets as triangles, of quadrilaterals both halves.

    Attributes:
        x: Corners of the cell beside each facet, shape (f, n, 3).
        cell: Number of that cell, shape (f,).
        corners: Which corners of the cell are the facet's, shape (f, n).
        size: Smallest distance between corners of the cell, shape (f,).
    """

    def __init__(self, x: FloatArray, cell: IntArray, corners: BoolArray, size: FloatArray):
        self.cell, self.corners, self.size = cell, corners, size
        # of a quadrilateral in the order (0, 0), (1, 0), (0, 1), (1, 1)
        own = x[corners].reshape(len(x), 3 if x.shape[1] == 4 else 4, 3)
        halves = [(0, 1, 2)] if own.shape[1] == 3 else [(0, 1, 3), (0, 3, 2)]
        self._triangles = np.concatenate([own[:, half] for half in halves])

    def nearest(self, point: FloatArray) -> tuple[FloatArray, float, int]:
        """The nearest point of the facets, its distance, and the facet; infinite and -1 if there are none."""
        if not len(self._triangles):
            return point, np.inf, -1
        nearest, _ = nearest_points(point, self._triangles)
        distance = np.linalg.norm(nearest - point, axis=1)
        k = int(np.argmin(distance))
        rounding = 1e-15 * np.max(np.abs(self._triangles))
        point_on: FloatArray = np.where(np.abs(nearest[k]) <= rounding, 0.0, nearest[k])
        return point_on, float(distance[k]), k % len(self.cell)
