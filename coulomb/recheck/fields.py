"""solution.xdmf and contact.xdmf of a run, with their HDF5 files, as trees of fields."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import IntArray, in_words
from ..fem.meshes import FACETS, SEPARATOR, SOLIDS
from ..io.field_files import NODE, WHOLE, Grid, data_of, read_grids
from ..io.grid_file import described
from ..io.output import grids_of_files
from ..io.result_grids import BODIES, FACES
from ..io.run_directory import CONTACT, FIELDS, SOLUTION, RunDirectory
from ..model.solution import Solution
from .comparison import Field

_KINDS: Final = {SOLUTION: (SOLIDS, BODIES), CONTACT: (FACETS, FACES)}
"""XDMF's names of the cells of the files by the number of their nodes, and the names of their collections of grids."""

Grids = dict[str, dict[str, Grid]]
"""The grids of the files of a run, by the names of file and grid."""


def whole(comm: MPI.Comm, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Rows of all ranks, a single column as numbers, on rank 0; collective."""
    parts = comm.gather(values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values)
    return values if parts is None else np.concatenate([part for part in parts if len(part)] or parts[:1])


def grids_of(answer: Solution, bars: Mapping[str, Any] | None) -> Grids:
    """The grids that would be written of an answer with these error bars, on rank 0; collective."""
    comm, by_file = answer.problem.comm, Grids()
    for name, grids in grids_of_files(answer, {}, bars).items():
        by_file[name] = {}
        for one in grids:
            fields = {field: whole(comm, values) for field, values in (*one.on_points.items(), *one.on_cells.items())}
            mesh = one.grid.kind, whole(comm, one.grid.cells), whole(comm, one.grid.points)
            by_file[name][one.name or WHOLE] = Grid(*mesh, fields, frozenset(one.on_cells))
    return by_file


def fields_of(grids: Grids) -> dict[str, dict[str, dict[str, Field]]]:
    """Their fields by file, grid and name, and the points; but for the numbers of nodes."""

    def fields(of: Grid) -> dict[str, Field]:
        middle, named = of.points[of.cells].mean(axis=1), {"points": of.points, **of.fields}
        named.pop(NODE, None)
        return {name: Field(values, middle if name in of.on_cells else of.points) for name, values in named.items()}

    return {file: {name: fields(of) for name, of in there.items()} for file, there in grids.items()}


def in_order(folder: Path, grids: Grids, like: Grids, numbers: Mapping[str, IntArray]) -> Grids:
    """The grids of files in a folder, with points and cells in the order of other grids: `numbers` are those of the
    nodes of the bodies in the files, by the names of their grids.

    Raises:
        ValueError: If the meshes are not those.
    """
    ordered = Grids()
    for file, there in grids.items():
        wanted, ordered[file] = like[file], {}
        if list(there) != list(wanted):
            what = [", ".join(map(repr, names)) for names in (there, wanted)]
            raise ValueError(f"{folder / file}: shows {what[0]}, but of the case are {what[1]}")
        for name, grid in there.items():
            node = numbers[name.partition(SEPARATOR)[0] if len(numbers) > 1 else next(iter(numbers))]
            if file == CONTACT:
                place = np.full(len(node), -1)
                place[grid.fields[NODE].astype(np.int64)] = np.arange(len(grid.points))
                node = place[node[wanted[name].fields[NODE].astype(np.int64)]]
            ordered[file][name] = _in_order(folder / file, grid, wanted[name], node)
    return ordered


def _in_order(file: Path, grid: Grid, like: Grid, node: IntArray) -> Grid:
    """A grid in the order of another one, by the numbers of the nodes of that in it, -1 for one that is not there."""
    rows = node[like.cells]
    if np.any(node < 0) or len(grid.points) != len(node) or grid.cells.shape != rows.shape:
        sizes = [f"{len(of.points)} points and {len(of.cells)} cells" for of in (grid, like)]
        raise ValueError(f"{file}: has another mesh than the case: {sizes[0]}, the case {sizes[1]}")
    here, there = (np.lexsort(of.T[::-1]) for of in (rows, grid.cells))
    wrong = np.any(rows[here] != grid.cells[there], axis=1)
    if np.any(wrong):
        place = in_words(like.points[like.cells[here[np.argmax(wrong)]]].mean(axis=0))
        raise ValueError(
            f"{file}: {np.count_nonzero(wrong)} of {len(rows)} cells (first seen at x = {place}) have other nodes than "
            "those of the case, or have them in another order"
        )
    cell = np.empty(len(rows), dtype=np.int64)
    cell[here] = there
    fields = {name: values[cell if name in grid.on_cells else node] for name, values in grid.fields.items()}
    return grid._replace(cells=like.cells, points=grid.points[node], fields=fields)


def sound(files: RunDirectory) -> tuple[dict[str, Any], Grids, dict[str, float]]:
    """The summary of a run whose files are all there, and the grids and times of these.

    Raises:
        ValueError: If a file is missing, cannot be read, is not that of its data, or has a damaged mesh, or fields with
            entries that are not finite.
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
        grids_of_file = {name: read_grids(files.path / name) for name in FIELDS}
    except (OSError, KeyError, IndexError, RuntimeError, TypeError) as error:
        raise ValueError(f"{files.path}: is incomplete: {error}") from None
    for name, grid in ((name, grid) for name, grids in grids_of_file.items() for grid in grids.values()):
        for one, values in grid.fields.items():
            if not np.all(np.isfinite(values)):
                raise ValueError(f"{data_of(files.path / name)}: {one} has entries that are not finite")
    return contents, grids_of_file, times
