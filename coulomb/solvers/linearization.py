"""The nodal part of a Newton system of path following, and its inverse.

At a node, with y = x_t/r inside the unit disc, h = nu2/r, slope F = dr/dx_n, k = F (1 + |y|^2)/2 and D22 = z/nu,

    [J11   J12 ] [dx ]   [r1]     J11 = A + C,  C dx = (0, h (dx_t - F y dx_n))
    [J21  -D22 ] [dnu] = [r2]     J12 dnu = (-dnu1, y dnu2),  J21 dx = (-dx_n, y dx_t - k dx_n)

J21 is the derivative of the constraints -z.  Without slope C is diag(0, h, h), J12 the transpose of J21, and the system
the paper's J_AM; with the multipliers eliminated, A + C + J12 D22^-1 J21 is J_SC.  With slope it is unsymmetric due to
the two terms of dx_n in the tangential rows, -h F y and -y k/D22_2; no tangential unknown acts on the normal row.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, squares


@dataclass(frozen=True, eq=False)
class Linearization:
    """The nodal numbers of a Newton system.

    Attributes:
        slope: F = dr/dx_n, shape (m,).
        r: Bound of friction, shape (m,); 1 where there is no friction.
        h: nu2/r, shape (m,); 0 without friction.
        y: x_t/r, shape (m, 2).
        D22: z/nu, shape (m, 2); 1 where there is no constraint.
        frictional: Nodes with friction, shape (m,); the others have no tangential unknowns.
    """

    slope: FloatArray
    r: FloatArray
    h: FloatArray
    y: FloatArray
    D22: FloatArray
    frictional: npt.NDArray[np.bool_]

    @cached_property
    def k(self) -> FloatArray:
        """F (1 + |y|^2)/2, how fast the slack of the disc grows with x_n, shape (m,)."""
        return 0.5 * self.slope * (1.0 + squares(self.y))

    @cached_property
    def _disc(self) -> FloatArray:
        """Derivative of -z2 along dx_n, dx_t1, dx_t2, shape (m, 3); 0 without friction."""
        return np.column_stack([-self.k, self.y[:, 0], self.y[:, 1]]) * self.frictional[:, None]

    @cached_property
    def _C(self) -> FloatArray:
        """The last two rows of the nodal part of J11 along dx_n, as that along dx_t is h, shape (m, 2)."""
        return -(self.h * self.slope)[:, None] * self.y

    def C(self, dx: FloatArray) -> FloatArray:
        """The nodal part of J11 on dx (m, 3)."""
        forces = np.zeros_like(dx)
        forces[:, 1:] = self.h[:, None] * dx[:, 1:] + self._C * dx[:, :1]
        return forces

    def J21(self, dx: FloatArray) -> FloatArray:
        """Derivative of -z along dx (m, 3, ...), shape (m, 2, ...)."""
        change = np.empty((len(dx), 2, *dx.shape[2:]))
        change[:, 0] = -dx[:, 0]
        change[:, 1] = np.einsum("ij,ij...->i...", self._disc, dx)
        return change

    def J12(self, dnu: FloatArray) -> FloatArray:
        """Force balance of the multipliers dnu (m, 2), shape (m, 3)."""
        forces = np.empty((len(dnu), 3))
        forces[:, 0] = -dnu[:, 0]
        forces[:, 1:] = self.y * dnu[:, 1:]
        return forces

    def schur(self, dx: FloatArray) -> FloatArray:
        """(C + J12 D22^-1 J21) dx, what J_SC adds to A dx, shape (m, 3)."""
        return self.C(dx) + self.J12(self.J21(dx) / self.D22)

    def multipliers(self, dx: FloatArray, r2: FloatArray) -> FloatArray:
        """dnu of dx (m, 3), eliminated from the second row of the system, shape (m, 2)."""
        return (self.J21(dx) - r2) / self.D22

    def dy(self, dx: FloatArray) -> FloatArray:
        """Change of y to first order, (dx_t - F y dx_n)/r, shape (m, 2)."""
        dy = (dx[:, 1:] - (self.slope * dx[:, 0])[:, None] * self.y) / self.r[:, None]
        return np.where(self.frictional[:, None], dy, 0.0)


class NodalInverse:
    """(diag(D) + C + J12 D22^-1 J21)^-1, node by node: the normal unknown first, then the pair that follows it.

    The pair's block is that of the disc; its coupling to the normal unknown, h F y + y k/D22_2, is kept separate to
    avoid cancellation as D22 -> 0.  D (m, 3) is positive, or 0 where C is regular, as in a zero row of A.
    """

    def __init__(self, nodal: Linearization, D: FloatArray):
        self._at, self._normal = nodal, D[:, :1]
        self._pair = np.where(nodal.frictional[:, None], D[:, 1:] + nodal.h[:, None], 1.0)
        self._S = nodal.D22[:, 1:] + np.sum(nodal.y**2 / self._pair, axis=1)[:, None]
        self._drag, self._widen = (nodal.h * nodal.slope)[:, None] * nodal.y, (nodal.k * nodal.frictional)[:, None]

    def __call__(self, r: FloatArray) -> FloatArray:
        """The inverse applied to r (m, 3, ...)."""
        z = self.uncoupled(r)
        return z + self.follow(z[:, :1])

    def uncoupled(self, r: FloatArray) -> FloatArray:
        """The inverse without the coupling of the pair to the normal unknown: symmetric."""
        nodal, D22 = self._at, like(self._at.D22, r)
        z = np.empty_like(r)
        z[:, 0] = r[:, 0] * D22[:, 0] / (1.0 + like(self._normal, r)[:, 0] * D22[:, 0])
        z[:, 1:] = disc_inverse(like(self._pair, r), like(nodal.y, r), D22[:, 1:], like(self._S, r), r[:, 1:])
        z[~nodal.frictional, 1:] = 0.0
        return z

    def follow(self, dx_n: FloatArray) -> FloatArray:
        """Contribution of dx_n (m, 1, ...) to dx_t, shape (m, 3, ...)."""
        nodal, pair, S = self._at, like(self._pair, dx_n), like(self._S, dx_n)
        y, D22 = like(nodal.y, dx_n), like(nodal.D22, dx_n)
        dx_t = disc_inverse(pair, y, D22[:, 1:], S, like(self._drag, dx_n) * dx_n)
        dx_t += y / pair * (like(self._widen, dx_n) * dx_n / S)
        dx_t[~nodal.frictional] = 0.0
        return np.concatenate([np.zeros_like(dx_n), dx_t], axis=1)


def like(values: FloatArray, r: FloatArray) -> FloatArray:
    """Nodal numbers (m, k), shaped to work on many right-hand sides (m, k, ...)."""
    return values.reshape(values.shape + (1,) * (r.ndim - 2))


def disc_inverse(D: FloatArray, y: FloatArray, d22: FloatArray, S: FloatArray, r: FloatArray) -> FloatArray:
    """(D + y y^T / d22)^-1 r on the tangential pairs, (m, 2, ...), with S = d22 + y^T D^-1 y.

    Sherman and Morrison's D^-1 - D^-1 y y^T D^-1 / S, with the difference expanded to avoid cancellation as
    d22 -> 0: (d22 D^-1 + w w^T / det D) / S, where w = (-y2, y1).
    """
    w = np.empty_like(y)
    w[:, 0], w[:, 1] = -y[:, 1], y[:, 0]
    along = (w[:, :1] * r[:, :1] + w[:, 1:] * r[:, 1:]) / (D[:, :1] * D[:, 1:])
    return (d22 * r / D + along * w) / S
