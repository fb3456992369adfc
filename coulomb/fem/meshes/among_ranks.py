"""Places and numbers that ranks divide among them, and what one of them reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, IntArray
from ...ranks import on_rank_0

Value = TypeVar("Value")

_MOST_SAMPLES: Final = 4096
"""Coordinates in all by which space is divided among the ranks."""


def global_numbers(index_map: Any) -> IntArray:
    """Those of the entries of an index map of DOLFINx on this rank, ghosts included."""
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    return np.asarray(index_map.local_to_global(local), dtype=np.int64)


def bounds(comm: MPI.Comm, x: FloatArray) -> FloatArray:
    """Lowest and highest coordinates of the places x (k, 3) of all ranks, shape (2, 3), infinite if there are none;
    collective."""
    ends = np.array([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    return np.min(comm.allgather(ends), axis=0) * [[1.0], [-1.0]]


class Slabs:
    """A division of space into one slab per rank, with about as many points of all ranks in each; collective."""

    def __init__(self, comm: MPI.Comm, x: FloatArray):
        few = x[:: max(1, len(x) * comm.size // _MOST_SAMPLES)]
        every: FloatArray = np.concatenate(comm.allgather(few))
        self._axis = int(np.argmax(np.ptp(every, axis=0))) if len(every) else 0
        shares = np.arange(1, comm.size) / comm.size
        self._edges = np.quantile(every[:, self._axis], shares) if len(every) else np.zeros(comm.size - 1)

    def of(self, x: FloatArray) -> IntArray:
        """The slab of every point, shape (k,)."""
        return np.searchsorted(self._edges, x[:, self._axis], side="right").astype(np.int64)

    def near(self, x: FloatArray, distance: float) -> tuple[IntArray, IntArray]:
        """Points and slabs that are within a distance, in metres: numbers of points, and of slabs."""
        first, last = (
            np.searchsorted(self._edges, x[:, self._axis] + shift, side="right") for shift in (-distance, distance)
        )
        count = last - first + 1
        point = np.repeat(np.arange(len(x)), count)
        step = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
        return point, (first[point] + step).astype(np.int64)


def on_first_rank(comm: MPI.Comm, path: str, read: Callable[[], Value]) -> Value | None:
    """What rank 0 reads from a file, None on the others; ValueError on every rank if it cannot be read; collective."""
    found: list[Value] = []

    def reading() -> None:
        try:
            found.append(read())
        except OSError as error:
            raise ValueError(f"{error.filename or path}: cannot be read: {error.strerror or error}") from None
        except ValueError:
            raise
        except Exception as error:  # of a damaged file
            raise ValueError(
                f"{path}: is damaged, or too large for one rank: {type(error).__name__}: {error}"
            ) from None

    on_rank_0(comm, reading)
    return found[0] if found else None
