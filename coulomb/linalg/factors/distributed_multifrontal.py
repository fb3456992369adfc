"""K = L L^T on several ranks by nested dissection, the contact nodes last: as `multifrontal` on one rank.

Each rank factorises its parts of the bodies alone, with the fronts of one rank; the fronts above are shared (see
`shared_dissection` and `distributed_front`).  The rows of K go to the ranks that eliminate their nodes first.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..nodal_blocks import nodal_blocks
from ..reductions import concatenated
from .distributed_factors import DistributedFactors, Entries, LocalPart, local_parts, shared_work
from .front_blocks import column_ranks
from .multifrontal import SINGLE_FROM, Work
from .nested_dissection import Nodes
from .refined_solver import RefinedSolver
from .shared_dissection import dissect_shared


class SharedSymbolic:
    """What is known of a factorisation on several ranks before it is made; collective.

    Args:
        K: Symmetric positive definite, assembled, 3 rows per node, those of a node on one rank.
        points: Coordinates of this rank's nodes, shape (k, 3).
        last: Nodes to eliminate last, by global number; those of all ranks together.

    Attributes:
        comm: The ranks.
        owned: Number of nodes of each rank.
        first: Number of this rank's first node.
        dissection: Parts of the bodies, and the fronts above.
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
        """What a factorisation takes; collective."""
        return shared_work(self.comm, self.dissection, self.prepared[1])

    def _prepared(self, blocks: scipy.sparse.bsr_matrix) -> tuple[Entries, list[LocalPart]]:
        entries = self._redistributed(blocks)
        return entries, local_parts(self.comm, self.dissection, entries, self._points)

    def _redistributed(self, blocks: scipy.sparse.bsr_matrix) -> Entries:
        """The entries of K that this rank eliminates, row by row."""
        comm, label = self.comm, self.dissection.label
        mine = np.arange(self.first, self.first + len(blocks.indptr) - 1)
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
        rank = np.empty(len(self.dissection.label), dtype=np.int64)
        for part in self.dissection.parts:
            rank[part.own] = part.rank
        for front in self.dissection.fronts:
            rank[front.own] = column_ranks(front)
        return rank


class DistributedMultifrontalSolver(RefinedSolver):
    """Cholesky factorisation of K on several ranks, some of its nodes last; all calls are collective.

    Args:
        K: Symmetric positive definite, assembled, 3 rows per node, those of a node on one rank.
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
        entries, parts = self._symbolic.prepared
        dissection, owned = self._symbolic.dissection, self._symbolic.owned
        return DistributedFactors(self.comm, dissection, parts, entries, owned, dtype)

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
