"""Numbers of the nodes of several bodies on several ranks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ...arrays import IntArray


class JoinedNumbers:
    """Global numbers of what several bodies have on every rank, one body after the other, from the first number and
    count of each body on this rank in its own numbering."""

    def __init__(self, comm: MPI.Comm, sizes: Sequence[tuple[int, int]]):
        table = np.array(comm.allgather(list(sizes)), dtype=np.int64)
        self._first, self._count = table[:, :, 0], table[:, :, 1]
        self.total = int(self._count.sum())

    def first_of(self, rank: int) -> int:
        return int(self._first[rank].sum())

    def of(self, place: int, numbers: IntArray) -> IntArray:
        """Numbers among all, from those of one body; of any rank."""
        ends = self._first[:, place] + self._count[:, place]
        rank = np.searchsorted(ends, numbers, side="right")  # a rank without any ends where it starts
        before = self._first.sum(axis=1) + self._count[:, :place].sum(axis=1)
        return before[rank] + numbers - self._first[rank, place]


def in_joined_numbers(
    rows: scipy.sparse.csr_matrix, number: Callable[[IntArray], IntArray], total: int
) -> scipy.sparse.csr_matrix:
    """Rows over the displacements of the nodes of one body as rows over those of all."""
    node, axis = np.divmod(rows.indices.astype(np.int64), 3)
    widened = scipy.sparse.csr_matrix((rows.data, 3 * number(node) + axis, rows.indptr), (rows.shape[0], 3 * total))
    widened.sort_indices()
    return widened
