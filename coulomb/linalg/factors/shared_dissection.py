"""Nested dissection on several ranks: a part of each body for each rank, and above the parts shared separators.

A body is cut into as many parts as there are ranks, by the planes of `nested_dissection`: first between two halves of
the ranks, then within each half.  Each rank eliminates its part alone.  The separators, and last the contact nodes, are
fronts that the ranks of the parts below share.  The cuts need the coordinates of all nodes on every rank (24 bytes per
node), but of the matrix only the rows that a rank has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching

from ...arrays import FloatArray
from ..reductions import concatenated
from .nested_dissection import LEAF, Nodes, along_space, halves, large_parts


@dataclass(frozen=True)
class Part:
    """Nodes of a body, at least one, that a rank eliminates alone; the border is in the order of elimination."""

    rank: int
    own: Nodes
    border: Nodes


@dataclass(frozen=True)
class SharedFront:
    """A separator, or the contact nodes of a body, in the order of elimination; with ascending ranks that share it.

    `border` are the nodes eliminated later that are coupled with them or with nodes below, `parts` and `children` the
    numbers of the parts and shared fronts whose update matrices are added here; the last front of a body is a root.
    """

    ranks: tuple[int, ...]
    own: Nodes
    border: Nodes
    parts: tuple[int, ...]
    children: tuple[int, ...]
    root: bool


@dataclass(frozen=True)
class SharedDissection:
    """Parts, and shared fronts with children before parents; the same on all ranks.

    `label` has for each node the number of its part, or the number of parts plus that of its shared front, shape (k,).
    """

    parts: list[Part]
    fronts: list[SharedFront]
    label: Nodes


class Graph(NamedTuple):
    """Couples (row, column) of nodes, as far as a rank has the rows."""

    row: Nodes
    column: Nodes


class _Piece(NamedTuple):
    """Nodes that are to be divided among ranks from `first` on."""

    nodes: Nodes
    first: int
    ranks: int


def dissect_shared(
    comm: MPI.Comm, blocks: scipy.sparse.bsr_matrix, first: int, points: FloatArray, last: npt.NDArray[np.bool_]
) -> SharedDissection:
    """Parts and shared fronts of all bodies; collective.

    `blocks` are this rank's rows of K from the node `first` on, `points` (k, 3) and `last` (k,), the nodes that are
    eliminated last, those of all ranks.
    """
    rows = len(blocks.indptr) - 1
    graph = Graph(
        np.repeat(np.arange(first, first + rows, dtype=np.int64), np.diff(blocks.indptr)),
        blocks.indices.astype(np.int64),
    )
    body = large_parts(_components(comm, graph, len(points)))
    cutting = _Cutting(comm, graph, points)
    for number in range(int(body.max(initial=-1)) + 1):
        here = body == number
        cutting.cut(np.flatnonzero(here & ~last), np.flatnonzero(here & last))
    return cutting.finished()


def _components(comm: MPI.Comm, graph: Graph, nodes: int) -> Nodes:
    """A number for each node, the same for nodes that are coupled with each other, shape (nodes,); collective."""
    mine = scipy.sparse.csr_matrix((np.ones(len(graph.row), np.int8), graph), shape=(nodes, nodes))
    count, component = connected_components(mine, directed=False)
    label = np.arange(nodes)
    while True:
        least = np.full(count, nodes)
        np.minimum.at(least, component, label)
        lower = least[component]
        comm.Allreduce(MPI.IN_PLACE, lower, op=MPI.MIN)
        if np.array_equal(lower, label):
            return np.unique(label, return_inverse=True)[1].astype(np.int64)
        label = lower


class _Cutting:
    def __init__(self, comm: MPI.Comm, graph: Graph, points: FloatArray):
        self._comm, self._graph, self._points = comm, graph, points
        self._parts: list[tuple[int, Nodes]] = []  # rank, nodes
        self._fronts: list[SharedFront] = []

    def cut(self, nodes: Nodes, last: Nodes) -> None:
        """Add parts and fronts of a body: these nodes, then the last ones; collective."""
        level = [_Piece(nodes, 0, self._comm.size)]
        cuts: dict[tuple[int, int], Nodes] = {}
        done: dict[tuple[int, int], Nodes] = {}
        while level:
            below = []
            wanted = [piece for piece in level if piece.ranks > 1 and len(piece.nodes) > LEAF]
            found = self._separators(wanted)
            for piece in level:
                parts = found.get(piece.first)
                if piece.ranks == 1 or parts is None:
                    done[piece.first, piece.ranks] = piece.nodes
                    continue
                low, high, separator = parts
                half = piece.ranks // 2
                cuts[piece.first, piece.ranks] = separator
                below += [
                    _Piece(low, piece.first, half),
                    _Piece(high, piece.first + half, piece.ranks - half),
                ]
            level = below
        below_parts, children = self._grow(0, self._comm.size, cuts, done)
        ranks = tuple(range(self._comm.size))
        own = along_space(last, self._points)
        self._fronts.append(SharedFront(ranks, own, last[:0], below_parts, children, True))

    def _grow(
        self, first: int, count: int, cuts: dict[tuple[int, int], Nodes], done: dict[tuple[int, int], Nodes]
    ) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Add the part or front of ranks from `first` on, and all below: numbers of parts and of fronts."""
        nodes = done.get((first, count))
        if nodes is not None:
            if len(nodes) == 0:
                return (), ()
            self._parts.append((first, nodes))
            return (len(self._parts) - 1,), ()
        half = count // 2
        low = self._grow(first, half, cuts, done)
        high = self._grow(first + half, count - half, cuts, done)
        own = along_space(cuts[first, count], self._points)
        ranks = tuple(range(first, first + count))
        self._fronts.append(SharedFront(ranks, own, own[:0], low[0] + high[0], low[1] + high[1], False))
        return (), (len(self._fronts) - 1,)

    def _separators(self, pieces: list[_Piece]) -> dict[int, tuple[Nodes, Nodes, Nodes]]:
        """Two parts of each piece that are not coupled, and the smallest separator found; by the piece's first rank.

        Every rank finds which of its nodes are coupled across a plane.  Planes are those of the first rank, so that
        rounding errors of different processors cannot matter.
        """
        if not pieces:
            return {}
        side = np.zeros((4, len(self._points)), dtype=np.int8)
        if self._comm.rank == 0:
            for number, (nodes, _, count) in enumerate(pieces):
                for candidate, high in enumerate(halves(self._points[nodes], (count // 2) / count)):
                    side[candidate, nodes] = np.where(high, 2, 1) + 2 * number
        self._comm.Bcast(side)
        touching = np.zeros(side.shape, dtype=np.int8)
        for flags, sides in zip(touching, side, strict=True):
            row, column = sides[self._graph.row], sides[self._graph.column]
            across = (row != column) & ((row - 1) // 2 == (column - 1) // 2) & (row > 0) & (column > 0)
            flags[self._graph.row[across]] = 1
        self._comm.Allreduce(MPI.IN_PLACE, touching, op=MPI.MAX)
        found = {}
        for nodes, first, _ in pieces:
            best = None
            for flags, sides in zip(touching[:, nodes] > 0, side[:, nodes], strict=True):
                high = sides % 2 == 0
                for separator in (flags & high, flags & ~high) if sides.any() else ():
                    if best is None or np.count_nonzero(separator) < np.count_nonzero(best[1]):
                        best = (high, separator)
            if best is not None:
                high, separator = best
                found[first] = nodes[~high & ~separator], nodes[high & ~separator], nodes[separator]
        return found

    def finished(self) -> SharedDissection:
        """Parts and fronts with their borders, given to the ranks that have most of their rows; collective."""
        k, count = len(self._points), len(self._parts)
        own = [nodes for _, nodes in self._parts] + [front.own for front in self._fronts]
        label = np.empty(k, dtype=np.int64)
        place = np.zeros(k, dtype=np.int64)  # in the order of elimination
        start = 0
        for number, nodes in enumerate(own):
            label[nodes], place[nodes] = number, np.arange(start, start + len(nodes))
            start += len(nodes)
        row, column = self._graph
        later = label[column] > label[row]
        mine = np.unique(label[row[later]] * k + column[later])
        coupled = np.unique(concatenated(self._comm, mine))
        ends = np.searchsorted(coupled, np.arange(len(own) + 1) * k)
        direct = [coupled[a:b] % k for a, b in pairwise(ends)]
        borders: list[Nodes] = []
        for number, nodes in enumerate(direct):
            if number >= count:
                front = self._fronts[number - count]
                below = [borders[part] for part in front.parts] + [borders[count + child] for child in front.children]
                nodes = np.unique(np.concatenate([nodes, *below]))
                nodes = nodes[label[nodes] > number]
            borders.append(nodes[np.argsort(place[nodes])])
        rank = self._ranks(np.unique(row), label)
        parts = [Part(rank[at], nodes, borders[number]) for number, (at, nodes) in enumerate(self._parts)]
        fronts = [
            replace(front, ranks=tuple(sorted(rank[at] for at in front.ranks)), border=borders[count + number])
            for number, front in enumerate(self._fronts)
        ]
        return SharedDissection(parts, fronts, label)

    def _ranks(self, mine: Nodes, label: Nodes) -> list[int]:
        """The rank in place of each number: so that most rows of K are where they are needed; collective."""
        at = np.array([number for number, _ in self._parts] + [-1] * len(self._fronts), dtype=np.int64)[label[mine]]
        counts = np.bincount(at[at >= 0], minlength=self._comm.size)
        rows = concatenated(self._comm, counts[None])
        of_numbers = scipy.sparse.csr_matrix(rows.T + 1)  # scipy.optimize would take as long to load as all the rest
        chosen = min_weight_full_bipartite_matching(of_numbers, maximize=True)[1].tolist()
        return [int(rank) for rank in chosen]
