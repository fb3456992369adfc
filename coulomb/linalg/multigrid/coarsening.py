"""From a grid of multigrid to a coarser one: aggregates, smoothed interpolation, and the Galerkin product.

Smoothed aggregation (Vanek, Mandel, Brezina 1996) as PETSc's GAMG has it, in C with threads (native/coarsening.h), in
blocks of a node's displacements, or of an aggregate's six rigid motions.  Aggregates are of one rank.  On each, the
motions are made orthonormal: with the rows that K holds (no entry beside the diagonal) left out, so that a coarse
displacement moves nothing that is held.  The Galerkin product is made row by row, from rows of P^T K that are kept as
long as they are needed.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...exchange import Exchange, owner_of
from ...native import kernels, threads
from ..petsc_arrays import DistributedEntries, Entries
from ..reductions import concatenated
from .block_matrix import PADDING, Blocks, DistributedBlocks, joined_rows

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
    def parts(self) -> tuple[_Array | None, ...]:
        """For kernels: pointers, columns and values of both parts."""
        return (*self.own, *(self.others or (None, None, None)))

    @property
    def pattern(self) -> tuple[_Array | None, ...]:
        """For kernels: pointers and columns of both parts."""
        return (*self.parts[:2], *self.parts[3:5])


def _block_rows(entries: Entries, size: int, columns: int) -> BlockRows:
    rows = (len(entries.indptr) - 1) // size
    indptr, indices = (array.astype(np.int32, copy=False) for array in entries[:2])
    pointers, block_columns = np.empty(rows + 1, np.int32), np.empty(len(indices) // size, np.int32)
    if kernels().block_pattern(rows, size, indptr, indices, pointers, block_columns):
        return BlockRows(pointers, block_columns[: pointers[-1]], entries.values)
    blocks = scipy.sparse.csr_matrix((entries.values, indices, indptr), shape=(size * rows, columns)).tobsr(
        (size, size)
    )
    blocks.sort_indices()
    pointers, block_columns = (array.astype(np.int32, copy=False) for array in (blocks.indptr, blocks.indices))
    return BlockRows(pointers, block_columns, entries_of(pointers, block_columns, blocks.data, 1).values)


def entries_of(pointers: _Array, columns: _Array, blocks: FloatArray, threads: int) -> Entries:
    """The entries of blocks (k, b, b) by rows."""
    rows, size = len(pointers) - 1, blocks.shape[1]
    indptr = np.empty(size * rows + 1, np.int32)
    indices, values = np.empty(blocks.size, np.int32), np.empty(blocks.size)
    blocks = np.ascontiguousarray(blocks, dtype=np.float64)
    kernels().entries_of_blocks(rows, size, threads, pointers, columns, blocks, indptr, indices, values)
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


class RowExchange:
    """Between ranks that ask for things by their numbers (ascending) and those that have them; collective.

    `asked` are the things of this rank that others ask for, counted from its first one, by ranks.
    """

    def __init__(self, comm: MPI.Comm, starts: _Array, needed: _Array):
        self._comm = comm
        ask = Exchange(comm, owner_of(starts, needed))
        self.asked: _Array = ask.send(needed) - int(starts[comm.rank])
        self._askers = ask.sources

    def fetched(self, rows: _Array, lengths: _Array) -> _Array:
        """Rows for the things asked for, `lengths` for each of these: those for the needed ones; collective."""
        return Exchange(self._comm, np.repeat(self._askers, lengths)).send(rows)


_STRONG: Final = 0.02  # part of the diagonals from which on nodes belong together, as GAMG's threshold
_DAMPING: Final = 1.7  # over the largest eigenvalue of D^-1 K, which is estimated a little too small
_MOTIONS: Final = 6
_ALONE: Final = 2_000  # nodes below which one thread takes less time than several


class Coarser(NamedTuple):
    """P, P^T K P, and the six motions of its unknowns that P makes those of the finer grid, shape (unknowns, 6)."""

    P: DistributedBlocks
    matrix: DistributedEntries
    motions: FloatArray


def coarser(
    matrix: DistributedEntries, size: int, motions: FloatArray, inverse: FloatArray, largest: float
) -> Coarser | None:
    """The next grid; None if no two nodes belong together; collective.

    K is symmetric, in blocks of 3 or 6 rows; the six motions (rows of this rank, 6) it maps to almost zero; `inverse`
    is that of its diagonal D, `largest` the eigenvalue of D^-1 K.
    """
    K = WholeBlocks(matrix, size)
    team = threads() if K.count >= _ALONE else 1
    aggregates, count, loose = _aggregates(K, team)
    starts = np.concatenate([[0], np.cumsum(concatenated(K.comm, np.array([count])))])
    if starts[-1] == 0:
        return None
    P0, R = _orthonormal(size, aggregates, count, loose, motions, team)
    P = _smoothed(K, aggregates, starts, P0, _DAMPING / largest * inverse, team)
    del P0
    coarse = galerkin(K, P, _MOTIONS)
    return Coarser(P, with_diagonal(coarse), R.reshape(-1, _MOTIONS))


def _aggregates(K: WholeBlocks, team: int) -> tuple[npt.NDArray[np.int32], int, _Array]:
    """The aggregate of each node or -1, how many there are, and which rows have entries beside the diagonal."""
    n, size = K.count, K.size
    norms, loose = np.zeros(n), np.zeros(size * n, np.uint8)
    examine = kernels()[f"examine_{size}_6"]
    examine(n, team, *K.own, norms, loose)
    if K.others is not None:
        examine(n, team, *K.others, None, loose)
    strong, aggregates = np.empty(len(K.own.columns), np.uint8), np.empty(n, np.int32)
    kernels()[f"strength_{size}_6"](n, team, *K.own, norms, _STRONG, strong)
    count = kernels().aggregate(n, K.own.pointers, K.own.columns, strong, aggregates)
    return aggregates, count, loose


def _orthonormal(
    size: int, aggregates: _Array, count: int, loose: _Array, motions: FloatArray, team: int
) -> tuple[FloatArray, FloatArray]:
    """The motions with orthonormal columns on each aggregate, shape (rows, 6), padded; and R, shape (count, 6, 6)."""
    members = np.argsort(aggregates, kind="stable").astype(np.int32)
    begin = np.searchsorted(aggregates[members], np.arange(count + 1)).astype(np.int32)
    P0 = np.zeros(motions.size + PADDING)[: motions.size].reshape(motions.shape)
    P0[:] = motions
    P0.reshape(len(aggregates), size * _MOTIONS)[aggregates < 0] = 0.0
    R = np.zeros((count, _MOTIONS, _MOTIONS))
    kernels()[f"orthonormal_{size}_6"](count, team, begin, members, loose, P0, R)
    return P0, R


def _smoothed(
    K: WholeBlocks, aggregates: npt.NDArray[np.int32], starts: _Array, P0: FloatArray, S: FloatArray, team: int
) -> DistributedBlocks:
    """(1 - S K) P0; collective."""
    n, size, own = K.count, K.size, int(np.diff(starts)[K.comm.rank])
    needed: _Array = np.empty(0, np.int64)
    if K.others is not None:
        numbers = np.where(aggregates >= 0, aggregates + starts[K.comm.rank], -1)
        exchange = RowExchange(K.comm, K.starts, K.ghosts)
        nodal = np.column_stack([numbers, P0.reshape(n, size * _MOTIONS)])[exchange.asked]
        ghosts = exchange.fetched(nodal, np.ones(len(nodal), np.int64))
        of_ghosts = ghosts[:, 0].astype(np.int64)
        needed = np.unique(of_ghosts[of_ghosts >= 0])
        places = np.where(of_ghosts >= 0, own + np.searchsorted(needed, of_ghosts), -1)
        aggregates = np.concatenate([aggregates, places]).astype(np.int32)
        P0 = np.concatenate([P0.ravel(), ghosts[:, 1:].ravel(), np.zeros(PADDING)])
    count = own + len(needed)
    pointers = np.zeros(n + 1, np.int32)
    kernels().coupled_aggregates(n, team, *K.pattern, aggregates, count, pointers[1:])
    np.cumsum(pointers, out=pointers)
    columns = np.empty(pointers[-1], np.int32)
    values = np.zeros(len(columns) * size * _MOTIONS + PADDING, np.float32)
    kernels()[f"smoothed_{size}_6"](n, team, *K.parts, aggregates, count, P0, S, pointers, columns, values)
    whole = Blocks(pointers, columns, values, None)
    if K.others is None:
        return DistributedBlocks(K.comm, whole, None, needed, starts)
    mine = columns < own
    others = _chosen(whole, ~mine, size * _MOTIONS)
    others = others._replace(columns=others.columns - np.int32(own))
    return DistributedBlocks(K.comm, _chosen(whole, mine, size * _MOTIONS), others, needed, starts)


def _chosen(blocks: Blocks, chosen: npt.NDArray[np.bool_], numbers: int) -> Blocks:
    pointers = np.concatenate([[0], np.cumsum(chosen)])[blocks.pointers].astype(np.int32)
    values = np.zeros(int(pointers[-1]) * numbers + PADDING, np.float32)
    values[:-PADDING] = blocks.values[:-PADDING].reshape(-1, numbers)[chosen].ravel()
    return Blocks(pointers, blocks.columns[chosen], values, None)


def galerkin(K: WholeBlocks, P: DistributedBlocks, width: int) -> DistributedEntries:
    """P^T K P, of P with blocks of so many columns; collective.

    On several ranks the rows of P of other ranks' nodes are fetched, and what this rank's rows of K add to coarse rows
    of other ranks is sent to these.
    """
    team = threads() if K.count >= _ALONE else 1
    own = int(np.diff(P.starts)[K.comm.rank])
    rows, numbers = (P.own, np.arange(own)) if P.others is None else _with_ghosts(K, P, own, width)
    n, nodes = K.count, len(rows.pointers) - 1
    coarse = own + len(P.columns)
    begin = np.empty(coarse + 1, np.int32)
    of, places = np.empty((2, rows.pointers[n]), np.int32)
    kernels().by_columns(n, coarse, *rows[:2], begin, of, places)
    pointers = np.zeros(coarse + 1, np.int32)
    pattern = (begin, of, *K.pattern, *rows[:2])
    sizes = n, nodes, coarse, len(numbers), team
    kernels().product_pattern(*sizes, *pattern, pointers[1:], None)
    np.cumsum(pointers, out=pointers)
    columns = np.empty(pointers[-1], np.int32)
    most = kernels().product_pattern(*sizes, *pattern, pointers, columns)
    blocks = np.empty((len(columns), width, width))
    kernel = kernels()[f"galerkin_{K.size}_{width}"]
    kernel(*sizes, most, begin, of, places, *K.parts, *rows[:3], pointers, columns, blocks)
    if P.others is None:
        entries = entries_of(pointers, columns, blocks, team)
        return DistributedEntries(K.comm, entries, None, np.empty(0, np.int32), width * P.starts)
    return _gathered(P, pointers, numbers[columns], blocks)


def _with_ghosts(K: WholeBlocks, P: DistributedBlocks, own: int, width: int) -> tuple[Blocks, _Array]:
    """The rows of P of this rank's nodes and of those to which K couples them, and the numbers of its columns: those of
    this rank, those that its own rows need, and others; collective."""
    assert P.others is not None
    both = joined_rows(P.own, P.others._replace(columns=P.others.columns + np.int32(own)))
    columns, lengths = both.columns, np.diff(both.pointers)
    values = both.values[:-PADDING].reshape(len(columns), K.size * width)
    known = np.concatenate([np.arange(own) + P.starts[K.comm.rank], P.columns])
    rows = RowExchange(K.comm, K.starts, K.ghosts)
    of_ghosts = rows.fetched(lengths[rows.asked], np.ones(len(rows.asked), np.int64))
    asked = _rows_of(lengths, rows.asked)
    fetched = rows.fetched(known[columns[asked]], lengths[rows.asked])
    more = rows.fetched(values[asked], lengths[rows.asked])
    numbers_of_columns = np.concatenate([known, np.setdiff1d(fetched, known)])
    order = np.argsort(numbers_of_columns)
    places = order[np.searchsorted(numbers_of_columns, fetched, sorter=order)].astype(np.int32)
    pointers = np.concatenate([[0], np.cumsum(np.concatenate([lengths, of_ghosts]))]).astype(np.int32)
    together = np.concatenate([values.ravel(), more.ravel(), np.zeros(PADDING, np.float32)])
    return Blocks(pointers, np.concatenate([columns, places]).astype(np.int32), together, None), numbers_of_columns


def _rows_of(lengths: _Array, chosen: _Array) -> _Array:
    """The places of the entries of some rows, one row after the other."""
    begin = np.concatenate([[0], np.cumsum(lengths)])[chosen]
    ends = np.cumsum(lengths[chosen])
    places: _Array = np.arange(ends[-1] if len(ends) else 0)
    places += np.repeat(begin - ends + lengths[chosen], lengths[chosen])
    return places


def _gathered(P: DistributedBlocks, pointers: _Array, columns: _Array, blocks: FloatArray) -> DistributedEntries:
    """The sums of what all ranks have for a row; collective."""
    comm, width = P.comm, blocks.shape[1]
    first, end = P.starts[comm.rank : comm.rank + 2]
    own = end - first
    row = np.repeat(np.concatenate([np.arange(first, end), P.columns]), np.diff(pointers))
    mine = int(pointers[own])
    arrays = row, columns, blocks
    to = Exchange(comm, owner_of(P.starts, row[mine:]))  # the ranks that have the rows
    given = [to.send(array[mine:]) for array in arrays]
    rows, numbers, values = (np.concatenate([array[:mine], more]) for array, more in zip(arrays, given, strict=True))
    order = np.lexsort((numbers, rows))
    rows, numbers = rows[order] - first, numbers[order]
    new = np.append(True, (np.diff(rows) != 0) | (np.diff(numbers) != 0))[: len(rows)]
    positions = np.flatnonzero(new)
    values = np.add.reduceat(values[order], positions, axis=0) if len(positions) else values
    rows, numbers = rows[positions], numbers[positions]

    inside = (numbers >= first) & (numbers < end)
    needed, place = np.unique(numbers[~inside], return_inverse=True)

    def part(chosen: _Array, places: _Array) -> Entries:
        lengths = np.bincount(rows[chosen], minlength=own)
        begin = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
        return entries_of(begin, places.astype(np.int32), values[chosen], 1)

    others = part(~inside, place.reshape(-1))
    single = (width * needed[:, None] + np.arange(width)).ravel()
    return DistributedEntries(comm, part(inside, numbers[inside] - first), others, single, width * P.starts)


def with_diagonal(matrix: DistributedEntries) -> DistributedEntries:
    """With mean numbers where the diagonal is 0, in rows of motions that an aggregate does not have, or missing, in
    rows of vertices whose cells have all their nodes of second order on supports."""
    indptr, indices, values = matrix.own
    empty = np.flatnonzero(np.diff(indptr) == 0).astype(np.int32)
    if len(empty):
        places = indptr[empty]
        indices, values = np.insert(indices, places, empty), np.insert(values, places, 0.0)
        indptr = indptr + np.searchsorted(empty, np.arange(len(indptr))).astype(np.int32)
        matrix = matrix._replace(own=matrix.own._replace(indptr=indptr, indices=indices, values=values))
    row = np.repeat(np.arange(len(indptr) - 1, dtype=np.int32), np.diff(indptr))
    places = np.flatnonzero(indices == row)
    none = values[places] == 0.0
    if np.any(none):
        mean = values[places][~none].mean() if not np.all(none) else 1.0
        values[places[none]] = mean
    return matrix
