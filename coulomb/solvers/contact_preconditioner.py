"""Preconditioner of the semismooth Newton systems P dx + Q dw = r, dw = A dx: A replaced by D - V V^T + U U^T.

With C = (U, V) and S the signs of their products, M = P + Q (D + C S C^T) has by Woodbury's formula the inverse

    M^-1 = N^-1 - R C (S + C^T R C)^-1 C^T N^-1,    N = P + Q D,    R = N^-1 Q,

N and R nodal.  R = D^-1 where a node sticks, and in the row of the normal force of every closed node: there P = 0.  So
C^T R C is C^T D^-1 C, which stays from step to step, and a product with the other rows of C: a third of the work where
a third of the nodes slip.
"""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI
from scipy.linalg.lapack import dgetrf, dgetrs

from ..arrays import FloatArray
from ..linalg.low_rank import LowRankApproximation
from ..linalg.reductions import summed
from .contact_equations import ContactDerivative

_ROUNDING = 1e-13
"""Entries of R D - 1 below this are rounding errors."""


class ContactPreconditioner:
    """M^-1 at one point; collective, as every application.

    Args:
        comm: The ranks.
        at: The equations and their derivative.
        A: The approximation of A, not to be changed as long as this is used.
    """

    def __init__(self, comm: MPI.Comm, at: ContactDerivative, A: LowRankApproximation):
        self._comm, self._columns = comm, A.columns
        self._inverse = at.inverse(A.rest)
        s = A.columns.shape[1]
        if s == 0:
            return
        self._R: FloatArray = self._inverse @ at.Q
        change = self._R * A.rest[:, None, :] - np.eye(3)  # R D - 1
        rows = np.flatnonzero(np.any(np.abs(change) > _ROUNDING, axis=2).ravel())
        weighted = (A.columns / A.rest.reshape(-1, 1)).reshape(-1, 3, s)
        changed = (change @ weighted).reshape(-1, s)[rows]
        core = np.diag(A.signs) + A.weighted_gram + summed(comm, A.columns[rows].T @ changed)
        self._factors, self._pivots, _ = dgetrf(core)  # a singular one gives no numbers, and the method ends

    def __call__(self, r: FloatArray) -> FloatArray:
        """M^-1 applied to r (m, 3) or (m, 3, columns); collective."""
        count = math.prod(r.shape[2:])
        z = self._inverse @ r.reshape(len(r), 3, count)
        if self._columns.shape[1] > 0:
            seen = summed(self._comm, self._columns.T @ z.reshape(len(self._columns), count))
            known = dgetrs(self._factors, self._pivots, seen)[0]
            z -= self._R @ (self._columns @ known).reshape(z.shape)
        applied: FloatArray = z.reshape(r.shape)
        return applied
