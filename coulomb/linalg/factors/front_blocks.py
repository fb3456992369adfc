"""How the columns of shared fronts are cut into blocks, and whose they are; update matrices; messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from .blas import Real
from .nested_dissection import Nodes
from .shared_dissection import SharedFront

_WIDTH = 192
"""Most columns of a block: the larger, the faster are its products, and the longer it takes to finish one."""

TAG = 1701
"""Of all messages: every one is received from a given rank, in the order in which it was sent."""


class Block(NamedTuple):
    """Columns of a front, or of a child's update matrix.

    Attributes:
        start: First column.
        stop: Column after the last one.
        rank: The rank that has them, from row `start` on.
    """

    start: int
    stop: int
    rank: int


class Piece(NamedTuple):
    """Columns of a child that belong to one block of the parent.

    Attributes:
        child: The child's block.
        source: Its rank.
        to: The parent's block.
        target: Its rank.
        start: First column of the child's block.
        first: First column of the piece, in the child.
        after: Column after its last one.
    """

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
        for start, stop in zip(*pairs(edges), strict=True):
            turn = number % (2 * ranks)  # there and back, since the later blocks are shorter
            blocks[side].append(Block(3 * start, 3 * stop, front.ranks[min(turn, 2 * ranks - 1 - turn)]))
            number += 1
    return blocks[0], blocks[1]


def pairs(edges: Nodes) -> tuple[list[int], list[int]]:
    """Starts and ends of what lies between edges."""
    listed = [int(edge) for edge in edges]
    return listed[:-1], listed[1:]


def column_ranks(front: SharedFront) -> Nodes:
    """The rank that has the columns of each own node of a front."""
    heads = blocks_of(front)[0]
    widths = [(block.stop - block.start) // 3 for block in heads]
    return np.repeat(np.array([block.rank for block in heads], dtype=np.int64), widths)


class Update:
    """A child's update matrix, a lower triangle on its border: the columns that this rank has.

    Args:
        border: The child's border, in the order of elimination.
        blocks: All columns.
        columns: Those of this rank, by number of the block; rows from the block's start on.
    """

    def __init__(self, border: Nodes, blocks: Sequence[Block], columns: dict[int, Real]):
        self.border, self.blocks, self.columns = border, blocks, columns

    @classmethod
    def of(cls, front: SharedFront, columns: dict[int, Real]) -> Update:
        """The update matrix of a shared front; without columns on ranks that do not share it."""
        own = 3 * len(front.own)
        blocks = [Block(block.start - own, block.stop - own, block.rank) for block in blocks_of(front)[1]]
        return cls(front.border, blocks, columns)
