"""Coulomb's law as complementarity in second-order cones, in variables without units.

    x = s (X_0, F X_1, F X_2),   Z = S (A x - b) / (a s) + |Z_t| e,   S = diag(1, F, F):     X in L,  Z in L,  X.Z = 0

at every contact, L = {X_0 >= |X_t|} (G. De Saxce, Z.-Q. Feng: The bipotential method, 1998).  In these variables |Z_t|
= F |w_t|, so that Z in L is w_n >= 0, X in L is Coulomb's cone, and X.Z = 0 says that friction opposes the slip.  A
contact without friction has zero tangential rows; its X_t changes nothing, and is left to the centring of the path.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse

from ...arrays import FloatArray
from ..friction_problem import FrictionProblem
from ..results import Goal, SolverResult, Status
from .cones import Projection, cone_residual, project, radius
from .newton_matrix import NewtonMatrix


class NaturalMap(NamedTuple):
    """X - P(X - rho (w + |w_t| e)), zero exactly at a solution, shape (m, 3), and what its derivative needs.

    Attributes:
        value: Shape (m, 3).
        size: Euclidean norm of the value over 1 + |q|.
        w: Shape (m, 3).
        projection: Of X - rho (w + |w_t| e).
    """

    value: FloatArray
    size: float
    w: FloatArray
    projection: Projection


class Scales(NamedTuple):
    """What takes the units from a problem, and its measure of an answer.

    Attributes:
        compliance: a, the mean diagonal of A, metres per newton.
        force: s, of which the largest |b| is the displacement a s, newtons.
        loads: |b| / (a s).
    """

    compliance: float
    force: float
    loads: float

    @classmethod
    def of(cls, problem: FrictionProblem) -> Scales:
        """Those of a problem on one rank."""
        a, largest = problem.mean_diagonal, float(np.abs(problem.b).max())
        s = largest / a or 1.0
        return cls(a, s, float(np.linalg.norm(problem.b)) / (a * s))

    def residual(self, problem: FrictionProblem, x: FloatArray, gradient: FloatArray) -> float:
        """The larger of the natural residual and the collection's, of forces x in newtons with A x - b in metres."""
        r, u = x.reshape(-1, 3) / self.force, gradient.reshape(-1, 3) / (self.compliance * self.force)
        return max(problem.residual(x, gradient), cone_residual(r, u, problem.law.friction, self.loads))


def answer(
    name: str,
    problem: FrictionProblem,
    goal: Goal,
    x: FloatArray,
    gradient: FloatArray,
    residual: float,
    otherwise: Status,
    products: int,
) -> SolverResult:
    """The result with some forces.

    Args:
        name: The solver's.
        problem: The problem.
        goal: Decides on the status.
        x: Forces in newtons, shape (3 m,).
        gradient: A x - b in metres, shape (3 m,), computed afresh.
        residual: Of both.
        otherwise: The status if they do not pass.
        products: Products by A so far.
    """
    w = gradient.reshape(-1, 3)
    return SolverResult(
        x=x,
        gradient=gradient,
        slip_bound=problem.slip_bound(x),
        multipliers=np.stack([np.maximum(w[:, 0], 0.0), radius(w)], axis=1),
        status=goal.verdict(residual, x, otherwise),
        outer_steps=0,
        newton_steps=0,
        products=products,
        residual=residual,
        history=(),
        method=name,
    )


class ConeProblem:
    """A problem with Coulomb friction in these variables, on one rank.

    Args:
        problem: Coulomb's law without cohesion, lower bounds 0, no rigid motions.
        A: Its compliance as a sparse matrix.
        scales: Its units.

    Attributes:
        contacts: m.
        W: S A S / a, sparse.
        q: -S b / (a s), shape (m, 3).
        matrix: Newton systems with W.
        products: Products by W so far.
        rho: Forces over displacements, of each contact, shape (m, 1).
    """

    def __init__(self, problem: FrictionProblem, A: Any, scales: Scales):
        friction = problem.law.friction
        self.contacts = len(friction)
        self._a, self._s, self._loads = scales
        self._S = np.column_stack([np.ones_like(friction), friction, friction])
        scale = scipy.sparse.diags(self._S.ravel())
        self.W = (scale @ (A / self._a) @ scale).tocsr()
        self.q: FloatArray = -self._S * problem.b.reshape(-1, 3) / (self._a * self._s)
        self.matrix, self.products = NewtonMatrix(self.W), 0
        stiffest = np.maximum(self.W.diagonal().reshape(-1, 3).max(axis=1), 1e-3)
        self.rho: FloatArray = (1.0 / stiffest)[:, None]

    def forces(self, X: FloatArray) -> FloatArray:
        """X (m, 3) in newtons, shape (3 m,)."""
        return (self._s * self._S * X).ravel()

    def scaled(self, x: FloatArray) -> FloatArray:
        """Forces in newtons (3 m,) as X (m, 3); 0 along the tangents of contacts without friction."""
        X: FloatArray = x.reshape(-1, 3) / (self._s * np.where(self._S > 0.0, self._S, 1.0))
        return np.where(self._S > 0.0, X, 0.0)

    def w(self, X: FloatArray) -> FloatArray:
        """W X + q, shape (m, 3)."""
        self.products += 1
        image: FloatArray = (self.W @ X.ravel()).reshape(-1, 3) + self.q
        return image

    def natural_map(self, X: FloatArray) -> NaturalMap:
        """The natural map at X (m, 3)."""
        w = self.w(X)
        z = w.copy()
        z[:, 0] += radius(w)
        projection = project(X - self.rho * z)
        value = X - projection.point
        return NaturalMap(value, float(np.linalg.norm(value) / (1.0 + self._loads)), w, projection)

    def newton_step(self, at: NaturalMap, proximal: float) -> FloatArray | None:
        """The step of the nonsmooth Newton method, shape (m, 3); None where its matrix is singular.

        With the derivative G of the projection, E = 1 + e (0, w_t)^T/|w_t| and a proximal term in the matrix alone:
        (1 - G + rho G E (W + proximal)) dX = -value.
        """
        G = at.projection.derivative()
        slip = radius(at.w)
        E = np.tile(np.eye(3), (self.contacts, 1, 1))
        E[:, 0, 1:] = at.w[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
        L = self.rho[:, :, None] * (G @ E)
        if not self.matrix.factorise(np.eye(3) - G + proximal * L, L):
            return None
        step = -self.matrix.solve(at.value)
        return step if np.isfinite(step).all() else None
