"""Matrices in small dense blocks with products in C (native/): symmetric ones, and interpolations between grids.

Values are stored in single precision, half the memory that a product reads; vectors and sums are in double precision.
A symmetric matrix keeps what single precision rounds off as well, for products as accurate as in double precision.
Between ranks, the entries in columns of other ranks form a PETSc matrix of their own.

Vectors of this rank are arrays with room for a few numbers behind their end (`padded`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc

from ..arrays import FloatArray
from .nodal_blocks import upper_blocks

PADDING = 8
"""Numbers behind the end of an array that the kernels may read."""

SHAPES = ((3, 3), (3, 6), (6, 6))
"""Shapes of blocks for which there are kernels."""

_LANES = {3: 4, 6: 8}
_CHUNK = 20_000  # rows
_Array = npt.NDArray[Any]


def padded(size: int) -> FloatArray:
    """A vector of zeros with room behind its end; the room is not part of it."""
    return np.zeros(size + PADDING)[:size]


def address(array: _Array | None) -> ctypes.c_void_p:
    """The address of an array's first number, for a kernel."""
    return ctypes.c_void_p(None if array is None else array.ctypes.data)


class _Elsewhere:
    """Entries in columns of other ranks, of a matrix with blocks: a PETSc matrix, or nothing."""

    def __init__(self, matrix: PETSc.Mat):
        self._matrix: PETSc.Mat | None = None
        if matrix.comm.size == 1:
            return
        indptr, indices, values = matrix.getValuesCSR()
        first, last = matrix.getOwnershipRangeColumn()
        other = (indices < first) | (indices >= last)
        before = np.concatenate([[0], np.cumsum(other)])
        csr = tuple(array.astype(PETSc.IntType) for array in (before[indptr], indices[other]))
        self._matrix = PETSc.Mat().createAIJ(matrix.getSizes(), csr=(*csr, values[other]), comm=matrix.comm)
        self._x, self._y = self._matrix.createVecs()

    def mult(self, x: FloatArray) -> FloatArray | None:
        """Its product, to be read before the next one; None if there are no such entries; collective."""
        if self._matrix is None:
            return None
        self._x.array[:] = x
        self._matrix.mult(self._x, self._y)
        product: FloatArray = self._y.array_r
        return product

    def mult_transpose(self, y: FloatArray) -> FloatArray | None:
        """The product with its transpose, as `mult`."""
        if self._matrix is None:
            return None
        self._y.array[:] = y
        self._matrix.multTranspose(self._y, self._x)
        product: FloatArray = self._x.array_r
        return product

    def destroy(self) -> None:
        """Free the PETSc objects."""
        if self._matrix is not None:
            for thing in (self._matrix, self._x, self._y):
                thing.destroy()


def _own_blocks(matrix: PETSc.Mat, shape: tuple[int, int]) -> Iterator[tuple[int, scipy.sparse.bsr_matrix]]:
    """The entries of this rank's rows in this rank's columns, in blocks, by some rows after the other, with the number
    of the first: PETSc's arrays can only be copied, and a copy of the whole matrix would need as much memory again."""
    own = matrix if matrix.comm.size == 1 else matrix.getDiagonalBlock()
    rows, columns = own.getSize()
    step = shape[0] * max(_CHUNK // shape[0], 1)
    every = PETSc.IS().createStride(columns, 0, 1, comm=PETSc.COMM_SELF)
    for first in range(0, max(rows, 1), step):
        count = min(step, rows - first)
        here = PETSc.IS().createStride(count, first, 1, comm=PETSc.COMM_SELF)
        part = own.createSubMatrix(here, every)
        indptr, indices, values = part.getValuesCSR()
        blocks = scipy.sparse.csr_matrix((values, indices, indptr), shape=(count, columns)).tobsr(shape)
        blocks.sort_indices()
        yield first // shape[0], blocks
        for thing in (part, here):
            thing.destroy()
    every.destroy()


def _joined(pointers: list[_Array]) -> npt.NDArray[np.int32]:
    """Pointers to the rows of parts, as those of the whole."""
    counts = np.concatenate([np.diff(part) for part in pointers])
    joined: npt.NDArray[np.int32] = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return joined


class SymmetricBlocks:
    """A symmetric matrix by its upper triangle in blocks.

    Args:
        library: The kernels.
        matrix: Symmetric, assembled; the rows of a block on one rank.
        size: Rows of a block, 3 or 6.
        accurate: Whether `mult` is as accurate as in double precision, for which it keeps twice as many numbers.

    Attributes:
        size: Rows of this rank.
    """

    def __init__(self, library: ctypes.CDLL, matrix: PETSc.Mat, size: int, accurate: bool = False):
        pointers, columns, high, low = [], [], [], []
        for first, rows in _own_blocks(matrix, (size, size)):
            row_pointers, row_columns, blocks = upper_blocks(rows, first)
            pointers.append(row_pointers)
            columns.append(row_columns.astype(np.int32))
            high.append(blocks.ravel().astype(np.float32))
            if accurate:
                low.append((blocks.ravel() - high[-1]).astype(np.float32))
        room = np.zeros(PADDING, dtype=np.float32)
        self._pointers, self._columns = _joined(pointers), np.concatenate(columns)
        self._values = np.concatenate([*high, room])
        high.clear()
        self._low = np.concatenate([*low, room]) if accurate else None
        self._n = len(self._pointers) - 1
        self.size = size * self._n
        self._sums = np.zeros(_LANES[size] * self._n + PADDING)
        self._elsewhere = _Elsewhere(matrix)
        self._right = padded(self.size)
        self._product, self._residual, self._step = (
            getattr(library, f"{name}_{size}_{size}") for name in ("product", "residual", "step")
        )
        self._matrix = (self._n, address(self._pointers), address(self._columns), address(self._values))

    def mult(self, x: FloatArray, y: FloatArray) -> None:
        """y <- K x, in double precision if `accurate`; x padded; collective."""
        self._product(*self._matrix, address(self._low), address(x), address(y), address(self._sums))
        other = self._elsewhere.mult(x)
        if other is not None:
            y += other

    def residual(self, b: FloatArray, x: FloatArray, r: FloatArray) -> None:
        """r <- b - K x, K in single precision; x padded; collective."""
        b = self._less_others(b, x)
        self._residual(*self._matrix, address(b), address(x), address(r), address(self._sums))

    def step(
        self, inverse: FloatArray, b: FloatArray, x: FloatArray, d: FloatArray, first: float, second: float
    ) -> None:
        """d <- first d + second inverse (b - K x), x <- x + d, K in single precision; x padded; collective."""
        b = self._less_others(b, x)
        factors = ctypes.c_double(first), ctypes.c_double(second)
        vectors = (address(vector) for vector in (inverse, b, x, d))
        self._step(*self._matrix, *vectors, *factors, address(self._sums))

    def _less_others(self, b: FloatArray, x: FloatArray) -> FloatArray:
        """b less the product with the columns of other ranks."""
        other = self._elsewhere.mult(x)
        return b if other is None else np.subtract(b, other, out=self._right)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._elsewhere.destroy()


class BlockInterpolation:
    """An interpolation P from a coarse grid, in blocks.

    Args:
        library: The kernels.
        matrix: Assembled; the rows and columns of a block on one rank.
        shape: Rows and columns of a block, one of SHAPES.
    """

    def __init__(self, library: ctypes.CDLL, matrix: PETSc.Mat, shape: tuple[int, int]):
        parts = [rows for _, rows in _own_blocks(matrix, shape)]
        self._pointers = _joined([rows.indptr for rows in parts])
        self._columns = np.concatenate([rows.indices for rows in parts]).astype(np.int32)
        room = np.zeros(PADDING, dtype=np.float32)
        self._values = np.concatenate([*(rows.data.ravel().astype(np.float32) for rows in parts), room])
        self._n, self._coarse = len(self._pointers) - 1, matrix.getLocalSize()[1] // shape[1]
        self._sums = np.zeros(_LANES[shape[1]] * self._coarse + PADDING)
        self._elsewhere = _Elsewhere(matrix)
        self._prolong, self._restrict = (
            getattr(library, f"{name}_{shape[0]}_{shape[1]}") for name in ("prolong", "restrict_to")
        )
        self._matrix = (address(self._pointers), address(self._columns), address(self._values))

    def prolong(self, e: FloatArray, x: FloatArray) -> None:
        """x <- x + P e; e padded; collective."""
        self._prolong(self._n, *self._matrix, address(e), address(x))
        other = self._elsewhere.mult(e)
        if other is not None:
            x += other

    def restrict(self, r: FloatArray, b: FloatArray) -> None:
        """b <- P^T r; collective."""
        self._restrict(self._n, self._coarse, *self._matrix, address(r), address(b), address(self._sums))
        other = self._elsewhere.mult_transpose(r)
        if other is not None:
            b += other

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._elsewhere.destroy()
