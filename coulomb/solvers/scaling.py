"""The Tresca problem in the variables in which PF works: the answer and the counts do not depend on the user's units.

    x = s W x~,    A~ = W A W / a,    b~ = W b / (a s),    a the mean diagonal of A

s is a nominal nodal force: the multiple of equal pressure on all nodes that minimises the objective.  W is 1 on normal
forces and min(g/s, 1) on friction, so that small discs become unit discs: the gradient of a node then weighs as much as
its force can do work, and slip bounds spread over many orders of magnitude cost no more steps than equal ones.
The constraints are c = (lower - x_n, (|x_t|^2 - g^2) / (2 g)) <= 0, so all multipliers are displacements.
A node whose slip bound is zero has no disc and no friction: its second constraint and its tangential pair drop out.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..arrays import FloatArray
from ..linalg.compliance import Compliance
from ..linalg.reductions import Reductions
from .barrier import Barrier
from .friction_problem import FrictionProblem
from .newton_systems import Linearization
from .scaled_compliance import ScaledCompliance


def nominal_force(A: Compliance, b: FloatArray, over: Reductions) -> float:
    """s, in newtons, > 0: the equal pressure on all nodes that minimises the objective; one product by A."""
    e = np.zeros((A.nodes, 3))
    e[:, 0] = 1.0
    A_e = np.empty(3 * A.nodes)
    A.mult(e.ravel(), A_e)
    return max(over.dot(e.ravel(), b), 0.1 * over.norm(e) * over.norm(b)) / over.dot(e.ravel(), A_e)


class ScaledQP(Barrier):
    """A Tresca problem, scaled; forces as (m, 3), constraints as (m, 2), all of this rank.

    Args:
        qp: The problem in newtons and metres.
    """

    def __init__(self, qp: FrictionProblem):
        super().__init__(qp.reductions, qp.law.frictional)
        self.qp, m = qp, self.nodes
        self._a = qp.mean_diagonal
        self._s = nominal_force(qp.A, qp.b, qp.reductions)
        self._s = max(self._s, 0.1 * self._over.max(np.abs(np.asarray(qp.lower))))
        g = qp.law.scaled(self._s).cohesion
        self._W = np.ones((m, 3))
        self._W[self.frictional, 1:] = np.minimum(g[self.frictional], 1.0)[:, None]
        self._g = np.where(self.frictional, np.maximum(g, 1.0), 1.0)
        self.A = ScaledCompliance(qp.A, self._W, self._a, self._s)
        self.lower = np.broadcast_to(np.asarray(qp.lower) / self._s, (m,))
        self._b = self._W * qp.b.reshape(-1, 3) / (self._a * self._s)

    # --- between the scaled and the user's variables ------------------------------------------------------------

    def scaled(self, x: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces (3 m,) in N and A x - b (3 m,) in m, as x~ and A~ x~ - b~, both (m, 3)."""
        x_scaled = x.reshape(-1, 3) / (self._s * self._W)
        x_scaled[~self.frictional, 1:] = 0.0
        return x_scaled, self._W * gradient.reshape(-1, 3) / (self._a * self._s)

    def unscaled(self, x: FloatArray, nu: FloatArray, A_x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces in N (3 m,), A x - b in m (3 m,), multipliers in m (m, 2)."""
        multipliers = self._a * self._s * nu / np.column_stack([self._W[:, 0], self._W[:, 1]])
        gradient = self._a * self._s * (A_x - self._b) / self._W
        return (self._s * self._W * x).ravel(), gradient.ravel(), multipliers

    def residual(self, x: FloatArray, A_x: FloatArray) -> float:
        """Natural residual of the unscaled problem."""
        forces, gradient, _ = self.unscaled(x, np.zeros((self.nodes, 2)), A_x)
        return self.qp.residual(forces, gradient)

    # --- the pieces of F, J and N(gamma, beta) ------------------------------------------------------------------

    def slack(self, x: FloatArray) -> FloatArray:
        """z = -c(x), shape (m, 2)."""
        disc = (self._g**2 - x[:, 1] ** 2 - x[:, 2] ** 2) / (2.0 * self._g)
        return self.on_constraints(np.column_stack([x[:, 0] - self.lower, disc]))

    def gradient(self, x: FloatArray, nu: FloatArray, A_x: FloatArray) -> FloatArray:
        """grad_x L = A x - b - nu1 e_n + nu2 x_t / g on the unknowns, shape (m, 3)."""
        r = A_x - self._b
        r[:, 0] -= nu[:, 0]
        r[:, 1:] += nu[:, 1:] * x[:, 1:] / self._g[:, None]
        r[~self.frictional, 1:] = 0.0
        return r

    def linearize(self, x: FloatArray, nu: FloatArray, z: FloatArray) -> Linearization:
        h = nu[:, 1] / self._g
        D22 = np.where(self._active, z / self.safe(nu), 1.0)
        return Linearization(h, x[:, 1:] / self._g[:, None], D22, self.frictional)

    def distance_to_boundary(self, x: FloatArray, dx: FloatArray, nu: FloatArray, dnu: FloatArray) -> float:
        """Largest alpha with x + alpha dx feasible and nu + alpha dnu >= 0; inf if there is none."""
        room = self._g**2 - np.sum(x[:, 1:] ** 2, axis=1)
        return self._longest(x[:, 0] - self.lower, dx[:, 0], nu, dnu, x[:, 1:], dx[:, 1:], room)

    # --- a warm start -------------------------------------------------------------------------------------------

    def projection_step(self, x: FloatArray, w: FloatArray) -> FloatArray:
        """q = x - D^-1 w with w = A x - b and D = diag(A), made isotropic on each disc; a solution has P(q) = x."""
        return x - w / self._isotropic

    @cached_property
    def _isotropic(self) -> FloatArray:
        d = self.A.diagonal.copy()
        d[:, 1:] = 0.5 * (d[:, 1:2] + d[:, 2:3])
        return d

    def distance_from_solution(self, x: FloatArray, q: FloatArray) -> float:
        """Root mean square of x - P(q) in units of the nominal force."""
        p = np.empty_like(q)
        p[:, 0] = np.maximum(q[:, 0], self.lower)
        size = np.maximum(np.hypot(q[:, 1], q[:, 2]), self._g)
        p[:, 1:] = q[:, 1:] * (self._g / size)[:, None]
        p[~self.frictional, 1:] = 0.0
        return self.rms(self._W * (x - p))

    def smoothed_projection(self, q: FloatArray, theta: float) -> tuple[FloatArray, FloatArray]:
        """The point of the projection's central path: x strictly feasible (m, 3), nu (m, 2), nu_i z_i = theta.

        Minimises 1/2 (x - q)^T D (x - q) under the constraints with barrier theta.  A bound: x_n - l is the positive
        root of t^2 - (q_n - l) t - theta/d (the smoothing of Chen, Harker, Kanzow and Smale).  A disc:
        x_t = q_t / (1 + tau) with tau = nu2 / (g d), where d tau (g^2 - |q_t|^2 / (1 + tau)^2) = 2 theta.
        """
        d, d_t, g = self._isotropic[:, 0], self._isotropic[:, 1], self._g
        x, nu = np.zeros_like(q), np.zeros((self.nodes, 2))
        above = q[:, 0] - self.lower
        root = np.sqrt(above**2 + 4.0 * theta / d)
        with np.errstate(divide="ignore", invalid="ignore"):  # the form of the root that does not cancel
            t = np.where(above > 0.0, 0.5 * (above + root), 2.0 * theta / d / (root - above))
        x[:, 0], nu[:, 0] = self.lower + t, theta / t

        size = np.hypot(q[:, 1], q[:, 2])
        low = np.maximum(size / g - 1.0, 0.0)
        high = low + 1.0 + 4.0 * theta / (d_t * g**2)
        for _ in range(100):  # bisection: the left-hand side grows with tau between these bounds
            tau = 0.5 * (low + high)
            short = tau * d_t * (g**2 - (size / (1.0 + tau)) ** 2) < 2.0 * theta
            low, high = np.where(short, tau, low), np.where(short, high, tau)
        x[:, 1:] = q[:, 1:] / (1.0 + high)[:, None]
        x[~self.frictional, 1:] = 0.0
        nu[:, 1] = self.on_constraints(theta / self.safe(self.slack(x)))[:, 1]
        return x, nu
