"""The conditions of contact with friction as equations that are not smooth, and their derivative at forces x.

With w = A x - b and p = x - w/d, d the diagonal of A (P. Alart, A. Curnier: A mixed formulation for frictional contact
problems prone to Newton like solution methods, Comput. Methods Appl. Mech. Engrg. 92, 1991), at every node

    x_n - max(p_n, lower) = 0,      x_t - min(r/|p_t|, 1) p_t = 0,      r = r(x_n)

They hold exactly at a solution.  With dp = dx - dw/d the derivative is P dx + Q dw, with 3 x 3 matrices per node: a
node is open (dx_n = ..), sticks (dw_t = ..) or slips.  At a slipping node, with e = p_t/|p_t|, the derivative along p_t
is

    T = (r/|p_t|) (1 - beta h e^T),  h = x_t/max(r, |x_t|),  beta = 1/(1 - min(c, 0) min(|x_t|/r, 1)),  c = cos(e, x_t)

in place of h = e, beta = 1 (S. Hueeber, G. Stadler, B. Wohlmuth: A primal-dual active set algorithm for
three-dimensional contact problems with Coulomb friction, SIAM J. Sci. Comput. 30, 2008).  Both agree at a solution.
Away from it h is inside the unit disc, which is what lets full steps converge: with h = e most of the load steps
measured did not converge without shorter steps (semismooth-variants.csv).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .laws import FrictionLaw


@dataclass(frozen=True, eq=False)
class ContactDerivative:
    """The equations and their derivative at one point; this rank's m nodes.

    Attributes:
        value: What the equations leave over, newtons, shape (m, 3).
        P: Derivative along dx, shape (m, 3, 3).
        Q: Derivative along dw, newtons per metre, shape (m, 3, 3).
        status: 0 open, 1 stick, 2 slip, shape (m,); nodes without friction stick where they are closed.
    """

    value: FloatArray
    P: FloatArray
    Q: FloatArray
    status: npt.NDArray[np.int64]

    def apply(self, dx: FloatArray, dw: FloatArray) -> FloatArray:
        """P dx + Q dw, shapes (m, 3)."""
        return np.einsum("iab,ib->ia", self.P, dx) + np.einsum("iab,ib->ia", self.Q, dw)


@dataclass(frozen=True, eq=False)
class ContactEquations:
    """The equations of a problem.

    Attributes:
        law: The law of friction.
        lower: Lower bounds of the normal forces in newtons, shape (m,).
        frictional: Nodes whose friction is to be found, shape (m,); at the others it is 0 here.
        d_n: diag(A) along n, metres per newton, shape (m,).
        d_t: Mean of diag(A) along t1 and t2, shape (m,); positive where there is friction to be found.
    """

    law: FrictionLaw
    lower: FloatArray
    frictional: npt.NDArray[np.bool_]
    d_n: FloatArray
    d_t: FloatArray

    @cached_property
    def rho_t(self) -> FloatArray:
        """1/d_t where there is friction to be found, else 0, shape (m,)."""
        return np.where(self.frictional, 1.0 / np.where(self.frictional, self.d_t, 1.0), 0.0)

    def pressed(self, x: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """p = x - w/d, along n (m,) and along the tangents (m, 2)."""
        return x[:, 0] - w[:, 0] / self.d_n, x[:, 1:] - self.rho_t[:, None] * w[:, 1:]

    def opened(self, x: FloatArray, w: FloatArray) -> FloatArray:
        """Forces x with exactly the lower bound at nodes that are open, and no friction where there it has no bound;
        newtons and metres, shapes (m, 3)."""
        open_nodes = x[:, 0] - w[:, 0] / self.d_n <= self.lower
        after = x.copy()
        after[open_nodes, 0] = self.lower[open_nodes]
        after[open_nodes & (self.law.radius(after[:, 0]) == 0.0), 1:] = 0.0
        return after

    def nearest_change(
        self,
        x: FloatArray,
        w: FloatArray,
        dx: FloatArray,
        dw: FloatArray,
        bound: FloatArray,
        over: Reductions,
        border: npt.NDArray[np.bool_],
    ) -> float:
        """The least factor t for which a node of x + t dx, w + t dw, with bounds r + t `bound` (m,), is on the border
        of two states to first order, shapes (m, 3), beside those that are there (`border`, shape (m,)); inf if none
        ever is; collective."""
        (p_n, p), (dp_n, dp) = self.pressed(x, w), self.pressed(dx, dw)
        p_n = p_n - self.lower
        length = np.hypot(p[:, 0], p[:, 1])
        rubbing = self.frictional & (p_n > 0.0) & (length > 0.0) & ~border
        way = np.einsum("ka,ka->k", p, dp) / np.where(length > 0.0, length, 1.0)
        way -= self.law.slope(x[:, 0]) * dx[:, 0] + bound
        margins = np.concatenate([p_n[~border], (length - self.law.radius(x[:, 0]))[rubbing]])
        rates = np.abs(np.concatenate([dp_n[~border], way[rubbing]]))
        steps = np.abs(margins[rates > 0.0]) / rates[rates > 0.0]
        return over.min(np.append(steps, np.inf))

    def at(self, x: FloatArray, w: FloatArray) -> ContactDerivative:
        """The equations at forces x with w = A x - b, newtons and metres, shapes (m, 3)."""
        m, e2 = len(x), np.eye(2)
        P: FloatArray = np.zeros((m, 3, 3))
        Q: FloatArray = np.zeros((m, 3, 3))
        value: FloatArray = np.empty((m, 3))
        rho_n, rho_t = 1.0 / self.d_n, self.rho_t
        p_n, p = self.pressed(x, w)
        closed = p_n > self.lower
        value[:, 0] = np.where(closed, rho_n * w[:, 0], x[:, 0] - self.lower)
        P[:, 0, 0], Q[:, 0, 0] = np.where(closed, 0.0, 1.0), np.where(closed, rho_n, 0.0)

        x_t = x[:, 1:]
        r = np.where(self.frictional, self.law.radius(x[:, 0]), 0.0)
        length, size = np.hypot(p[:, 0], p[:, 1]), np.hypot(x_t[:, 0], x_t[:, 1])
        sticks, slips = (length <= r) & (r > 0.0), (length > r) & (r > 0.0)
        radius, far = np.where(r > 0.0, r, 1.0), np.where(length > 0.0, length, 1.0)
        e = np.where(slips[:, None], p / far[:, None], 0.0)
        h = x_t / np.maximum(radius, size)[:, None]
        c = np.sum(x_t * e, axis=1) / np.where(size > 0.0, size, 1.0)
        beta = 1.0 / (1.0 - np.minimum(c, 0.0) * np.minimum(size / radius, 1.0))
        T = np.where(slips, r / far, 0.0)[:, None, None] * (e2 - beta[:, None, None] * h[:, :, None] * e[:, None, :])
        T[sticks] = e2
        value[:, 1:] = x_t - np.where(sticks[:, None], p, r[:, None] * e)
        P[:, 1:, 1:] = e2 - T
        Q[:, 1:, 1:] = rho_t[:, None, None] * T
        P[:, 1:, 0] = -np.where(x[:, 0] > 0.0, self.law.slope(x[:, 0]), 0.0)[:, None] * e
        status = np.where(closed | (self.law.radius(np.zeros(m)) > 0.0), np.where(slips, 2, 1), 0)
        return ContactDerivative(value, P, Q, status)
