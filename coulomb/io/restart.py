"""What a run has written, read back on any number of ranks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..arrays import FloatArray
from ..fem.user_values import on_all_ranks

_AT_ONCE = 200_000  # points read at a time: no rank ever holds the whole mesh


def read_step(directory: Path, comm: MPI.Comm) -> dict[str, Any]:
    """What the summary of a load step keeps for going on, the same on every rank.

    Raises:
        ValueError: On every rank, if it cannot be read.
    """

    record: dict[str, Any] = read_summary(directory, comm)["step"]
    return record


def read_summary(directory: Path, comm: MPI.Comm) -> dict[str, Any]:
    """The summary of a load step, the same on every rank.

    Raises:
        ValueError: On every rank, if it cannot be read, or is none of a load step.
    """

    def read() -> dict[str, Any]:
        if comm.rank > 0:
            return {}
        told: dict[str, Any] = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
        if "row" not in told.get("step", {}):
            raise KeyError("summary.json has no step")
        return told

    shared: dict[str, Any] = comm.bcast(on_all_ranks(read, f"{directory}: is no load step", comm))
    return shared


def nodal_vectors(path: Path, name: str, x: FloatArray, comm: MPI.Comm, elsewhere: float | None = None) -> FloatArray:
    """A vector field of a file of DOLFINx's at this rank's points, found by their coordinates; collective.

    Args:
        path: HDF5 file.
        name: Of the field.
        x: Points in metres, shape (k, 3).
        comm: The ranks.
        elsewhere: Value at points that the file does not have; by default that is an error.

    Raises:
        ValueError: On every rank, if the file cannot be read or lacks a point.
    """

    ends = np.array([x.min(axis=0), -x.max(axis=0)]) if len(x) else np.full((2, 3), np.inf)
    size = float(np.max(-np.min(comm.allgather(ends), axis=0).sum(axis=0)))

    def read() -> FloatArray:
        values = np.full((len(x), 3), np.nan if elsewhere is None else elsewhere)
        with h5py.File(path, "r") as file:
            points, group = file["Mesh/mesh/geometry"], file[f"Function/{name}"]
            field = group[next(iter(group))]
            if len(field) != len(points):
                raise ValueError(f"{name} does not fit to the mesh")
            if len(x) == 0:
                return values
            tree = cKDTree(x)
            for first in range(0, len(points), _AT_ONCE):
                part = slice(first, first + _AT_ONCE)
                distance, number = tree.query(np.array(points[part]), distance_upper_bound=1e-9 * size)
                found = np.isfinite(distance)
                values[number[found]] = np.array(field[part])[found]
        if np.any(np.isnan(values)):
            raise ValueError("belongs to another mesh, or is not whole")
        return values

    return on_all_ranks(read, str(path), comm)


def history_in(folder: Path) -> dict[str, Any] | None:
    """The entry `history` of the summary of a load history; None where there is none, or it cannot be read."""
    try:
        told: dict[str, Any] | None = json.loads((folder / "summary.json").read_text(encoding="utf-8")).get("history")
    except (OSError, ValueError):
        return None
    return told


def steps_in(folder: Path) -> list[int]:
    """Numbers of the complete steps in a directory, from 1 without a gap; a step is complete once it has a summary."""
    found: list[int] = []
    while (folder / "steps" / f"{len(found) + 1:04d}" / "summary.json").is_file():
        found.append(len(found) + 1)
    return found
