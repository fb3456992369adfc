"""Comparison of solution.xdmf and contact.xdmf, with their HDF5 files, with those that are written anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, in_words
from ...contact_fields import ANSWER, COMPLIANCES, CONTACT_FIELDS
from ...fem.meshes import FACETS, SEPARATOR, SOLIDS
from ...nearest import in_a_cell, same_nodes
from ...units import amount
from ..field_files import NODE, OPPOSITE, data_of, fields_in, grids_of, names_in_cells
from ..grid_file import Described, described
from ..result_grids import BODIES, FACES, OURS
from ..run_directory import CONTACT, FIELDS, OLD, SOLUTION, RunDirectory
from .comparison import Comparison

SLIP_BOUND_LIMIT: Final = 1e-6
"""Accepted relative difference between g of the last Tresca problem and the law at its forces, plus ten times the
natural residual; for other solvers g is that of the law."""

_EXACT: Final = ("status", "face", OPPOSITE, NODE)
"""Whole numbers, which rounding does not change."""

_SOURCES: Final = {field.name: field.follows for field in CONTACT_FIELDS if field.given}
_FOLLOWS: Final = f"the case and {ANSWER}"

_KINDS: Final = {SOLUTION: (SOLIDS, BODIES), CONTACT: (FACETS, FACES)}
"""XDMF's names of the cells of the files by the number of their nodes, and the names of their collections of grids."""

_NEAR: Final = 1e-9
"""Distance of points at the same place, over the extent of the mesh."""

Order = npt.NDArray[np.int64]


def compare_fields(folder: Path, expected: Sequence[Path], found: Comparison, limit: float | None) -> list[str]:
    """Compare the fields of a run with those that follow from the answer, and, in the other directories, from perturbed
    ones.  `limit` is the accepted difference of g, if it is that of a Tresca problem.  Gives the names of
    what could not be compared.

    Raises:
        ValueError: If a file cannot be read, or its mesh is damaged.
    """
    orders: dict[str, Order] = {}
    left = [f"{one} of {CONTACT}" for one in dict.fromkeys(COMPLIANCES)]
    times = [[one.time for one in described_fields(of)] for of in (folder, expected[0])]
    for name, told, should in zip(FIELDS, *times, strict=True):
        found.tree(f"{name}: time", told, should, source="the load step, or that of the problem")
        files = [of / name for of in (folder, *expected)]
        there, groups = grids_of(files[0]), grids_of(files[1])
        if list(there) != list(groups):
            what = [", ".join(map(repr, names)) or "one grid" for names in (there, groups)]
            raise ValueError(f"{files[0]}: shows {what[0]}, but of the case are {what[1]}")
        for grid, group in groups.items():
            left += _compare_grid(files, (there[grid], group), grid, orders, found, limit)
    return left


def sound(files: RunDirectory) -> dict[str, Any]:
    """The summary of a run whose files are all there.

    Raises:
        ValueError: If a file is missing, cannot be read, or has entries that are not finite.
    """
    contents = files.read_summary(
        ("law", "mean_compliance", "totals", "certificate", "method", "iterations", "residual", "faces")
    )
    compliance, certificate = contents["mean_compliance"], contents["certificate"]
    if isinstance(compliance, bool) or not isinstance(compliance, float | int) or not 0.0 < compliance < math.inf:
        raise ValueError(f"{files.summary}: mean_compliance should be a positive number, but is {compliance!r}")
    if not isinstance(certificate, dict) or not isinstance(certificate.get("passed"), bool):
        raise ValueError(f"{files.summary}: certificate does not say whether it had passed: {OLD}")
    described_fields(files.path, finite=True)
    return contents


def described_fields(folder: Path, finite: bool = False) -> tuple[Described, Described]:
    """What solution.xdmf and contact.xdmf of a run describe.

    Raises:
        ValueError: If one cannot be read, is not that of its data, or, if asked for, has entries that are not `finite`.
    """
    found = []
    for name, (kinds, collection) in _KINDS.items():
        for path in (folder / name, data_of(folder / name)):
            if not path.is_file():
                raise ValueError(f"{folder}: is incomplete: there is no {path.name}")
        try:
            found.append(described(folder / name, kinds, collection))
            for group in grids_of(folder / name).values() if finite else ():
                for one, values in fields_in(folder / name, group)[2].items():
                    if not np.all(np.isfinite(values)):
                        raise ValueError(f"{data_of(folder / name)}: {one} has entries that are not finite")
        except (OSError, KeyError, IndexError, RuntimeError, TypeError) as error:
            raise ValueError(f"{folder}: is incomplete: {error}") from None
    return found[0], found[1]


def _compare_grid(
    files: Sequence[Path],
    groups: tuple[str, str],
    grid: str,
    orders: dict[str, Order],
    found: Comparison,
    limit: float | None,
) -> list[str]:
    """Compare a grid of the first file with that of the others; `groups` are those of its data in the first, and in
    the others."""
    (points, cells, fields), name, of = fields_in(files[0], groups[0]), files[0].name, f" of {grid}" if grid else ""
    (x, rows, expected), *others = (fields_in(file, groups[1]) for file in files[1:])
    node, cell = _same_mesh(files[0], points, cells, x, rows)
    found.field(f"{name}: points{of}", points[node], x, x, "the case")
    if name == SOLUTION:
        orders[grid] = node
    else:
        body = grid.partition(SEPARATOR)[0] if len(orders) > 1 else next(iter(orders))
        for values in (expected, *(other[2] for other in others)):
            values[NODE] = orders[body][values[NODE].astype(np.int64)].astype(np.float64)
    middle, in_cells = x[rows].mean(axis=1), names_in_cells(files[1])
    for one in expected:
        if one not in fields:
            found.fault(f"{name}: lacks {one}{of}, unlike the case")
            continue
        order, place = (cell, middle) if one in in_cells else (node, x)
        if fields[one].shape != expected[one].shape:
            raise ValueError(f"{data_of(files[0])}: {one} does not match the mesh")
        written, follows = fields[one][order], expected[one]
        if one == "slip_bound" and limit is not None:
            if not (off := float(np.linalg.norm(written - follows))) <= limit * float(np.linalg.norm(follows)):
                found.fault(f"{name}: {one}{of}: differs from the law at the contact forces by {amount(off, 'N')}")
            continue
        rounded = [] if one in _EXACT else [other[2][one] for other in others]
        found.field(f"{name}: {one}{of}", written, follows, place, _SOURCES.get(one, _FOLLOWS), rounded)
    more = [one for one in fields if one not in expected]
    for one in more:
        if one in OURS:
            found.fault(f"{name}: has {one}{of}, unlike the case")
    return [f"{one} of {name}" for one in more if one not in OURS]


def _same_mesh(file: Path, points: FloatArray, cells: Order, x: FloatArray, rows: Order) -> tuple[Order, Order]:
    """The numbers in a file of the nodes and of the cells of a mesh.

    Raises:
        ValueError: If it has others, or has the nodes of a cell in another order.
    """
    node: Order = np.full(1, -1)
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
