"""A in the variables of a scaled problem, and A x of the iterates of a path."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..linalg.compliance import Compliance, Formed, RecycledColumns
from ..linalg.reductions import Reductions, summed

_LEAST_WEIGHT = 1e-3
"""Weights below this make columns inaccurate that were found with others."""


class ScaledCompliance:
    """A~ = W A W / a for forces x = s W x~: the interface of A for Newton systems.  Arrays are (m, 3).

    Args:
        A: The compliance.
        W: Weights.
        a: Its scale, metres per newton.
        s: The scale of forces, newtons.
        G: G~^T, the displacements of the nodes under rigid motions, shape (m, 3, r); None if there are none.

    Attributes:
        diagonal: diag(A~).
        rest: diag(A~), where products are inexact without the few large eigenvalues that the estimate of it has found.
        G: G~^T, shape (m, 3, r), r = 0 without rigid motions.
        rigid: Columns F~ of a part F~ F~^T of A~ that is known exactly (`MatrixFreeCompliance.rigid`), shape (3 m, q).
        recalls: Whether Newton systems begin with the columns of A that earlier problems have found.
    """

    def __init__(self, A: Compliance, W: FloatArray, a: float, s: float, G: FloatArray | None = None):
        self.A, self.W, self.a, self.s = A, W, a, s
        self.comm, self.nodes = A.comm, A.nodes
        self.diagonal: FloatArray = W**2 * A.diagonal().reshape(-1, 3) / a
        free = A.matrix_free
        rest = A.diagonal() if free is None or A.exact else free.rest_of_diagonal
        self.rest: FloatArray = W**2 * rest.reshape(-1, 3) / a
        self.G: FloatArray = np.empty((*W.shape, 0)) if G is None else G
        F = None if free is None else free.rigid
        self.rigid: FloatArray = np.empty((W.size, 0)) if F is None else W.reshape(-1, 1) * F / np.sqrt(a)
        self.recalls = False

    def mult(self, x: FloatArray, tolerance: float = 0.0) -> FloatArray:
        """A~ x, to a relative accuracy; one product."""
        y = np.empty(self.W.size)
        self.A.mult((self.W * x).ravel(), y, tolerance)
        return self.W * y.reshape(-1, 3) / self.a

    def mult_incremental(self, x: FloatArray, tolerance: float = 0.0) -> FloatArray:
        """A~ x of the next iterate, its change to a relative accuracy; one product."""
        y = np.empty(self.W.size)
        self.A.mult_incremental(self.forces(x), y, tolerance)
        return self.image(y)

    def dense(self) -> FloatArray:
        """A~ as an array, shape (3 m, 3 m), on one rank: as A has it, or by 3 m products."""
        A, W = self.A, self.W.ravel()
        if isinstance(A, Formed):
            return W[:, None] * A.dense() * W / self.a
        return np.array([self.mult(e.reshape(-1, 3)).ravel() for e in np.eye(W.size)]).T

    def resultant(self, x: FloatArray) -> FloatArray:
        """G~ x of all ranks, shape (r,); collective."""
        return summed(self.comm, np.einsum("iaq,ia->q", self.G, x))

    def forces(self, x: FloatArray) -> FloatArray:
        """s W x in newtons, shape (3 m,)."""
        return (self.s * self.W * x).ravel()

    def known(self) -> RecycledColumns | None:
        """The columns that earlier problems with this A have found, scaled; None if there are none, or if the weights
        are too far apart; collective if there are any."""
        learnt = self.A.learnt
        if not self.recalls or learnt.X is None or learnt.U is None:
            return None
        if Reductions(self.comm).min(self.W) < _LEAST_WEIGHT:
            return None
        scaled, root, W = RecycledColumns(), np.sqrt(self.a), self.W.reshape(-1, 1)
        scaled.keep(root * learnt.X / W, W * learnt.U / root, learnt.part)
        return scaled

    def keep(self, found: RecycledColumns, prepared: object | None = None) -> None:
        """Keep the columns found by a Newton system, scaled, for problems to come; and what was `prepared` of them, in
        the variables of this problem."""
        if found.X is not None and found.U is not None:
            root, W = np.sqrt(self.a), self.W.reshape(-1, 1)
            self.A.learnt.keep(W * found.X / root, root * found.U / W, found.part, prepared)

    def image(self, displacement: FloatArray) -> FloatArray:
        """Displacements A x in metres (3 m,), as A~ x~."""
        return self.W * displacement.reshape(-1, 3) / (self.a * self.s)


_SHARPEST = 1e-5
"""Smallest factor of the accuracy of products: below it the accuracy of the solves with K decides."""


class IterateProducts:
    """A x of the iterates, one product each, the next from the one before.

    Args:
        A: The scaled compliance.

    Attributes:
        sharper: Factor of the accuracy of inexact products, 1 at first.
    """

    def __init__(self, A: ScaledCompliance):
        self._scaled, self.sharper = A, 1.0

    def first(self, x: FloatArray, tolerance: float) -> FloatArray:
        """A x of the first iterate x (m, 3), to a relative accuracy."""
        return self._scaled.mult_incremental(x, tolerance)

    def advance(self, x: FloatArray, predicted: FloatArray | None, alpha: float, tolerance: float) -> FloatArray:
        """A x of the next iterate x (m, 3), alpha along the last step.

        Args:
            x: Shape (m, 3).
            predicted: A x + alpha A dx for a straight step: sufficient if products are exact.
            alpha: Step length.
            tolerance: Accuracy of a product relative to the change.
        """
        if predicted is not None and self._scaled.A.exact:
            return predicted
        return self._scaled.mult_incremental(x, self.sharper * tolerance)

    def exact(self, x: FloatArray) -> FloatArray:
        """The most accurate A x, shape (m, 3), for the final residual."""
        return self._scaled.mult_incremental(x)

    def corrected(self, A_x: FloatArray, exact: FloatArray) -> FloatArray:
        """A x (m, 3) of the present iterate with which to continue, once the exact one is known."""
        return exact

    def tighten(self) -> None:
        """Make inexact products ten times as accurate from now on."""
        self.sharper = max(0.1 * self.sharper, _SHARPEST)
