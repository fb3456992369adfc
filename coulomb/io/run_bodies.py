"""The bodies in the files of a run, on one rank."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components

from ..arrays import FloatArray
from ..fem import compat
from ..fem.bodies import (
    FIELDS,
    HELD_OBLIQUE,
    TEMPERATURE,
    TIE_STRESSES,
    VECTORS,
    CellMaterials,
    DisplacementSpace,
    ElasticBody,
)
from ..fem.meshes import MeshFile, corners_of, distributed, inspect
from ..nearest import in_a_cell, same_nodes, tree_of
from .field_files import data_of, grids_of, read_fields
from .result_grids import GROUND, INTERNAL, ON_BODY, ON_CELLS, ROUNDING, TIE_FORCE
from .run_directory import OLD, SOLUTION

_NEAR: Final = 1e-9
"""Distance of points at the same place, over the extent of the mesh."""


def places(points: FloatArray, wanted: FloatArray) -> npt.NDArray[np.int64]:
    """Number of every wanted point (q, d) among the points (k, d), none of which are at one place, matched to 1e-9 of
    their extent; -1 for one that is not among them."""
    if not len(points):
        return np.full(len(wanted), -1)
    distance, number = tree_of(points).query(wanted)
    near = distance <= _NEAR * float(np.max(np.ptp(points, axis=0)))
    return np.where(near, number, -1).astype(np.int64)


def nodes_in(
    x: FloatArray, rows: npt.NDArray[np.integer[Any]], points: FloatArray, others: npt.NDArray[np.integer[Any]]
) -> npt.NDArray[np.int64]:
    """Number of every node x (k, 3) of the cells `rows` among the points (n, 3) of the same cells, `others`, with other
    numbers (`same_nodes`); -1 for one that is not among them."""
    if not len(points):
        return np.full(len(x), -1)
    return same_nodes(x, in_a_cell(x, rows), points, others, _NEAR * float(np.max(np.ptp(points, axis=0))))


def midpoints(domain: Any) -> FloatArray:
    """Midpoints of the cells of a mesh on one rank, metres, shape (c, 3)."""
    middle: FloatArray = domain.geometry.x[compat.cell_geometry(domain)].mean(axis=1)
    return middle


def midpoints_of_facets(body: DisplacementSpace, facets: npt.NDArray[np.int32]) -> FloatArray:
    """Midpoints of boundary facets of a body on one rank and of the cells beside them, which tell facets at one place
    apart, metres, shape (f, 6)."""
    domain = body.domain
    domain.topology.create_connectivity(2, 3)
    beside = domain.topology.connectivity(2, 3)
    cell = beside.array[beside.offsets[facets]]  # a boundary facet has one
    return np.hstack([domain.geometry.x[corners_of(domain, facets)].mean(axis=1), midpoints(domain)[cell]])


Fields = dict[str, FloatArray]


class RecordedBody(DisplacementSpace):
    """A body of the user's forms, of which only the internal forces are known, on the mesh in the files, with the nodes
    of the displacements as points.

    Attributes:
        internal: The internal forces as recorded, at its nodes, newtons, shape (k, 3).
    """

    def __init__(self, domain: Any):
        super().__init__(compat.functionspace(domain, compat.geometry_degree(domain), (3,)))
        self.internal = np.zeros_like(self.x)

    def internal_force(self, u: FloatArray) -> FloatArray:
        """The internal forces as recorded, whatever the displacement is."""
        return self.internal


@dataclass(frozen=True)
class WrittenBody:
    """One of the bodies.

    Attributes:
        name: Its name; "" if it is the only one.
        points: Its nodes in the order of the file, shape (p, 3).
        cells: Their numbers per cell, in the order of the file.
        body: The body with the materials of the files, or with the recorded internal forces of the user's forms; its
            nodes may be in another order.
        in_file: Number in the file of every node of `body`, shape (p,).
        on_cells: Fields of the cells, in the order of `body.domain`, shape (c,).
        nodes: Its nodes among those of all bodies.
    """

    name: str
    points: FloatArray
    cells: npt.NDArray[np.int64]
    body: ElasticBody | RecordedBody
    in_file: npt.NDArray[np.int64]
    on_cells: Fields
    nodes: slice

    @property
    def elastic(self) -> ElasticBody | None:
        """The body with its materials; None if it is of the user's forms."""
        return self.body if isinstance(self.body, ElasticBody) else None

    def nodes_in(self, other: DisplacementSpace) -> npt.NDArray[np.int64]:
        """Number of every node among those of the same body elsewhere, -1 for one that is not there, shape (p,)."""
        return nodes_in(self.body.x, compat.cell_dofs(self.body.V), other.x, compat.cell_dofs(other.V))


class WrittenBodies:
    """All bodies together: the nodes of the first, then those of the second, ...

    Attributes:
        parts: The bodies.
        x: Coordinates of the nodes in metres, shape (k, 3).
        comm: The rank.
    """

    def __init__(self, parts: Sequence[WrittenBody]):
        self.parts, self.comm = tuple(parts), MPI.COMM_SELF
        self.x: FloatArray = np.concatenate([part.body.x for part in parts])

    @property
    def slices(self) -> dict[str, slice]:
        """The nodes of each body by name, if there are several; else empty."""
        return {part.name: part.nodes for part in self.parts} if len(self.parts) > 1 else {}

    @property
    def elastic(self) -> bool:
        """Whether the materials of all bodies are known: none is of the user's forms."""
        return all(part.elastic is not None for part in self.parts)

    def each(self, values: FloatArray) -> Iterator[tuple[WrittenBody, FloatArray]]:
        """Every body with its part of nodal values."""
        for part in self.parts:
            yield part, values[part.nodes]

    def internal_force(self, u: FloatArray) -> FloatArray:
        """Internal nodal forces of u in newtons, shapes (k, 3); of the user's forms as recorded."""
        return np.concatenate([part.body.internal_force(own) for part, own in self.each(u)])

    def largest_gradient(self, u: FloatArray) -> float:
        """Largest norm of the displacement gradient of u (k, 3) in a cell."""
        return float(np.max([part.body.largest_gradient(own) for part, own in self.each(u)]))

    def has_meshes_of(self, other: WrittenBodies) -> bool:
        """Whether the meshes are the same objects as those of other files."""
        pairs = zip(self.parts, other.parts, strict=False)
        return len(self.parts) == len(other.parts) and all(a.body.domain is b.body.domain for a, b in pairs)

    def numbers_in(self, others: Sequence[DisplacementSpace], unfit: str) -> npt.NDArray[np.int64]:
        """The number of every node among those of the same bodies elsewhere, one body after the other, shape (k,).

        Raises:
            ValueError: If a node is not there, with the text `unfit`.
        """
        if len(others) != len(self.parts):
            raise ValueError(unfit)
        found, start = [], 0
        for part, other in zip(self.parts, others, strict=True):
            number = part.nodes_in(other)
            if np.any(number < 0):
                raise ValueError(unfit)
            found.append(start + number)
            start += len(other.x)
        return np.concatenate(found)

    @cached_property
    def component(self) -> npt.NDArray[np.int64]:
        """Component of the meshes of each node: cells that share nodes are in one; shape (k,)."""
        found, before = [], 0
        for part in self.parts:
            cells = compat.cell_dofs(part.body.V)
            rows = np.repeat(cells[:, 0], cells.shape[1] - 1), cells[:, 1:].ravel()
            size = len(part.body.x)
            joined = scipy.sparse.coo_matrix((np.ones(len(rows[0])), rows), shape=(size, size))
            count, of_node = connected_components(joined, directed=False)
            found.append(before + of_node.astype(np.int64))
            before += count
        return np.concatenate(found)

    @property
    def spaces(self) -> list[DisplacementSpace]:
        """Every body on its mesh."""
        return [part.body for part in self.parts]


def read_bodies(file: Path, folder: Path, forms: Any, like: WrittenBodies | None) -> tuple[WrittenBodies, Fields]:
    """The bodies of solution.xdmf, and the fields at their nodes; the folder is for messages.

    `forms` is the entry of this name of summary.json, None if no body is of the user's forms.  The meshes of another
    run, `like`, are reused if they are identical.

    Raises:
        ValueError: If a file cannot be read or does not match the others.
        OSError, KeyError, IndexError, RuntimeError, TypeError: If a file is incomplete.
    """
    grids, read = grids_of(file), []
    known = {} if like is None else {part.name: part for part in like.parts}
    for name, group in grids.items():
        of_forms = forms is not None and (not name or name in forms)
        read.append(_read_body(file, folder, name, group, of_forms, known.get(name)))
    ends = np.cumsum([0, *(len(body.points) for body, _ in read)])
    parts = [replace(body, nodes=slice(int(a), int(b))) for (body, _), (a, b) in zip(read, pairwise(ends), strict=True)]
    names = dict.fromkeys(name for _, fields in read for name in fields)
    return WrittenBodies(parts), {
        name: _together(name, [(len(b.points), fields) for b, fields in read]) for name in names
    }


def _together(name: str, parts: Sequence[tuple[int, Mapping[str, FloatArray]]]) -> FloatArray:
    """A field of all bodies, 0 on those without it."""
    shape = next(fields[name].shape[1:] for _, fields in parts if name in fields)
    return np.concatenate([fields.get(name, np.zeros((count, *shape))) for count, fields in parts])


def _read_body(
    file: Path, folder: Path, name: str, group: str, forms: bool, known: WrittenBody | None
) -> tuple[WrittenBody, Fields]:
    data = data_of(file)
    needed = (*ON_BODY, INTERNAL, ROUNDING) if forms else (*ON_CELLS, *ON_BODY)
    optional = (HELD_OBLIQUE, TEMPERATURE, *GROUND, TIE_FORCE, *TIE_STRESSES, *(() if forms else FIELDS))
    points, cells, in_file = read_fields(data, needed, optional, group)
    constants = [one for one in (*ON_CELLS, *FIELDS) if one in in_file]
    for one in constants:
        fits(data, one, in_file[one], (len(cells), 3) if one in VECTORS else (len(cells),))
    scalars = (TEMPERATURE, *TIE_STRESSES)
    nodal = (*ON_BODY, HELD_OBLIQUE, INTERNAL, ROUNDING, *GROUND, TIE_FORCE, *scalars)
    on_body = [one for one in nodal if one in in_file]
    for one in on_body:
        fits(data, one, in_file[one], (len(points),) if one in scalars else (len(points), 3))
    same = known is not None and np.array_equal(known.points, points) and np.array_equal(known.cells, cells)
    if not same:
        inspect(MeshFile(str(data), points, cells, {}, {}), 1.0, MPI.COMM_SELF)
    domain = known.body.domain if known and same else distributed(MPI.COMM_SELF, points, cells)
    of_cell = np.asarray(domain.topology.original_cell_index)
    on_cells = {one: in_file[one][of_cell] for one in constants}
    body = RecordedBody(domain) if forms else ElasticBody(domain, _materials(data, on_cells))
    node = np.empty(len(body.x), dtype=np.int64)
    node[compat.cell_dofs(body.V)] = np.asarray(domain.geometry.input_global_indices)[compat.cell_geometry(domain)]
    if len(node) != len(points):
        raise ValueError(f"{folder}: {data.name} has points that belong to no cell of {SOLUTION}")
    if isinstance(body, RecordedBody):
        body.internal = in_file[INTERNAL][node]
    fields = {one: in_file[one][node] for one in on_body}
    return WrittenBody(name, points, cells, body, node, on_cells, slice(0, len(points))), fields


def fits(path: Path, name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    """Check the values of a field.

    Raises:
        ValueError: If they have another shape, or are not finite.
    """
    if values.shape != shape:
        raise ValueError(f"{path}: {name} does not match the mesh")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{path}: {name} has entries that are not finite")


def _materials(path: Path, on_cells: Fields) -> CellMaterials:
    try:
        return CellMaterials.of_fields(on_cells)
    except KeyError as error:
        raise ValueError(f"{path}: has no field {error}: {OLD}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
