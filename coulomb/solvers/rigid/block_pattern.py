"""L W + D with blocks of 3 x 3, as the columns of a sparse matrix: the same pattern again and again, in any order."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...native import kernels


class BlockPattern:
    """The entries of a block matrix and where they are in compressed columns.

    Args:
        W: Block matrix of scipy, blocks of 3 x 3, columns in order, with all blocks of the diagonal.

    Attributes:
        order: New numbers to old ones of rows and columns alike; None for the old ones.
        indptr: Of the compressed columns.
        indices: Of the compressed columns.
    """

    def __init__(self, W: Any):
        self._m = W.shape[0] // 3
        self._first, self._column = W.indptr.astype(np.int32), W.indices.astype(np.int32)
        self._blocks: FloatArray = np.ascontiguousarray(W.data)
        self._row = np.repeat(np.arange(self._m), np.diff(self._first))
        self._diagonal = np.flatnonzero(self._row == self._column)
        self._place(None)

    def reorder(self, order: npt.NDArray[np.intp]) -> None:
        """Number rows and columns anew, order (3 m,) from new numbers to old ones."""
        self._place(order.astype(np.int32))

    def _place(self, order: npt.NDArray[np.int32] | None) -> None:
        n = 3 * self._m
        self.order = order
        old = np.arange(n, dtype=np.int32) if order is None else order
        new = np.empty(n, dtype=np.int32)
        new[old] = np.arange(n, dtype=np.int32)
        self.indptr = np.empty(n + 1, dtype=np.int32)
        self.indices = np.empty(9 * len(self._column), dtype=np.int32)
        self._at = np.empty(9 * len(self._column), dtype=np.int32)
        arrays = (self._first, self._column, old, new, self.indptr, self.indices, self._at)
        kernels().positions(self._m, *(array.ctypes.data for array in arrays))

    def entries(self, D: FloatArray, L: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Entries of r (L W + D) c in compressed columns, and r, c of shape (3 m,): largest entries of rows, then of
        columns, are 1.

        Args:
            D: Shape (m, 3, 3).
            L: Shape (m, 3, 3); None for 1.
        """
        data, r, c = np.empty(len(self._at)), np.empty(3 * self._m), np.empty(3 * self._m)
        D, left = np.ascontiguousarray(D), None if L is None else np.ascontiguousarray(L)
        arrays = (self._first, self._column, self._blocks, D, left, self._at, np.empty_like(self._blocks), r, c, data)
        kernels().entries(self._m, *(None if array is None else array.ctypes.data for array in arrays))
        return data, r, c
