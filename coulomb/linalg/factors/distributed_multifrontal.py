"""K = L L^T on several ranks by nested dissection, the contact nodes last: as `multifrontal` on one rank.

Each rank factorises its parts of the bodies alone, with the fronts of one rank; the fronts above are shared (see
`nested_dissection` and `distributed_front`).  The rows of K go to the ranks that eliminate their nodes first.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..petsc_arrays import NodalRows, nodal_blocks
from ..reductions import Reductions, concatenated, exchanged, incoming, summed
from .blas import Real
from .distributed_front import Block, DistributedFront, Update, column_ranks
from .frontal_factors import FrontalFactors, NotPositiveDefinite
from .multifrontal import SINGLE_FROM, Work, predicted_work
from .nested_dissection import Front, Nodes, Part, dissect_part, dissect_shared
from .refined_solver import RefinedSolver


class Entries(NamedTuple):
    """Blocks (k, 3, 3) of rows of K that a rank needs, ascending, without those of nodes eliminated before."""

    row: Nodes
    column: Nodes
    values: FloatArray


class LocalPart:
    """A part of a body on this rank, from rows of K with those of the part among them; `fronts` has children first."""

    def __init__(self, part: Part, entries: Entries, points: FloatArray):
        self.part = part
        nodes = np.concatenate([part.own, part.border])
        place = np.zeros(len(points), dtype=np.int64)
        place[nodes] = np.arange(len(nodes))
        here = np.zeros(len(points), dtype=bool)
        here[part.own] = True
        self._chosen = np.flatnonzero(here[entries.row])
        counts = np.bincount(place[entries.row[self._chosen]], minlength=len(nodes))
        self._indptr, self._indices = np.concatenate([[0], np.cumsum(counts)]), place[entries.column[self._chosen]]
        coupled = (np.empty(len(self._indices), np.int8), self._indices, self._indptr)
        graph = scipy.sparse.csr_matrix(coupled, shape=(len(nodes),) * 2)
        self.fronts: list[Front] = dissect_part(graph, points[nodes], len(part.own))
        self._nodes = nodes

    def factorise(self, entries: Entries, dtype: npt.DTypeLike) -> Real:
        """Make the factors; the update matrix on the border."""
        blocks = (entries.values[self._chosen], self._indices, self._indptr)
        rows = NodalRows(scipy.sparse.bsr_matrix(blocks, shape=(3 * len(self._nodes),) * 2))
        self._factors = FrontalFactors(rows, self.fronts, dtype)
        own, border = np.split(self._nodes[self._factors.order], [len(self.part.own)])
        self._own, self._border = own, border
        update, self._factors.update = self._factors.update, np.empty((0, 0))
        return update

    def forward(self, x: Real) -> None:
        """x <- L^-1 x on the nodes of the part, the rest subtracted on its border; shape (nodes, 3)."""
        mine = np.zeros((len(self._nodes), 3), dtype=x.dtype)
        mine[: len(self._own)] = x[self._own]
        self._factors.forward(mine.reshape(-1))
        x[self._own] = mine[: len(self._own)]
        x[self._border] += mine[len(self._own) :]

    def backward(self, x: Real) -> None:
        """x <- L^-T x on the nodes of the part, with the solution on its border; shape (nodes, 3)."""
        mine = np.concatenate([x[self._own], x[self._border]])
        self._factors.backward(mine.reshape(-1))
        x[self._own] = mine[: len(self._own)]


class DistributedFactors:
    """K = L L^T on all ranks; all calls are collective.

    Raises:
        NotPositiveDefinite: On every rank, if a pivot is not positive in this precision.
    """

    def __init__(self, symbolic: SharedSymbolic, dtype: npt.DTypeLike):
        self.comm, self._dissection, self.dtype = symbolic.comm, symbolic.dissection, np.dtype(dtype)
        entries, self._parts = symbolic.prepared
        self._plan_solves(symbolic.owned)
        self._shared = [
            DistributedFront(self.comm, front, dtype) if self.comm.rank in front.ranks else None
            for front in self._dissection.fronts
        ]
        self._factorise(entries)

    def _factorise(self, entries: Entries) -> None:
        dissection, failed = self._dissection, False
        matrices: dict[int, Real] = {}
        for part in self._parts:
            try:
                matrices[id(part.part)] = part.factorise(entries, self.dtype)
            except NotPositiveDefinite:
                failed = True
        self._refuse(failed)
        updates: dict[int, Update] = {}
        for number, one in enumerate(dissection.parts):
            columns = {0: matrices.pop(id(one))} if id(one) in matrices else {}
            updates[number] = Update(one.border, [Block(0, 3 * len(one.border), one.rank)], columns)
        count = len(dissection.parts)
        for number, (front, columns_of) in enumerate(zip(dissection.fronts, self._shared, strict=True)):
            if columns_of is None:
                updates[count + number] = Update.of(front, {})
                continue
            self._add_entries(columns_of, entries)
            below = [*front.parts, *(count + child for child in front.children)]
            with np.errstate(all="ignore"):  # above the diagonal is anything, and everywhere after a failure
                columns_of.add_updates([updates.pop(child) for child in below])
                updates[count + number] = columns_of.factorise()
            failed |= columns_of.failed
        self._refuse(failed)

    def _refuse(self, failed: bool) -> None:
        if Reductions(self.comm).any(failed):
            raise NotPositiveDefinite("a pivot on one of the ranks")

    def _add_entries(self, columns: DistributedFront, entries: Entries) -> None:
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

    def _plan_solves(self, owned: Nodes) -> None:
        """Where the entries of a right-hand side go, and those of the solution come from."""
        home = np.empty(len(self._dissection.label), dtype=np.int64)
        for part in self._dissection.parts:
            home[part.own] = part.rank
        for front in self._dissection.fronts:
            home[front.own] = front.ranks[0]
        first = int(owned[: self.comm.rank].sum())
        mine = home[first : first + int(owned[self.comm.rank])]
        self._out = np.argsort(mine, kind="stable")
        self._out_counts = np.bincount(mine, minlength=self.comm.size)
        self._here = np.flatnonzero(home == self.comm.rank)
        owner = np.repeat(np.arange(self.comm.size), owned)
        self._here_counts = np.bincount(owner[self._here], minlength=self.comm.size)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """K^-1 rhs in this precision, of this rank's nodes, shapes (k, 3)."""
        comm = self.comm
        size = Reductions(comm).max(np.abs(rhs)) or 1.0
        x = np.zeros((len(self._dissection.label), 3), dtype=self.dtype)
        sent = (rhs[self._out] / size).astype(self.dtype)
        x[self._here] = exchanged(comm, sent, self._out_counts, self._here_counts)
        parts: list[LocalPart | DistributedFront] = [*self._parts, *filter(None, self._shared)]
        for one in parts:
            one.forward(x)
        for one in reversed(parts):
            one.backward(x)
        solution = np.empty_like(rhs)
        solution[self._out] = exchanged(comm, x[self._here], self._here_counts, self._out_counts)
        solution *= size
        return solution

    def schur_solve(self, z: FloatArray) -> FloatArray:
        """S^-1 z for the Schur complement S of K on the last nodes, the same on all ranks."""
        size = float(np.max(np.abs(z), initial=0.0)) or 1.0
        w = (z / size).astype(self.dtype)
        part = np.empty_like(w)
        for front, here in self._roots():
            part[here] = front.product(w[here])
        self.comm.Allreduce(part, w)
        return w * np.float64(size)

    def schur_squares(self, columns: scipy.sparse.csr_matrix) -> FloatArray:
        """b^T S^-1 b for each column b of a matrix, the same on all ranks."""
        part = sum((front.squares(columns[here]) for front, here in self._roots()), np.zeros(columns.shape[1]))
        return summed(self.comm, part)

    def _roots(self) -> Iterator[tuple[DistributedFront, slice]]:
        """The last front of every body, and the place of its displacements among those of all last nodes."""
        start = 0
        for front in self._shared:
            if front is not None and front.front.root:
                yield front, slice(start, start + front.own)
                start += front.own


class SharedSymbolic:
    """What is known of a factorisation on several ranks before it is made; collective.

    Arguments as of `DistributedMultifrontalSolver`.  `owned` is the number of nodes of each rank, `first` that of this
    rank's first node.
    """

    def __init__(self, K: PETSc.Mat, points: FloatArray, last: npt.NDArray[np.integer[Any]]):
        self._K = K
        self.comm: MPI.Comm = K.getComm().tompi4py()
        comm = self.comm
        self.owned = concatenated(comm, np.array([len(points)]))
        self.first = int(self.owned[: comm.rank].sum())
        self._points: FloatArray = concatenated(comm, points)
        is_last = np.zeros(len(self._points), dtype=bool)
        is_last[concatenated(comm, last.astype(np.int64))] = True
        blocks = nodal_blocks(K)
        self.dissection = dissect_shared(comm, blocks, self.first, self._points, is_last)
        self._ready: tuple[Entries, list[LocalPart]] | None = self._prepared(blocks)

    @property
    def prepared(self) -> tuple[Entries, list[LocalPart]]:
        """The rows of K that this rank needs, and its parts of the bodies; collective after `forget`."""
        return self._ready or self._prepared(nodal_blocks(self._K))

    def forget(self) -> None:
        """Free `prepared`, which is large."""
        self._ready = None

    def work(self) -> Work:
        """What a factorisation takes, without doing it, the same on all ranks; collective."""
        comm, fronts = self.comm, self.dissection.fronts
        each = [predicted_work(part.fronts) for part in self.prepared[1]]
        mine, kept = float(sum(work.operations for work in each)), float(sum(work.bytes for work in each))
        own, border = (np.array([3.0 * len(getattr(front, side)) for front in fronts]) for side in ("own", "border"))
        shared = own**3 / 3 + own**2 * border + own * border**2
        ranks = np.array([len(front.ranks) for front in fronts])
        total, memory = summed(comm, np.array([mine, kept]))
        longest = Reductions(comm).max(np.array([mine])) + float(np.sum(shared / ranks))
        entries = 4.0 * float(np.sum(own * (own + border)) + np.max(border**2, initial=0.0))
        return Work(float(total + shared.sum()), float(memory) + entries, longest)

    def _prepared(self, blocks: scipy.sparse.bsr_matrix) -> tuple[Entries, list[LocalPart]]:
        entries = self._redistributed(blocks)
        mine = [part for part in self.dissection.parts if part.rank == self.comm.rank]
        return entries, [LocalPart(part, entries, self._points) for part in mine]

    def _redistributed(self, blocks: scipy.sparse.bsr_matrix) -> Entries:
        """The entries of K that this rank eliminates, row by row."""
        comm, label = self.comm, self.dissection.label
        mine = np.arange(self.first, self.first + len(blocks.indptr) - 1)
        row, column = np.repeat(mine, np.diff(blocks.indptr)), blocks.indices
        needed = np.flatnonzero(label[column] >= label[row])
        rank = self._eliminating_ranks()[row[needed]]
        order = needed[np.argsort(rank, kind="stable")]
        counts = np.bincount(rank, minlength=comm.size).astype(np.int64)
        other = incoming(comm, counts)
        pairs = exchanged(comm, np.column_stack([row[order], column[order]]).astype(np.int64), counts, other)
        values = exchanged(comm, blocks.data[order], counts, other)
        return Entries(pairs[:, 0], pairs[:, 1], values)  # ascending, since ranks have ascending rows

    def _eliminating_ranks(self) -> Nodes:
        """The rank that needs the row of each node."""
        rank = np.empty(len(self.dissection.label), dtype=np.int64)
        for part in self.dissection.parts:
            rank[part.own] = part.rank
        for front in self.dissection.fronts:
            rank[front.own] = column_ranks(front)
        return rank


class DistributedMultifrontalSolver(RefinedSolver):
    """Cholesky factorisation of K on several ranks, some of its nodes last; all calls are collective.

    Args:
        K: As of `MultifrontalSolver`, the rows of a node on one rank.
        points: Coordinates of this rank's nodes, shape (k, 3).
        last: Nodes to eliminate last, by global number; those of all ranks together.
        single: Whether to factorise in single precision; by default where it is faster.
        symbolic: Of the same K, points and nodes, if it is known.

    Attributes:
        last: The same nodes on every rank, in the order of `schur_solve`, body after body.

    Raises:
        ValueError: On every rank, if K is not positive definite.
    """

    method = "direct (nested dissection, shared fronts)"
    _factors: DistributedFactors

    def __init__(
        self,
        K: PETSc.Mat,
        points: FloatArray,
        last: npt.NDArray[np.integer[Any]],
        single: bool | None = None,
        symbolic: SharedSymbolic | None = None,
    ):
        super().__init__(K)
        self._symbolic = symbolic or SharedSymbolic(K, points, last)
        first = self._symbolic.first
        roots = [front.own for front in self._symbolic.dissection.fronts if front.root]
        self.last: Nodes = np.concatenate([np.empty(0, np.int64), *roots])
        mine = (self.last >= first) & (self.last < first + len(points))
        self._mine = np.flatnonzero(np.repeat(mine, 3))
        self._at = (3 * (self.last[mine] - first)[:, None] + np.arange(3)).ravel()
        if single is None:
            single = self._symbolic.work().operations >= SINGLE_FROM
        self._factorise(single)
        self._symbolic.forget()

    def _factorised_in(self, dtype: npt.DTypeLike) -> DistributedFactors:
        return DistributedFactors(self._symbolic, dtype)

    def contact_part(self, u: FloatArray) -> FloatArray:
        """Displacements of the nodes `last`, shape (3 last,), the same on all ranks, of this rank's, shape (n,)."""
        part = np.zeros(3 * len(self.last))
        part[self._mine] = u[self._at]
        return summed(self.comm, part)

    def contact_forces(self, z: FloatArray) -> FloatArray:
        """Forces on the nodes `last`, shape (3 last,), among those on this rank's nodes, shape (n,)."""
        forces = np.zeros(len(self._root))
        forces[self._at] = z[self._mine]
        return forces

    def schur_solve(self, z: FloatArray) -> FloatArray:
        """S^-1 z by the factors, for the Schur complement S of K on the nodes `last`, shape (3 last,)."""
        return self._factors.schur_solve(z)

    def schur_diagonal(self, rows: scipy.sparse.csr_matrix) -> FloatArray:
        """b^T S^-1 b for each row b of this rank's matrix, shape (k, 3 last)."""
        everywhere = scipy.sparse.hstack(self.comm.allgather(rows.T.tocsr()), format="csr")
        start = sum(self.comm.allgather(rows.shape[0])[: self.comm.rank])
        return self._factors.schur_squares(everywhere)[start : start + rows.shape[0]]
