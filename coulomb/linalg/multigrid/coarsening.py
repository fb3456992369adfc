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
from mpi4py import MPI

from ...arrays import FloatArray
from ...exchange import Exchange, owner_of
from ...native import kernels, threads
from ..reductions import concatenated
from .block_matrix import PADDING, Blocks, DistributedBlocks, joined_rows, split, with_padding

_Array = npt.NDArray[Any]


class WholeRows:
    """All blocks of this rank's rows of a symmetric matrix in `symmetric_blocks`, where these have them.

    Attributes:
        parts: For kernels: pointers and columns of the blocks in this rank's columns, where they are, and their values;
            the same of those in columns of other ranks, as places in `ghosts`, each None on one rank.
        starts: Number of the first block of each rank, and of all blocks, shape (ranks + 1,).
        ghosts: Numbers of blocks of other ranks, ascending.
    """

    def __init__(self, matrix: DistributedBlocks, size: int):
        self.comm, self.size, self.starts, self.ghosts = matrix.comm, size, matrix.starts, matrix.columns
        upper, others = matrix.own, matrix.others
        self.count, self.is_distributed = len(upper.pointers) - 1, others is not None
        pointers = np.empty(self.count + 1, np.int32)
        columns, at = np.empty((2, 2 * len(upper.columns) - self.count), np.int32)
        kernels().whole_rows(self.count, upper.pointers, upper.columns, pointers, columns, at)
        self.own = pointers, columns, at, upper.values, upper.low
        self.parts: tuple[_Array | None, ...] = (*self.own, *(others or 4 * (None,)))

    @property
    def pattern(self) -> tuple[_Array | None, ...]:
        """For kernels: pointers and columns of both parts."""
        return (*self.parts[:2], *self.parts[5:7])


def whole(matrix: DistributedBlocks) -> DistributedBlocks:
    """A distributed symmetric matrix as one that each rank has for itself; collective."""
    if matrix.others is None:
        return matrix
    own, others, first = matrix.own, matrix.others, int(matrix.starts[matrix.comm.rank])
    row = np.repeat(np.arange(len(others.pointers) - 1), np.diff(others.pointers))
    numbers = matrix.columns[others.columns] if len(row) else row
    others = others._replace(columns=numbers.astype(np.int32)).chosen(numbers > first + row)
    mine = joined_rows(own._replace(columns=own.columns + np.int32(first)), others)  # which come after those of its own
    assert mine.low is not None
    both = mine.values[:-PADDING], mine.low[:-PADDING]
    lengths, columns, *values = (
        concatenated(matrix.comm, array) for array in (np.diff(mine.pointers), mine.columns, *both)
    )
    pointers = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    everything = Blocks(pointers, columns, *map(with_padding, values))
    return DistributedBlocks(MPI.COMM_SELF, everything, None, matrix.columns[:0], np.array([0, matrix.starts[-1]]))


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
    matrix: DistributedBlocks
    motions: FloatArray


def coarser(
    matrix: DistributedBlocks, size: int, motions: FloatArray, inverse: FloatArray, largest: float
) -> Coarser | None:
    """The next grid; None if no two nodes belong together; collective.

    K is in `symmetric_blocks` of 3 or 6 rows; the six motions (rows of this rank, 6) it maps to almost zero; `inverse`
    is that of its diagonal D, `largest` the eigenvalue of D^-1 K.
    """
    K = WholeRows(matrix, size)
    team = threads() if K.count >= _ALONE else 1
    aggregates, count, loose = _aggregates(K, team)
    starts = np.concatenate([[0], np.cumsum(concatenated(K.comm, np.array([count])))])
    if starts[-1] == 0:
        return None
    P0, R = _orthonormal(size, aggregates, count, loose, motions, team)
    P = _smoothed(K, aggregates, starts, P0, _DAMPING / largest * inverse, team)
    del P0
    coarse = galerkin(K, P, _MOTIONS)
    return Coarser(P, with_diagonal(coarse, _MOTIONS), R.reshape(-1, _MOTIONS))


def _aggregates(K: WholeRows, team: int) -> tuple[npt.NDArray[np.int32], int, _Array]:
    """The aggregate of each node or -1, how many there are, and which rows have entries beside the diagonal."""
    n, size = K.count, K.size
    norms, loose = np.zeros(n), np.zeros(size * n, np.uint8)
    examine = kernels()[f"examine_{size}_6"]
    examine(n, team, *K.own, norms, loose)
    if K.is_distributed:
        pointers, columns, values, low = K.parts[5:]
        examine(n, team, pointers, columns, None, values, low, None, loose)
    pointers, columns = K.own[:2]
    strong, aggregates = np.empty(len(columns), np.uint8), np.empty(n, np.int32)
    kernels()[f"strength_{size}_6"](n, team, *K.own, norms, _STRONG, strong)
    count = kernels().aggregate(n, pointers, columns, strong, aggregates)
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
    K: WholeRows, aggregates: npt.NDArray[np.int32], starts: _Array, P0: FloatArray, S: FloatArray, team: int
) -> DistributedBlocks:
    """(1 - S K) P0; collective."""
    n, size, own = K.count, K.size, int(np.diff(starts)[K.comm.rank])
    needed: _Array = np.empty(0, np.int64)
    if K.is_distributed:
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
    both = Blocks(pointers, columns, values, None)
    if not K.is_distributed:
        return DistributedBlocks(K.comm, both, None, needed, starts)
    others = both.chosen(columns >= own)
    others = others._replace(columns=others.columns - np.int32(own))
    return DistributedBlocks(K.comm, both.chosen(columns < own), others, needed, starts)


def galerkin(K: WholeRows, P: DistributedBlocks, width: int) -> DistributedBlocks:
    """P^T K P in `symmetric_blocks`, of P with blocks of so many columns; collective.

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
    sizes = n, nodes, own, coarse, len(numbers), team
    kernels().product_pattern(*sizes, *pattern, pointers[1:], None)
    np.cumsum(pointers, out=pointers)
    columns = np.empty(pointers[-1], np.int32)
    most = kernels().product_pattern(*sizes, *pattern, pointers, columns)
    blocks = np.empty((len(columns), width, width))
    kernel = kernels()[f"galerkin_{K.size}_{width}"]
    kernel(*sizes, most, begin, of, places, *K.parts, *rows[:3], pointers, columns, blocks)
    if P.others is None:
        return DistributedBlocks(K.comm, split(pointers, columns, blocks), None, P.columns[:0], P.starts)
    return _gathered(P, pointers, numbers[columns], blocks)


def _with_ghosts(K: WholeRows, P: DistributedBlocks, own: int, width: int) -> tuple[Blocks, _Array]:
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


def _gathered(P: DistributedBlocks, pointers: _Array, columns: _Array, blocks: FloatArray) -> DistributedBlocks:
    """The sums of what all ranks have for a row; collective."""
    comm = P.comm
    first, end = P.starts[comm.rank : comm.rank + 2]
    own = end - first
    row = np.repeat(np.concatenate([np.arange(first, end), P.columns]), np.diff(pointers))
    mine = int(pointers[own])
    arrays = row, columns, blocks
    to = Exchange(comm, owner_of(P.starts, row[mine:]))  # the ranks that have the rows
    given = [to.send(array[mine:]) for array in arrays]
    rows, numbers, values = (np.concatenate([array[:mine], more]) for array, more in zip(arrays, given, strict=True))
    upper = (numbers < first) | (numbers >= rows)  # of this rank's columns
    rows, numbers, values = rows[upper], numbers[upper], values[upper]
    order = np.lexsort((numbers, rows))
    rows, numbers = rows[order] - first, numbers[order]
    new = np.append(True, (np.diff(rows) != 0) | (np.diff(numbers) != 0))[: len(rows)]
    positions = np.flatnonzero(new)
    values = np.add.reduceat(values[order], positions, axis=0) if len(positions) else values
    rows, numbers = rows[positions], numbers[positions]

    inside = (numbers >= first) & (numbers < end)
    needed, place = np.unique(numbers[~inside], return_inverse=True)

    def part(chosen: _Array, places: _Array) -> Blocks:
        lengths = np.bincount(rows[chosen], minlength=own)
        begin = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
        return split(begin, places.astype(np.int32), values[chosen])

    others = part(~inside, place.reshape(-1))
    return DistributedBlocks(comm, part(inside, numbers[inside] - first), others, needed, P.starts)


def with_diagonal(matrix: DistributedBlocks, size: int) -> DistributedBlocks:
    """With mean numbers where the diagonal is 0: in rows of motions that an aggregate does not have, and of vertices
    whose cells have all their nodes of second order on supports."""
    at, blocks = np.arange(size), matrix.own.values[:-PADDING].reshape(-1, size, size)
    diagonal = blocks[matrix.own.pointers[:-1, None], at, at]
    none = diagonal == 0.0
    if np.any(none):
        diagonal[none] = diagonal[~none].mean() if not np.all(none) else 1.0
        blocks[matrix.own.pointers[:-1, None], at, at] = diagonal
    return matrix
