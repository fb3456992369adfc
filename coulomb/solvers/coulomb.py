"""The Coulomb problem on the contact nodes: a Tresca problem whose slip bound is F times its own normal forces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import FloatArray
from ..linalg.compliance import Compliance
from ..linalg.reductions import Reductions
from .results import Accept, CoulombResult, ProgressCallback
from .tresca import TrescaQP


@dataclass(frozen=True)
class CoulombProblem:
    """The Tresca problem whose slip bound is friction times its own normal forces.

    Attributes:
        A: Compliance, in metres per newton.
        b: Free gap closure in metres, this rank's part, shape (3 m,), node by node (n, t1, t2).
        friction: Coefficient F >= 0 at every contact node, shape (m,).
        accept: The certificate that an answer must pass besides; None where the residual alone decides.

    Raises:
        ValueError: On every rank, if the shape does not fit or a coefficient is negative or not finite on any rank.
    """

    A: Compliance
    b: FloatArray
    friction: FloatArray
    accept: Accept | None = None

    def __post_init__(self) -> None:
        over = self.reductions
        if not over.all(self.friction.shape == (self.A.nodes,)):
            raise ValueError(f"friction must have shape ({self.A.nodes},), but has {self.friction.shape}")
        if not over.all(bool(np.all(np.isfinite(self.friction) & (self.friction >= 0.0)))):
            raise ValueError("friction has entries that are negative or not finite")

    @cached_property
    def reductions(self) -> Reductions:
        return Reductions(self.A.comm)

    @cached_property
    def mean_diagonal(self) -> float:
        """Mean of diag(A) in metres per newton."""
        return self.tresca(np.zeros_like(self.friction)).mean_diagonal

    def slip_bound(self, x: FloatArray) -> FloatArray:
        """F x_n in newtons, shape (m,)."""
        bound: FloatArray = self.friction * np.maximum(x[0::3], 0.0)
        return bound

    def tresca(self, slip_bound: FloatArray) -> TrescaQP:
        """The Tresca problem with these slip bounds in newtons, shape (m,)."""
        return TrescaQP(self.A, self.b, slip_bound)

    def residual(self, x: FloatArray, gradient: FloatArray | None = None) -> float:
        """Coulomb residual: the natural residual of the Tresca problem with g = F x_n, at x; 0 exactly at a solution.

        Args:
            x: Contact forces in newtons, shape (3 m,).
            gradient: A x - b where it is known already; else it is computed, with one product.
        """
        return self.tresca(self.slip_bound(x)).residual(x, gradient)


class CoulombSolver(Protocol):
    """Anything that solves a Coulomb problem.

    `solve` raises NotConverged, carrying the result, if the Coulomb residual stays above the tolerance.
    """

    @property
    def tolerance(self) -> float: ...

    def solve(
        self,
        problem: CoulombProblem,
        *,
        start: FloatArray | None = None,
        progress: ProgressCallback | None = None,
    ) -> CoulombResult: ...
