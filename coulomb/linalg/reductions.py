"""Sums, norms and extreme values over the contact nodes of all ranks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray


@dataclass(frozen=True)
class Reductions:
    """Reductions of rank-local numpy arrays; every call is collective, and the array of a rank may be empty."""

    comm: MPI.Comm

    def sum(self, v: FloatArray | float) -> float:
        return float(self.comm.allreduce(float(np.sum(v)), op=MPI.SUM))

    def dot(self, v: FloatArray, w: FloatArray) -> float:
        return float(self.comm.allreduce(float(np.vdot(v, w)), op=MPI.SUM))

    def total(self, v: FloatArray) -> FloatArray:
        """Sum over the ranks, entry by entry, of an array of the same shape on each."""
        array: FloatArray = self.comm.allreduce(v)
        return array

    def norm(self, v: FloatArray) -> float:
        """Euclidean norm, safe from overflow and underflow of the squares."""
        largest = self.max(np.abs(v))
        if largest <= 0.0:  # all entries are zero, or there are none
            return 0.0
        if not math.isfinite(largest):
            return largest
        w = v / largest
        return largest * math.sqrt(self.dot(w, w))

    def max(self, v: FloatArray) -> float:
        """Largest entry; NaN if any entry is, -inf if there is none."""
        local = float(np.max(v)) if np.size(v) else -math.inf
        return float(np.max(self.comm.allgather(local)))

    def min(self, v: FloatArray) -> float:
        """Smallest entry; NaN if any entry is, +inf if there is none."""
        return -self.max(-np.asarray(v))

    def all(self, condition: bool) -> bool:
        return bool(self.comm.allreduce(bool(condition), op=MPI.LAND))
