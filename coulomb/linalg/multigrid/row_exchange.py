"""Rows of arrays that go to other ranks once; for what goes often see ghost_blocks.py."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

_Array = npt.NDArray[Any]


class RowExchange:
    """Between ranks that ask for things by their numbers and those that have them; collective.

    Args:
        comm: The ranks.
        starts: Number of the first thing of each rank, and of all, shape (ranks + 1,).
        needed: Numbers of things that this rank asks for, ascending.

    Attributes:
        asked: Things of this rank that others ask for, counted from its first one, by ranks.
    """

    def __init__(self, comm: MPI.Comm, starts: _Array, needed: _Array):
        self._comm = comm
        self._needed = _per_rank(comm, starts, needed)
        self._asked = _transposed(comm, self._needed)
        numbers = _moved(comm, needed.astype(np.int64), self._needed, self._asked)
        self.asked: _Array = numbers - int(starts[comm.rank])

    def fetched(self, rows: _Array, lengths: _Array) -> _Array:
        """Rows for the things asked for, `lengths` for each of these: those for the needed ones; collective."""
        ends = np.concatenate([[0], np.cumsum(lengths)])[np.concatenate([[0], np.cumsum(self._asked)])]
        out = np.diff(ends)
        return _moved(self._comm, rows, out, _transposed(self._comm, out))


def to_owners(comm: MPI.Comm, starts: _Array, numbers: _Array, *arrays: _Array) -> list[_Array]:
    """Rows of arrays, one per number, at the ranks that have things of these numbers (ascending); collective."""
    out = _per_rank(comm, starts, numbers)
    into = _transposed(comm, out)
    return [_moved(comm, array, out, into) for array in arrays]


def _per_rank(comm: MPI.Comm, starts: _Array, numbers: _Array) -> _Array:
    owner = np.searchsorted(starts, numbers, side="right") - 1
    return np.bincount(owner, minlength=comm.size).astype(np.int64)


def _transposed(comm: MPI.Comm, counts: _Array) -> _Array:
    other = np.empty_like(counts)
    comm.Alltoall(counts, other)
    return other


def _moved(comm: MPI.Comm, rows: _Array, out: _Array, into: _Array) -> _Array:
    """Rows (k, ...) to the ranks, so many to each."""
    width = int(np.prod(rows.shape[1:]))
    received = np.empty((int(into.sum()), *rows.shape[1:]), rows.dtype)
    comm.Alltoallv([np.ascontiguousarray(rows), width * out], [received, width * into])
    return received
