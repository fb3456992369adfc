"""A scalar field from a file, as a temperature or a gap, with its own mesh, interpolated at the nodes of the body.

A point that is a node of the field's mesh has its value exactly; elsewhere the field is linear in tetrahedra, into
which other cells are split.  No interpolator of SciPy keeps the cells: its Delaunay triangulation fills slots and
hollows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, IntArray, in_words
from ...nearest import tree_of
from ...regular_file import read_bytes
from .. import compat
from ..cell_search import boxes
from ..compat import geometry
from ..geometry import first_place
from .meshio_format import by_meshio
from .xdmf_format import array_of, xml_of

Parts = Sequence[tuple[str, IntArray]]
"""Cells by kind: rows of node numbers, the corners first."""

_CUBE = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
_HALVED = (
    *((0, 4, 6, 7), (1, 5, 4, 8), (2, 6, 5, 9), (3, 8, 7, 9)),
    *((4, 9, 6, 7), (4, 9, 7, 8), (4, 9, 8, 5), (4, 9, 5, 6)),
)
_SPLIT = {
    "tet": ((0, 1, 2, 3),),
    "hex": _CUBE,
    "wed": ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)),
    "pyr": ((0, 1, 2, 4), (0, 2, 3, 4)),
}
"""Tetrahedra of a cell by the beginning of its kind's name, in VTK's order of nodes."""

_MESHIO = {".vtu": "vtu", ".vtk": "vtk", ".msh": "gmsh", ".med": "med", ".e": "exodus", ".exo": "exodus"}
"""meshio's name of the format, by the end of the file's name."""


def read_nodal_field(path: str, field: str) -> tuple[FloatArray, IntArray, FloatArray]:
    """Points (n, 3) in the file's unit of length, tetrahedra (t, 4), and the values of a field (n,); errors as of
    `NodalField.from_file`."""
    kind = Path(path).suffix.lower()
    if kind not in (".xdmf", *_MESHIO):
        raise ValueError(f"{path}: a field is read from files that end in .xdmf, {', '.join(_MESHIO)}")
    try:
        points, cells, values = _xdmf(path, field) if kind == ".xdmf" else _meshio(path, field, _MESHIO[kind])
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
    values = np.squeeze(values)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{path}: has points in {points.shape[-1]}D, but a field in 3D is needed")
    if values.shape != (len(points),):
        raise ValueError(f"{path}: {field} must be one number per node, but has shape {values.shape}")
    split = [rows[:, part] for name, rows in cells for part in _parts(name, rows.shape[1])]
    if not split:
        listed = ", ".join(name for name, _ in cells) or "none"
        raise ValueError(f"{path}: has no solid cells, in which {field} could be interpolated (cells: {listed})")
    return points.astype(np.float64), np.concatenate(split).astype(np.int64), values.astype(np.float64)


def _parts(kind: str, width: int) -> Sequence[tuple[int, ...]]:
    """Tetrahedra of a kind of cell, none of a flat one."""
    return _HALVED if kind[:3] == "tet" and width == 10 else _SPLIT.get(kind[:3], ())


def _missing(path: str, field: str, there: Sequence[str]) -> ValueError:
    listed = ", ".join(map(repr, dict.fromkeys(there))) or "none"
    return ValueError(f"{path}: has no field {field!r} with values at nodes; it has {listed}")


def _meshio(path: str, field: str, form: str) -> tuple[FloatArray, Parts, FloatArray]:
    mesh = by_meshio(path, read_bytes(path), form)
    if field not in mesh.point_data:
        raise _missing(path, field, list(mesh.point_data))
    cells = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
    return np.asarray(mesh.points), cells, np.asarray(mesh.point_data[field], dtype=np.float64)


def _xdmf(path: str, field: str) -> tuple[FloatArray, Parts, FloatArray]:
    tree = xml_of(path)
    nodal = [one for one in tree.iter("Attribute") if (one.get("Center") or "Node").lower() == "node"]
    named = [one for one in nodal if one.get("Name") == field]
    if not named:
        raise _missing(path, field, [str(one.get("Name")) for one in nodal])
    if len(named) > 1:
        raise ValueError(f"{path}: has {field!r} at {len(named)} times; write a file with one of them")
    geometry = next(tree.iter("Geometry"), None)
    topologies = [one for one in tree.iter("Topology") if one.find("DataItem") is not None]
    if geometry is None or not topologies:
        raise ValueError(f"{path}: has no mesh")
    kind = str(topologies[0].get("TopologyType") or topologies[0].get("Type")).lower()
    rows = array_of(path, topologies[0]).astype(np.int64)
    if rows.ndim != 2:
        raise ValueError(f"{path}: has cells of kind {kind}, which are not read here; write tetrahedra or hexahedra")
    return array_of(path, geometry), [(kind, rows)], array_of(path, named[0])


SNAP: Final = 0.25
"""Distance outside a cell, relative to its mean edge, up to which its values are taken: the field's mesh may have other
chords of a curved surface than that of the body."""

_SAME: Final = 1e-9
"""Distance, relative to the extent of the field, up to which a point is a node of its mesh."""

_INTO: Final = 1e-3
"""Part of the way from a node to the middle of a cell at which the part of the field is looked for."""


@dataclass(frozen=True, eq=False)
class NodalField:
    """A number at each node of a mesh, as temperatures or gaps; a function of place, as `ContactProblem` and `Contact`
    take it.

    Attributes:
        points: Nodes of the mesh in metres, shape (n, 3).
        tetrahedra: Its cells, split into tetrahedra, rows of node numbers, shape (t, 4).
        values: Numbers at the nodes, shape (n,): temperatures in kelvin or degrees Celsius, gaps in metres.
        name: What messages call it.

    Raises:
        ValueError: If a value is not finite, or the arrays do not match.
    """

    points: FloatArray
    tetrahedra: IntArray
    values: FloatArray
    name: str = "the field"

    def __post_init__(self) -> None:
        count = len(self.points)
        if self.points.shape != (count, 3) or self.values.shape != (count,) or not count:
            raise ValueError(f"{self.name}: {self.values.shape} values do not match points {self.points.shape}")
        if not np.all(np.isfinite(self.values)) or not np.all(np.isfinite(self.points)):
            raise ValueError(f"{self.name}: has entries that are not finite")
        cells = self.tetrahedra
        if cells.ndim != 2 or cells.shape[1] != 4 or not len(cells) or not 0 <= cells.min() <= cells.max() < count:
            raise ValueError(f"{self.name}: its tetrahedra must be rows of four node numbers below {count}")

    @classmethod
    def from_file(cls, path: str | Path, field: str, scale: float = 1.0) -> NodalField:
        """Read numbers at nodes from a file, on every rank by itself.

        Args:
            path: XDMF (of DOLFINx or meshio), or a format that meshio reads: VTU, VTK, gmsh, MED, Exodus.
            field: Name of the field, one number per node.
            scale: Metres per unit of length of the file.

        Raises:
            ValueError: If the file cannot be read, or has no such field or no solid cells, with the fields it has.
        """
        points, tetrahedra, values = read_nodal_field(str(path), field)
        return cls(scale * points, tetrahedra, values, f"{path}: {field}")

    def __call__(self, x: FloatArray) -> FloatArray:
        """Values at points x (3, k) in metres, shape (k,).

        Raises:
            ValueError: If a point is outside the mesh of the field, with its place.
        """
        points = np.ascontiguousarray(x.T)
        distance, node = self._nodes.query(points)
        interpolated: FloatArray = self.values[node]
        missing = np.flatnonzero(distance > _SAME * np.max(np.ptp(self.points, axis=0)))
        if len(missing):
            interpolated[missing] = self._interpolated(points[missing])
        return interpolated

    def at_nodes(self, x: FloatArray, inside: FloatArray) -> FloatArray:
        """Values at the nodes x (k, 3) of a mesh, shape (k,); where parts touch, and the field has several nodes at the
        place, that of the part with the node: `inside` is the middle of a cell of it, shape (k, 3).  Errors as of a
        call."""
        at_given = self(x.T)
        given = self._nodes.query(x, k=2)[0][:, -1] <= _SAME * np.max(np.ptp(self.points, axis=0))
        cell, _ = self._cells.nearest(x[given] + _INTO * (inside - x)[given])
        nodes = self._cells.rows[cell]
        nearest = np.argmin(np.linalg.norm(self.points[nodes] - x[given, None], axis=2), axis=1)
        at_given[given] = np.where(cell < 0, at_given[given], self.values[nodes[np.arange(len(nodes)), nearest]])
        return at_given

    @cached_property
    def _nodes(self) -> Any:
        return tree_of(self.points)

    @cached_property
    def _cells(self) -> _Cells:
        return _Cells(self.points, self.tetrahedra)

    def _interpolated(self, x: FloatArray) -> FloatArray:
        """Values at points (k, 3) that are no nodes."""
        cell, weights = self._cells.nearest(x)
        if np.any(cell < 0):
            low, high = (in_words(end(self.points, axis=0)) for end in (np.min, np.max))
            raise ValueError(
                f"{self.name} does not cover the body: it has no cell at x = {first_place(x, cell < 0)}; its points "
                f"are between ({low}) and ({high}) metres (is scale, the metres per unit of length, right?)"
            )
        nodes = self._cells.rows[cell]
        return np.einsum("ki,ki->k", weights, self.values[nodes])


class _Cells:
    """Tetrahedra of some volume, rows of four nodes, and DOLFINx's search for the nearest one to a point, by distances
    whose errors are of a given size: edges are near 1 there."""

    def __init__(self, points: FloatArray, rows: IntArray):
        x = points[rows]
        i, j = np.triu_indices(4, 1)
        edge = np.linalg.norm(x[:, i] - x[:, j], axis=2).mean(axis=1)
        solid = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) > 1e-12 * edge**3
        self._low, self._unit = x[solid].min(axis=(0, 1)), float(np.median(edge[solid]))
        used, nodes = np.unique(rows[solid], return_inverse=True)
        self._mesh = compat.create_mesh(MPI.COMM_SELF, "tetrahedron", nodes.reshape(-1, 4), self._placed(points[used]))
        cells = np.arange(np.sum(solid), dtype=np.int32)
        self._boxes, self._middles = boxes(self._mesh, len(cells)), geometry.create_midpoint_tree(self._mesh, 3, cells)
        order = np.asarray(self._mesh.topology.original_cell_index)
        self.rows, self._corners = rows[solid][order], self._placed(x[solid][order])
        self._snap = SNAP * edge[solid][order] / self._unit

    def _placed(self, x: FloatArray) -> FloatArray:
        return (x - self._low) / self._unit

    def nearest(self, x: FloatArray) -> tuple[IntArray, FloatArray]:
        """The tetrahedron nearest to each point (k, 3), -1 where none is near, shape (k,), and the weights of its
        nodes, shape (k, 4); of a point outside those of the nearest point of the boundary."""
        points = self._placed(x)
        cell = geometry.compute_closest_entity(self._boxes, self._middles, self._mesh, points).astype(np.int64)
        corners, beyond = self._corners[cell], np.zeros(len(x))
        for k in np.flatnonzero(_shares(points, corners).min(axis=1) < 0.0):
            off = geometry.compute_distance_gjk(corners[k], points[k])
            points[k] += off
            beyond[k] = np.linalg.norm(off)
        return np.where(beyond <= self._snap[cell], cell, -1), _shares(points, corners)


def _shares(x: FloatArray, corners: FloatArray) -> FloatArray:
    """Barycentric coordinates of points (k, 3) in tetrahedra with these corners (k, 4, 3), shape (k, 4)."""
    edges = (corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    inner = np.linalg.solve(edges, (x - corners[:, 0])[:, :, None])[:, :, 0]
    return np.column_stack([1.0 - inner.sum(axis=1), inner])
