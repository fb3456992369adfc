"""Rigid motions of bodies that soft springs hold, apart from what is elastic in K^-1.

With R the motions that springs alone resist, scaled so that R^T K R = 1,

    K^-1 = R R^T + P K^-1 P^T,    P = 1 - R (K R)^T,    A = B K^-1 B^T = F F^T + A_e,    F = B R

exactly, for P is the projection on displacements v without energy in common with the motions, (K R)^T v = 0, and P^T
takes from forces what the springs carry in the motions.  F F^T may be 1e8 times as large as A_e.  From
products by A to a few per cent, path following learns nothing but the motions; from products by A_e of that accuracy,
with F F^T known, it learns A_e (docs/measurements.md).

K R has the forces of the springs only, and is taken from these: as a product by K it would have rounding errors of the
body's stiffness.  (Solving on the complement of a few directions is deflation: R. A. Nicolaides, SIAM J. Numer. Anal.
24, 1987.)
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ..reductions import summed


class SoftMotions:
    """The motions and the forces that they cause.

    Args:
        comm: The ranks.
        motions: R, this rank's rows, shape (n, q), with R^T K R = 1: in metres per root of a joule.
        forces: K R, shape (n, q).

    Attributes:
        motions: As given.
    """

    def __init__(self, comm: MPI.Comm, motions: FloatArray, forces: FloatArray):
        self._comm, self.motions = comm, motions
        self._loaded = np.flatnonzero(np.any(forces != 0.0, axis=1))
        self._forces: FloatArray = np.ascontiguousarray(forces[self._loaded])

    def take_from_forces(self, r: FloatArray) -> FloatArray:
        """r <- P^T r, shape (n,): less what the springs carry in the motions, whose amounts R^T r, shape (q,), are
        returned; collective."""
        amounts = summed(self._comm, self.motions.T @ r)
        r[self._loaded] -= self._forces @ amounts
        return amounts

    def take_from(self, u: FloatArray) -> None:
        """u <- P u, displacements of shape (n,); collective."""
        u -= self.motions @ summed(self._comm, self._forces.T @ u[self._loaded])
