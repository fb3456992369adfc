"""Blocks of a distributed vector that a rank needs and other ranks have: fetched, or summed where they belong.

Messages go between neighbours only, by requests that are made once.  The kernels (native/exchange.h) start and await
them: from Python a product would take longer for that than a small grid takes to multiply.  They are on their way while
the product with this rank's own columns is made.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ...native import address

PADDING = 8
"""Numbers behind the end of an array that the kernels may read."""

_FETCH, _GIVE = 1702, 1703  # tags
_Array = npt.NDArray[Any]


def padded(size: int) -> FloatArray:
    """A vector of zeros with room behind its end; the room is not part of it."""
    return np.zeros(size + PADDING)[:size]


class Exchange(ctypes.Structure):
    """`struct exchange` of native/exchange.h."""

    _fields_ = (
        *(
            (name, ctypes.c_void_p)
            for name in ("start", "wait", "fetch", "give", "statuses", "values", "buffer", "own")
        ),
        *((name, ctypes.c_int) for name in ("messages", "count", "size")),
    )


class GhostBlocks:
    """The blocks that this rank needs of others; collective.

    Args:
        comm: The ranks.
        starts: Number of the first block of each rank, and of all blocks, shape (ranks + 1,).
        needed: Numbers of blocks of other ranks, ascending, shape (k,).
        size: Numbers in a block.

    Attributes:
        values: The fetched blocks, or those to give, shape (size k,), padded.
        exchange: What kernels need to fetch or give them; valid until `destroy`.
    """

    def __init__(self, comm: MPI.Comm, starts: _Array, needed: _Array, size: int):
        owner = np.searchsorted(starts, needed, side="right") - 1
        into = np.bincount(owner, minlength=comm.size).astype(np.int64)
        out = np.empty_like(into)
        comm.Alltoall(into, out)
        asked = np.empty(int(out.sum()), dtype=np.int64)
        comm.Alltoallv([needed.astype(np.int64), into], [asked, out])
        own = (asked - int(starts[comm.rank])).astype(np.int32)
        self.values = padded(size * len(needed))
        buffer = np.empty((len(own), size))
        ends, first = np.cumsum(out), 0
        self._fetch: list[MPI.Prequest] = []
        self._give: list[MPI.Prequest] = []
        for rank in np.flatnonzero(into):
            mine = self.values[first : first + size * into[rank]]
            self._fetch.append(comm.Recv_init(mine, int(rank), _FETCH))
            self._give.append(comm.Send_init(mine, int(rank), _GIVE))
            first += size * int(into[rank])
        for rank in np.flatnonzero(out):
            part = slice(ends[rank] - out[rank], ends[rank])
            self._fetch.append(comm.Send_init(buffer[part], int(rank), _FETCH))
            self._give.append(comm.Recv_init(buffer[part], int(rank), _GIVE))
        statuses = np.empty(MPI._sizeof(MPI.Status) * len(self._fetch) + 1, np.uint8)
        self._arrays = _handles(self._fetch), _handles(self._give), statuses, self.values, buffer, own
        functions = (ctypes.cast(function, ctypes.c_void_p) for function in _start_and_wait())
        self.exchange = Exchange(*functions, *map(address, self._arrays), len(self._fetch), len(own), size)

    def destroy(self) -> None:
        """Free the requests."""
        for request in (*self._fetch, *self._give):
            request.Free()


def _handles(requests: Sequence[MPI.Prequest]) -> npt.NDArray[np.uint8]:
    """MPI's own handles of persistent requests, which stay the same until these are freed, one after the other."""
    size = MPI._sizeof(MPI.Request)
    together = b"".join(ctypes.string_at(MPI._addressof(request), size) for request in requests)
    return np.frombuffer(together + b"\0", np.uint8).copy()


@functools.cache
def _start_and_wait() -> tuple[Any, Any]:
    """MPI's functions: those that all of the process sees, which a tool may have replaced, or those of the library to
    which mpi4py is linked."""
    everywhere = ctypes.CDLL(None)
    library = everywhere if hasattr(everywhere, "MPI_Startall") else ctypes.CDLL(MPI.__file__)
    return library.MPI_Startall, library.MPI_Waitall
