"""K = L L^T on one rank by nested dissection, the contact nodes last: K^-1, and their Schur complement as a factor.

The multifrontal method (Duff and Reid 1983) with dense fronts and LAPACK.  It was compared with MUMPS 5.5, called
from C (docs/measurements.md): MUMPS accepts the same order of elimination (ICNTL(7) = 1), also beside a Schur
complement (ICNTL(19)), makes the same number of operations, and takes 1.2 to 1.7 times as long at p = 8 to 16.  PETSc
3.18 cannot pass the order on: the option mat_mumps_icntl_7 refuses 1, and MUMPS's Cholesky factorisation ignores the
ordering of the preconditioner.  Without it MUMPS uses AMD beside a Schur complement: twice the operations at p = 16,
and 2.2 times as long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc
from scipy.linalg.blas import dsyrk, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf

from ..arrays import FloatArray
from .nested_dissection import Front, Nodes, dissect
from .nodal_blocks import nodal_blocks

Factor = tuple[FloatArray, FloatArray]
"""The columns of L of a front: head (own, own), a lower triangle, and below (border, own)."""

NOT_POSITIVE_DEFINITE = (
    "the stiffness matrix is not positive definite to rounding: the body can move without resistance, or its materials "
    "and springs are too far apart; clamp it, or give it stiffer springs"
)


class MultifrontalSolver:
    """Cholesky factorisation of K on one rank, some of its nodes last.

    Args:
        K: Symmetric positive definite, assembled, 3 rows per node, on one rank.
        points: The nodes' coordinates, shape (k, 3).
        last: Nodes to eliminate last, ascending.

    Attributes:
        last: The same nodes, in the order of `schur_factors`, body after body.

    Raises:
        ValueError: If K is not positive definite.
    """

    name = "direct (nested dissection, LAPACK Cholesky)"
    tolerance = 0.0
    iterations = 0

    def __init__(self, K: PETSc.Mat, points: FloatArray, last: npt.NDArray[np.integer[Any]]):
        blocks = nodal_blocks(K)
        nodes = len(points)
        graph = scipy.sparse.csr_matrix((np.empty(len(blocks.indices), np.int8), blocks.indices, blocks.indptr))
        graph.resize(nodes, nodes)
        self._fronts = dissect(graph, points, last.astype(np.int64))
        self._factors, _ = factorised(blocks, self._fronts)
        roots = [number for number, front in enumerate(self._fronts) if front.root]
        self._roots = [number for number in roots if len(self._fronts[number].own)]
        self.last: Nodes = np.concatenate([np.empty(0, np.int64), *(self._fronts[root].own for root in self._roots)])

    @property
    def schur_factors(self) -> list[FloatArray]:
        """L of the Schur complement S = L L^T on the nodes `last` of each of the bodies, which S does not couple.

        Lower triangles, shape (3 m, 3 m), Fortran order; entries above the diagonal are undefined.  The block of K^-1
        on these nodes is S^-1.
        """
        return [self._factors[root][0] for root in self._roots]

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        x = rhs.array_r.reshape(-1, 3).copy()
        forward(self._fronts, self._factors, x)
        backward(self._fronts, self._factors, x)
        u.array[:] = x.ravel()

    def destroy(self) -> None:
        self._fronts, self._factors = [], []


def forward(fronts: list[Front], factors: list[Factor], x: FloatArray) -> None:
    """x <- L^-1 x on the nodes of the fronts; of nodes that only borders have, what remains of x; shape (k, 3)."""
    for front, (head, below) in zip(fronts, factors, strict=True):
        if len(front.own):
            y = dtrsv(head, x[front.own].ravel(), lower=1)
            x[front.own] = y.reshape(-1, 3)
            x[front.border] -= (below @ y).reshape(-1, 3)


def backward(fronts: list[Front], factors: list[Factor], x: FloatArray) -> None:
    """x <- L^-T x on the nodes of the fronts, with given x on nodes that only borders have; shape (k, 3)."""
    for front, (head, below) in zip(reversed(fronts), reversed(factors), strict=True):
        if len(front.own):
            y = x[front.own].ravel() - below.T @ x[front.border].ravel()
            x[front.own] = dtrsv(head, y, lower=1, trans=1).reshape(-1, 3)


def factorised(blocks: scipy.sparse.bsr_matrix, fronts: list[Front]) -> tuple[list[Factor], dict[int, FloatArray]]:
    """The columns of L of every front, and the update matrices of the last fronts of trees (which have no parent).

    Update matrices are lower triangles on the borders; the entries above the diagonal are undefined.

    Raises:
        ValueError: If K is not positive definite on the nodes of the fronts.
    """
    place = np.full(blocks.shape[0] // 3, -1, dtype=np.int64)
    updates: dict[int, FloatArray] = {}
    workspace = _Workspace(fronts)
    factors: list[Factor] = []
    for number, front in enumerate(fronts):
        e, b = 3 * len(front.own), 3 * len(front.border)
        children = list(front.children)
        if front.root and len(children) == 1 and len(fronts[children[0]].border) == len(front.own):
            child = children.pop()  # a last front: the child's update is all of it
            head = updates.pop(child)
            if number < len(fronts) - 1:  # its memory is used for the next body
                head = head.copy(order="F")
            workspace.pop(child, fronts[child])
        else:
            head = np.zeros((e, e), order="F")
        below: FloatArray = np.zeros((b, e), order="F")
        update = workspace.push(number, front)
        _assemble(blocks, front, place, head, below)
        for child in children:
            _add(updates.pop(child), fronts[child], head, below, update)
            workspace.pop(child, fronts[child])
        if e:
            head, failed = dpotrf(head, lower=1, clean=0, overwrite_a=1)
            if failed:
                raise ValueError(NOT_POSITIVE_DEFINITE)
        if e and b:
            below = dtrsm(1.0, head, below, side=1, lower=1, trans_a=1, overwrite_b=1)
            update = dsyrk(-1.0, below, beta=1.0, c=update, lower=1, overwrite_c=1)
        factors.append((head, below))
        updates[number] = update
    return factors, updates


def _assemble(blocks: scipy.sparse.bsr_matrix, front: Front, place: Nodes, head: FloatArray, below: FloatArray) -> None:
    """Add the entries of K between the front's own nodes and all nodes that are not eliminated yet.

    Args:
        blocks: K.
        front: The front.
        place: Workspace, -1 for every node, before and after.
        head: Entries between the own nodes are added here, in its lower triangle.
        below: Entries between border and own nodes are added here.
    """
    own, border = len(front.own), len(front.border)
    place[front.own], place[front.border] = np.arange(own), own + np.arange(border)
    first, count = blocks.indptr[front.own], np.diff(blocks.indptr)[front.own]
    entries = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    column, row = np.repeat(np.arange(own), count), place[blocks.indices[entries]]  # K is symmetric: rows as columns
    for matrix, chosen, start in ((head, (row >= column) & (row < own), 0), (below, row >= own, own)):
        height = len(matrix)
        corner = 3 * (row[chosen] - start) + 3 * height * column[chosen]
        inside = np.arange(3) + height * np.arange(3)[:, None]
        matrix.T.reshape(-1)[corner[:, None, None] + inside] += blocks.data[entries[chosen]]
    place[front.own] = place[front.border] = -1


def _add(child: FloatArray, front: Front, head: FloatArray, below: FloatArray, update: FloatArray) -> None:
    """Add a child's update matrix (a lower triangle on its border) to the parent's front, run by run."""
    own = len(head)
    runs: Any = (3 * front.runs).tolist()
    pieces = [(slice(i, i + n), slice(j, j + n)) for i, j, n in runs]
    for k, (rows, to) in enumerate(pieces):
        beyond = slice(to.start - own, to.stop - own)
        for columns, at in pieces[: k + 1]:
            if to.start < own:
                head[to, at] += child[rows, columns]
            elif at.start < own:
                below[beyond, at] += child[rows, columns]
            else:
                update[beyond, at.start - own : at.stop - own] += child[rows, columns]


class _Workspace:
    """Memory for the update matrices of the fronts, allocated once: touching new memory takes longer than the sums.

    When a front is assembled, the update matrices of its children are the latest ones at depths of their parity.  So
    fronts of even and of odd depth have a stack each.
    """

    def __init__(self, fronts: list[Front]):
        depth = [0] * len(fronts)
        for number in reversed(range(len(fronts))):
            for child in fronts[number].children:
                depth[child] = depth[number] + 1
        self._side = [d % 2 for d in depth]
        self._top = [0, 0]
        height = [0, 0]
        for number, front in enumerate(fronts):
            side = self._side[number]
            self._top[side] += self._size(front)
            height[side] = max(height[side], self._top[side])
            for child in front.children:
                self._top[1 - side] -= self._size(fronts[child])
        self._memory = [np.empty(size) for size in height]

    @staticmethod
    def _size(front: Front) -> int:
        return (3 * len(front.border)) ** 2

    def push(self, number: int, front: Front) -> FloatArray:
        """Zeros for the border of a front, a square in Fortran order."""
        side, size = self._side[number], self._size(front)
        zeros = self._memory[side][self._top[side] : self._top[side] + size]
        self._top[side] += size
        zeros.fill(0.0)
        return zeros.reshape((3 * len(front.border),) * 2, order="F")

    def pop(self, number: int, front: Front) -> None:
        """Release the square that was pushed last on this side."""
        self._top[self._side[number]] -= self._size(front)
