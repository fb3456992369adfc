"""An interior-point path for Coulomb's law in second-order cones, for a compliance without full rank.

    Z = W X + q + |Z_t| e,   X o Z = theta e,   X and Z inside L (cone_problem.py), theta to 0

X o Z is linearised with the scaling of Nesterov and Todd: with dZ = P c - P^2 dX,

    (W + E P^2) dX = E P c + F,   E = 1 - e (0, Z_t)^T/|Z_t|,   F = Z - W X - q - |Z_t| e

which is regular in the cone even where W is not: P^2 is positive definite, and at a contact that sticks or slips it is
small only along forces that W leaves undetermined.  Steps have Mehrotra's predictor and corrector.

|Z_t| is not differentiable at Z_t = 0, the sticking contacts, and the problem is not a minimisation: steps of the
linearisation may be blocked.  After such a step the next ones keep |Z_t| (E = 1), a step of the convex problem with
given slip; Z stays inside L, and |Z_t| is updated after each step.  With the slip |Z_t| given for good it is the
convex problem of V. Acary, F. Cadoux, C. Lemarechal, J. Malick: A formulation of the linear discrete Coulomb friction
problem via convex optimization, ZAMM 91 (2011), whose slip is unique although the forces are not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import FloatArray
from .cone_problem import ConeProblem
from .cones import determinant, product, quotient, radius, scaling, step_to_boundary, times

_TO_BOUNDARY = 0.99  # largest fraction of the distance to the boundary
_CENTRED = 1e-2  # smallest sqrt(det X det Z) over theta
_BLOCKED = 0.1  # a step shorter than this is blocked
_KEPT = 3  # steps with the slip kept after it, and more as long as they are blocked
_FEASIBLE = 0.3  # with the slip kept, theta decreases where F is below this fraction of it ...
_CENTRING = 0.3  # ... by this factor
_LEAST = 0.05  # least centring; of the convex problem
_LEAST_CONVEX = 1e-3


class ConeStep(NamedTuple):
    """A point of the path and how it was reached.

    Attributes:
        X: Shape (m, 3), inside L.
        Z: Shape (m, 3), inside L.
        theta: X.Z / m.
        infeasibility: Root mean square of F.
        sigma: Centring of the step.
        alpha: Its length; 0 at the start.
    """

    X: FloatArray
    Z: FloatArray
    theta: float
    infeasibility: float
    sigma: float = 0.0
    alpha: float = 0.0


class ConePath:
    """The path, step by step.

    Args:
        problem: The problem.
        slip: |Z_t| of the convex problem with given slip, shape (m,); None to find it.
    """

    def __init__(self, problem: ConeProblem, slip: FloatArray | None = None):
        self._problem, self._slip, self._kept = problem, slip, 0
        self._e = np.zeros((problem.contacts, 3))
        self._e[:, 0] = 1.0

    def start(self) -> ConeStep:
        """Equal pressure and gaps."""
        return self._point(self._e.copy(), self._e.copy())

    def _F(self, X: FloatArray, Z: FloatArray) -> FloatArray:
        F = Z - self._problem.w(X)
        F[:, 0] -= radius(Z) if self._slip is None else self._slip
        return F

    def _point(self, X: FloatArray, Z: FloatArray, sigma: float = 0.0, alpha: float = 0.0) -> ConeStep:
        m = self._problem.contacts
        size = float(np.linalg.norm(self._F(X, Z))) / np.sqrt(m)
        return ConeStep(X, Z, float(np.vdot(X, Z)) / m, size, sigma, alpha)

    def step(self, at: ConeStep) -> ConeStep | None:
        """The next point, by one Newton matrix; None if there is none."""
        X, Z, m = at.X, at.Z, self._problem.contacts
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            P = scaling(X, Z)
            keep = self._keeps(at)
            E = np.tile(np.eye(3), (m, 1, 1))
            if not keep:
                slip = radius(Z)
                E[:, 0, 1:] = -Z[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
            if not self._problem.matrix.factorise(E @ P.square):
                return None
            F, square = self._F(X, Z), product(P.point, P.point)

            def direction(right: FloatArray) -> tuple[FloatArray, FloatArray]:
                c = times(P.P, quotient(P.point, right))
                dX = self._problem.matrix.solve(times(E, c) + F)
                return dX, c - times(P.square, dX)

            dX, dZ = direction(-square)
            sigma = self._centring(at, keep, min(1.0, step_to_boundary(X, dX), step_to_boundary(Z, dZ)))
            second = product(times(P.P, dX), times(P.inverse, dZ))
            dX, dZ = direction(sigma * at.theta * self._e - square - second)
            alpha = min(1.0, _TO_BOUNDARY * min(step_to_boundary(X, dX), step_to_boundary(Z, dZ)))
        return self._centred(at, dX, dZ, sigma, alpha)

    def _keeps(self, at: ConeStep) -> bool:
        """Whether this step keeps the slip."""
        if self._slip is not None:
            return True
        blocked = 0.0 < at.alpha < _BLOCKED
        self._kept = max(self._kept - 1, int(blocked)) if self._kept else _KEPT * int(blocked)
        return self._kept > 0

    def _centring(self, at: ConeStep, keep: bool, alpha: float) -> float:
        """sigma, from the length of the predictor; with the slip kept, theta must not decrease faster than F."""
        if self._slip is not None:
            return max((1.0 - alpha) ** 3, _LEAST_CONVEX)
        if keep:
            return _CENTRING if at.infeasibility < _FEASIBLE * at.theta else 1.0
        return max((1.0 - alpha) ** 3, _LEAST)

    def _centred(self, at: ConeStep, dX: FloatArray, dZ: FloatArray, sigma: float, alpha: float) -> ConeStep | None:
        """The longest step that stays near the path."""
        if not np.isfinite(alpha):
            return None
        while alpha > 1e-9:
            X, Z = at.X + alpha * dX, at.Z + alpha * dZ
            product_ = determinant(X) * determinant(Z)
            theta = float(np.vdot(X, Z)) / len(X)
            if float(product_.min()) >= (_CENTRED * theta) ** 2:
                return self._point(X, Z, sigma, alpha)
            alpha *= 0.8
        return None
