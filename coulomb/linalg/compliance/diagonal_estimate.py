"""The diagonal of a compliance that is not formed, from a few products."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ..reductions import Reductions
from ..unsolved import Unsolved

_ACCURACY = 0.03
"""Relative residual of the products."""


class DiagonalEstimate(NamedTuple):
    """diag(A), and `rest`, its part without the large eigenvalues of A that were found; shape (3 m,)."""

    whole: FloatArray
    rest: FloatArray


class Products(Protocol):
    """What the estimate takes of a `Compliance`."""

    @property
    def comm(self) -> MPI.Comm: ...

    @property
    def nodes(self) -> int: ...

    def mult(self, x: FloatArray, y: FloatArray, tolerance: float = 0.0) -> None: ...


def estimated_diagonal(
    A: Products, B: PETSc.Mat, K: PETSc.Mat, probes: int = 8, rigid: FloatArray | None = None
) -> DiagonalEstimate:
    """diag(A) of A = B K^-1 B^T from a few products, or that of A - F F^T with `rigid` columns F, shape (3 m, q).

    From products Y = A V with random signs V, Nyström's approximation Y (V^T Y)^-1 Y^T <= A has the few large
    eigenvalues of slender bodies, along which diag(A) varies by orders of magnitude.  The diagonal of the rest is close
    to a multiple of diag(B diag(K)^-1 B^T), one multiple for each of n, t1 and t2.  They are found from what the other
    probes leave of A v, R v, since the mean of v_i (R v)_i is R_ii (Hutchinson 1989; E. N. Epperly, J. A. Tropp, R. J.
    Webber: XTrace, SIAM J. Matrix Anal. Appl. 45, 2024).  The inverse is shifted by the square of the products'
    accuracy, the error of v^T A v.
    """
    over, local = Reductions(A.comm), _of_diagonal(B, K)
    random = np.random.default_rng([2718, A.comm.rank])
    V: FloatArray = random.choice([-1.0, 1.0], size=(probes, local.size))
    Y, y = np.empty_like(V), np.empty(local.size)
    for v, image in zip(V, Y, strict=True):
        try:
            A.mult(v, y, _ACCURACY)
        except Unsolved:  # the scale of diag(K)^-1 then; path following reports the failure
            return DiagonalEstimate(local.ravel(), local.ravel())
        image[:] = y if rigid is None else y - rigid @ over.total(rigid.T @ v)
    G = over.total(V @ Y.T)
    size = float(np.trace(G))
    if not size > 0.0:
        return DiagonalEstimate(local.ravel(), local.ravel())
    eigenvalues, Q = np.linalg.eigh(0.5 * (G + G.T) / size)
    inverse: FloatArray = (Q / (np.maximum(eigenvalues, 0.0) + _ACCURACY**2)) @ Q.T
    known = np.sum(Y * (inverse / size @ Y), axis=0)
    left = np.sum(V * ((inverse / inverse.diagonal()).T @ Y), axis=0) / probes
    traces, local_traces = over.totals(left.reshape(-1, 3).sum(axis=0), local.sum(axis=0))
    whole = max(float(traces.sum()), _ACCURACY**2 * size / probes)
    common = np.full(3, whole / float(local_traces.sum()))
    factors = np.divide(traces, local_traces, out=common, where=(traces > 0.0) & (local_traces > 0.0))
    rest: FloatArray = (local * factors).ravel()
    return DiagonalEstimate(known + rest, rest)


def _of_diagonal(B: PETSc.Mat, K: PETSc.Mat) -> FloatArray:
    """diag(B diag(K)^-1 B^T), shape (m, 3)."""
    u, x = B.createVecs()
    squares = B.duplicate(copy=True)
    indptr, indices, values = squares.getValuesCSR()
    squares.setValuesCSR(indptr, indices, values**2)
    squares.assemble()
    K.getDiagonal(u)
    u.reciprocal()
    squares.mult(u, x)
    local: FloatArray = x.array_r.reshape(-1, 3).copy()
    for done in (squares, u, x):
        done.destroy()
    return local
