"""Linear constraints G x = r3 beside a nodal system, and the preconditioner that satisfies them exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ..reductions import summed

NodalMap = Callable[[FloatArray], FloatArray]
"""Maps unknowns of this rank's nodes, shape (m, block) or (m, block, columns)."""

_RANK_DEFICIENT = 1e-14  # singular values of the constraints' matrix below this part of the largest are rounding


class Constraints:
    """A few dense rows G over the nodes of all ranks, and their multipliers, the same on all ranks.

    Args:
        comm: The ranks.
        G: G^T, this rank's nodes, shape (m, 3, r).

    Attributes:
        count: Number of constraints r.
        G: As given.
    """

    def __init__(self, comm: MPI.Comm, G: FloatArray):
        self._comm, self.G, self.count = comm, G, G.shape[2]

    def resultant(self, x: FloatArray) -> FloatArray:
        """G x of x (m, 3, ...), shape (r, ...); collective if there are any."""
        if not self.count:
            return np.empty((0, *x.shape[2:]))
        return summed(self._comm, np.einsum("iaq,ia...->q...", self.G, x))

    def without(self, w: FloatArray, multipliers: FloatArray) -> FloatArray:
        """w - G^T multipliers, shape (m, 3)."""
        return w - self.G @ multipliers if self.count else w


class ConstraintPreconditioner:
    """[P, -G^T; G, 0]^-1 by block elimination with the r x r matrix S = G P^-1 G^T.

    (C. Keller, N. I. M. Gould, A. J. Wathen: Constraint preconditioning for indefinite linear systems, SIAM J. Matrix
    Anal. Appl. 21, 2000.)  S may be singular: multipliers without resistance are zero.

    Args:
        inverse: P^-1 on (m, block) and on (m, block, r); x is the first three of `block` unknowns per node.
        constraints: G.
        block: Unknowns per node.
        left: Replaces G^T in the first row of the matrix, shape (m, block, r).
    """

    def __init__(self, inverse: NodalMap, constraints: Constraints, block: int, left: FloatArray | None = None):
        self._inverse, self._constraints = inverse, constraints
        r = constraints.count
        if not r:
            return
        G = left
        if G is None:
            G = np.zeros((len(constraints.G), block, r))
            G[:, :3] = constraints.G
        self._PG = inverse(G)
        S = constraints.resultant(self._PG[:, :3])
        size = np.sqrt(np.abs(S.diagonal()))
        size[size == 0.0] = 1.0
        self._S_inverse: FloatArray = np.linalg.pinv(S / np.outer(size, size), rcond=_RANK_DEFICIENT) / np.outer(
            size, size
        )

    def __call__(self, r: FloatArray, r3: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unknowns (m, block) and multipliers (r,) for right-hand sides (m, block) and (r,); collective."""
        z = self._inverse(r)
        if not self._constraints.count:
            return z, r3
        multipliers: FloatArray = self._S_inverse @ (r3 - self._constraints.resultant(z[:, :3]))
        return z + self._PG @ multipliers, multipliers
