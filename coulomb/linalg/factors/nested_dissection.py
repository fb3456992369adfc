"""Nested dissection of a body by planes: an order of elimination that ends on the contact nodes.

A plane cuts the nodes into two halves and a separator, which is eliminated after both; the halves are cut recursively
(George 1973; by coordinates: Heath and Raghavan 1995).  The contact nodes are the last separator, so the matrix that
remains before their elimination is their Schur complement.  In a multifrontal factorisation (Duff and Reid 1983) each
separator has a front: the nodes eliminated there, and a border, the nodes eliminated later that are coupled with these
or with nodes eliminated below.

On several ranks a body is cut into as many parts as there are ranks, by the same planes: first between two halves of
the ranks, then within each half.  Each rank eliminates its part alone.  The separators, and last the contact nodes, are
fronts that the ranks of the parts below share.  The cuts need the coordinates of all nodes on every rank (24 bytes per
node), but of the matrix only the rows that a rank has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching

from ...arrays import FloatArray
from ...native import kernels
from ..reductions import concatenated

Nodes = npt.NDArray[np.int64]


LEAF: Final = 80
"""Largest number of nodes of a part that is not cut (30 to 80 take the same time)."""

_PART: Final = 0.01
"""Part of the nodes from which those that are coupled with no others are a body of their own."""

_PARALLEL: Final = 0.999  # component of a unit vector along an axis to which it is nearly parallel

_BLOCK: Final = 8  # nodes whose order along a separator is not changed


@dataclass(frozen=True)
class Front:
    """A separator, or a part of the body that is not cut.

    Attributes:
        own: Nodes eliminated here.
        border: Nodes eliminated later that are coupled with them or with nodes below; in the parent's order.
        children: Numbers of the fronts whose update matrices are added here.
        runs: The border's places in the parent's (own, border), see `runs_of`; none extends from own to border.
        root: Whether it is the last one of a body.
    """

    own: Nodes
    border: Nodes
    children: tuple[int, ...]
    runs: Nodes
    root: bool = False


def dissect(graph: scipy.sparse.csr_matrix, points: FloatArray, last: Nodes, leaf: int = LEAF) -> list[Front]:
    """Fronts in the order of elimination, children before parents.

    Bodies that are not coupled have a tree each, whose last front has no border; that with most nodes in it comes last.
    `graph` (k, k) is symmetric; its values are not used.  The amount of work depends on the coordinates (k, 3), the
    result does not.  `last` are the nodes of the last fronts, ascending.
    """
    tree = _Tree(graph, points, leaf)
    body = large_parts(connected_components(graph, directed=False)[1])
    for number in np.argsort(np.bincount(body[last], minlength=np.max(body, initial=0) + 1), kind="stable"):
        here = body == number
        mine = last[here[last]]
        here[mine] = False
        tree.children.append(tree.grow(np.flatnonzero(here)))
        tree.own.append(mine)
    return _in_order(tree.own, _borders(graph, tree.own, tree.children), tree.children, points)


def dissect_part(graph: scipy.sparse.csr_matrix, points: FloatArray, count: int, leaf: int = LEAF) -> list[Front]:
    """Fronts of the first `count` nodes; the border of the last one has the other nodes that are coupled, ascending.

    `graph` (k, k) has the rows of the first ones; the others are empty.
    """
    tree = _Tree(graph, points, leaf)
    tree.grow(np.arange(count))
    return _in_order(tree.own, _borders(graph, tree.own, tree.children), tree.children, points)


def large_parts(label: npt.NDArray[np.integer[Any]]) -> Nodes:
    """Number of the body of each node, from that of the part of nodes that are coupled with each other, shape (k,).

    Parts with few of the nodes, such as held nodes, which are coupled with none, belong to the first body.
    """
    size = np.bincount(label)
    large = size >= _PART * len(label)
    number = np.where(large, np.cumsum(large) - 1, 0)
    return number[label].astype(np.int64)


class _Tree:
    """Separators and their children in the order of elimination, cut by native/dissection.c as `halves` does."""

    def __init__(self, graph: scipy.sparse.csr_matrix, points: FloatArray, leaf: int):
        self.own: list[Nodes] = []
        self.children: list[tuple[int, ...]] = []
        self._points, self._leaf = np.ascontiguousarray(points, dtype=np.float64), leaf
        self._ptr, self._col = graph.indptr.astype(np.int64), graph.indices.astype(np.int64)

    def grow(self, nodes: Nodes) -> tuple[int, ...]:
        """Cut these nodes down to the leaves; the number of their front, or nothing if there are no nodes."""
        count, first = len(nodes), len(self.own)
        if count == 0:
            return ()
        given, own, counts, below = (np.empty(size * count, dtype=np.int64) for size in (1, 1, 2, 4))  # some are empty
        given[:] = nodes
        made = kernels().dissect_nodes(
            len(self._points), count, given, self._ptr, self._col, self._points, self._leaf, own, counts, below
        )
        if made < 0:
            raise MemoryError("the order of elimination needs more memory than there is")
        self.own += np.split(own, np.cumsum(counts[: made - 1]))
        self.children += [
            tuple(first + child for child in two if child >= 0) for two in below[: 2 * made].reshape(-1, 2).tolist()
        ]
        return (len(self.own) - 1,)


def halves(x: FloatArray, low: float = 0.5) -> Iterator[npt.NDArray[np.bool_]]:
    """Which nodes lie beyond the part `low` along each coordinate axis and along the longest principal axis."""
    centred = x - x.mean(axis=0)
    _, principal = np.linalg.eigh(centred.T @ centred)
    axes, longest = [*centred.T], principal[:, 2]
    most = longest[np.argmax(np.abs(longest))]
    if abs(most) < _PARALLEL:
        axes.append(centred @ longest * np.sign(most))  # LAPACK's vectors may have either sign
    for along in axes:
        extent = np.ptp(along)
        middle = int(low * (len(along) - 1))
        cut = np.partition(along, middle)[middle]
        high = along > cut + 1e-9 * extent
        if 2 * np.count_nonzero(high) < (1.0 - low) * len(along):  # many nodes at the cut itself
            high = along > cut - 1e-9 * extent
        if high.any() and not high.all():
            yield high


def _borders(graph: scipy.sparse.csr_matrix, own: list[Nodes], children: list[tuple[int, ...]]) -> list[Nodes]:
    """The border of every front, ascending."""
    left = np.ones(graph.shape[0], dtype=bool)  # not eliminated
    borders: list[Nodes] = []
    starts, counts = graph.indptr[:-1], np.diff(graph.indptr)
    for nodes, below in zip(own, children, strict=True):
        left[nodes] = False
        count = counts[nodes]
        entries = np.repeat(starts[nodes] - np.cumsum(count) + count, count) + np.arange(count.sum())
        coupled = np.concatenate([graph.indices[entries], *(borders[child] for child in below)])
        borders.append(np.unique(coupled[left[coupled]]))
    return borders


def _in_order(
    own: list[Nodes], borders: list[Nodes], children: list[tuple[int, ...]], points: FloatArray
) -> list[Front]:
    """The fronts, with their own nodes `along_space` and borders in the order of the parent, as few runs there."""
    place = np.empty(len(points), dtype=np.int64)
    order_of_border = list(borders)
    runs: list[Nodes] = [np.empty((0, 3), dtype=np.int64)] * len(own)
    fronts: list[Front] = []
    inner = {child for below in children for child in below}
    for number in reversed(range(len(own))):
        mine = own[number] if not children[number] else along_space(own[number], points)
        both = np.concatenate([mine, order_of_border[number]])
        place[both] = np.arange(len(both))
        for child in children[number]:
            border = borders[child][np.argsort(place[borders[child]])]
            order_of_border[child], runs[child] = border, runs_of(place[border], len(mine))
        root = number not in inner
        fronts.append(Front(mine, order_of_border[number], children[number], runs[number], root))
    return fronts[::-1]


def runs_of(places: Nodes, own: int) -> Nodes:
    """Ascending places as runs (first, its place, length), split where they leave the parent's own nodes."""
    if len(places) == 0:
        return np.empty((0, 3), dtype=np.int64)
    cut = places[1:] != places[:-1] + 1
    border = int(np.searchsorted(places, own))
    if 0 < border < len(places):
        cut[border - 1] = True
    runs = np.empty((1 + np.count_nonzero(cut), 3), dtype=np.int64)
    runs[0, 0], runs[1:, 0] = 0, np.flatnonzero(cut) + 1
    runs[:, 1] = places[runs[:, 0]]
    runs[:-1, 2] = runs[1:, 0] - runs[:-1, 0]
    runs[-1, 2] = len(places) - runs[-1, 0]
    return runs


def along_space(nodes: Nodes, points: FloatArray) -> Nodes:
    """The nodes ordered by halves, quarters and so on along their longest extents."""
    ordered, places = nodes.astype(np.int64), np.ascontiguousarray(points, dtype=np.float64)
    if kernels().order_along_space(len(nodes), ordered, places, _BLOCK):
        raise MemoryError("the order of elimination needs more memory than there is")
    return ordered


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
                below += [_Piece(low, piece.first, half), _Piece(high, piece.first + half, piece.ranks - half)]
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
