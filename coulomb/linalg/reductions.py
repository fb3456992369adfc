"""Sums, norms, extreme values and concatenations of arrays over all ranks.

All calls are collective, and on buffers: mpi4py's calls on objects send each as a message of its own along a tree.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray


def summed(comm: MPI.Comm, v: FloatArray) -> FloatArray:
    """Sum over the ranks, entry by entry, of an array of the same shape on each; collective."""
    total: FloatArray = np.array(v, dtype=np.float64, order="C")
    if comm.size > 1:
        comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
    return total


def concatenated(comm: MPI.Comm, rows: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The rows (k, ...) of all ranks one after the other, on every rank; collective."""
    counts = np.empty(comm.size, dtype=np.int64)
    comm.Allgather(np.array([rows.size], dtype=np.int64), counts)
    whole = np.empty((int(counts.sum()) // max(int(np.prod(rows.shape[1:])), 1), *rows.shape[1:]), dtype=rows.dtype)
    comm.Allgatherv(np.ascontiguousarray(rows), (whole, counts))
    return whole


@dataclass(frozen=True)
class Reductions:
    """Reductions of rank-local numpy arrays; every call is collective, and the array of a rank may be empty.

    Attributes:
        comm: The ranks.
        copies: Factor of all sums, for totals of a body of which the mesh is one of so many layers.
    """

    comm: MPI.Comm
    copies: float = 1.0

    def sum(self, v: FloatArray | float) -> float:
        if self.comm.size == 1:
            return self.copies * float(np.add.reduce(v, axis=None))
        return self.copies * float(summed(self.comm, np.array([np.add.reduce(v, axis=None)]))[0])

    def dot(self, v: FloatArray, w: FloatArray) -> float:
        if self.comm.size == 1:
            return self.copies * float(np.vdot(v, w))
        return self.copies * float(summed(self.comm, np.array([np.vdot(v, w)]))[0])

    def total(self, v: FloatArray) -> FloatArray:
        """See `summed`; times `copies`."""
        return self.copies * summed(self.comm, v)

    def totals(self, *arrays: FloatArray) -> list[FloatArray]:
        """`total` of several arrays, in one call."""
        sums = self.total(np.concatenate([v.ravel() for v in arrays]))
        ends = np.cumsum([v.size for v in arrays])[:-1]
        return [part.reshape(v.shape) for part, v in zip(np.split(sums, ends), arrays, strict=True)]

    def norm(self, *arrays: FloatArray) -> float:
        """Euclidean norm of one array, or of several together, safe from overflow and underflow of the squares."""
        v = arrays[0] if len(arrays) == 1 else np.concatenate([v.ravel() for v in arrays])
        here = float(np.maximum.reduce(np.abs(v), axis=None)) if np.size(v) else 0.0
        square = 0.0
        if here > 0.0 and math.isfinite(here):
            w = v / here
            square = float(np.vdot(w, w))
        if self.comm.size == 1:
            return here * math.sqrt(square) if math.isfinite(here) and here > 0.0 else here
        largest, squares = self._gathered(here, square).T
        size = float(np.max(largest))
        if not size > 0.0 or not math.isfinite(size):  # all entries are zero, or one is not finite
            return 0.0 if size <= 0.0 else size
        return size * math.sqrt(float(np.sum((largest / size) ** 2 * squares)))

    def max(self, v: FloatArray) -> float:
        """Largest entry; NaN if any entry is, -inf if there is none."""
        local = float(np.maximum.reduce(v, axis=None)) if np.size(v) else -math.inf
        if self.comm.size == 1:
            return local
        return float(np.max(self._gathered(local)))

    def largest(self, v: FloatArray) -> FloatArray:
        """Largest over the ranks, entry by entry, of an array of the same length on each; NaN where any is."""
        if self.comm.size == 1:
            return v
        return np.max(self._gathered(*v), axis=0)

    def ends(self, x: FloatArray) -> FloatArray:
        """Least and largest coordinates of places x (k, 3), shape (2, 3); NaN where any is."""
        ends = np.concatenate([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
        return self.largest(ends).reshape(2, 3) * [[-1.0], [1.0]]

    def extent(self, x: FloatArray) -> FloatArray:
        """Extent of places x (k, 3) along the axes, shape (3,)."""
        return np.subtract(*self.ends(x)[::-1])

    def min(self, v: FloatArray) -> float:
        """Smallest entry; NaN if any entry is, +inf if there is none."""
        return -self.max(-np.asarray(v))

    def all(self, condition: bool | np.bool_) -> bool:
        return not self.any(not condition)

    def any(self, condition: bool | np.bool_) -> bool:
        return bool(condition) if self.comm.size == 1 else self.sum(float(condition)) > 0.0

    def require(self, condition: bool | np.bool_, message: str) -> None:
        """Raise a ValueError on every rank, unless the condition holds on all."""
        if not self.all(condition):
            raise ValueError(message)

    def _gathered(self, *values: float) -> FloatArray:
        """Numbers of all ranks, shape (ranks, numbers): MPI's extremes are undefined for NaN."""
        mine = np.array([values])
        if self.comm.size == 1:
            return mine
        every = np.empty((self.comm.size, len(values)))
        self.comm.Allgather(mine, every)
        return every
