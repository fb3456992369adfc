"""A solve with K that ends before its tolerance, or is not begun; and the least residual that it can reach."""

from __future__ import annotations

import sys
from typing import Final

LEAST_RESIDUAL: Final = 2.0 * sys.float_info.epsilon
"""Residual of a solve with K in double precision that is due to rounding errors, relative to |D u| with D = diag(K), in
the norm of D^-1/2."""


class CGNotConverged(RuntimeError):
    """A solve by conjugate gradients ended before its tolerance, on all ranks; the solution has what was reached.

    Residual and tolerance are relative to the right-hand side; `indefinite` if K or the preconditioner is not positive
    definite, to rounding.
    """

    def __init__(self, iterations: int, residual: float, tolerance: float, indefinite: bool):
        self.iterations, self.residual, self.tolerance, self.indefinite = iterations, residual, tolerance, indefinite
        why = "the stiffness matrix or its preconditioner is not positive definite, to rounding: " if indefinite else ""
        super().__init__(
            f"the solution of K u = f by conjugate gradients with multigrid failed: {why}after {iterations} iterations "
            f"|f - K u| is {residual:.1e} |f|, and {tolerance:.1e} |f| is needed"
        )


class TooSlow(RuntimeError):
    """A solve or product was not begun, on all ranks, as those before took all iterations that are allowed.

    It is no `CGNotConverged`: what has been reached is of no use, as another method begins anew.
    """
