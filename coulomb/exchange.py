"""Rows of arrays sent between ranks: to given ranks and back, and rows of a distributed array by their numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from .arrays import IntArray


class Exchange:
    """Sends a row to a rank for each of this rank's k entries, `to` (k,), and brings answers back; collective.

    No rank receives more than is sent to it.  Rows arrive in the order of the ranks that sent them, and of these in
    their order there: if entries are numbered rank after rank, they arrive in the order of their numbers.

    Attributes:
        given, got: How many rows this rank sends to each rank, and receives of each, shape (ranks,).
    """

    def __init__(self, comm: MPI.Comm, to: npt.NDArray[np.integer[Any]]):
        self._comm = comm
        self._order = np.argsort(to, kind="stable")
        self.given = np.bincount(to, minlength=comm.size).astype(np.int64)
        self.got = np.empty_like(self.given)
        comm.Alltoall(self.given, self.got)

    @property
    def sources(self) -> IntArray:
        """The rank that sent each of the rows received."""
        return np.repeat(np.arange(self._comm.size), self.got)

    def send(self, rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The rows (k, ...) of all ranks that go to this rank; collective."""
        return self._all_to_all(rows[self._order], self.given, self.got)

    def reply(self, answers: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """For this rank's entries the answers of the ranks that got them, one for each row received, in their order;
        collective."""
        back = self._all_to_all(answers, self.got, self.given)
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
