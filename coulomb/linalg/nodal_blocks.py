"""K in 3 x 3 blocks, one per pair of coupled nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc

from .petsc_arrays import own_and_others

_Array = npt.NDArray[Any]


class NodalRows:
    """Rows of K node by node: coupled nodes, and where their 3 x 3 blocks are among its values, which are not copied.

    Attributes:
        indptr, indices: Coupled nodes of every node, ascending, as all of 64 bits.
        first, stride: Where the block of each pair begins among the values, and from one of its rows to the next.
        values: The values of K, on one rank.
    """

    def __init__(self, K: PETSc.Mat | scipy.sparse.bsr_matrix):
        if isinstance(K, PETSc.Mat):
            stored = own_and_others(K)[0]
            if _whole(stored.indptr, stored.indices):
                self._take(*stored)
                return
            K = nodal_blocks(K)
        K.sort_indices()
        self.indptr: _Array = K.indptr.astype(np.int64)
        self.indices: _Array = K.indices.astype(np.int64)
        self.values: _Array = np.ascontiguousarray(K.data, dtype=np.float64).ravel()
        self.first: _Array = 9 * np.arange(len(K.indices))
        self.stride: _Array = np.full(len(K.indices), 3)

    def _take(self, indptr: _Array, indices: _Array, values: _Array) -> None:
        """Rows of which every block is stored wholly."""
        length = np.diff(indptr)[::3]
        coupled = length // 3
        self.indptr = np.concatenate([[0], np.cumsum(coupled)])
        inside = np.arange(self.indptr[-1]) - np.repeat(self.indptr[:-1], coupled)
        self.values, self.first = values, np.repeat(indptr[:-1:3].astype(np.int64), coupled) + 3 * inside
        self.stride = np.repeat(length.astype(np.int64), coupled)
        self.indices = indices[self.first].astype(np.int64) // 3


def _whole(indptr: _Array, indices: _Array) -> bool:
    """Whether rows (n,) and columns of a matrix consist of 3 x 3 blocks of which every entry is stored."""
    length = np.diff(indptr).reshape(-1, 3)
    if len(indices) % 3 > 0 or np.any(length % 3 > 0) or np.any(length != length[:, :1]):
        return False
    triples = indices.reshape(-1, 3)
    return bool(np.all(triples[:, 0] % 3 == 0) and np.all(triples[:, 2] == triples[:, 0] + 2))


def nodal_blocks(K: PETSc.Mat) -> scipy.sparse.bsr_matrix:
    """This rank's rows of K, 3 rows per node, all columns."""
    indptr, indices, values = K.getValuesCSR()
    shape = (len(indptr) - 1, K.getSize()[1])
    return scipy.sparse.csr_matrix((values, indices, indptr), shape=shape).tobsr((3, 3))
