"""Nested dissection of a body by planes: an order of elimination that ends on the contact nodes.

A plane cuts the nodes into two halves and a separator, which is eliminated after both; the halves are cut recursively
(George 1973; by coordinates: Heath and Raghavan 1995).  The contact nodes are the last separator, so the matrix that
remains before their elimination is their Schur complement.  In a multifrontal factorisation (Duff and Reid 1983) each
separator has a front: the nodes eliminated there, and a border, the nodes eliminated later that are coupled with these
or with nodes eliminated below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray
from ...native import kernels

Nodes = npt.NDArray[np.int64]


LEAF: Final = 80
"""Largest number of nodes of a part that is not cut (30 to 80 take the same time)."""

_PART: Final = 0.01
"""Part of the nodes from which those that are coupled with no others are a body of their own."""

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


def large_parts(label: npt.NDArray[np.integer[Any]]) -> Nodes:
    """Number of the body of each node, from that of the part of nodes that are coupled with each other, shape (k,).

    Parts with few of the nodes, such as held nodes, which are coupled with none, belong to the first body.
    """
    size = np.bincount(label)
    large = size >= _PART * len(label)
    number = np.where(large, np.cumsum(large) - 1, 0)
    return number[label].astype(np.int64)


class _Tree:
    """Separators and their children in the order of elimination, cut by native/dissection.c."""

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
