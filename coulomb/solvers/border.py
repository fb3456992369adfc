"""Contact points on the border of two states, where an answer has one derivative as a parameter grows and another as it
falls.

Along a direction, forces x + t dx and w + t dw satisfy the equations of contact for small t > 0 if (dx, dw) satisfy
their directional derivative, which at such points is piecewise smooth (L. Qi, J. Sun: A nonsmooth version of Newton's
method, Math. Program. 58, 1993).  With dp = dx - dw/d, and dr the change of the bound of friction,

    at a point that closes without a force     dx_n = max(dp_n, 0)
    that sticks at its bound, e = p_t/|p_t|    dx_t = dp_t where e.dp_t <= dr, else dp_t - e (e.dp_t - dr)
    that closes, where the bound is 0 there    dx_t = dr e where it has slipped, else
                                               dx_t = dp_t where |dp_t| <= dr, else dr dp_t/|dp_t|

A semismooth Newton iteration finds which hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from .contact_equations import ContactDerivative, ContactEquations


@dataclass(frozen=True, eq=False)
class Border:
    """The points on a border at forces x with w = A x - b; this rank's part.

    Attributes:
        equations: The equations of contact, with any d,
        at: and their derivative at the answer, in which each of the points is in one of its states.
        closing: Points that close without a force, shape (m,).
        turning: That stick at their bound, shape (m,).
        directions: The directions e of friction there, shape (m, 2).
        landing: Frictional points of `closing` whose bound is 0, and that have slipped, shape (m,),
        without_bound: or not, shape (m,).
        slope: dr/dx_n, shape (m,).
    """

    equations: ContactEquations
    at: ContactDerivative
    closing: npt.NDArray[np.bool_]
    turning: npt.NDArray[np.bool_]
    directions: FloatArray
    landing: npt.NDArray[np.bool_]
    without_bound: npt.NDArray[np.bool_]
    slope: FloatArray

    @classmethod
    def found(
        cls, equations: ContactEquations, derivative: ContactDerivative, x: FloatArray, w: FloatArray, least: FloatArray
    ) -> Border:
        """Where forces and bounds are apart by no more than `least` (m,), newtons; x and w as in the equations."""
        p_n, p = equations.pressed(x, w)
        p_n -= equations.lower
        bound, length = equations.law.radius(x[:, 0]), np.hypot(p[:, 0], p[:, 1])
        closing = np.abs(p_n) <= least
        frictional, bounded = equations.frictional & (closing | (p_n > 0.0)), bound > least
        turning = frictional & bounded & (np.abs(length - bound) <= least)
        bare, slope = frictional & closing & ~bounded, equations.law.slope(np.maximum(x[:, 0], 0.0))
        slipped = length > least
        return cls(equations, derivative, closing, turning, _over(p, length), bare & slipped, bare & ~slipped, slope)

    @property
    def points(self) -> npt.NDArray[np.bool_]:
        """Shape (m,)."""
        return self.closing | self.turning

    @property
    def rubbing(self) -> npt.NDArray[np.bool_]:
        """Those whose friction is not decided, shape (m,)."""
        return self.turning | self.landing | self.without_bound

    def along(self, dx: FloatArray, dw: FloatArray, bound: FloatArray) -> tuple[ContactDerivative, FloatArray]:
        """The derivative of the equations along a direction with dx, dw (m, 3) and a change of the bound (m,), and by
        what that change acts in the equations of friction, newtons, shape (m, 2)."""
        P, Q, status = self.at.P.copy(), self.at.Q.copy(), self.at.status.copy()
        dp_n, dp = self.equations.pressed(dx, dw)
        length, dr = np.hypot(dp[:, 0], dp[:, 1]), self.slope * dx[:, 0] + bound
        here = self.closing
        P[here, 0, 0] = np.where(dp_n > 0.0, 0.0, 1.0)[here]
        Q[here, 0, 0] = np.where(dp_n > 0.0, 1.0 / self.equations.d_n, 0.0)[here]
        status[here] = np.where(dp_n > 0.0, np.maximum(status, 1), 0)[here]

        here, bare = self.rubbing, self.without_bound
        e = np.where(bare[:, None], _over(dp, length), self.directions)
        slips = here & ((np.where(bare, length, np.einsum("ka,ka->k", e, dp)) > dr) | self.landing)
        part = np.where(bare, np.maximum(dr, 0.0) / np.where(length > 0.0, length, 1.0), 1.0)
        part[self.landing] = 0.0
        e[~slips] = 0.0
        T = np.where(slips, part, 1.0)[:, None, None] * (np.eye(2) - e[:, :, None] * e[:, None, :])
        P[here, 1:, 1:], Q[here, 1:, 1:] = (np.eye(2) - T)[here], (self.equations.rho_t[:, None, None] * T)[here]
        P[here, 1:, 0] = -(self.slope[:, None] * e)[here]
        status[here] = np.where(slips, 2, status)[here]
        return ContactDerivative(np.zeros_like(dx), P, Q, status), e * np.where(slips, bound, 0.0)[:, None]

    def chosen(self, firm: bool) -> tuple[ContactDerivative, FloatArray]:
        """The derivative of the equations with all of these points closed, and sticking where they may (`firm`), or all
        open, and slipping where they are closed; and the directions of friction of those that slip, 0 of others, shape
        (m, 2)."""
        P, Q, status = self.at.P.copy(), self.at.Q.copy(), self.at.status.copy()
        here = self.closing
        P[here, 0, 0], Q[here, 0, 0] = 0.0 if firm else 1.0, 1.0 / self.equations.d_n[here] if firm else 0.0
        status[here] = np.maximum(status[here], 1) if firm else 0
        here, slips = self.rubbing, self.rubbing & (self.landing | (not firm))
        e = np.where((slips & ~self.without_bound)[:, None], self.directions, 0.0)
        part = np.where(slips & ~self.turning, 0.0, 1.0)
        T = part[:, None, None] * (np.eye(2) - e[:, :, None] * e[:, None, :])
        P[here, 1:, 1:], Q[here, 1:, 1:] = (np.eye(2) - T)[here], (self.equations.rho_t[:, None, None] * T)[here]
        P[here, 1:, 0] = -(self.slope[:, None] * e)[here]
        status[here] = np.where(slips, 2, status)[here]
        return ContactDerivative(np.zeros_like(self.at.value), P, Q, status), e


def _over(vectors: FloatArray, length: FloatArray) -> FloatArray:
    """Vectors (m, 2) over their lengths (m,), 0 where these are 0."""
    return vectors / np.where(length > 0.0, length, 1.0)[:, None]
