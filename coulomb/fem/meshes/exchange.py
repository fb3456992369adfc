"""Rows of arrays sent between ranks: to given ranks and back, and rows of a distributed array by their numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray, IntArray

Value = TypeVar("Value")

_MOST_SAMPLES: Final = 4096
"""Coordinates in all by which space is divided among the ranks."""


class Exchange:
    """Sends a row to a rank for each of this rank's k entries, `to` (k,), and brings answers back; collective.

    No rank receives more than is sent to it.  Rows arrive in the order of the ranks that sent them, and of these in
    their order there: if entries are numbered rank after rank, they arrive in the order of their numbers.
    """

    def __init__(self, comm: MPI.Comm, to: npt.NDArray[np.integer[Any]]):
        self._comm = comm
        self._order = np.argsort(to, kind="stable")
        self._out = np.bincount(to, minlength=comm.size).astype(np.int64)
        self._into = np.empty_like(self._out)
        comm.Alltoall(self._out, self._into)

    @property
    def sources(self) -> IntArray:
        """The rank that sent each of the rows received."""
        return np.repeat(np.arange(self._comm.size), self._into)

    def send(self, rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The rows (k, ...) of all ranks that go to this rank; collective."""
        return self._all_to_all(rows[self._order], self._out, self._into)

    def reply(self, answers: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """For this rank's entries the answers of the ranks that got them, one for each row received, in their order;
        collective."""
        back = self._all_to_all(answers, self._into, self._out)
        found = np.empty_like(back)
        found[self._order] = back
        return found

    def _all_to_all(self, rows: npt.NDArray[Any], out: IntArray, into: IntArray) -> npt.NDArray[Any]:
        if self._comm.size == 1:
            return rows
        rows = np.ascontiguousarray(rows)
        found = np.empty((int(into.sum()), *rows.shape[1:]), dtype=rows.dtype)
        size = rows.dtype.itemsize * int(np.prod(rows.shape[1:], dtype=np.int64))
        kind = MPI.BYTE.Create_contiguous(size).Commit()
        try:
            self._comm.Alltoallv([rows, out, kind], [found, into, kind])
        finally:
            kind.Free()
        return found


def starts_of(comm: MPI.Comm, count: int) -> IntArray:
    """Number of the first row of every rank, and the number of all, where ranks have `count` rows each, shape (ranks +
    1,); collective."""
    return np.concatenate([[0], np.cumsum(comm.allgather(int(count)))]).astype(np.int64)


def even_starts(ranks: int, count: int) -> IntArray:
    """The same where so many rows are shared evenly."""
    return np.arange(ranks + 1, dtype=np.int64) * count // ranks


def owner_of(starts: IntArray, numbers: npt.NDArray[np.integer[Any]]) -> IntArray:
    """The rank that has the row of each number."""
    return np.searchsorted(starts, numbers, side="right").astype(np.int64) - 1


def global_numbers(index_map: Any) -> IntArray:
    """Those of the entries of an index map of DOLFINx on this rank, ghosts included."""
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    return np.asarray(index_map.local_to_global(local), dtype=np.int64)


def fetched(
    comm: MPI.Comm, starts: IntArray, numbers: npt.NDArray[np.integer[Any]], rows: npt.NDArray[Any]
) -> npt.NDArray[Any]:
    """Rows of a distributed array, of which this rank has `rows` after `starts_of`, by their numbers of any shape;
    collective."""
    if comm.size == 1:
        return rows[numbers]
    wanted, inverse = np.unique(numbers, return_inverse=True)
    ask = Exchange(comm, owner_of(starts, wanted))
    return ask.reply(rows[ask.send(wanted) - starts[comm.rank]])[inverse.reshape(numbers.shape)]


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
    found: Value | None = None
    fault = ""
    if comm.rank == 0:
        try:
            found = read()
        except OSError as error:
            fault = f"{error.filename or path}: cannot be read: {error.strerror or error}"
        except ValueError as error:
            fault = str(error)
        except Exception as error:  # no error due to a damaged file may leave the other ranks waiting
            fault = f"{path}: is damaged, or too large for one rank: {type(error).__name__}: {error}"
    fault = comm.bcast(fault)
    if fault:
        raise ValueError(fault)
    return found
