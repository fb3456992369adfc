"""Reading of the files of a run on any number of ranks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.geometry import on_all_ranks
from ..nearest import tree_of
from .field_files import COINCIDENT, data_of, grids_of, parts_of_field
from .run_directory import STEPS, SUMMARY, RunDirectory, step_place


def read_step(directory: Path, comm: MPI.Comm) -> dict[str, Any]:
    """Data in the summary of a load step for its continuation, the same on every rank.

    Raises:
        ValueError: On every rank, if it cannot be read.
    """

    record: dict[str, Any] = read_summary(directory, comm)["step"]
    return record


def read_summary(directory: Path, comm: MPI.Comm) -> dict[str, Any]:
    """The summary of a load step, the same on every rank.

    Raises:
        ValueError: On every rank, if it cannot be read, or is not that of a load step.
    """

    def read() -> dict[str, Any]:
        if comm.rank > 0:
            return {}
        contents = RunDirectory(directory).read_summary()
        if "row" not in contents.get("step", {}):
            raise ValueError(f"{SUMMARY} has no step")
        return contents

    with _offering_whole_steps(directory):
        shared: dict[str, Any] = comm.bcast(on_all_ranks(read, f"{directory}: is no load step", comm))
    return shared


@contextmanager
def _offering_whole_steps(step: Path) -> Iterator[None]:
    """Adds to errors in the files of a load step how to continue from the last whole step before."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{error}{_offer(RunDirectory(step))}") from None


def _offer(step: RunDirectory) -> str:
    """How to continue from the last whole step before one that cannot be read; empty if its files can be read."""
    if step.step_number is None:
        return ""
    history, number = RunDirectory(step.path.parents[1]), 1
    while number <= step.step_number and _is_whole(history.step(number)):
        number += 1
    if number > step.step_number:
        return ""
    if number == 1:
        return f"; no load step before is whole: move {history.path / STEPS} away, and run the case again"
    later = " and those after it" if history.begun_steps[-1] > number else ""
    return (
        f"; the last whole load step is {number - 1}: to continue from there, move {step_place(number)}{later} out of "
        f"{history.path}, then{f': coulomb resume {history.path}' if history.case.exists() else ' resume'}"
    )


def _is_whole(step: RunDirectory) -> bool:
    try:
        step.read_summary(("step",))
        for file in (step.solution, step.contact):
            grids_of(file)
            h5py.File(data_of(file), "r").close()
        return True
    except (OSError, ValueError):
        return False


def at_nodes(file: Path, name: str, parts: Sequence[tuple[str, FloatArray]], comm: MPI.Comm) -> FloatArray:
    """A vector field of a result file at this rank's points of several grids, found by their coordinates, shape (k, 3);
    collective.

    Args:
        file: XDMF file.
        name: Name of the field.
        parts: Name of each grid, "" for the only one of a file, and points on it in metres, shapes (p, 3).
        comm: The ranks.

    Raises:
        ValueError: On every rank, if a file cannot be read, or lacks a grid or a point.
    """

    def groups() -> dict[str, str]:
        found = grids_of(file)
        missing = [grid for grid, _ in parts if grid not in found]
        if missing:
            raise ValueError(f"has no grid {missing[0]!r}: belongs to another problem, or is incomplete")
        return found

    def read(group: str, x: FloatArray, size: float) -> FloatArray:
        values, hits = np.full((len(x), 3), np.nan), np.zeros(len(x))
        tree = tree_of(x) if len(x) else None
        for points, vectors in parts_of_field(data_of(file), name, group):
            if tree is not None:
                distance, number = tree.query(points, distance_upper_bound=1e-9 * size)
                found = np.isfinite(distance)
                values[number[found]] = vectors[found]
                np.add.at(hits, number[found], 1.0)
        if np.any(hits > 1.0):
            raise ValueError(COINCIDENT)
        if np.any(np.isnan(values)):
            raise ValueError("belongs to another mesh, or is incomplete")
        return values

    with _offering_whole_steps(file.parent):
        of, found = on_all_ranks(groups, str(file), comm), []
        for grid, x in parts:
            ends = np.array([x.min(axis=0), -x.max(axis=0)]) if len(x) else np.full((2, 3), np.inf)
            size = float(np.max(-np.min(comm.allgather(ends), axis=0).sum(axis=0)))
            one = partial(read, of[grid], x, size)
            found.append(on_all_ranks(one, str(data_of(file)), comm))
        return np.concatenate(found)
