"""The problem with friction in the variables in which the one loop works, and its linearisation.

    x = s (x_n, r y),  r = c + F x_n,   A~ = A/a,   b~ = b/(a s),   a the mean diagonal of A,  s a nominal nodal force

A friction cone is a disc of unit radius once friction is measured by its bound: y = x_t/r(x_n).
With w = A~ x~ - b~ and the slacks z1 = x_n - lower, z2 = r (1 - |y|^2)/2, both in newtons (scaled),

    w_n - nu1 = 0          nu1 z1 = theta
    w_t + nu2 y = 0        nu2 z2 = theta

at every node: at theta = 0 Signorini's law and the law of friction.  nu1 is the gap; nu2 the slip, which friction
opposes.
A node without friction has no second constraint and no y.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from .barrier import Barrier
from .friction_problem import FrictionProblem
from .laws import FrictionLaw
from .scaled_compliance import ScaledCompliance
from .scaling import nominal_force


class ConeIterate(NamedTuple):
    """x_n (m,), y (m, 2), nu (m, 2), A x (m, 3), in scaled variables; x_n > lower, |y| < 1, nu > 0."""

    x_n: FloatArray
    y: FloatArray
    nu: FloatArray
    A_x: FloatArray


class ConeLinearization(NamedTuple):
    """The nodal numbers of the Newton system at an iterate, see `one_loop`.

    Attributes:
        F: Slope dr/dx_n (m,).
        g: r(x_n) (m,).
        h: nu2/g (m,), 0 without friction.
        y: Shape (m, 2).
        c: F (1 + |y|^2)/2 (m,): how the cone widens with x_n.
        D22: z/nu (m, 2), 1 where there is no constraint.
        frictional: Shape (m,).
    """

    F: FloatArray
    g: FloatArray
    h: FloatArray
    y: FloatArray
    c: FloatArray
    D22: FloatArray
    frictional: npt.NDArray[np.bool_]

    def constraints(self, dx: FloatArray) -> FloatArray:
        """Change of -z along dx (m, 3): (-dx_n, y dx_t - c dx_n), shape (m, 2)."""
        disc = np.einsum("ij,ij->i", self.y, dx[:, 1:]) - self.c * dx[:, 0]
        return np.column_stack([-dx[:, 0], np.where(self.frictional, disc, 0.0)])

    def C(self, dx: FloatArray) -> FloatArray:
        """The nodal part of the system on dx (m, 3): what it adds to A dx, unsymmetric."""
        d = self.constraints(dx) / self.D22
        r = np.empty_like(dx)
        r[:, 0] = -d[:, 0]
        r[:, 1:] = self.h[:, None] * (dx[:, 1:] - (self.F * dx[:, 0])[:, None] * self.y) + d[:, 1:] * self.y
        return r

    def blocks(self) -> FloatArray:
        """C as matrices, shape (m, 3, 3); the identity on the tangential pair of a node without friction."""
        e = np.eye(3)
        C = np.stack([self.C(np.tile(e[k], (len(self.F), 1))) for k in range(3)], axis=2)
        C[~self.frictional, 1:, 1:] = np.eye(2)
        return C

    def dy(self, dx: FloatArray) -> FloatArray:
        """Change of y to first order, (dx_t - F y dx_n)/g, shape (m, 2)."""
        return np.where(
            self.frictional[:, None],
            (dx[:, 1:] - (self.F * dx[:, 0])[:, None] * self.y) / self.g[:, None],
            0.0,
        )


class ScaledCoulomb(Barrier):
    """A problem with friction, scaled; all of this rank.

    Args:
        problem: The problem in newtons and metres.
    """

    def __init__(self, problem: FrictionProblem):
        super().__init__(problem.reductions, problem.law.frictional)
        self.problem, m = problem, self.nodes
        self._a = problem.mean_diagonal
        self._s = nominal_force(problem.A, problem.b, self._over)
        self.A = ScaledCompliance(problem.A, np.ones((m, 3)), self._a, self._s)
        self._s = max(self._s, 0.1 * self._over.max(np.abs(np.asarray(problem.lower))))
        self.lower = np.broadcast_to(np.asarray(problem.lower) / self._s, (m,))
        law = problem.law.scaled(self._s)
        self._law = FrictionLaw(np.where(self.frictional, law.cohesion, 1.0), law.friction)
        self._b = problem.b.reshape(-1, 3) / (self._a * self._s)

    def inside(self, x: FloatArray, least: float, most: float) -> tuple[FloatArray, FloatArray]:
        """x_n (m,) >= lower + least and y (m, 2), |y| <= most, nearest to forces in N (3 m,)."""
        forces = x.reshape(-1, 3) / self._s
        x_n = np.maximum(forces[:, 0], self.lower + least)
        y = np.where(self.frictional[:, None], forces[:, 1:] / self._law.radius(x_n)[:, None], 0.0)
        size = np.linalg.norm(y, axis=1)
        return x_n, y * (np.minimum(size, most) / np.where(size > 0.0, size, 1.0))[:, None]

    def forces(self, x_n: FloatArray, y: FloatArray) -> FloatArray:
        """x = (x_n, r y), shape (m, 3)."""
        return np.column_stack([x_n, self._law.radius(x_n)[:, None] * y])

    def slack(self, x_n: FloatArray, y: FloatArray) -> FloatArray:
        """z, shape (m, 2); 0 where there is no constraint."""
        return self.on_constraints(
            np.column_stack([x_n - self.lower, 0.5 * self._law.radius(x_n) * (1.0 - np.sum(y**2, axis=1))])
        )

    def gradient(self, v: ConeIterate) -> FloatArray:
        """(w_n - nu1, w_t + nu2 y) on the unknowns, shape (m, 3)."""
        r = v.A_x - self._b
        r[:, 0] -= v.nu[:, 0]
        r[:, 1:] += v.nu[:, 1:] * v.y
        r[~self.frictional, 1:] = 0.0
        return r

    def linearize(self, v: ConeIterate) -> ConeLinearization:
        g = self._law.radius(v.x_n)
        z = self.slack(v.x_n, v.y)
        return ConeLinearization(
            F=self._law.slope,
            g=g,
            h=self.on_constraints(v.nu)[:, 1] / g,
            y=v.y,
            c=0.5 * self._law.slope * (1.0 + np.sum(v.y**2, axis=1)),
            D22=np.where(self._active, z, 1.0) / self.safe(v.nu),
            frictional=self.frictional,
        )

    def weight(self, x_n: FloatArray) -> FloatArray:
        """Rows as they can do work, shape (m, 3): 1 for gaps, min(r, 1) for slips: open nodes get no weight."""
        W = np.ones((self.nodes, 3))
        W[:, 1:] = np.minimum(self._law.radius(x_n), 1.0)[:, None]
        return W

    def distance_to_boundary(self, v: ConeIterate, dx_n: FloatArray, dy: FloatArray, dnu: FloatArray) -> float:
        """Largest alpha with x_n + alpha dx_n >= lower, |y + alpha dy| <= 1, nu + alpha dnu >= 0; or inf."""
        return self._longest(v.x_n - self.lower, dx_n, v.nu, dnu, v.y, dy, 1.0 - np.sum(v.y**2, axis=1))

    def unscaled(self, v: ConeIterate) -> tuple[FloatArray, FloatArray]:
        """Forces in N (3 m,), and A x - b in m (3 m,)."""
        gradient = self._a * self._s * (v.A_x - self._b)
        return (self._s * self.forces(v.x_n, v.y)).ravel(), gradient.ravel()
