"""Nonsmooth Gauss-Seidel sweeps in C (native/gauss_seidel.c), for the problems on which they are the quickest method.

M. Jean, J. J. Moreau: Unilaterality and dry friction in the dynamics of rigid body collections (1992).  A sweep costs
little and many problems of few contacts need few of them; on stacks and towers the rate is near 1.  So their number is
limited: a fifth of the work of the other methods is spent in any case, and more as long as less than that work is left,
at the trend of the residual (native/trend.h).

Slow modes of contacts that keep their states are left out by Anderson's mixing (native/mixing.h): after every 16 sweeps
the forces are combined with those after the eight blocks before.  Not where the work is given: those are problems whose
contacts change their states again and again.

Where a problem has few contacts nearly all time would go into checks of the arguments and of the answer.  The kernel
does these as well, and `sweep` takes arrays as the user gives them: where anything is unusual the answer is None, and
the checks in Python find out what it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...arrays import FloatArray
from ...native import kernels
from ..results import Goal, SolverResult, Status

_FLOAT, _INT, _LARGEST = np.dtype(np.float64), np.dtype(np.int32), np.iinfo(np.int32).max


class Sweeps(NamedTuple):
    """What the sweeps have reached.

    Attributes:
        residual: The larger of the cone and the natural residual, computed afresh from A as given.
        made: Number of sweeps.
        x: Forces in newtons, shape (3 m,).
        gradient: A x - b in metres, shape (3 m,), computed afresh.
        slip_bound: F x_n in newtons, shape (m,).
        multipliers: max(w_n, 0) and |w_t| in metres, shape (m, 2).
    """

    residual: float
    made: int
    x: FloatArray
    gradient: FloatArray
    slip_bound: FloatArray
    multipliers: FloatArray

    def result(self, method: str, goal: Goal) -> SolverResult:
        """As the result of a method."""
        return SolverResult(
            x=self.x,
            gradient=self.gradient,
            slip_bound=self.slip_bound,
            multipliers=self.multipliers,
            status=goal.verdict(self.residual, self.x, Status.STAGNATED),
            products=self.made,
            residual=self.residual,
            method=method,
        )


def sweep(
    A: Any, b: FloatArray, friction: FloatArray | float, tolerance: float, start: Any = None, work: float = 0.0
) -> Sweeps | None:
    """Forces by sweeps, as long as they promise to be quicker than other methods, or until some work is spent.

    Args:
        A: Compliance, shape (3 m, 3 m), in metres per newton: scipy's compressed rows, or an array.
        b: Free gap closure in metres, shape (3 m,).
        friction: Coefficients, shape (m,), or one number.
        tolerance: Residual at which to stop, the larger of cone and natural residual.
        start: Forces in newtons, shape (3 m,); 0 if None.
        work: Contacts and blocks that change, in microseconds; 0 for as many as promise to be quicker.

    Returns:
        None where any argument is not valid or not suitable: types, shapes, numbers that are
        not finite, an asymmetric A, one with a diagonal entry that is not positive, or negative friction.
    """
    if b.ndim != 1 or not b.flags.c_contiguous or b.dtype != _FLOAT:
        return None
    n = len(b)
    m = n // 3
    if A.shape != (n, n) or n == 0 or 3 * m != n:
        return None
    if isinstance(A, np.ndarray):
        if A.dtype != _FLOAT or not A.flags.aligned or A.strides[0] % 8 or A.strides[1] % 8:
            return None
        entries, indptr, indices, data = n * n, None, None, A
        strides = A.strides[0] // 8, A.strides[1] // 8
    else:
        pointers, columns, values = A.indptr, A.indices, A.data
        if pointers.dtype != _INT or columns.dtype != _INT:
            if max(len(values), columns.max(initial=0)) > _LARGEST:
                return None
            pointers, columns = pointers.astype(_INT), columns.astype(_INT)
        if values.dtype != _FLOAT or len(pointers) != n + 1:
            return None
        if not (values.flags.c_contiguous and columns.flags.c_contiguous and pointers.flags.c_contiguous):
            return None
        entries, strides = min(len(values), len(columns)), (0, 0)
        indptr, indices, data = pointers, columns, values
    number, coefficients = 0.0, None
    if isinstance(friction, np.ndarray):
        if friction.shape != (m,) or friction.dtype != _FLOAT or not friction.flags.c_contiguous:
            return None
        coefficients = friction
    else:
        number = friction
    out = np.empty(2 + 9 * m)
    made = kernels().gauss_seidel(
        m, entries, indptr, indices, data, *strides, b, coefficients, number, start, tolerance, work, out
    )
    if made < 0:
        return None
    x, w, last = out[2 : 2 + n], out[2 + n : 2 + 2 * n], 2 + 2 * n + m
    return Sweeps(float(out[1]), made, x, w, out[2 + 2 * n : last], out[last:].reshape(m, 2))
