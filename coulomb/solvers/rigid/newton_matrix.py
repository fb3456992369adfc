"""Sums of a symmetric matrix and nodal blocks, factorised again and again: the Newton systems of the cone method."""

from __future__ import annotations

import warnings
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from ...arrays import FloatArray
from ...native import kernels


class BlockPattern:
    """The entries of a matrix W of 3 x 3 blocks, columns in order, with all blocks of the diagonal, and where they are
    in compressed columns, `indptr` and `indices`.

    Attributes:
        order: New numbers to old ones of rows and columns alike; None for the old ones.
    """

    def __init__(self, W: Any):
        self._m = W.shape[0] // 3
        self._first, self._column = W.indptr.astype(np.int32), W.indices.astype(np.int32)
        self._blocks: FloatArray = np.ascontiguousarray(W.data)
        self._row = np.repeat(np.arange(self._m), np.diff(self._first))
        self._diagonal = np.flatnonzero(self._row == self._column)
        self.reorder(None)

    def reorder(self, order: npt.NDArray[np.int32] | None) -> None:
        """Number rows and columns anew, order (3 m,) from new numbers to old ones."""
        n = 3 * self._m
        self.order = order
        old = np.arange(n, dtype=np.int32) if order is None else order
        new = np.empty(n, dtype=np.int32)
        new[old] = np.arange(n, dtype=np.int32)
        self.indptr = np.empty(n + 1, dtype=np.int32)
        self.indices = np.empty(9 * len(self._column), dtype=np.int32)
        self._at = np.empty(9 * len(self._column), dtype=np.int32)
        arrays = (self._first, self._column, old, new, self.indptr, self.indices, self._at)
        kernels().positions(self._m, *arrays)

    def entries(self, D: FloatArray, L: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Entries of r (L W + D) c in compressed columns, and r, c of shape (3 m,): largest entries of rows, then of
        columns, are 1.

        D and L have shape (m, 3, 3); None is L = 1.
        """
        data, r, c = np.empty(len(self._at)), np.empty(3 * self._m), np.empty(3 * self._m)
        D, left = np.ascontiguousarray(D), None if L is None else np.ascontiguousarray(L)
        arrays = (self._first, self._column, self._blocks, D, left, self._at, np.empty_like(self._blocks), r, c, data)
        kernels().entries(self._m, *arrays)
        return data, r, c


_SMALL: Final = 90  # rows up to which dense algebra is quicker
_FULL: Final = 0.25  # of the blocks: a matrix with more is treated as dense
_OVERHEAD: Final = 1e5  # of a system per contact, in operations of a factorisation that take as long


class NewtonMatrix:
    """M = L W + D with nodal blocks L and D, and its LU factors; W and the pattern stay.

    Sparse factors have a symmetric minimum degree order, found at the first factorisation, and prefer the diagonal as
    pivot.  Rows, then columns, are first scaled to a largest entry of 1: the blocks of open and of closed contacts
    differ by many orders of magnitude.  W (3 m, 3 m) is symmetric and sparse.

    Attributes:
        factorisations: Their number so far.
        operations: Floating-point operations of all of them, with as many for the rest of each system as take as long.
            Those of sparse factors are counted once and go with the square of their entries.
        limit: Operations after which nothing more is factorised.
    """

    def __init__(self, W: Any):
        self._rows = W.shape[0]
        m = self._rows // 3
        self.W = W.tocsr()
        pattern = _with_diagonal(self.W.tobsr((3, 3)))
        self.factorisations, self.operations, self.limit = 0, 0.0, np.inf
        self._work, self._entries, self._counted = 2.0 / 3.0 * self._rows**3, 1, False
        self.dense = self._rows <= _SMALL or len(pattern.indices) > _FULL * m**2
        self._lu: Any = None
        if self.dense:
            self._W: FloatArray = self.W.toarray()
            at = 3 * np.arange(m)[:, None, None]
            self._at = (at + np.arange(3)[:, None], at + np.arange(3))
        else:
            self._pattern = BlockPattern(pattern)

    def factorise(self, D: FloatArray, L: FloatArray | None = None, diagonal: float = 0.01) -> bool:
        """Factorise L W + D, both (m, 3, 3), None is L = 1; whether it is regular, and within the limit of work.

        Sparse factors have the diagonal as pivot down to this size, over the largest entry of the column.
        """
        if self.operations > self.limit:
            return False
        self.factorisations += 1
        self.operations += _OVERHEAD * self._rows / 3
        return self._factorise_dense(D, L) if self.dense else self._factorise_sparse(D, L, diagonal)

    def _factorise_dense(self, D: FloatArray, L: FloatArray | None) -> bool:
        M = self._W.copy() if L is None else (L @ self._W.reshape(len(L), 3, -1)).reshape(self._W.shape)
        M[self._at] += D
        self.operations += self._work
        with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
            self._r = 1.0 / np.abs(M).max(axis=1)
            M *= self._r[:, None]
            self._c = 1.0 / np.abs(M).max(axis=0)
            M *= self._c
            if not np.isfinite(M).all():
                return False
            self._lu = scipy.linalg.lu_factor(M.T, overwrite_a=True, check_finite=False)
        return bool(np.all(np.diagonal(self._lu[0]) != 0.0))

    def _factorise_sparse(self, D: FloatArray, L: FloatArray | None, diagonal: float) -> bool:
        pattern = self._pattern
        data, self._r, self._c = pattern.entries(D, L)
        if not np.isfinite(data).all():
            return False
        matrix = scipy.sparse.csc_matrix((data, pattern.indices, pattern.indptr), shape=(self._rows, self._rows))
        order = "MMD_AT_PLUS_A" if pattern.order is None else "NATURAL"
        try:
            self._lu = scipy.sparse.linalg.splu(
                matrix, permc_spec=order, diag_pivot_thresh=diagonal, options={"SymmetricMode": True}
            )
        except RuntimeError:  # exactly singular
            return False
        self._order = pattern.order
        if self._order is None or not (self._counted or L is not None):
            below, right = np.diff(self._lu.L.indptr) - 1, np.bincount(self._lu.U.indices, minlength=self._rows)
            self._work, self._entries = 2.0 * float(below @ right), self._lu.nnz
            self._counted = L is None  # L has many zeros, which take time but are left out of these factors
        if self._order is None:
            pattern.reorder(np.argsort(self._lu.perm_c).astype(np.int32))
        self.operations += self._work * (self._lu.nnz / self._entries) ** 2
        return True

    def sign(self) -> float:
        """The sign of the determinant of the last matrix."""
        if self.dense:
            lu, pivots = self._lu
            odd, diagonal = np.count_nonzero(pivots != np.arange(len(pivots))), np.diagonal(lu)
        else:
            odd, diagonal = _transpositions(self._lu.perm_r) + _transpositions(self._lu.perm_c), self._lu.U.diagonal()
        return float((-1.0) ** int(odd + np.count_nonzero(diagonal < 0.0)))

    def solve(self, right: FloatArray, transposed: bool = False) -> FloatArray:
        """The solution for a right-hand side (m, 3), with the last factors, or with their transposes."""
        first, last = (self._c, self._r) if transposed else (self._r, self._c)
        r = first * right.ravel()
        if self.dense:
            x = scipy.linalg.lu_solve(self._lu, r, trans=int(not transposed), check_finite=False)
        else:
            new = slice(None) if self._order is None else self._order
            x = np.empty_like(r)
            x[new] = self._lu.solve(r[new], "T" if transposed else "N")
        return (last * x).reshape(right.shape)


def _with_diagonal(blocks: Any) -> Any:
    """A block matrix with columns in order and all blocks of the diagonal, zeros where there were none."""
    m = blocks.shape[0] // 3
    blocks.sort_indices()
    rows = np.repeat(np.arange(m), np.diff(blocks.indptr))
    missing = np.setdiff1d(np.arange(m), rows[rows == blocks.indices])
    if not len(missing):
        return blocks
    indptr = np.searchsorted(missing, np.arange(m + 1))
    ones = scipy.sparse.bsr_matrix((np.ones((len(missing), 3, 3)), missing, indptr), shape=blocks.shape)
    blocks = (blocks + ones).tobsr((3, 3))
    blocks.sort_indices()
    rows = np.repeat(np.arange(m), np.diff(blocks.indptr))
    blocks.data[(rows == blocks.indices) & np.isin(rows, missing)] = 0.0
    return blocks


def _transpositions(permutation: Any) -> int:
    """Their number in a permutation: its length less its cycles."""
    after, seen, cycles = permutation.tolist(), bytearray(len(permutation)), 0
    for first in range(len(after)):
        if not seen[first]:
            cycles, k = cycles + 1, first
            while not seen[k]:
                seen[k], k = 1, after[k]
    return len(after) - cycles
