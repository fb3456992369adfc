"""Rows of a distributed matrix in blocks of which every entry is stored, for the kernels of native/coarsening.h."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...native import address, kernels
from ..petsc_arrays import DistributedEntries, Entries
from ..reductions import concatenated

_Array = npt.NDArray[Any]


class BlockRows(NamedTuple):
    """Rows of blocks, columns ascending in each row; values by rows of entries."""

    pointers: npt.NDArray[np.int32]
    columns: npt.NDArray[np.int32]
    values: _Array


class WholeBlocks:
    """Rows of this rank of a square matrix in blocks; its values are used where they are, if blocks are stored wholly.

    Attributes:
        starts: Number of the first block of each rank, and of all blocks, shape (ranks + 1,).
        own: Blocks in this rank's columns.
        others: Blocks in columns of other ranks, as places in `ghosts`; None on one rank.
        ghosts: Numbers of blocks of other ranks, ascending.
    """

    def __init__(self, matrix: DistributedEntries, size: int):
        self.comm, self.size, self.starts = matrix.comm, size, matrix.starts // size
        self.ghosts, place = np.unique(matrix.columns // size, return_inverse=True)
        self.own = _block_rows(matrix.own, size, len(matrix.own.indptr) - 1)
        self.others: BlockRows | None = None
        if matrix.others is not None:
            at = size * place.reshape(-1) + matrix.columns % size
            indptr, indices, values = matrix.others
            numbers = at[indices] if len(indices) else indices
            self.others = _block_rows(Entries(indptr, numbers, values), size, size * len(self.ghosts))

    @property
    def count(self) -> int:
        return len(self.own.pointers) - 1

    @property
    def pattern(self) -> tuple[ctypes.c_void_p, ...]:
        """For kernels: pointers and columns of both parts."""
        others = (None, None) if self.others is None else self.others[:2]
        return tuple(map(address, (*self.own[:2], *others)))

    @property
    def parts(self) -> tuple[ctypes.c_void_p, ...]:
        """For kernels: pointers, columns and values of both parts."""
        others = (None, None, None) if self.others is None else self.others
        return tuple(map(address, (*self.own, *others)))


def _block_rows(entries: Entries, size: int, columns: int) -> BlockRows:
    rows = (len(entries.indptr) - 1) // size
    indptr, indices = (array.astype(np.int32, copy=False) for array in entries[:2])
    pointers, found = np.empty(rows + 1, np.int32), np.empty(len(indices) // size, np.int32)
    if kernels().block_pattern(rows, size, *map(address, (indptr, indices, pointers, found))):
        return BlockRows(pointers, found[: pointers[-1]], entries.values)
    blocks = scipy.sparse.csr_matrix((entries.values, indices, indptr), shape=(size * rows, columns)).tobsr(
        (size, size)
    )
    blocks.sort_indices()
    pointers, found = (array.astype(np.int32, copy=False) for array in (blocks.indptr, blocks.indices))
    return BlockRows(pointers, found, entries_of(pointers, found, blocks.data, 1).values)


def entries_of(pointers: _Array, columns: _Array, blocks: FloatArray, threads: int) -> Entries:
    """The entries of blocks (k, b, b) by rows."""
    rows, size = len(pointers) - 1, blocks.shape[1]
    indptr = np.empty(size * rows + 1, np.int32)
    indices, values = np.empty(blocks.size, np.int32), np.empty(blocks.size)
    blocks = np.ascontiguousarray(blocks, dtype=np.float64)
    arrays = map(address, (pointers, columns, blocks, indptr, indices, values))
    kernels().entries_of_blocks(rows, size, threads, *arrays)
    return Entries(indptr, indices, values)


def whole(matrix: DistributedEntries) -> DistributedEntries:
    """A distributed square matrix as one that each rank has for itself; collective."""
    if matrix.others is None:
        return matrix
    shape = len(matrix.own.indptr) - 1, int(matrix.starts[-1])
    own, others = matrix.own, matrix.others
    numbers = matrix.columns[others.indices] if len(others.indices) else others.indices
    mine = scipy.sparse.csr_matrix((own.values, own.indices + matrix.starts[matrix.comm.rank], own.indptr), shape=shape)
    mine = mine + scipy.sparse.csr_matrix((others.values, numbers, others.indptr), shape=shape)
    mine.sort_indices()
    lengths = concatenated(matrix.comm, np.diff(mine.indptr).astype(np.int32))
    indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    indices = concatenated(matrix.comm, mine.indices.astype(np.int32))
    everything = Entries(indptr, indices, concatenated(matrix.comm, mine.data))
    return DistributedEntries(MPI.COMM_SELF, everything, None, np.empty(0, np.int32), np.array([0, shape[1]]))
