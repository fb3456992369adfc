"""The Tresca problem: contact with given slip bounds, a convex quadratic programme."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arrays import FloatArray
from ..linalg.compliance import Compliance
from ..linalg.reductions import Reductions
from .results import Accept, ProgressCallback, QPResult


@dataclass(frozen=True)
class TrescaQP:
    """min 1/2 x^T A x - b^T x  subject to  x_n >= lower,  |x_t| <= slip_bound  at every contact node.

    Attributes:
        A: Compliance, in metres per newton, symmetric positive (semi)definite.
        b: Free gap closure in metres, this rank's part, shape (3 m,), node by node (n, t1, t2).
        slip_bound: Radius g >= 0 of the friction discs in newtons, shape (m,).
        lower: Lower bound of the normal forces in newtons, a number or shape (m,); 0 for plain contact.
        accept: The certificate that an answer must pass besides; None where the residual alone decides.

    Raises:
        ValueError: On every rank, if shapes do not fit or a value is not finite or a slip bound negative on any rank.
    """

    A: Compliance
    b: FloatArray
    slip_bound: FloatArray
    lower: float | FloatArray = 0.0
    accept: Accept | None = None

    def __post_init__(self) -> None:
        m, over = self.A.nodes, self.reductions
        if not over.all(self.b.shape == (3 * m,)):
            raise ValueError(f"b must have shape ({3 * m},), three entries a contact node, but has {self.b.shape}")
        if not over.all(self.slip_bound.shape == (m,)):
            raise ValueError(f"slip_bound must have shape ({m},), one a contact node, but has {self.slip_bound.shape}")
        if not over.all(np.shape(self.lower) in ((), (m,))):
            raise ValueError(f"lower must be a number or have shape ({m},), but has {np.shape(self.lower)}")
        for name, values in (("b", self.b), ("slip_bound", self.slip_bound), ("lower", np.asarray(self.lower))):
            if not over.all(bool(np.all(np.isfinite(values)))):
                raise ValueError(f"{name} has entries that are not finite")
        if not over.all(bool(np.all(self.slip_bound >= 0.0))):
            raise ValueError("slip_bound has negative entries; a friction disc has a radius >= 0")

    @cached_property
    def reductions(self) -> Reductions:
        return Reductions(self.A.comm)

    @cached_property
    def mean_diagonal(self) -> float:
        """Mean of diag(A) in metres per newton: the scale that turns a gap into a force."""
        d = self.A.diagonal()
        return self.reductions.sum(d) / self.reductions.sum(float(d.size))

    def gradient(self, x: FloatArray) -> FloatArray:
        """A x - b in metres, shape (3 m,); one product by A."""
        y = np.empty_like(x)
        self.A.mult(x, y)
        return y - self.b

    def objective(self, x: FloatArray) -> float:
        """1/2 x^T A x - b^T x in joules; one product by A."""
        return 0.5 * (self.reductions.dot(x, self.gradient(x)) - self.reductions.dot(x, self.b))

    def project(self, x: FloatArray) -> FloatArray:
        """The feasible point nearest to x, node by node: normal force onto its bound, friction onto its disc."""
        return project(x, self.slip_bound, self.lower)

    def residual(self, x: FloatArray, gradient: FloatArray | None = None) -> float:
        """Natural residual, relative and scaled: 0 exactly at the solution.

        Args:
            x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
            gradient: A x - b where it is known already; else it is computed, with one product.

        Returns:
            `natural_residual` with the mean diagonal of A.
        """
        if gradient is None:
            gradient = self.gradient(x)
        return natural_residual(x, gradient, self.slip_bound, self.mean_diagonal, self.reductions, self.lower)


def project(x: FloatArray, slip_bound: FloatArray, lower: float | FloatArray = 0.0) -> FloatArray:
    """The point nearest to x (3 m,) with x_n >= lower and |x_t| <= slip_bound, node by node."""
    v = x.reshape(-1, 3)
    p = np.empty_like(v)
    p[:, 0] = np.maximum(v[:, 0], lower)
    size = np.hypot(v[:, 1], v[:, 2])
    inside = size <= slip_bound
    shrink = np.where(inside, 1.0, slip_bound / np.where(inside, 1.0, size))
    p[:, 1:] = v[:, 1:] * shrink[:, None]
    return p.ravel()


def natural_residual(
    x: FloatArray,
    gradient: FloatArray,
    slip_bound: FloatArray,
    compliance: float,
    over: Reductions,
    lower: float | FloatArray = 0.0,
) -> float:
    """|x - P(x - (A x - b)/a)| / |x| (ALGORITHMS.md, section 1); inf for x = 0 where that is no solution.

    Args:
        x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
        gradient: A x - b in metres, shape (3 m,).
        slip_bound: Radius of the friction discs in newtons, shape (m,).
        compliance: a, metres per newton.
        over: Reductions over the ranks.
        lower: Lower bound of the normal forces in newtons.
    """
    distance = over.norm(x - project(x - gradient / compliance, slip_bound, lower))
    size = over.norm(x)
    if size > 0.0:
        return distance / size
    return 0.0 if distance == 0.0 else math.inf


class QPSolver(Protocol):
    """Anything that solves a Tresca problem.

    `solve` raises NotConverged, carrying the result, if the residual of the QP stays above the tolerance.
    """

    @property
    def tolerance(self) -> float: ...

    def solve(
        self,
        qp: TrescaQP,
        start: QPResult | None = None,
        *,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> QPResult: ...
