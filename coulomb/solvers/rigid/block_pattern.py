"""L W + D with blocks of 3 x 3, as the columns of a sparse matrix: the same pattern again and again, in any order.

In C (native/block_pattern.c), by numpy without a compiler.
"""

from __future__ import annotations

import ctypes
import functools
import logging
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...compiled import compiled_library

_log = logging.getLogger(__name__)

_SOURCE = Path(__file__).parent / "native" / "block_pattern.c"


@functools.cache
def _kernels() -> Any:
    try:
        library = compiled_library("block_pattern", [_SOURCE])
    except (OSError, subprocess.SubprocessError) as error:
        _log.info("no kernels in C, Newton matrices of rigid bodies take longer: %s", error)
        return None
    library.positions.argtypes = [ctypes.c_long] + [ctypes.c_void_p] * 7
    library.entries.argtypes = [ctypes.c_long] + [ctypes.c_void_p] * 10
    library.positions.restype = library.entries.restype = None
    return library


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
        n, kernels = 3 * self._m, _kernels()
        self.order = order
        old = np.arange(n, dtype=np.int32) if order is None else order
        new = np.empty(n, dtype=np.int32)
        new[old] = np.arange(n, dtype=np.int32)
        self.indptr = np.empty(n + 1, dtype=np.int32)
        self.indices = np.empty(9 * len(self._column), dtype=np.int32)
        self._at = np.empty(9 * len(self._column), dtype=np.int32)
        if kernels is not None:
            arrays = (self._first, self._column, old, new, self.indptr, self.indices, self._at)
            kernels.positions(self._m, *(array.ctypes.data for array in arrays))
            return
        shape = (len(self._column), 3, 3)
        i = np.broadcast_to(new.reshape(-1, 3)[self._row][:, :, None], shape).ravel()
        j = np.broadcast_to(new.reshape(-1, 3)[self._column][:, None, :], shape).ravel()
        placed = np.lexsort((i, j))
        self.indices, self._at[placed] = i[placed], np.arange(len(placed))
        self.indptr[:] = np.searchsorted(j[placed], np.arange(n + 1))

    def entries(self, D: FloatArray, L: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Entries of r (L W + D) c in compressed columns, and r, c of shape (3 m,): largest entries of rows, then of
        columns, are 1.

        Args:
            D: Shape (m, 3, 3).
            L: Shape (m, 3, 3); None for 1.
        """
        kernels, data = _kernels(), np.empty(len(self._at))
        if kernels is not None:
            r, c, M = np.empty(3 * self._m), np.empty(3 * self._m), np.empty_like(self._blocks)
            D, left = np.ascontiguousarray(D), None if L is None else np.ascontiguousarray(L)
            arrays = (self._first, self._column, self._blocks, D, left, self._at, M, r, c)
            given = (None if array is None else array.ctypes.data for array in arrays)
            kernels.entries(self._m, *given, data.ctypes.data)
            return data, r, c
        M = self._blocks.copy() if L is None else L[self._row] @ self._blocks
        M[self._diagonal] += D
        with np.errstate(divide="ignore", invalid="ignore"):
            r = 1.0 / np.maximum.reduceat(np.abs(M).max(axis=2), self._first[:-1], axis=0).ravel()
            M *= r.reshape(-1, 3)[self._row][:, :, None]
            largest = np.zeros((self._m, 3))
            np.maximum.at(largest, self._column, np.abs(M).max(axis=1))
            c = 1.0 / largest.ravel()
            M *= c.reshape(-1, 3)[self._column][:, None, :]
        data[self._at] = M.ravel()
        return data, r, c
