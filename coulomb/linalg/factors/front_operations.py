"""What the multifrontal factorisation does beside LAPACK: entries of K, sums of update matrices, substitutions.

In C: on the block of 11 000 unknowns numpy takes three times as long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ...native import address, kernels
from ..nodal_blocks import NodalRows
from .nested_dissection import Front, Nodes

Real = npt.NDArray[Any]
"""Numbers in single or double precision."""


class FrontOperations:
    """Operations on fronts whose columns are one after another in `memory`: head (own, own), then below (border, own);
    by the kernels of native/fronts.h.

    All matrices are in Fortran order; heads and update matrices are lower triangles.

    Args:
        fronts: The fronts, children before parents.
        order: Nodes in the order of elimination, those of the last border included.
        nodes: Number of nodes of K.
        memory: For the columns of all fronts.
    """

    def __init__(self, fronts: list[Front], order: Nodes, nodes: int, memory: Real):
        self.memory, self.order = memory, order.astype(np.int64)
        self.own = np.array([len(front.own) for front in fronts], dtype=np.int64)
        self.border = np.array([len(front.border) for front in fronts], dtype=np.int64)
        self.borders: Nodes = np.concatenate([front.border for front in fronts]).astype(np.int64)
        self.position: Nodes = np.full(nodes, -1, dtype=np.int64)  # of nodes that no front has
        self.position[order] = np.arange(len(order))
        self.edges = self.position[self.borders]
        names = ("assemble", "extend", "forward", "backward")
        self._assemble, self._extend, self._forward, self._backward = (
            kernels()[f"{name}_{memory.dtype.name}"] for name in names
        )
        self._work = np.empty(3 * int(self.border.max(initial=0)), dtype=memory.dtype)

    def assemble(self, K: NodalRows) -> None:
        """Set the entries of K on and below the diagonal, in the order of elimination, and zeros elsewhere."""
        place = np.empty_like(self.position)
        self._assemble(
            len(self.own),
            *map(address, (self.own, self.border, self.order, self.borders, self.position)),
            *map(address, (K.indptr, K.indices, K.first, K.stride)),
            *map(address, (K.values, place, self.memory)),
        )

    def add_to_columns(self, child: Real, front: Front, head: Real, below: Real) -> None:
        """Add the update matrix of a child, the front given, to the parent's own columns."""
        self._extended(0, child, front, len(head), len(below), head, below)

    def add_to_update(self, child: Real, front: Front, own: int, update: Real) -> None:
        """Add the rest of it to the update matrix of the parent, which has `own` columns."""
        self._extended(1, child, front, own, len(update), update, update)

    def _extended(self, rest: int, child: Real, front: Front, own: int, border: int, head: Real, below: Real) -> None:
        width, count, e, b = (n for n in (len(child), len(front.runs), own, border))
        self._extend(rest, address(child), width, count, address(front.runs), e, b, address(head), address(below))

    def forward(self, x: Real) -> None:
        """x <- L^-1 x in the order of elimination, shape (3 k,); on the last border, what remains of x."""
        self._substituted(self._forward, x)

    def backward(self, x: Real) -> None:
        """x <- L^-T x in the order of elimination, shape (3 k,), with given x on the last border."""
        self._substituted(self._backward, x)

    def _substituted(self, kernel: Any, x: Real) -> None:
        places = (self.own, self.border, self.edges)
        kernel(len(self.own), *map(address, (*places, self.memory, x, self._work)))


def split_columns(memory: Real, own: Nodes, border: Nodes) -> tuple[list[Real], list[Real]]:
    """Head (3 own, 3 own) and what is below (3 border, 3 own) of every front, in Fortran order."""
    heads: list[Real] = []
    below: list[Real] = []
    at = 0
    for e, b in zip(3 * own, 3 * border, strict=True):
        heads.append(memory[at : at + e * e].reshape((e, e), order="F"))
        below.append(memory[at + e * e : at + e * (e + b)].reshape((b, e), order="F"))
        at += e * (e + b)
    return heads, below
