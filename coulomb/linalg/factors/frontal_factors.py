"""The numerical part of the multifrontal factorisation: L of every front, in single or double precision.

The fronts are dense: LAPACK and BLAS do nearly all of the work.  Memory is allocated twice, for L as a whole and for
the update matrices, since the first access to new memory takes about as long as the sums there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import dsyrk, dtrsm, ssyrk, strsm
from scipy.linalg.lapack import dpotrf, spotrf

from ...arrays import FloatArray
from ...native import kernels
from ..petsc_arrays import NodalRows
from .nested_dissection import Front, Nodes

Real = npt.NDArray[Any]
"""Numbers in single or double precision."""

_ROUTINES = {np.dtype(np.float32): (spotrf, strsm, ssyrk), np.dtype(np.float64): (dpotrf, dtrsm, dsyrk)}


class NotPositiveDefinite(ValueError):
    """A pivot is not positive in this precision."""


class FrontalFactors:
    """L of K = L L^T, of every front its columns: head (own, own), a lower triangle, and below (border, own).

    All matrices are in Fortran order.

    Entries of K, sums of update matrices and substitutions are left to C: numpy takes three times as long on the block
    of 11 000 unknowns.

    Raises:
        NotPositiveDefinite: If a pivot is not positive in this precision.
    """

    def __init__(self, K: NodalRows, fronts: list[Front], dtype: npt.DTypeLike):
        self.dtype = np.dtype(dtype)
        self.order: Nodes = np.concatenate([front.own for front in fronts]).astype(np.int64)
        own, border = (
            np.array([len(getattr(front, side)) for front in fronts], dtype=np.int64) for side in ("own", "border")
        )
        borders = np.concatenate([front.border for front in fronts]).astype(np.int64)
        memory = np.empty(9 * int(np.sum(own * (own + border))), dtype=self.dtype)
        position: Nodes = np.full(len(K.indptr) - 1, -1, dtype=np.int64)  # of nodes that no front has
        position[self.order] = np.arange(len(self.order))
        assemble, self._extend, self._forward, self._backward = (
            kernels()[f"{name}_{self.dtype.name}"] for name in ("assemble", "extend", "forward", "backward")
        )
        entries = (K.indptr, K.indices, K.first, K.stride, K.values)
        assemble(len(own), own, border, self.order, borders, position, *entries, np.empty_like(position), memory)
        self._columns = own, border, position[borders], memory
        self._widest, self._work = 3 * int(border.max(initial=0)), np.empty(0, dtype=self.dtype)
        self.heads: list[Real] = []
        self.below: list[Real] = []
        row = 0
        for e, b in zip(3 * own, 3 * border, strict=True):
            self.heads.append(memory[row : row + e * e].reshape((e, e), order="F"))
            self.below.append(memory[row + e * e : row + e * (e + b)].reshape((b, e), order="F"))
            row += e * (e + b)
        with np.errstate(all="ignore"):  # above the diagonal is anything
            self._eliminate(fronts)

    def _eliminate(self, fronts: list[Front]) -> None:
        potrf, trsm, syrk = _ROUTINES[self.dtype]
        updates = dict[int, Real]()
        whole = {front.children[0]: number for number, front in enumerate(fronts) if _is_update_of_child(fronts, front)}
        stacks = Stacks(fronts, self.dtype)
        for number, (front, head, below) in enumerate(zip(fronts, self.heads, self.below, strict=True)):
            added = () if number in whole.values() else front.children
            for child in added:
                self._add(updates[child], fronts[child], len(head), head, below)
            if len(head):
                _, failed = potrf(head, lower=1, clean=0, overwrite_a=1)
                if failed:
                    raise NotPositiveDefinite(f"pivot {failed} of front {number}")
            if number in whole:  # what remains is the whole of the last front, where K is already
                update = self.heads[whole[number]]
            else:
                update = stacks.push(number)
            kept = 1.0 if number in whole else 0.0
            if below.size:
                syrk(-1.0, trsm(1.0, head, below, 1, 1, 1, overwrite_b=1), kept, update, lower=1, overwrite_c=1)
            elif number not in whole:
                update.fill(0.0)
            for child in added:
                self._add(updates.pop(child), fronts[child], len(head), update)
                stacks.pop(child)
            updates[number] = update

    def _add(self, child: Real, front: Front, own: int, into: Real, below: Real | None = None) -> None:
        """Add a child's update matrix, its front given, to the parent's `own` columns, head and below, or the rest of
        it to the parent's update matrix."""
        rest, below = (1, into) if below is None else (0, below)
        self._extend(rest, child, len(child), len(front.runs), front.runs, own, len(below), into, below)

    def forward(self, x: Real) -> None:
        """x <- L^-1 x in the order of elimination, shape (3 k,) or (c, 3 k)."""
        self._substitute(self._forward, x)

    def backward(self, x: Real) -> None:
        """x <- L^-T x in the order of elimination, shape (3 k,) or (c, 3 k)."""
        self._substitute(self._backward, x)

    def _substitute(self, kernel: Callable[..., Any], x: Real) -> None:
        count = len(x) if x.ndim == 2 else 1
        if len(self._work) < count * self._widest:
            self._work = np.empty(count * self._widest, dtype=self.dtype)
        kernel(len(self.heads), *self._columns, count, x.shape[-1], x, self._work)

    def solve(self, rhs: FloatArray) -> FloatArray:
        """K^-1 rhs, shapes (n, 3), in this precision."""
        return self.substituted(*self.eliminated(rhs))

    def eliminated(self, rhs: FloatArray) -> tuple[Real, FloatArray]:
        """L^-1 rhs (..., n, 3) in the order of elimination, shape (..., 3 k), over numbers, and these (..., 1)."""
        size = np.max(np.abs(rhs), axis=(-2, -1), initial=0.0)[..., None]  # single precision has a small range
        size = np.where(size > 0.0, size, 1.0)
        ordered = (rhs[..., self.order, :] / size[..., None]).astype(self.dtype, order="C")
        x = ordered.reshape(*rhs.shape[:-2], -1)
        self.forward(x)
        return x, size

    def substituted(self, x: Real, size: FloatArray) -> FloatArray:
        """L^-T x, shape (..., n, 3), times numbers (..., 1); x (..., 3 k) is overwritten."""
        self.backward(x)
        solution = np.empty((*x.shape[:-1], len(self.order), 3))
        solution[..., self.order, :] = x.reshape(solution.shape)
        solution *= size[..., None]
        return solution


class Stacks:
    """Memory for the update matrices of the fronts.

    When a front is assembled, the update matrices of its children are the latest ones at depths of their parity.  So
    fronts of even and of odd depth have a stack each.
    """

    def __init__(self, fronts: list[Front], dtype: npt.DTypeLike):
        self._side, height = stack_heights(fronts)
        self._width = [3 * len(front.border) for front in fronts]
        self._top = [0, 0]
        self._memory = [np.empty(size, dtype=dtype) for size in height]

    def push(self, number: int) -> Real:
        """A square for the border of a front, in Fortran order; its content is undefined."""
        side, width = self._side[number], self._width[number]
        square = self._memory[side][self._top[side] : self._top[side] + width**2]
        self._top[side] += width**2
        return square.reshape((width, width), order="F")

    def pop(self, number: int) -> None:
        """Release the square that was pushed last on the side of this front."""
        self._top[self._side[number]] -= self._width[number] ** 2


def stack_heights(fronts: list[Front]) -> tuple[list[int], tuple[int, int]]:
    """The stack of every front, 0 or 1, and the numbers that each stack has to hold."""
    depth = [0] * len(fronts)
    for number in reversed(range(len(fronts))):
        for child in fronts[number].children:
            depth[child] = depth[number] + 1
    side = [d % 2 for d in depth]
    last = {front.children[0] for front in fronts if _is_update_of_child(fronts, front)}
    sizes = [0 if number in last else (3 * len(front.border)) ** 2 for number, front in enumerate(fronts)]
    top, height = [0, 0], [0, 0]
    for number, front in enumerate(fronts):
        top[side[number]] += sizes[number]
        height[side[number]] = max(height[side[number]], top[side[number]])
        for child in front.children:
            top[1 - side[number]] -= sizes[child]
    return side, (height[0], height[1])


def _is_update_of_child(fronts: list[Front], front: Front) -> bool:
    """Whether a front is the last of a body, and the update matrix of its only child is all of it."""
    return front.root and len(front.children) == 1 and len(fronts[front.children[0]].border) == len(front.own)
