"""A dense front whose columns are distributed over ranks: elimination of its own nodes, update matrix, and solves.

The columns are cut into blocks, which are dealt to the ranks in turn.  The rank of a block of own columns factorises it
and sends it to the others, each of which subtracts it from its own columns; the next block is finished first, so that
nobody waits for it.  What remains in the columns of the border is the update matrix, whose columns go to the ranks that
have their place in the parent.

For solves every rank keeps the triangle of the front's own nodes and the rows below it that belong to its blocks.  Of
the last front, the Schur complement S = L L^T of a body, it keeps its rows of L^-1: a product with S^-1 is then a sum
over the ranks of L^-T L^-1 x.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from scipy.linalg.blas import dtrsv, strsv

from ...arrays import FloatArray
from . import blas
from .blas import Real
from .nested_dissection import Nodes, SharedFront, runs_of

_WIDTH: Final = 192
"""Most columns of a block: the larger, the faster are its products, and the longer it takes to finish one."""

TAG: Final = 1701
"""Of all messages: every one is received from a given rank, in the order in which it was sent."""


class Block(NamedTuple):
    """Columns of a front, or of a child's update matrix, on one rank, rows from `start` on."""

    start: int
    stop: int
    rank: int


class Piece(NamedTuple):
    """Columns of a child, `first` to `after`, that belong to one block of the parent: block and rank of both."""

    child: int
    source: int
    to: int
    target: int
    start: int
    first: int
    after: int


class Sent:
    """Messages on their way."""

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self._messages: list[tuple[MPI.Request, Real]] = []

    def to(self, rank: int, numbers: Real) -> None:
        """Send contiguous numbers, which must not change until `wait`."""
        self._messages.append((self._comm.Isend(numbers, rank, TAG), numbers))

    def wait(self) -> None:
        """Return when all have been received, or copied by MPI."""
        MPI.Request.Waitall([request for request, _ in self._messages])


def blocks_of(front: SharedFront) -> tuple[list[Block], list[Block]]:
    """Blocks of the front's own columns, and of its border's (numbered after its own); 3 columns per node."""
    own, border = len(front.own), len(front.border)
    ranks = len(front.ranks)
    width = max(1, min(_WIDTH // 3, (own + border) // (4 * ranks)))
    blocks: list[list[Block]] = [[], []]
    number = 0
    for side, first, nodes in ((0, 0, own), (1, own, border)):
        count = -(-nodes // width)
        edges = first + np.round(np.linspace(0, nodes, count + 1)).astype(int)
        for start, stop in pairwise(edges):
            turn = number % (2 * ranks)  # there and back, since the later blocks are shorter
            blocks[side].append(Block(3 * start, 3 * stop, front.ranks[min(turn, 2 * ranks - 1 - turn)]))
            number += 1
    return blocks[0], blocks[1]


def column_ranks(front: SharedFront) -> Nodes:
    """The rank that has the columns of each own node of a front."""
    heads = blocks_of(front)[0]
    widths = [(block.stop - block.start) // 3 for block in heads]
    return np.repeat(np.array([block.rank for block in heads], dtype=np.int64), widths)


class Update:
    """A child's update matrix, a lower triangle on its border: this rank's columns by number of the block."""

    def __init__(self, border: Nodes, blocks: Sequence[Block], columns: dict[int, Real]):
        self.border, self.blocks, self.columns = border, blocks, columns

    @classmethod
    def of(cls, front: SharedFront, columns: dict[int, Real]) -> Update:
        """Of a shared front; without columns on ranks that do not share it."""
        own = 3 * len(front.own)
        blocks = [Block(block.start - own, block.stop - own, block.rank) for block in blocks_of(front)[1]]
        return cls(front.border, blocks, columns)


class DistributedFront:
    """A front of which this rank has some columns; all calls are collective over the front's ranks."""

    def __init__(self, comm: MPI.Comm, front: SharedFront, dtype: npt.DTypeLike):
        self._comm, self.front, self._dtype = comm, front, np.dtype(dtype)
        self.own = 3 * len(front.own)
        self.size = self.own + 3 * len(front.border)
        self._heads, self._tails = blocks_of(front)
        self._blocks = self._heads + self._tails
        self._mine = [number for number, block in enumerate(self._blocks) if block.rank == comm.rank]
        heights = [self.size - block.start for block in self._blocks]
        widths = [(block.stop - block.start) * (block.rank == comm.rank) for block in self._blocks]
        self._offsets = np.cumsum([0, *(w * h for w, h in zip(widths, heights, strict=True))])
        self._memory: Real = np.zeros(self._offsets[-1], dtype=self._dtype)
        self._columns: dict[int, Real] = {
            n: self._memory[self._offsets[n] : self._offsets[n + 1]].reshape((heights[n], -1), order="F")
            for n in self._mine
        }
        self.failed, self._trsv = False, strsv if self._dtype == np.float32 else dtrsv

    def add_entries(self, column: Nodes, row: Nodes, entries: FloatArray) -> None:
        """Add entries of K in columns of this rank.

        Blocks [i, j] of `entries` (k, 3, 3) have rows of the first and columns of the second node: places (k,) in the
        front, `column` of own nodes, `row` of nodes that are not before them (K is symmetric).
        """
        starts = np.array([block.start for block in self._blocks], dtype=np.int64)
        at = np.searchsorted(starts, 3 * column, side="right") - 1
        height = self.size - starts[at]
        corner = self._offsets[at] + 3 * row - starts[at] + height * (3 * column - starts[at])
        place = corner[:, None, None] + np.arange(3) + height[:, None, None] * np.arange(3)[:, None]
        self._memory[place] += entries

    def add_updates(self, children: Sequence[Update]) -> None:
        """Add the children's update matrices, which their ranks send."""
        nodes = np.concatenate([self.front.own, self.front.border])
        order = np.argsort(nodes)
        me, sent = self._comm.rank, Sent(self._comm)
        for child in children:
            place = order[np.searchsorted(nodes, child.border, sorter=order)]
            runs: Any = (3 * runs_of(place, len(self.front.own))).tolist()
            pieces = self._pieces(child, 3 * place)
            for rank in self.front.ranks:
                here = [piece for piece in pieces if piece.source == me and piece.target == rank]
                parts = [
                    child.columns[at.child][at.first - at.start :, at.first - at.start : at.after - at.start]
                    for at in here
                ]
                if rank == me:
                    for part, at in zip(parts, here, strict=True):
                        self._add(part, at, runs)
                elif parts:
                    sent.to(rank, np.concatenate([part.ravel(order="F") for part in parts]))
            rows = 3 * len(child.border)
            for rank in self.front.ranks:
                here = [piece for piece in pieces if piece.source == rank != me and piece.target == me]
                ends = np.cumsum([0, *((rows - at.first) * (at.after - at.first) for at in here)])
                packed = np.empty(ends[-1], dtype=self._dtype)
                if here:
                    self._comm.Recv(packed, rank, TAG)
                for at, start, stop in zip(here, ends[:-1], ends[1:], strict=True):
                    self._add(packed[start:stop].reshape((rows - at.first, -1), order="F"), at, runs)
        sent.wait()

    def _pieces(self, child: Update, place: Nodes) -> list[Piece]:
        """The parts of a child's columns that belong to one block of this front."""
        # columns of a node are in one block
        firsts = [block.start for block in self._blocks]
        edges = [3 * int(k) for k in np.searchsorted(place, [*firsts, self.size])]
        return [
            Piece(number, block.rank, to, target.rank, block.start, max(block.start, start), min(block.stop, stop))
            for number, block in enumerate(child.blocks)
            for to, (target, (start, stop)) in enumerate(zip(self._blocks, pairwise(edges), strict=True))
            if max(block.start, start) < min(block.stop, stop)
        ]

    def _add(self, part: Real, at: Piece, runs: list[tuple[int, int, int]]) -> None:
        """Add columns of a child, rows from the first column's on, to a block of this rank."""
        columns, start = self._columns[at.to], self._blocks[at.to].start
        for i, j, n in runs:
            a, b = max(i, at.first), min(i + n, at.after)
            if a >= b:
                continue
            across = slice(j + a - i - start, j + b - i - start)
            for k, m, length in runs:
                c = max(k, a)
                if c < k + length:
                    rows = slice(m + c - k - start, m + length - start)
                    columns[rows, across] += part[c - at.first : k + length - at.first, a - at.first : b - at.first]

    def factorise(self) -> Update:
        """Eliminate the own nodes; the update matrix on the border.  `failed` is whether a pivot is not positive."""
        me, sent = self._comm.rank, Sent(self._comm)
        panels: list[Real] = []
        for number, block in enumerate(self._heads):
            if number == 0 and block.rank == me:
                self._finish(0, sent)
            if block.rank == me:
                panel: Real = self._columns.pop(number)
            else:
                panel = np.empty((self.size - block.start, block.stop - block.start), dtype=self._dtype, order="F")
                self._comm.Recv(panel.T, block.rank, TAG)
            panels.append(panel)
            after = number + 1
            if after < len(self._heads) and self._heads[after].rank == me:
                self._subtract(panel, block, after)
                self._finish(after, sent)
            for other in self._mine:
                if after < other < len(self._heads):
                    self._subtract(panel, block, other)
        for other in self._mine:
            if other >= len(self._heads):
                for panel, block in zip(panels, self._heads, strict=True):
                    self._subtract(panel, block, other)
        self._keep(panels)
        sent.wait()
        first = len(self._heads)
        rest = {n - first: self._columns[n] for n in self._mine if n >= first}
        del self._memory, self._columns
        return Update.of(self.front, rest)

    def _finish(self, number: int, sent: Sent) -> None:
        """Factorise a block of own columns, and send it to the other ranks."""
        columns = self._columns[number]
        width = columns.shape[1]
        head = columns[:width]
        self.failed |= blas.potrf(head) != 0
        blas.trsm_right(head, columns[width:], transposed=True)
        for rank in self.front.ranks:
            if rank != self._comm.rank:
                sent.to(rank, columns.T)

    def _subtract(self, panel: Real, block: Block, number: int) -> None:
        """Subtract finished columns, times their rows here, from a block of this rank."""
        target = self._blocks[number]
        below = panel[target.start - block.start :]
        blas.gemm(-1.0, below, below[: target.stop - target.start], 1.0, self._columns[number], transposed=True)

    def _keep(self, panels: list[Real]) -> None:
        """Keep what solves need."""
        if self.front.root:
            self.inverse = self._inverse_rows(panels)
            return
        e = self.own
        self._head: Real = np.zeros((e, e), dtype=self._dtype, order="F")
        rows = [np.arange(b.start, b.stop) for b in self._tails if b.rank == self._comm.rank]
        below: Nodes = np.concatenate([np.empty(0, np.int64), *rows]) - e
        self._rows: Nodes = (3 * self.front.border[:, None] + np.arange(3)).ravel()[below]
        self._below: Real = np.empty((len(below), e), dtype=self._dtype)
        for panel, block in zip(panels, self._heads, strict=True):
            self._head[block.start :, block.start : block.stop] = panel[: e - block.start]
            self._below[:, block.start : block.stop] = panel[below + e - block.start]

    def _inverse_rows(self, panels: list[Real]) -> list[tuple[int, Real]]:
        """This rank's rows of L^-1 in blocks: the column after the last, and the rows, shape (width, that)."""
        inverse = []
        for number, block in enumerate(self._heads):
            if block.rank != self._comm.rank:
                continue
            width = block.stop - block.start
            rows: Real = np.zeros((width, block.stop), dtype=self._dtype, order="F")
            rows[:, block.start :] = np.tril(panels[number][:width])
            blas.trtri(rows[:, block.start :])
            for other in reversed(range(number)):  # X_jk = -(sum of X_jm L_mk) L_kk^-1
                panel, at = panels[other], self._heads[other]
                w = at.stop - at.start
                here = rows[:, at.start : at.stop]
                blas.gemm(-1.0, rows[:, at.stop :], panel[w : block.stop - at.start], 0.0, here)
                blas.trsm_right(panel[:w], here, transposed=False)
            inverse.append((block.stop, rows))
        return inverse

    def product(self, x: Real) -> Real:
        """This rank's part of L^-T L^-1 x, of the last front of a body: S^-1 x is the sum over all ranks."""
        y = np.zeros_like(x)
        for stop, rows in self.inverse:
            y[:stop] += rows.T @ (rows @ x[:stop])
        return y

    def squares(self, columns: scipy.sparse.csr_matrix) -> FloatArray:
        """This rank's part of the squares of |L^-1 b|, for each column b of a matrix, shape (columns,)."""
        total: FloatArray = np.zeros(columns.shape[1])
        for stop, rows in self.inverse:
            total += np.sum((columns[:stop].T @ rows.T) ** 2, axis=1)
        return total

    def forward(self, x: Real) -> None:
        """x <- L^-1 x on the own nodes, the rest subtracted on the border; on the last front of a body x <- S^-1 x.

        Of x (k, 3) own nodes have the ranks' summands, and afterwards the same value on all ranks of the front.
        """
        own = self._summed(x[self.front.own].ravel())
        if self.front.root:
            own = self._summed(self.product(own))
        elif self.own:
            own = self._trsv(self._head, own, lower=1)
            x.reshape(-1)[self._rows] -= self._below @ own
        x[self.front.own] = own.reshape(-1, 3)

    def backward(self, x: Real) -> None:
        """x <- L^-T x on the own nodes, with the solution on the border; shape (k, 3)."""
        if not self.front.root and self.own:
            known = self._summed(self._below.T @ x.reshape(-1)[self._rows])
            own = x[self.front.own].ravel() - known
            x[self.front.own] = self._trsv(self._head, own, lower=1, trans=1).reshape(-1, 3)

    def _summed(self, x: Real) -> Real:
        ranks, comm = self.front.ranks, self._comm
        total = np.zeros_like(x)
        if len(ranks) == comm.size:
            comm.Allreduce(x, total)
            return total
        sent = Sent(comm)
        for rank in ranks:
            if rank != comm.rank:
                sent.to(rank, x)
        for rank in ranks:  # in the same order on all
            part = x
            if rank != comm.rank:
                part = np.empty_like(x)
                comm.Recv(part, rank, TAG)
            total += part
        sent.wait()
        return total
