"""Writes the results of a run: XDMF fields, summary.json, iterations.csv."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import shutil
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from ..contact_fields import names
from ..fem import compat
from ..fem.bodies import Elasticity, SingleBody, relative_error
from ..fem.geometry import same_on_all_ranks
from ..fem.meshes import facet_columns
from ..model.discrete_problem import DiscreteProblem
from ..model.provenance import moment, now, provenance
from ..model.solution import Solution
from ..ranks import on_rank_0
from ..regular_file import replacing
from ..solvers.results import OuterStep, QPStep
from .atomic_output import OWN, PARTIAL, finish, locked, refuse_to_replace
from .energy_error import recovered_errors
from .grid_file import GridFields, write_grids
from .result_grids import body_grids, collections, contact_facets, contact_grids
from .run_directory import CASE, CONTACT, ITERATIONS, MESH, SOLUTION, STEPS, SUMMARY
from .summary import summary

STRESS_ERROR = "stress_error"
"""Estimated error of the stress in a cell, pascals (`fem.bodies.recovery`), beside error bars."""


def write(
    solution: Solution,
    directory: str | Path,
    extra: Mapping[str, Any] | None = None,
    case: str = "",
    overwrite: bool = True,
    fields: Mapping[str, Any] | None = None,
    mesh: Path | None = None,
    keep: bool = True,
) -> dict[str, Any]:
    """Write all results into a directory; those that are there are kept as DIRECTORY.previous when all new ones are
    complete.

    Args:
        directory: Created if necessary.
        extra: Additional entries for summary.json.
        case: Contents of case.json; empty without one.
        overwrite: Whether results that are there may be replaced.
        fields: The user's functions to be written beside, by name (`result_grids.interpolated`).
        mesh: Directory of meshes that is moved there (`MESH`); by default the one that is there, if the case names it.
        keep: Whether results that are there are kept; not those of the same run.

    Returns:
        The summary, with the seconds of the output added.

    Raises:
        OSError: On every rank, if the directory cannot be written to.
        ValueError: On every rank, if another run uses it, or it has files that must not be replaced.
    """
    problem, target, extra = solution.problem, Path(directory), extra or {}
    comm, folder = problem.comm, target / (PARTIAL if keep else OWN)

    def begin() -> None:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()

    def complete() -> dict[str, Any]:
        _write_history(solution.result.history, folder / ITERATIONS)
        contents["seconds"]["output"] = time.perf_counter() - began
        contents["picture"] = "not asked for"
        contents["run"]["ended"] = moment(now())
        if case:
            (folder / CASE).write_text(case, encoding="utf-8")
        if mesh is not None:
            os.rename(mesh, folder / MESH)
        elif str((target / MESH).absolute()) in case:
            shutil.copytree(target / MESH, folder / MESH)
        write_json(contents, folder / SUMMARY)
        finish(target)
        return contents

    same_on_all_ranks({"directory": str(directory), "overwrite": overwrite}, comm)
    with locked(target, comm) as alone:
        if keep and alone:  # a run that has locked it has asked when it began
            refuse_to_replace(target, overwrite, comm)
        began = time.perf_counter()
        on_rank_0(comm, begin)
        try:
            refuse_full_disk(problem, folder)
            write_fields(solution, folder, fields or {}, extra.get("error"))
            contents = {**summary(solution), **({"fields": list(fields)} if fields else {}), **extra}
            contents["run"] = provenance(problem.started, comm)
            contents = on_rank_0(comm, complete)
        finally:  # no collective call: an unforeseen error may be that of one rank
            if comm.rank == 0 and not (folder / SUMMARY).exists():
                shutil.rmtree(folder, ignore_errors=True)
    problem.seconds.update(contents["seconds"])
    return contents


def write_fields(solution: Solution, folder: Path, given: Mapping[str, Any], bars: Mapping[str, Any] | None) -> None:
    """solution.xdmf and contact.xdmf with their HDF5 files; collective."""
    problem, names_of, of = solution.problem, collections(solution.problem), solution.problem.elasticity.slice
    for (name, grids), collection in zip(grids_of_files(solution, given, bars).items(), names_of, strict=True):
        noted = grids if of is None else [replace(grid, note=of.note) for grid in grids]
        write_grids(problem.comm, folder / name, noted, problem.time, collection)


def grids_of_files(
    solution: Solution, given: Mapping[str, Any], bars: Mapping[str, Any] | None
) -> dict[str, list[GridFields]]:
    """The grids of solution.xdmf and contact.xdmf; beside error bars with the error of the stress where it is known: by
    recovery, scaled to that of all cells together in the bars; collective."""
    problem, grids = solution.problem, body_grids(solution, given)
    if bars is not None and all(isinstance(member.body, Elasticity) for member in problem.elasticity.members):
        errors = recovered_errors(solution)
        recovered, known = relative_error(errors.values()), bars.get("relative_stress_error")
        scale = known / recovered if known and recovered > 0.01 * known else 1.0
        grids = [
            replace(grid, on_cells={**grid.on_cells, STRESS_ERROR: scale * one.stress})
            for grid, one in zip(grids, errors.values(), strict=True)
        ]
    return {SOLUTION: grids, CONTACT: contact_grids(solution)}


def size_on_disk(problem: DiscreteProblem) -> float:
    """Approximate bytes of the fields of a solution; collective."""
    return 1.1e5 + sum(_size_of(problem, member.body) for member in problem.elasticity.members)


def _size_of(problem: DiscreteProblem, body: SingleBody) -> float:
    comm = problem.comm
    points, cells = body.numbering.total, body.domain.topology.index_map(3).size_global
    width = compat.cell_dofs(body.V).shape[1] + body.numbers_per_cell
    facets = contact_facets(problem, body)
    on_face: int = comm.allreduce(len(body.nodes_of(facets)))
    of_face: int = comm.allreduce(facet_columns(body.domain.topology.cell_type, body.degree).shape[1] * len(facets))
    vectors = 6 if body.ground is None else 12
    per_node = 24.0 * (1 + len(names(vector=True))) + 8.0 * len(names(vector=False))  # with the coordinates
    # coordinates and 5 vectors per node, with springs 11
    return 24.0 * vectors * points + per_node * on_face + 8.0 * width * cells + 8.0 * of_face


def refuse_full_disk(problem: DiscreteProblem, target: Path, times: int = 1) -> None:
    """Check beforehand that there is disk space for the results of some steps in a directory, which may not exist yet:
    with a full disk HDF5 leaves damaged files and no clear message.

    Raises:
        OSError: On every rank.
    """
    needed = times * size_on_disk(problem)

    def look() -> None:
        place = target.absolute()
        while not place.exists():
            place = place.parent
        free = shutil.disk_usage(place).free
        if free < needed:
            message = f"no space left: the results take about {needed / 1e6:.3g} MB, and {free / 1e6:.3g} MB are free"
            raise OSError(errno.ENOSPC, message)

    on_rank_0(problem.comm, look)


class Series:
    """The time series of the steps' XDMF files of one name in a folder, on one rank.

    The part of each step is read once: reading those of all steps again after each would take time that grows with
    their number, more than a second per step after some hundred.
    """

    def __init__(self, folder: Path, name: str):
        self._folder, self._name = folder, name
        self._parts: dict[str, str] = {}

    def write(self, steps: Sequence[str]) -> None:
        """Write FOLDER/NAME, which refers to the files of the steps, by their directories relative to the folder."""
        with replacing(self._folder / self._name) as partial:
            partial.write_text(self.text(steps), encoding="utf-8")

    def text(self, steps: Sequence[str]) -> str:
        """What `write` writes."""
        for step in steps:
            if step not in self._parts:
                self._parts[step] = self._part(step)
        head = "<?xml version='1.0' encoding='utf-8'?>\n<Xdmf Version=\"3.0\">\n  <Domain>\n"
        head += f'    <Grid Name="{STEPS}" GridType="Collection" CollectionType="Temporal">\n'
        return "".join([head, *(self._parts[step] for step in steps), "    </Grid>\n  </Domain>\n</Xdmf>"])

    def _part(self, step: str) -> str:
        domain = ElementTree.parse(self._folder / step / self._name).getroot().find("Domain")
        assert domain is not None
        grid = domain.find("Grid")
        if grid is not None and grid.get("CollectionType") == "Temporal":
            grid = grid.find("Grid")
        assert grid is not None
        for item in grid.iter("DataItem"):
            if item.get("Format") == "HDF":
                item.text = f"{step}/{(item.text or '').strip()}"
        ElementTree.indent(grid, level=3)
        grid.tail = None
        return f"      {ElementTree.tostring(grid, encoding='unicode')}\n"


def _write_history(history: tuple[OuterStep, ...] | tuple[QPStep, ...], path: Path) -> None:
    """A row per step; `nan` where a step of another method than the first has no such value."""
    kinds = dict.fromkeys(type(step) for step in history) if history else (OuterStep,)
    names = dict.fromkeys(field.name for kind in kinds for field in fields(kind))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(names), restval="nan")
        writer.writeheader()
        writer.writerows(asdict(step) for step in history)


def write_json(contents: dict[str, Any], path: Path) -> None:
    """Write a JSON file, replacing an existing one atomically."""
    with replacing(path) as partial:
        partial.write_text(json.dumps(finite(contents), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def finite(value: Any) -> Any:
    """Replace nan and inf, which JSON does not have, by null."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
