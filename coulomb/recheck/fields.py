"""solution.xdmf and contact.xdmf of a run, with their HDF5 files, as trees of fields."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, IntArray, in_words
from ..fem.meshes import FACETS, SEPARATOR, SOLIDS
from ..io.field_files import NODE, WHOLE, Grid, data_of, read_grids
from ..io.grid_file import described
from ..io.output import grids_of_files
from ..io.result_grids import BODIES, FACES
from ..io.run_directory import CONTACT, FIELDS, SOLUTION, RunDirectory
from ..model.solution import Solution
from ..nearest import in_a_cell, same_nodes
from .comparison import Field

_KINDS: Final = {SOLUTION: (SOLIDS, BODIES), CONTACT: (FACETS, FACES)}
"""XDMF's names of the cells of the files by the number of their nodes, and the names of their collections of grids."""

_NEAR: Final = 1e-9
"""Distance of points at the same place, over the extent of the mesh."""

Grids = dict[str, dict[str, Grid]]
"""The grids of the files of a run, by the names of file and grid."""


Tree = dict[str, dict[str, dict[str, Any]]]


def grids_of(answer: Solution, bars: Mapping[str, Any] | None) -> Grids:
    """The grids that would be written of an answer with these error bars, on rank 0; collective."""
    comm, found = answer.problem.comm, Grids()

    def whole(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        parts = comm.gather(values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values)
        return values if parts is None else np.concatenate([part for part in parts if len(part)] or parts[:1])

    for name, grids in grids_of_files(answer, {}, bars).items():
        found[name] = {}
        for one in grids:
            fields = {field: whole(values) for field, values in (*one.on_points.items(), *one.on_cells.items())}
            mesh = one.grid.kind, whole(one.grid.cells), whole(one.grid.points)
            found[name][one.name or WHOLE] = Grid(*mesh, fields, frozenset(one.on_cells))
    return found


def fields_of(folder: Path, grids: Grids, like: Grids) -> Tree:
    """Fields by file, grid and name, in the order of the meshes of other grids; `folder` is that of the files that they
    are in, for messages.

    Raises:
        ValueError: If the meshes are not those.
    """
    numbers, found = dict[str, IntArray](), Tree()
    for name, there in grids.items():
        file, wanted, found[name] = folder / name, like[name], {}
        if list(there) != list(wanted):
            what = [", ".join(map(repr, names)) for names in (there, wanted)]
            raise ValueError(f"{file}: shows {what[0]}, but of the case are {what[1]}")
        for grid, (_, cells, points, fields, on_cells, *_) in there.items():
            x, rows = wanted[grid].points, wanted[grid].cells
            node, cell = _same_mesh(file, points, cells, x, rows)
            if name == SOLUTION:
                numbers[grid] = np.empty_like(node)
                numbers[grid][node] = np.arange(len(node))
            elif NODE in fields:
                body = grid.partition(SEPARATOR)[0] if len(numbers) > 1 else next(iter(numbers))
                fields = {**fields, NODE: numbers[body][fields[NODE].astype(np.int64)].astype(np.float64)}
            middle = x[rows].mean(axis=1)
            into = found[name][grid] = {"points": Field(points[node], x)}
            for one, values in fields.items():
                order, place = (cell, middle) if one in on_cells else (node, x)
                into[one] = Field(values[order], place)
    return found


def sound(files: RunDirectory) -> tuple[dict[str, Any], Grids, dict[str, float]]:
    """The summary of a run whose files are all there, and the grids and times of these.

    Raises:
        ValueError: If a file is missing, cannot be read, is not that of its data, or has a damaged mesh, or fields that
            do not match it or have entries that are not finite.
    """
    contents = files.read_summary(
        ("law", "mean_compliance", "totals", "certificate", "method", "iterations", "residual", "faces")
    )
    least = 0.0 if (contents.get("nodes") or {}).get("contact") == 0 else 5e-324  # 0 where all are tied
    if not least <= (compliance := contents["mean_compliance"]) < math.inf:
        raise ValueError(f"{files.summary}: mean_compliance should be a positive number, but is {compliance!r}")
    step = contents.get("step", {} if files.step_number else {"number": 1, "time": 0.0})
    if not all(isinstance(step.get(key), float | int) for key in ("number", "time")):
        raise ValueError(f"{files.summary}: step has no number and time")
    for path in (path for name in FIELDS for path in (files.path / name, data_of(files.path / name))):
        if not path.is_file():
            raise ValueError(f"{files.path}: is incomplete: there is no {path.name}")
    try:
        times = {name: described(files.path / name, *kind) for name, kind in _KINDS.items()}
        found = {name: read_grids(files.path / name) for name in FIELDS}
    except (OSError, KeyError, IndexError, RuntimeError, TypeError) as error:
        raise ValueError(f"{files.path}: is incomplete: {error}") from None
    for name, grid in ((name, grid) for name, grids in found.items() for grid in grids.values()):
        for one, values in grid.fields.items():
            if len(values) != len(grid.cells if one in grid.on_cells else grid.points):
                raise ValueError(f"{data_of(files.path / name)}: {one} does not match the mesh")
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{data_of(files.path / name)}: {one} has entries that are not finite")
    return contents, found, times


def _same_mesh(
    file: Path, points: FloatArray, cells: IntArray, x: FloatArray, rows: IntArray
) -> tuple[IntArray, IntArray]:
    """The numbers in a file of the nodes and of the cells of a mesh.

    Raises:
        ValueError: If it has others, or has the nodes of a cell in another order.
    """
    if np.array_equal(points, x) and np.array_equal(cells, rows):
        return np.arange(len(x)), np.arange(len(rows))
    node: IntArray = np.full(1, -1)
    if points.shape == x.shape and cells.shape == rows.shape and len(points):
        node = same_nodes(x, in_a_cell(x, rows), points, cells, _NEAR * float(np.max(np.ptp(points, axis=0))))
    if np.any(node < 0) or len(np.unique(node)) < len(node):
        where = "" if len(node) != len(x) else f" (first seen at x = {in_words(x[np.argmax(node < 0)])})"
        sizes = f"{len(points)} points and {len(cells)} cells, the case {len(x)} and {len(rows)}"
        raise ValueError(f"{file}: has another mesh than the case: {sizes}{where}")
    mine = node[rows]
    here, there = (np.lexsort(of.T[::-1]) for of in (mine, cells))
    wrong = np.any(mine[here] != cells[there], axis=1)
    if np.any(wrong):
        place = in_words(x[rows[here[np.argmax(wrong)]]].mean(axis=0))
        raise ValueError(
            f"{file}: {np.count_nonzero(wrong)} of {len(rows)} cells (first seen at x = {place}) have other nodes than "
            "those of the case, or have them in another order"
        )
    cell = np.empty(len(rows), dtype=np.int64)
    cell[here] = there
    return node, cell
