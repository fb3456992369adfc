"""The diagonal of a compliance that is not formed, from a few products."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from .reductions import Reductions
from .unsolved import Unsolved


class Products(Protocol):
    """The products by a compliance that the estimate takes, see `Compliance`."""

    @property
    def comm(self) -> MPI.Comm: ...

    @property
    def nodes(self) -> int: ...

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None: ...


def estimated_diagonal(
    A: Products, B: PETSc.Mat, K: PETSc.Mat, probes: int = 8, rigid: FloatArray | None = None
) -> FloatArray:
    """diag(A) of A = B K^-1 B^T from a few products, shape (3 m,).

    diag(A) is close to a multiple of diag(B diag(K)^-1 B^T), one multiple for each of n, t1 and t2, found from products
    with random signs v, since the mean of v_i (A v)_i is A_ii (Hutchinson 1989).  It neglects rigid motions of the
    body, with little effect on CG (`coulomb benchmark table1` shows both); those that are given are left out.

    Args:
        A: The compliance; `probes` products are made.
        B: Contact matrix, 3 rows per contact node.
        K: The stiffness matrix, of which only the diagonal is read.
        probes: Number of products.
        rigid: Columns F, shape (3 m, q): the diagonal is that of A - F F^T; None if there are none.
    """
    over = Reductions(A.comm)
    u, x = B.createVecs()
    squares = B.duplicate(copy=True)
    indptr, indices, values = squares.getValuesCSR()
    squares.setValuesCSR(indptr, indices, values**2)
    squares.assemble()
    K.getDiagonal(u)
    u.reciprocal()
    squares.mult(u, x)
    local = x.array_r.reshape(-1, 3).copy()
    for done in (squares, u, x):
        done.destroy()
    random = np.random.default_rng([2718, A.comm.rank])
    traces, y = np.zeros(3), np.empty(3 * A.nodes)
    for _ in range(probes):
        v = random.choice([-1.0, 1.0], size=3 * A.nodes)
        try:
            A.mult(v, y, 0.03)
            if rigid is not None:
                y -= rigid @ over.total(rigid.T @ v)
        except Unsolved:  # the scale of diag(K)^-1 then; path following reports the failure
            traces[:] = [over.sum(local[:, k]) for k in range(3)]
            break
        traces += [over.sum((v * y)[k::3]) / probes for k in range(3)]
    local_traces = np.array([over.sum(local[:, k]) for k in range(3)])
    factors = np.divide(traces, local_traces, out=np.zeros(3), where=local_traces > 0.0)  # 0 where all rows are zero
    estimate: FloatArray = (local * factors).ravel()
    return estimate
