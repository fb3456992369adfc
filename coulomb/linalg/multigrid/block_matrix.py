"""Matrices in small dense blocks with products in C (native/): symmetric ones, and interpolations between grids.

Values are stored in single precision, half the memory that a product reads; vectors and sums are in double precision.
A symmetric matrix keeps what single precision rounds off as well, for products as accurate as in double precision.
The entries in columns of other ranks are a matrix of their own, of which only the rows that have such entries are kept.
While the blocks of a vector that they need come from other ranks, the product with this rank's own
columns is made.

Vectors of this rank are arrays with room for a few numbers behind their end (`padded`).
"""

from __future__ import annotations

import ctypes
import functools
import itertools
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...exchange import Exchange, owner_of
from ...native import address, kernels, threads
from ..petsc_arrays import Distributed, DistributedEntries, Entries

# Blocks of a distributed vector that a rank needs and other ranks have: fetched, or summed where they belong.
#
# Messages go between neighbours only, by requests that are made once.  The kernels (native/exchange.h) start and await
# them: from Python a product would take longer for that than a small grid takes to multiply.  They are on their way
# while the product with this rank's own columns is made.

PADDING: Final = 8
"""Numbers behind the end of an array that the kernels may read."""

_FETCH, _GIVE = 1702, 1703  # tags
_Array = npt.NDArray[Any]


def padded(size: int) -> FloatArray:
    """A vector of zeros with room behind its end; the room is not part of it."""
    return np.zeros(size + PADDING)[:size]


class _ExchangeOfKernels(ctypes.Structure):
    """`struct exchange` of native/exchange.h."""

    _fields_ = (
        *(
            (name, ctypes.c_void_p)
            for name in ("start", "wait", "fetch", "give", "statuses", "values", "buffer", "own")
        ),
        *((name, ctypes.c_int) for name in ("messages", "count", "size")),
    )


class GhostBlocks:
    """The blocks of `size` numbers that this rank needs of others, by their ascending numbers; collective.

    Attributes:
        values: The fetched blocks, or those to give, shape (size k,), padded.
        exchange: What kernels need to fetch or give them; valid until `destroy`.
    """

    def __init__(self, comm: MPI.Comm, starts: _Array, needed: _Array, size: int):
        ask = Exchange(comm, owner_of(starts, needed))
        into, out = ask.given, ask.got
        own = (ask.send(needed) - int(starts[comm.rank])).astype(np.int32)
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
        self.exchange = _ExchangeOfKernels(*functions, *map(address, self._arrays), len(self._fetch), len(own), size)

    def destroy(self) -> None:
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


SHAPES = ((3, 3), (3, 6), (6, 6))
"""Shapes of blocks for which there are kernels."""

_LANES = {3: 4, 6: 8}
_ALONE: Final = 180_000  # entries below which one thread takes less time than several


class _OthersOfKernels(ctypes.Structure):
    """`struct others` of native/exchange.h."""

    _fields_ = (
        ("ghosts", ctypes.POINTER(_ExchangeOfKernels)),
        *((name, ctypes.c_void_p) for name in ("rows", "ptr", "col", "val", "low", "sums")),
        *((name, ctypes.c_int) for name in ("n", "columns")),
    )


class _BlocksOfKernels(ctypes.Structure):
    """`struct blocks` of native/exchange.h."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("shares", "ptr", "col", "val", "low", "sums")),
        ("others", ctypes.POINTER(_OthersOfKernels)),
        *((name, ctypes.c_int) for name in ("n", "columns", "threads")),
    )


class Blocks(NamedTuple):
    """Rows of blocks: `values` in single precision, padded, and in `low` what that rounds off, or None."""

    pointers: npt.NDArray[np.int32]
    columns: npt.NDArray[np.int32]
    values: npt.NDArray[np.float32]
    low: npt.NDArray[np.float32] | None

    def chosen(self, chosen: npt.NDArray[np.bool_]) -> Blocks:
        """Some of the blocks."""

        def part(array: _Array) -> _Array:
            return with_padding(_by_blocks(array, len(chosen))[chosen])

        pointers = np.concatenate([[0], np.cumsum(chosen)])[self.pointers].astype(np.int32)
        low = None if self.low is None else part(self.low)
        return Blocks(pointers, self.columns[chosen], part(self.values), low)


def with_padding(blocks: _Array) -> _Array:
    """Blocks one after the other in an array with room behind its end, which is part of it."""
    return np.append(blocks.ravel(), np.zeros(PADDING, np.float32))


def _by_blocks(array: _Array, count: int) -> _Array:
    return array[:-PADDING].reshape(count, -1 if count else 0)


def split(pointers: _Array, columns: _Array, blocks: FloatArray) -> Blocks:
    """From blocks in double precision, with what single precision rounds off."""
    low = np.empty(blocks.size + PADDING, np.float32)
    high = np.zeros_like(low)
    high[:-PADDING] = blocks.ravel()
    np.subtract(blocks.ravel(), high[:-PADDING], out=low[:-PADDING], casting="same_kind")
    low[-PADDING:] = 0.0
    return Blocks(pointers, columns, high, low)


def in_kernel_blocks(entries: Entries, shape: tuple[int, int], accurate: bool = False, upper: bool = False) -> Blocks:
    """Entries in blocks; of an upper triangle the block on the diagonal is first in its row, and always there."""
    rows = (len(entries.indptr) - 1) // shape[0]
    indptr, indices = (array.astype(np.int32, copy=False) for array in entries[:2])
    pointers = np.empty(rows + 1, dtype=np.int32)

    def convert(values: _Array, *out: _Array | None) -> int:
        return int(kernels().to_blocks(rows, *shape, int(upper), indptr, indices, values, pointers, *out))

    values = entries.values
    count = convert(values, None, None, None)
    if count < 0:  # columns do not ascend
        csr = scipy.sparse.csr_matrix((values.copy(), indices.copy(), indptr))
        csr.sort_indices()
        return in_kernel_blocks(Entries(csr.indptr, csr.indices, csr.data), shape, accurate, upper)
    columns = np.empty(count, dtype=np.int32)
    high = np.zeros(count * shape[0] * shape[1] + PADDING, dtype=np.float32)
    low = np.zeros_like(high) if accurate else None
    convert(values, columns, high, low)
    return Blocks(pointers, columns, high, low)


DistributedBlocks = Distributed[Blocks]


def distributed_blocks(
    entries: DistributedEntries, shape: tuple[int, int], accurate: bool = False, upper: bool = False
) -> DistributedBlocks:
    """Entries in blocks, the rows and columns of a block on one rank; `columns` are those of blocks.

    Of this rank's columns the upper triangle if `upper`, with what single precision rounds off if `accurate`.
    """
    needed, place = np.unique(entries.columns // shape[1], return_inverse=True)
    own, others = in_kernel_blocks(entries.own, shape, accurate, upper), None
    if entries.others is not None:
        at = (shape[1] * place.reshape(-1) + entries.columns % shape[1]).astype(np.int32)
        indptr, indices, values = entries.others
        indices = at[indices] if len(indices) else np.empty(0, np.int32)
        others = in_kernel_blocks(Entries(indptr, indices, values), shape, accurate)
    return DistributedBlocks(entries.comm, own, others, needed, entries.starts // shape[1])


def symmetric_blocks(entries: DistributedEntries, size: int) -> DistributedBlocks:
    """Of a symmetric matrix, in blocks of so many rows: of this rank's columns the upper triangle, the block on the
    diagonal first in its row; with what single precision rounds off."""
    return distributed_blocks(entries, (size, size), accurate=True, upper=True)


def sum_of(K: DistributedBlocks, S: DistributedBlocks) -> DistributedBlocks:
    """K + S in `symmetric_blocks`, S with few of them, in single precision; columns do not ascend, and
    may occur twice, but those of the diagonal."""
    own = K.own._replace(values=K.own.values.copy(), low=None)
    of_K, of_S = (_by_blocks(part.values, len(part.columns)) for part in (own, S.own))
    diagonal = S.own.pointers[:-1]
    of_K[own.pointers[:-1]] += of_S[diagonal]
    beside = np.any(of_S != 0.0, axis=1)
    beside[diagonal] = False
    if np.any(beside):
        own = joined_rows(own, S.own._replace(low=None).chosen(beside))
    others, columns = K.others, K.columns
    if K.others is not None and S.others is not None and len(S.columns):
        columns = np.union1d(K.columns, S.columns)
        both = (K.others, K.columns[K.others.columns]), (S.others, S.columns[S.others.columns])
        others = joined_rows(
            *(part._replace(columns=np.searchsorted(columns, numbers).astype(np.int32)) for part, numbers in both)
        )
    return DistributedBlocks(K.comm, own, others, columns, K.starts)


def joined_rows(*parts: Blocks) -> Blocks:
    """Matrices of as many rows as one; the columns of one after those of the other."""
    row = np.concatenate([np.repeat(np.arange(len(part.pointers) - 1), np.diff(part.pointers)) for part in parts])
    order = np.argsort(row, kind="stable")

    def joined(arrays: Sequence[_Array]) -> _Array:
        blocks = [_by_blocks(array, len(part.columns)) for array, part in zip(arrays, parts, strict=True)]
        return with_padding(np.concatenate([one for one in blocks if len(one)] or blocks[:1])[order])

    low = [part.low for part in parts if part.low is not None]
    pointers = sum((part.pointers for part in parts), np.zeros_like(parts[0].pointers))
    columns = np.concatenate([part.columns for part in parts])[order]
    return Blocks(pointers, columns, joined([part.values for part in parts]), joined(low) if low else None)


def on_every_rank(P: DistributedBlocks) -> DistributedBlocks:
    """An interpolation from a grid that every rank has as a whole: all columns are this rank's."""
    if P.others is None:
        return P
    first = P.starts[P.comm.rank]
    parts = (P.own, P.own.columns + first), (P.others, P.columns[P.others.columns])
    whole = joined_rows(*(part._replace(columns=columns.astype(np.int32)) for part, columns in parts))
    return DistributedBlocks(MPI.COMM_SELF, whole, None, P.columns[:0], np.array([0, P.starts[-1]]))


class _InKernels:
    """A matrix in blocks with all that the kernels need for products; collective.

    `shares` is how threads share the rows of an upper triangle, None for one thread; `sums` the blocks of sums that a
    product needs; `reference`, for the kernels, is valid until `destroy`.
    """

    def __init__(self, matrix: DistributedBlocks, shape: tuple[int, int], shares: _Array | None, sums: int, team: int):
        own, others, lanes = matrix.own, matrix.others, _LANES[shape[1]]
        columns = int(np.diff(matrix.starts)[matrix.comm.rank])
        arrays = [shares, *own, np.zeros(lanes * sums + PADDING)]
        sizes = len(own.pointers) - 1, columns, team
        self._ghosts: GhostBlocks | None = None
        elsewhere = None
        if others is not None:
            self._ghosts = GhostBlocks(matrix.comm, matrix.starts, matrix.columns, shape[1])
            rows = np.flatnonzero(np.diff(others.pointers)).astype(np.int32)
            pointers = np.append(others.pointers[rows], others.pointers[-1]).astype(np.int32)
            needed = len(matrix.columns)
            of_others = [rows, pointers, *others[1:], np.zeros(lanes * needed + PADDING)]
            arrays += of_others
            places = map(address, of_others)
            elsewhere = _OthersOfKernels(ctypes.pointer(self._ghosts.exchange), *places, len(rows), needed)
        self._arrays = arrays  # keeps them alive
        pointer = None if elsewhere is None else ctypes.pointer(elsewhere)
        self.reference = ctypes.byref(_BlocksOfKernels(*map(address, arrays[:6]), pointer, *sizes))

    def destroy(self) -> None:
        if self._ghosts is not None:
            self._ghosts.destroy()


def _checked(error: int) -> None:
    if error:
        raise MPI.Exception(error)


def _team(blocks: Blocks) -> int:
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
    """A symmetric matrix in `symmetric_blocks` of 3 or 6 rows, which are its `matrix`."""

    def __init__(self, matrix: DistributedBlocks, size: int):
        self.matrix, self._blocks = matrix, matrix.own
        n = len(self._blocks.pointers) - 1
        self.size, self._width = size * n, size
        self.threads = _team(self._blocks)
        shares, beyond = _shares(self._blocks, self.threads)
        self._matrix = _InKernels(matrix, (size, size), shares, n + beyond, self.threads)
        self._product, self._residual, self._smooth = (
            kernels()[f"{name}_{size}_{size}"] for name in ("product", "residual", "smooth")
        )

    @property
    def diagonal(self) -> FloatArray:
        """In single precision, shape (size,)."""
        at = np.arange(self._width)
        blocks = self._blocks.values[:-PADDING].reshape(-1, self._width, self._width)
        return blocks[self._blocks.pointers[:-1, None], at, at].astype(np.float64).ravel()

    def mult(self, x: FloatArray, y: FloatArray, accurate: bool = True) -> None:
        """y <- K x, as accurate as in double precision if `accurate`; x padded; collective."""
        _checked(self._product(self._matrix.reference, int(accurate), x, y))

    def residual(self, b: FloatArray, x: FloatArray, r: FloatArray) -> None:
        """r <- b - K x, K in single precision; x padded; collective."""
        _checked(self._residual(self._matrix.reference, b, x, r))

    def smooth(
        self, inverse: FloatArray, b: FloatArray, x: FloatArray, d: FloatArray, factors: FloatArray, zero: bool = False
    ) -> None:
        """Steps d <- first d + second inverse (b - K x), x <- x + d, K in single precision; x padded; collective.

        `factors` (steps, 2) has the two of each step; if `zero`, x and d are 0 before the first, whatever they hold.
        """
        _checked(self._smooth(self._matrix.reference, inverse, b, x, d, len(factors), factors, int(zero)))

    def destroy(self) -> None:
        self._matrix.destroy()


class BlockInterpolation:
    """An interpolation P from a coarse grid, with `columns` unknowns of this rank, in blocks of one of SHAPES."""

    def __init__(self, matrix: DistributedBlocks, shape: tuple[int, int]):
        self.shape = shape
        coarse, team = int(np.diff(matrix.starts)[matrix.comm.rank]), _team(matrix.own)
        self.columns = shape[1] * coarse
        self._matrix = _InKernels(matrix, shape, None, coarse * team, team)
        self._prolong, self._restrict = (
            kernels()[f"{name}_{shape[0]}_{shape[1]}"] for name in ("prolong", "restrict_to")
        )

    def prolong(self, e: FloatArray, x: FloatArray) -> None:
        """x <- x + P e; e padded; collective."""
        _checked(self._prolong(self._matrix.reference, e, x))

    def restrict(self, r: FloatArray, b: FloatArray) -> None:
        """b <- P^T r; collective."""
        _checked(self._restrict(self._matrix.reference, r, b))

    def destroy(self) -> None:
        self._matrix.destroy()
