"""Matrices in small dense blocks with products in C (native/): symmetric ones, and interpolations between grids.

Values are stored in single precision, half the memory that a product reads; vectors and sums are in double precision.
A symmetric matrix keeps what single precision rounds off as well, for products as accurate as in double precision.
The entries in columns of other ranks are a matrix of their own, of which only the rows that have such entries are kept.
While the blocks of a vector that they need come from other ranks (ghost_blocks.py), the product with this rank's own
columns is made.

Vectors of this rank are arrays with room for a few numbers behind their end (`padded`).
"""

from __future__ import annotations

import ctypes
import itertools
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ..arrays import FloatArray
from .ghost_blocks import PADDING, GhostBlocks, padded
from .native import threads
from .petsc_arrays import DistributedEntries, Entries

__all__ = [
    "PADDING",
    "SHAPES",
    "BlockInterpolation",
    "Blocks",
    "DistributedBlocks",
    "SymmetricBlocks",
    "address",
    "distributed_blocks",
    "in_kernel_blocks",
    "padded",
]

SHAPES = ((3, 3), (3, 6), (6, 6))
"""Shapes of blocks for which there are kernels."""

_LANES = {3: 4, 6: 8}
_ALONE = 180_000  # entries below which one thread takes less time than several
_Array = npt.NDArray[Any]


def address(array: _Array | None) -> ctypes.c_void_p:
    """The address of an array's first number, for a kernel."""
    return ctypes.c_void_p(None if array is None else array.ctypes.data)


class Blocks(NamedTuple):
    """Rows of blocks.

    Attributes:
        pointers: Where the blocks of a row begin, shape (rows + 1,).
        columns: Columns of blocks.
        values: In single precision, block after block by rows, padded.
        low: What single precision rounds off, padded; None if it is not kept.
    """

    pointers: npt.NDArray[np.int32]
    columns: npt.NDArray[np.int32]
    values: npt.NDArray[np.float32]
    low: npt.NDArray[np.float32] | None


def in_kernel_blocks(
    library: ctypes.CDLL, entries: Entries, shape: tuple[int, int], accurate: bool = False, upper: bool = False
) -> Blocks:
    """Entries in blocks; of an upper triangle the block on the diagonal is first in its row, and always there."""
    rows = (len(entries.indptr) - 1) // shape[0]
    indptr, indices = (array.astype(np.int32, copy=False) for array in entries[:2])
    pointers = np.empty(rows + 1, dtype=np.int32)

    def convert(values: _Array, *out: _Array | None) -> int:
        arrays = [indptr, indices, values, pointers, *out]
        return int(library.to_blocks(ctypes.c_long(rows), *shape, int(upper), *map(address, arrays)))

    values = entries.values
    count = convert(values, None, None, None)
    if count < 0:  # columns do not ascend
        csr = scipy.sparse.csr_matrix((values.copy(), indices.copy(), indptr))
        csr.sort_indices()
        return in_kernel_blocks(library, Entries(csr.indptr, csr.indices, csr.data), shape, accurate, upper)
    columns = np.empty(count, dtype=np.int32)
    high = np.zeros(count * shape[0] * shape[1] + PADDING, dtype=np.float32)
    low = np.zeros_like(high) if accurate else None
    convert(values, columns, high, low)
    return Blocks(pointers, columns, high, low)


class DistributedBlocks(NamedTuple):
    """Rows of this rank of a distributed matrix in blocks.

    Attributes:
        comm: The ranks.
        own: Blocks in this rank's columns.
        others: Blocks in columns of other ranks, as places in `needed`; None on one rank.
        needed: Numbers of columns of other ranks, ascending.
        starts: Number of the first column of each rank, and of all columns, shape (ranks + 1,).
    """

    comm: MPI.Comm
    own: Blocks
    others: Blocks | None
    needed: _Array
    starts: _Array


def distributed_blocks(
    library: ctypes.CDLL,
    entries: DistributedEntries,
    shape: tuple[int, int],
    accurate: bool = False,
    upper: bool = False,
) -> DistributedBlocks:
    """Entries in blocks, the rows and columns of a block on one rank; of this rank's columns the upper triangle if
    `upper`, with what single precision rounds off if `accurate`."""
    needed, place = np.unique(entries.columns // shape[1], return_inverse=True)
    own, others = in_kernel_blocks(library, entries.own, shape, accurate, upper), None
    if entries.others is not None:
        at = (shape[1] * place.reshape(-1) + entries.columns % shape[1]).astype(np.int32)
        indptr, indices, values = entries.others
        indices = at[indices] if len(indices) else np.empty(0, np.int32)
        others = in_kernel_blocks(library, Entries(indptr, indices, values), shape, accurate)
    return DistributedBlocks(entries.comm, own, others, needed, entries.starts // shape[1])


class _Others:
    """The blocks of a matrix in columns of other ranks; collective.

    Args:
        library: The kernels.
        matrix: The matrix, on several ranks.
        shape: Rows and columns of a block.
    """

    def __init__(self, library: ctypes.CDLL, matrix: DistributedBlocks, shape: tuple[int, int]):
        blocks = matrix.others
        assert blocks is not None
        self._rows = np.flatnonzero(np.diff(blocks.pointers)).astype(np.int32)
        self._pointers = np.append(blocks.pointers[self._rows], blocks.pointers[-1]).astype(np.int32)
        self._blocks = blocks
        self._needed = len(matrix.needed)
        self.ghosts = GhostBlocks(matrix.comm, matrix.starts, matrix.needed, shape[1])
        self._sums = np.zeros(_LANES[shape[1]] * self._needed + PADDING)
        self._add, self._restrict = (
            getattr(library, f"{name}_{shape[0]}_{shape[1]}") for name in ("others", "restrict_to")
        )
        self._places = tuple(map(address, (self._rows, self._pointers, blocks.columns, blocks.values)))

    def add(
        self,
        factor: float,
        y: FloatArray,
        inverse: FloatArray | None = None,
        x: FloatArray | None = None,
        accurate: bool = False,
    ) -> None:
        """y <- y + factor D^-1 A g, with the blocks g that are being fetched, and the same for x; D^-1 is 1 if there is
        no `inverse`."""
        g = self.ghosts.fetched()
        vectors = address(self._blocks.low if accurate else None), address(g), ctypes.c_double(factor)
        self._add(len(self._rows), *self._places, *vectors, address(inverse), address(y), address(x))

    def give_restricted(self, r: FloatArray) -> None:
        """Begin to send A^T r to the ranks of its entries."""
        rows, *matrix = self._places
        out = address(self.ghosts.values), address(self._sums)
        self._restrict(len(self._rows), self._needed, 1, rows, *matrix, address(r), *out)
        self.ghosts.give()


def _others(library: ctypes.CDLL, matrix: DistributedBlocks, shape: tuple[int, int]) -> _Others | None:
    """None on one rank."""
    return None if matrix.others is None else _Others(library, matrix, shape)


def _team(blocks: Blocks) -> int:
    """Threads for a matrix."""
    return threads() if len(blocks.values) >= _ALONE else 1


def _shares(blocks: Blocks, team: int) -> tuple[npt.NDArray[np.int32] | None, int]:
    """How threads share the rows of an upper triangle, as `shared` in native/blocks.h has it, and how many rows have
    further sums; None for one thread."""
    pointers, columns = blocks.pointers, blocks.columns
    if team == 1:
        return None, 0
    begin = np.searchsorted(pointers, np.arange(1, team) * (len(columns) / team))
    begin = np.concatenate([[0], begin, [len(pointers) - 1]])
    parts = (columns[pointers[a] : pointers[b]] for a, b in itertools.pairwise(begin))
    reach = np.maximum([1 + part.max(initial=-1) for part in parts], begin[1:])
    return np.concatenate([[team], begin, reach]).astype(np.int32), int((reach - begin[1:]).sum())


class SymmetricBlocks:
    """A symmetric matrix by its upper triangle in blocks.

    Args:
        library: The kernels.
        matrix: Symmetric; the rows of a block on one rank.
        size: Rows of a block, 3 or 6.
        accurate: Whether `mult` is as accurate as in double precision, for which it keeps twice as many numbers.

    Attributes:
        size: Rows of this rank.
        threads: Of its products.
    """

    def __init__(self, library: ctypes.CDLL, matrix: DistributedEntries, size: int, accurate: bool = False):
        blocks = distributed_blocks(library, matrix, (size, size), accurate, upper=True)
        self._blocks, self._others = blocks.own, _others(library, blocks, (size, size))
        n = len(self._blocks.pointers) - 1
        self.size, self._width = size * n, size
        self.threads = _team(self._blocks)
        self._shares, beyond = _shares(self._blocks, self.threads)
        self._sums = np.zeros(_LANES[size] * (n + beyond) + PADDING)
        self._product, self._residual, self._step = (
            getattr(library, f"{name}_{size}_{size}") for name in ("product", "residual", "step")
        )
        self._matrix = (n, address(self._shares), *map(address, self._blocks[:3]))

    @property
    def diagonal(self) -> FloatArray:
        """In single precision, shape (size,)."""
        at = np.arange(self._width)
        blocks = self._blocks.values[:-PADDING].reshape(-1, self._width, self._width)
        diagonal: FloatArray = blocks[self._blocks.pointers[:-1, None], at, at].astype(np.float64).ravel()
        return diagonal

    def mult(self, x: FloatArray, y: FloatArray, accurate: bool = True) -> None:
        """y <- K x, in double precision if `accurate`, here and in the matrix; x padded; collective."""
        if self._others is not None:
            self._others.ghosts.fetch(x)
        low = self._blocks.low if accurate else None
        self._product(*self._matrix, address(low), address(x), address(y), address(self._sums))
        if self._others is not None:
            self._others.add(1.0, y, accurate=accurate)

    def residual(self, b: FloatArray, x: FloatArray, r: FloatArray) -> None:
        """r <- b - K x, K in single precision; x padded; collective."""
        if self._others is not None:
            self._others.ghosts.fetch(x)
        self._residual(*self._matrix, address(b), address(x), address(r), address(self._sums))
        if self._others is not None:
            self._others.add(-1.0, r)

    def step(
        self, inverse: FloatArray, b: FloatArray, x: FloatArray, d: FloatArray, first: float, second: float
    ) -> None:
        """d <- first d + second inverse (b - K x), x <- x + d, K in single precision; x padded; collective."""
        if self._others is not None:
            self._others.ghosts.fetch(x)
        factors = ctypes.c_double(first), ctypes.c_double(second)
        vectors = (address(vector) for vector in (inverse, b, x, d))
        self._step(*self._matrix, *vectors, *factors, address(self._sums))
        if self._others is not None:
            self._others.add(-second, d, inverse, x)

    def destroy(self) -> None:
        """Free the requests of messages."""
        if self._others is not None:
            self._others.ghosts.destroy()


class BlockInterpolation:
    """An interpolation P from a coarse grid, in blocks.

    Args:
        library: The kernels.
        matrix: P.
        shape: Rows and columns of a block, one of SHAPES.

    Attributes:
        shape: The argument.
        columns: Unknowns of this rank on the coarse grid.
    """

    def __init__(self, library: ctypes.CDLL, matrix: DistributedBlocks, shape: tuple[int, int]):
        self.shape = shape
        self._blocks, self._others = matrix.own, _others(library, matrix, shape)
        self.columns = shape[1] * int(np.diff(matrix.starts)[matrix.comm.rank])
        self._n, self._coarse = len(self._blocks.pointers) - 1, self.columns // shape[1]
        self._threads = _team(self._blocks)
        self._sums = np.zeros(_LANES[shape[1]] * self._coarse * self._threads + PADDING)
        self._prolong, self._restrict = (
            getattr(library, f"{name}_{shape[0]}_{shape[1]}") for name in ("prolong", "restrict_to")
        )
        self._matrix = tuple(map(address, self._blocks[:3]))

    def prolong(self, e: FloatArray, x: FloatArray) -> None:
        """x <- x + P e; e padded; collective."""
        if self._others is not None:
            self._others.ghosts.fetch(e)
        self._prolong(self._n, self._threads, *self._matrix, address(e), address(x))
        if self._others is not None:
            self._others.add(1.0, x)

    def restrict(self, r: FloatArray, b: FloatArray) -> None:
        """b <- P^T r; collective."""
        if self._others is not None:
            self._others.give_restricted(r)
        vectors = address(r), address(b), address(self._sums)
        self._restrict(self._n, self._coarse, self._threads, None, *self._matrix, *vectors)
        if self._others is not None:
            self._others.ghosts.given(b)

    def destroy(self) -> None:
        """Free the requests of messages."""
        if self._others is not None:
            self._others.ghosts.destroy()
