"""Blocks of a distributed vector that a rank needs and other ranks have: fetched, or summed where they belong.

Messages go between neighbours only, by requests that are made once.  They are on their way while the caller computes:
`fetch` and `give` begin, `fetched` and `given` wait.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray

PADDING = 8
"""Numbers behind the end of an array that the kernels may read."""

_FETCH, _GIVE = 1702, 1703  # tags
_Array = npt.NDArray[Any]


def padded(size: int) -> FloatArray:
    """A vector of zeros with room behind its end; the room is not part of it."""
    return np.zeros(size + PADDING)[:size]


class GhostBlocks:
    """The blocks that this rank needs of others; collective.

    Args:
        comm: The ranks.
        starts: Number of the first block of each rank, and of all blocks, shape (ranks + 1,).
        needed: Numbers of blocks of other ranks, ascending, shape (k,).
        size: Numbers in a block.

    Attributes:
        values: The fetched blocks, or those to give, shape (size k,), padded.
    """

    def __init__(self, comm: MPI.Comm, starts: _Array, needed: _Array, size: int):
        self._comm, self._size = comm, size
        owner = np.searchsorted(starts, needed, side="right") - 1
        into = np.bincount(owner, minlength=comm.size).astype(np.int64)
        out = np.empty_like(into)
        comm.Alltoall(into, out)
        asked = np.empty(int(out.sum()), dtype=np.int64)
        comm.Alltoallv([needed.astype(np.int64), into], [asked, out])
        self._own: _Array = asked - int(starts[comm.rank])
        self.values = padded(size * len(needed))
        self._buffer: FloatArray = np.empty((len(self._own), size))
        self._ends = np.cumsum(out)
        self._parts = [slice(end - n, end) for end, n in zip(self._ends, out, strict=True) if n > 0]
        self._fetch: list[MPI.Prequest] = []
        self._give: list[MPI.Prequest] = []
        first = 0
        for rank in np.flatnonzero(into):
            mine = self.values[first : first + size * into[rank]]
            self._fetch.append(comm.Recv_init(mine, int(rank), _FETCH))
            self._give.append(comm.Send_init(mine, int(rank), _GIVE))
            first += size * int(into[rank])
        for rank, part in zip(np.flatnonzero(out), self._parts, strict=True):
            self._fetch.append(comm.Send_init(self._buffer[part], int(rank), _FETCH))
            self._give.append(comm.Recv_init(self._buffer[part], int(rank), _GIVE))

    def fetch(self, x: FloatArray) -> None:
        """Begin to fetch blocks of x, this rank's part of a vector."""
        np.take(x.reshape(-1, self._size), self._own, axis=0, out=self._buffer, mode="clip")
        MPI.Prequest.Startall(self._fetch)

    def fetched(self) -> FloatArray:
        """`values`, with the blocks of the other ranks."""
        MPI.Prequest.Waitall(self._fetch)
        return self.values

    def give(self) -> None:
        """Begin to send `values` to the ranks of these blocks."""
        MPI.Prequest.Startall(self._give)

    def given(self, b: FloatArray) -> None:
        """Add what other ranks have given to b, this rank's part of a vector."""
        MPI.Prequest.Waitall(self._give)
        blocks = b.reshape(-1, self._size)
        for part in self._parts:
            blocks[self._own[part]] += self._buffer[part]

    def destroy(self) -> None:
        """Free the requests."""
        for request in (*self._fetch, *self._give):
            request.Free()
