"""K = L L^T on several ranks by nested dissection, the contact nodes last: as `multifrontal` on one rank.

Each rank factorises its parts of the bodies alone, with the fronts of one rank; the fronts above are shared (see
`shared_dissection` and `distributed_front`).  The rows of K go to the ranks that eliminate their nodes first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc

from ..arrays import FloatArray
from .distributed_factors import DistributedFactors, Entries, LocalPart, local_parts, operations
from .front_blocks import column_ranks
from .multifrontal import SINGLE_FROM
from .nested_dissection import Nodes
from .nodal_blocks import nodal_blocks
from .reductions import concatenated
from .refined_solver import RefinedSolver
from .shared_dissection import dissect_shared


class DistributedMultifrontalSolver(RefinedSolver):
    """Cholesky factorisation of K on several ranks, some of its nodes last; all calls are collective.

    Args:
        K: Symmetric positive definite, assembled, 3 rows per node, those of a node on one rank.
        points: Coordinates of this rank's nodes, shape (k, 3).
        last: Nodes to eliminate last, by global number; those of all ranks together.
        single: Whether to factorise in single precision; by default where it is faster.

    Attributes:
        last: The same nodes on every rank, in the order of `schur_solve`, body after body.

    Raises:
        ValueError: On every rank, if K is not positive definite.
    """

    method = "direct (nested dissection, shared fronts)"
    _factors: DistributedFactors

    def __init__(
        self, K: PETSc.Mat, points: FloatArray, last: npt.NDArray[np.integer[Any]], single: bool | None = None
    ):
        super().__init__(K)
        comm = self.comm
        self._owned = concatenated(comm, np.array([len(points)]))
        self._first = int(self._owned[: comm.rank].sum())
        self._points: FloatArray = concatenated(comm, points)
        is_last = np.zeros(len(self._points), dtype=bool)
        is_last[concatenated(comm, last.astype(np.int64))] = True
        blocks = nodal_blocks(K)
        self._dissection = dissect_shared(comm, blocks, self._first, self._points, is_last)
        roots = [front.own for front in self._dissection.fronts if front.root]
        self.last: Nodes = np.concatenate([np.empty(0, np.int64), *roots])
        mine = (self.last >= self._first) & (self.last < self._first + len(points))
        self._mine = np.flatnonzero(np.repeat(mine, 3))
        self._at = (3 * (self.last[mine] - self._first)[:, None] + np.arange(3)).ravel()
        self._ready: tuple[Entries, list[LocalPart]] | None = self._prepared(blocks)
        if single is None:
            single = operations(comm, self._dissection, self._ready[1]) >= SINGLE_FROM
        self._factorise(single)
        self._ready = None  # it is large

    def _prepared(self, blocks: scipy.sparse.bsr_matrix) -> tuple[Entries, list[LocalPart]]:
        """What a factorisation needs."""
        entries = self._redistributed(blocks)
        return entries, local_parts(self.comm, self._dissection, entries, self._points)

    def _factorised_in(self, dtype: npt.DTypeLike) -> DistributedFactors:
        entries, parts = self._ready or self._prepared(nodal_blocks(self._K))
        return DistributedFactors(self.comm, self._dissection, parts, entries, self._owned, dtype)

    def _redistributed(self, blocks: scipy.sparse.bsr_matrix) -> Entries:
        """The entries of K that this rank eliminates, row by row."""
        comm, label = self.comm, self._dissection.label
        mine = np.arange(self._first, self._first + len(blocks.indptr) - 1)
        row, column = np.repeat(mine, np.diff(blocks.indptr)), blocks.indices
        needed = np.flatnonzero(label[column] >= label[row])
        rank = self._eliminating_ranks()[row[needed]]
        order = needed[np.argsort(rank, kind="stable")]
        counts = np.bincount(rank, minlength=comm.size)
        incoming = np.empty_like(counts)
        comm.Alltoall(counts, incoming)
        pairs = np.empty((int(incoming.sum()), 2), dtype=np.int64)
        values = np.empty((len(pairs), 3, 3))
        outgoing = np.column_stack([row[order], column[order]])
        comm.Alltoallv((outgoing, 2 * counts), (pairs, 2 * incoming))
        comm.Alltoallv((blocks.data[order], 9 * counts), (values, 9 * incoming))
        return Entries(pairs[:, 0], pairs[:, 1], values)  # ascending, since ranks have ascending rows

    def _eliminating_ranks(self) -> Nodes:
        """The rank that needs the row of each node."""
        rank = np.empty(len(self._dissection.label), dtype=np.int64)
        for part in self._dissection.parts:
            rank[part.own] = part.rank
        for front in self._dissection.fronts:
            rank[front.own] = column_ranks(front)
        return rank

    def contact_part(self, u: FloatArray) -> FloatArray:
        """Displacements of the nodes `last`, shape (3 last,), the same on all ranks, of this rank's, shape (n,)."""
        part = np.zeros(3 * len(self.last))
        part[self._mine] = u[self._at]
        whole = np.empty_like(part)
        self.comm.Allreduce(part, whole)
        return whole

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

    @property
    def schur_factors(self) -> list[FloatArray]:
        """Not on several ranks, which have parts of them.

        Raises:
            ValueError: Always.
        """
        raise ValueError("the factors of the Schur complement are not on one rank")
