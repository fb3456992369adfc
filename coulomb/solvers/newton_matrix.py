"""Sums of a symmetric matrix and nodal blocks, factorised again and again: the Newton systems of the cone method."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from ..arrays import FloatArray

_SMALL = 90  # rows up to which dense algebra is quicker
_FULL = 0.25  # of the blocks: a matrix with more is treated as dense


class NewtonMatrix:
    """M = L W + D with nodal blocks L and D, and its LU factors; W and the pattern stay.

    Sparse factors have a symmetric minimum degree order and prefer the diagonal as pivot.  Rows, then columns, are
    first scaled to a largest entry of 1: the blocks of open and of closed contacts differ by many orders of magnitude.

    Args:
        W: Symmetric, sparse, shape (3 m, 3 m).

    Attributes:
        factorisations: Their number so far.
        work: Floating-point operations of one factorisation; of a sparse one as measured at the first.
    """

    def __init__(self, W: Any):
        self._rows = W.shape[0]
        m = self._rows // 3
        diagonal = scipy.sparse.bsr_matrix((np.zeros((m, 3, 3)), np.arange(m), np.arange(m + 1)), shape=W.shape)
        diagonal.data[:] = 1.0
        self.W = W.tocsr()
        pattern = (scipy.sparse.bsr_matrix(abs(self.W), blocksize=(3, 3)) + diagonal).tobsr((3, 3))
        pattern.sort_indices()
        self.factorisations, self.work = 0, 2.0 / 3.0 * self._rows**3
        self.dense = self._rows <= _SMALL or len(pattern.indices) > _FULL * m**2
        self._lu: Any = None
        if self.dense:
            self._W: FloatArray = self.W.toarray()
            at = 3 * np.arange(m)[:, None, None]
            self._at = (at + np.arange(3)[:, None], at + np.arange(3))
        else:
            self._prepare(pattern)

    def _prepare(self, pattern: Any) -> None:
        """Blocks of W row by row, where those of the diagonal are, and the order of their entries in columns."""
        indptr, indices, count = pattern.indptr, pattern.indices, len(pattern.indices)
        self._first, self._row = indptr[:-1], np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
        self._diagonal = np.flatnonzero(indices == self._row)
        i, j = 3 * self._row[:, None, None] + np.arange(3)[:, None], 3 * indices[:, None, None] + np.arange(3)
        i, j = (np.broadcast_to(k, (count, 3, 3)).ravel() for k in (i, j))
        self._order = np.lexsort((i, j))
        self._indices = i[self._order].astype(np.int32)
        self._column = j[self._order]
        self._indptr = np.searchsorted(self._column, np.arange(self._rows + 1)).astype(np.int32)
        entries = scipy.sparse.csr_matrix(self.W)
        entries.sort_indices()
        rows = np.repeat(np.arange(self._rows), np.diff(entries.indptr))
        blocks = np.searchsorted(self._row * self._rows + indices, rows // 3 * self._rows + entries.indices // 3)
        self._blocks: FloatArray = np.zeros((count, 3, 3))
        self._blocks[blocks, rows % 3, entries.indices % 3] = entries.data

    def factorise(self, D: FloatArray, L: FloatArray | None = None) -> bool:
        """Factorise L W + D, both of shape (m, 3, 3); whether it is regular.

        Args:
            D: Added blocks.
            L: Factors of the rows of W; None for 1.
        """
        self.factorisations += 1
        return self._factorise_dense(D, L) if self.dense else self._factorise_sparse(D, L)

    def _factorise_dense(self, D: FloatArray, L: FloatArray | None) -> bool:
        M = self._W.copy() if L is None else (L @ self._W.reshape(len(L), 3, -1)).reshape(self._W.shape)
        M[self._at] += D
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

    def _factorise_sparse(self, D: FloatArray, L: FloatArray | None) -> bool:
        M = self._blocks.copy() if L is None else L[self._row] @ self._blocks
        M[self._diagonal] += D
        with np.errstate(divide="ignore", invalid="ignore"):
            self._r = 1.0 / np.maximum.reduceat(np.abs(M).max(axis=2), self._first, axis=0).ravel()
            M *= self._r.reshape(-1, 3)[self._row][:, :, None]
            data = M.ravel()[self._order]
            self._c = 1.0 / np.maximum.reduceat(np.abs(data), self._indptr[:-1])
            data *= self._c[self._column]
        if not np.isfinite(data).all():
            return False
        matrix = scipy.sparse.csc_matrix((data, self._indices, self._indptr), shape=(self._rows, self._rows))
        try:
            self._lu = scipy.sparse.linalg.splu(
                matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}
            )
        except RuntimeError:  # exactly singular
            return False
        if self.factorisations == 1:
            below, right = np.diff(self._lu.L.indptr) - 1, np.bincount(self._lu.U.indices, minlength=self._rows)
            self.work = 2.0 * float(below @ right)
        return True

    def solve(self, right: FloatArray) -> FloatArray:
        """The solution for a right-hand side (m, 3), with the last factors."""
        r = self._r * right.ravel()
        if self.dense:
            x = scipy.linalg.lu_solve(self._lu, r, trans=1, check_finite=False)
        else:
            x = self._lu.solve(r)
        solution: FloatArray = (self._c * x).reshape(right.shape)
        return solution
