"""K = L L^T on several ranks by nested dissection, the contact nodes last: as `multifrontal` on one rank.

Each rank factorises its parts of the bodies alone, with the fronts of one rank; the fronts above are shared (see
`shared_dissection` and `distributed_front`).  The rows of K go to the ranks that eliminate their nodes first.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from .distributed_front import DistributedFront
from .front_blocks import Block, Update, column_ranks
from .frontal_factors import Factor, backward, forward
from .multifrontal import NOT_POSITIVE_DEFINITE, factorised
from .nested_dissection import Front, Nodes, dissect_part
from .nodal_blocks import nodal_blocks
from .shared_dissection import Part, dissect_shared


class _Entries:
    """Rows of K that a rank needs, entries of nodes that are not eliminated before: node, coupled node, block."""

    def __init__(self, row: Nodes, column: Nodes, values: FloatArray):
        self.row, self.column, self.values = row, column, values


class _LocalPart:
    """A part of a body factorised on this rank."""

    def __init__(self, part: Part, entries: _Entries, points: FloatArray):
        count = len(part.own)
        nodes = np.concatenate([part.own, part.border])
        place = np.zeros(len(points), dtype=np.int64)
        place[nodes] = np.arange(len(nodes))
        here = np.zeros(len(points), dtype=bool)
        here[part.own] = True
        chosen = np.flatnonzero(here[entries.row])
        counts = np.bincount(place[entries.row[chosen]], minlength=len(nodes))
        indptr, indices = np.concatenate([[0], np.cumsum(counts)]), place[entries.column[chosen]]
        blocks = scipy.sparse.bsr_matrix((entries.values[chosen], indices, indptr), shape=(3 * len(nodes),) * 2)
        graph = scipy.sparse.csr_matrix((np.empty(len(indices), np.int8), indices, indptr), shape=(len(nodes),) * 2)
        self.own, self.nodes = part.own, nodes
        self.fronts: list[Front] = dissect_part(graph, points[nodes], count)
        self.factors: list[Factor]
        self.factors, updates = factorised(blocks, self.fronts)
        ((_, self.update),) = updates.items()

    def forward(self, x: FloatArray) -> None:
        """x <- L^-1 x on the nodes of the part, the rest subtracted on its border; shape (nodes, 3)."""
        mine = np.zeros((len(self.nodes), 3))
        mine[: len(self.own)] = x[self.own]
        forward(self.fronts, self.factors, mine)
        x[self.nodes[len(self.own) :]] += mine[len(self.own) :]
        x[self.own] = mine[: len(self.own)]

    def backward(self, x: FloatArray) -> None:
        """x <- L^-T x on the nodes of the part, with the solution on its border; shape (nodes, 3)."""
        mine = x[self.nodes]
        backward(self.fronts, self.factors, mine)
        x[self.own] = mine[: len(self.own)]


class DistributedMultifrontalSolver:
    """Cholesky factorisation of K on several ranks, some of its nodes last; all calls are collective.

    Args:
        K: Symmetric positive definite, assembled, 3 rows per node, those of a node on one rank.
        points: Coordinates of this rank's nodes, shape (k, 3).
        last: Nodes to eliminate last, by global number; those of all ranks together.

    Attributes:
        last: The same nodes on every rank, in the order of `schur_product`, body after body.

    Raises:
        ValueError: On every rank, if K is not positive definite.
    """

    name = "direct (nested dissection, shared fronts, LAPACK Cholesky)"
    method = "direct (nested dissection, shared fronts)"
    exact = True
    tolerance = 0.0
    iterations = 0

    def __init__(self, K: PETSc.Mat, points: FloatArray, last: npt.NDArray[np.integer[Any]]):
        self.comm: MPI.Comm = K.getComm().tompi4py()
        comm = self.comm
        blocks = nodal_blocks(K)
        self._owned = np.array(comm.allgather(len(points)))
        self._first = int(self._owned[: comm.rank].sum())
        everywhere = np.empty((int(self._owned.sum()), 3))
        comm.Allgatherv(np.ascontiguousarray(points), (everywhere, 3 * self._owned))
        is_last = np.zeros(len(everywhere), dtype=bool)
        is_last[np.concatenate(comm.allgather(last.astype(np.int64)))] = True
        self._dissection = dissect_shared(comm, blocks, self._first, everywhere, is_last)
        self._shared = [
            DistributedFront(comm, front, np.float64) if comm.rank in front.ranks else None
            for front in self._dissection.fronts
        ]
        self._plan_solves()
        entries = self._redistributed(blocks)
        self._factorise(entries, everywhere)
        roots = [front.own for front in self._dissection.fronts if front.root and len(front.own)]
        self.last: Nodes = np.concatenate([np.empty(0, np.int64), *roots])

    # --- factorisation ------------------------------------------------------------------------------------------------

    def _redistributed(self, blocks: scipy.sparse.bsr_matrix) -> _Entries:
        """The entries of K that this rank eliminates, row by row."""
        comm, label = self.comm, self._dissection.label
        mine = np.arange(self._first, self._first + len(blocks.indptr) - 1)
        row, column = np.repeat(mine, np.diff(blocks.indptr)), blocks.indices
        needed = np.flatnonzero(label[column] >= label[row])
        rank = self._eliminating_ranks()[row[needed]]
        order = needed[np.argsort(rank, kind="stable")]
        counts = np.bincount(rank, minlength=comm.size)
        incoming = np.array(comm.alltoall(counts.tolist()))
        pairs = np.empty((int(incoming.sum()), 2), dtype=np.int64)
        values = np.empty((len(pairs), 3, 3))
        outgoing = np.column_stack([row[order], column[order]])
        comm.Alltoallv((outgoing, 2 * counts), (pairs, 2 * incoming))
        comm.Alltoallv((blocks.data[order], 9 * counts), (values, 9 * incoming))
        return _Entries(pairs[:, 0], pairs[:, 1], values)  # ascending, since ranks have ascending rows

    def _eliminating_ranks(self) -> Nodes:
        """The rank that needs the row of each node."""
        rank = np.empty(len(self._dissection.label), dtype=np.int64)
        for part in self._dissection.parts:
            rank[part.own] = part.rank
        for front in self._dissection.fronts:
            rank[front.own] = column_ranks(front)
        return rank

    def _factorise(self, entries: _Entries, points: FloatArray) -> None:
        comm, dissection = self.comm, self._dissection
        self._parts: list[_LocalPart] = []
        updates: dict[int, Update] = {}
        failed = False
        for number, part in enumerate(dissection.parts):
            rows = 3 * len(part.border)
            columns = {}
            if part.rank == comm.rank and not failed:
                try:
                    self._parts.append(_LocalPart(part, entries, points))
                    columns[0] = self._parts[-1].update
                except ValueError:
                    failed = True
            updates[number] = Update(part.border, [Block(0, rows, part.rank)], columns)
        self._refuse(failed)
        count = len(dissection.parts)
        for number, (front, columns_of) in enumerate(zip(dissection.fronts, self._shared, strict=True)):
            if columns_of is None:
                updates[count + number] = Update.of(front, {})
                continue
            self._add_entries(columns_of, entries)
            below = [*front.parts, *(count + child for child in front.children)]
            columns_of.add_updates([updates.pop(child) for child in below])
            updates[count + number] = columns_of.factorise()
            failed |= columns_of.failed
        for local in self._parts:
            del local.update
        self._refuse(failed)

    def _refuse(self, failed: bool) -> None:
        if self.comm.allreduce(failed, op=MPI.LOR):
            raise ValueError(NOT_POSITIVE_DEFINITE)

    def _add_entries(self, columns: DistributedFront, entries: _Entries) -> None:
        """Add this rank's entries of K to its columns of a shared front."""
        front = columns.front
        place = np.full(len(self._dissection.label), -1, dtype=np.int64)
        both = np.concatenate([front.own, front.border])
        place[both] = np.arange(len(both))
        mine = np.zeros(len(place), dtype=bool)
        mine[front.own[column_ranks(front) == self.comm.rank]] = True
        chosen = np.flatnonzero(mine[entries.row])
        column, row = place[entries.row[chosen]], place[entries.column[chosen]]
        later = row >= column
        columns.add_entries(column[later], row[later], entries.values[chosen[later]])

    # --- solves -------------------------------------------------------------------------------------------------------

    def _plan_solves(self) -> None:
        """Where the entries of a right-hand side go, and those of the solution come from."""
        home = np.empty(len(self._dissection.label), dtype=np.int64)
        for part in self._dissection.parts:
            home[part.own] = part.rank
        for front in self._dissection.fronts:
            home[front.own] = front.ranks[0]
        mine = home[self._first : self._first + int(self._owned[self.comm.rank])]
        self._out = np.argsort(mine, kind="stable")
        self._out_counts = np.bincount(mine, minlength=self.comm.size)
        self._here = np.flatnonzero(home == self.comm.rank)
        owner = np.repeat(np.arange(self.comm.size), self._owned)
        self._here_counts = np.bincount(owner[self._here], minlength=self.comm.size)

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        comm = self.comm
        x = np.zeros((len(self._dissection.label), 3))
        received = np.empty((len(self._here), 3))
        sent = np.ascontiguousarray(rhs.array_r.reshape(-1, 3)[self._out])
        comm.Alltoallv((sent, 3 * self._out_counts), (received, 3 * self._here_counts))
        x[self._here] = received
        parts: list[_LocalPart | DistributedFront] = [*self._parts, *filter(None, self._shared)]
        for one in parts:
            one.forward(x)
        for one in reversed(parts):
            one.backward(x)
        comm.Alltoallv((np.ascontiguousarray(x[self._here]), 3 * self._here_counts), (sent, 3 * self._out_counts))
        solution = np.empty_like(sent)
        solution[self._out] = sent
        u.array[:] = solution.ravel()

    def schur_product(self, x: FloatArray) -> FloatArray:
        """S^-1 x, for the Schur complement S of K on the nodes `last`; shape (3 last,), the same on all ranks."""
        part = np.empty_like(x)
        for front, here in self._roots():
            part[here] = front.product(x[here])
        y = np.empty_like(part)
        self.comm.Allreduce(part, y)
        return y

    def schur_squares(self, columns: scipy.sparse.csr_matrix) -> FloatArray:
        """b^T S^-1 b for each column b of a matrix, shape (3 last, k), the same on all ranks."""
        part = sum((front.squares(columns[here]) for front, here in self._roots()), np.zeros(columns.shape[1]))
        y = np.empty_like(part)
        self.comm.Allreduce(part, y)
        return y

    def _roots(self) -> Iterator[tuple[DistributedFront, slice]]:
        """The last front of every body, and the place of its displacements among those of `last`."""
        start = 0
        for front in self._shared:
            if front is not None and front.front.root:
                yield front, slice(start, start + front.own)
                start += front.own

    def destroy(self) -> None:
        self._parts, self._shared = [], []
