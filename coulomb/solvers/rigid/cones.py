"""Coulomb's law as complementarity in second-order cones, in variables without units.

    x = s (X_0, F X_1, F X_2),   Z = S (A x - b) / (a s) + |Z_t| e,   S = diag(1, F, F):     X in L,  Z in L,  X.Z = 0

at every contact, L = {X_0 >= |X_t|} (G. De Saxce, Z.-Q. Feng: The bipotential method, 1998).  In these variables |Z_t|
= F |w_t|, so that Z in L is w_n >= 0, X in L is Coulomb's cone, and X.Z = 0 says that friction opposes the slip.  A
contact without friction has zero tangential rows; its X_t changes nothing, and is left to the centring of the path.

Second-order cones L = {x: x_0 >= |(x_1, x_2)|}, many at once: arrays of shape (m, 3), a cone per row.

F. Alizadeh, D. Goldfarb: Second-order cone programming, Mathematical Programming 95 (2003).  L is the cone of
squares of the product x o y = (x.y, x_0 y_1 + y_0 x_1, x_0 y_2 + y_0 x_2) with the unit e = (1, 0, 0).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import scipy.sparse

from ...arrays import FloatArray
from ..friction_problem import FrictionProblem
from .newton_matrix import NewtonMatrix

_DIAGONAL: Final = 1e-4  # of the largest entry of a column: pivots of proximal steps


def radius(x: FloatArray) -> FloatArray:
    """|(x_1, x_2)|, shape (m,)."""
    return np.sqrt(x[:, 1] ** 2 + x[:, 2] ** 2)


def determinant(x: FloatArray) -> FloatArray:
    """x_0^2 - x_1^2 - x_2^2 without cancellation, shape (m,): positive inside the cone, 0 on its surface."""
    t = radius(x)
    return (x[:, 0] - t) * (x[:, 0] + t)


def times(matrices: FloatArray, x: FloatArray) -> FloatArray:
    """Matrices (m, 3, 3) times vectors (m, 3)."""
    return (matrices @ x[:, :, None])[:, :, 0]


def product(x: FloatArray, y: FloatArray) -> FloatArray:
    """x o y, shape (m, 3)."""
    xy = x[:, :1] * y + y[:, :1] * x
    xy[:, 0] = np.einsum("ij,ij->i", x, y)
    return xy


def quotient(x: FloatArray, y: FloatArray) -> FloatArray:
    """The z with x o z = y, shape (m, 3), for x inside the cone."""
    z = np.empty_like(y)
    z[:, 0] = (x[:, 0] * y[:, 0] - x[:, 1] * y[:, 1] - x[:, 2] * y[:, 2]) / determinant(x)
    z[:, 1:] = (y[:, 1:] - z[:, :1] * x[:, 1:]) / x[:, :1]
    return z


def step_to_boundary(x: FloatArray, dx: FloatArray) -> float:
    """The largest t for which x + t dx is in all cones, x inside them; inf if there is none."""
    a = dx[:, 0] ** 2 - dx[:, 1] ** 2 - dx[:, 2] ** 2
    b = x[:, 0] * dx[:, 0] - x[:, 1] * dx[:, 1] - x[:, 2] * dx[:, 2]
    c = determinant(x)
    discriminant = b**2 - a * c
    root = np.sqrt(np.maximum(discriminant, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(b <= 0.0, c / (root - b), np.where(a < 0.0, (b + root) / -a, np.inf))
        t[discriminant < 0.0] = np.inf
        axis = np.where(dx[:, 0] < 0.0, -x[:, 0] / dx[:, 0], np.inf)
    return float(min(np.min(t), np.min(axis)))


class Scaling(NamedTuple):
    """Nesterov and Todd's scaling of x and z inside the cones: P x = P^-1 z = point.

    Attributes:
        P: Symmetric positive definite, maps the cone to itself, shape (m, 3, 3).
        inverse: P^-1.
        square: P^2, with P^2 x = z.
        point: Shape (m, 3).
    """

    P: FloatArray
    inverse: FloatArray
    square: FloatArray
    point: FloatArray


def scaling(x: FloatArray, z: FloatArray) -> Scaling:
    """The scaling of x and z, both inside the cones.

    With x' = x / sqrt(det x), z' likewise, J = diag(1, -1, -1) and w = (z' + J x') / sqrt(2 + 2 x'.z'), P^2 is
    sqrt(det z / det x) (2 w w^T - J), and P is the same with the square root of the hyperbolic rotation.
    """
    m, det_x, det_z = len(x), determinant(x), determinant(z)
    unit_x, unit_z = x / np.sqrt(det_x)[:, None], z / np.sqrt(det_z)[:, None]
    w = unit_z.copy()
    w[:, 0] += unit_x[:, 0]
    w[:, 1:] -= unit_x[:, 1:]
    w /= np.sqrt(2.0 + 2.0 * np.einsum("ij,ij->i", unit_x, unit_z))[:, None]
    size = np.sqrt(np.sqrt(det_z / det_x))[:, None, None]
    P = np.empty((m, 3, 3))
    P[:, 0, 0], P[:, 0, 1:], P[:, 1:, 0] = w[:, 0], w[:, 1:], w[:, 1:]
    P[:, 1:, 1:] = np.eye(2) + w[:, 1:, None] * w[:, None, 1:] / (1.0 + w[:, :1, None])
    inverse = P.copy()
    inverse[:, 0, 1:] *= -1.0
    inverse[:, 1:, 0] *= -1.0
    P, inverse = size * P, inverse / size
    return Scaling(P, inverse, P @ P, times(P, x))


class Projection(NamedTuple):
    """The nearest points of the cones to y.

    Attributes:
        point: Shape (m, 3).
        lower: y_0 - |(y_1, y_2)|, shape (m,); the projection is y where it is not negative.
        upper: y_0 + |(y_1, y_2)|; the projection is 0 where it is not positive.
        direction: (y_1, y_2) / |(y_1, y_2)|, shape (m, 2), 0 on the axis.
    """

    point: FloatArray
    lower: FloatArray
    upper: FloatArray
    direction: FloatArray

    def derivative(self) -> FloatArray:
        """An element of the generalised derivative, shape (m, 3, 3)."""
        G = np.zeros((len(self.lower), 3, 3))
        G[self.lower >= 0.0] = np.eye(3)
        between = (self.lower < 0.0) & (self.upper > 0.0)
        d, upper = self.direction[between], self.upper[between]
        B = np.empty((len(d), 3, 3))
        B[:, 0, 0], B[:, 0, 1:], B[:, 1:, 0] = 0.5, 0.5 * d, 0.5 * d
        along = d[:, :, None] * d[:, None, :]
        across = upper / (upper - self.lower[between])
        B[:, 1:, 1:] = 0.5 * along + across[:, None, None] * (np.eye(2) - along)
        G[between] = B
        return G


def project(y: FloatArray) -> Projection:
    """The nearest points of the cones to y (m, 3)."""
    t = radius(y)
    lower, upper = y[:, 0] - t, y[:, 0] + t
    direction = y[:, 1:] / np.where(t > 0.0, t, 1.0)[:, None]
    p, q = np.maximum(lower, 0.0), np.maximum(upper, 0.0)
    point = np.empty_like(y)
    point[:, 0] = 0.5 * (p + q)
    point[:, 1:] = (0.5 * (q - p))[:, None] * direction
    return Projection(point, lower, upper, direction)


def project_on_friction_cones(r: FloatArray, friction: FloatArray) -> FloatArray:
    """The nearest forces with |r_t| <= F r_n; r has shape (m, 3), F shape (m,)."""
    size = radius(r)
    inside, polar = size <= friction * r[:, 0], friction * size <= -r[:, 0]
    normal = (r[:, 0] + friction * size) / (1.0 + friction**2)
    along = (friction * normal / np.where(size > 0.0, size, 1.0))[:, None] * r[:, 1:]
    return np.where(polar[:, None], 0.0, np.where(inside[:, None], r, np.column_stack([normal, along])))


def cone_residual(r: FloatArray, u: FloatArray, friction: FloatArray, loads: float) -> float:
    """|r - P(r - (u + F |u_t| n))| / (1 + loads), P the projection on the friction cones: the FCLIB collection's
    measure.

    Args:
        r: Forces, shape (m, 3), and
        u: displacements, shape (m, 3), without units: for a mean diagonal of A of 1 and a largest |b| of 1.
        friction: Coefficients F, shape (m,).
        loads: |b|.
    """
    v = u.copy()
    v[:, 0] += friction * radius(u)
    return float(np.linalg.norm(r - project_on_friction_cones(r - v, friction)) / (1.0 + loads))


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
        return max(problem.residual(x, gradient), self.of_collection(problem, x, gradient))

    def of_collection(self, problem: FrictionProblem, x: FloatArray, gradient: FloatArray) -> float:
        """The collection's alone."""
        r, u = x.reshape(-1, 3) / self.force, gradient.reshape(-1, 3) / (self.compliance * self.force)
        return cone_residual(r, u, problem.law.friction, self.loads)


class ConeProblem:
    """A problem in these variables, on one rank: Coulomb's law without cohesion, lower bounds 0, no rigid motions.

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
        return (self.W @ X.ravel()).reshape(-1, 3) + self.q

    def natural_map(self, X: FloatArray, centre: FloatArray | None = None, c: float = 1.0) -> NaturalMap:
        """The natural map at X (m, 3); with a centre that of a proximal step, X - P(centre - rho/c (w + |w_t| e))."""
        w = self.w(X)
        z = w.copy()
        z[:, 0] += radius(w)
        projection = project((X if centre is None else centre) - self.rho / c * z)
        value = X - projection.point
        return NaturalMap(value, float(np.linalg.norm(value) / (1.0 + self._loads)), w, projection)

    def newton_step(self, natural_map: NaturalMap, proximal: float) -> FloatArray | None:
        """The step of the nonsmooth Newton method, shape (m, 3); None where its matrix is singular.

        With the derivative G of the projection, E = 1 + e (0, w_t)^T/|w_t| and a proximal term in the matrix alone:
        (1 - G + rho G E (W + proximal)) dX = -value.
        """
        G = natural_map.projection.derivative()
        L = self._slope(natural_map, G)
        return self._solved(np.eye(3) - G + proximal * L, L, natural_map.value)

    def proximal_step(self, natural_map: NaturalMap, c: float) -> FloatArray | None:
        """The Newton step for a proximal step: (1 + rho/c G E W) dX = -value.

        Other pivots than the diagonal, that the size of 1/c asks for, make the factors up to fifteen times as slow.
        """
        L = self._slope(natural_map, natural_map.projection.derivative()) / c
        return self._solved(np.tile(np.eye(3), (self.contacts, 1, 1)), L, natural_map.value, _DIAGONAL)

    def _slope(self, natural_map: NaturalMap, G: FloatArray) -> FloatArray:
        """rho G E."""
        slip = radius(natural_map.w)
        E = np.tile(np.eye(3), (self.contacts, 1, 1))
        E[:, 0, 1:] = natural_map.w[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
        return self.rho[:, :, None] * (G @ E)

    def _solved(self, D: FloatArray, L: FloatArray, value: FloatArray, diagonal: float = 0.01) -> FloatArray | None:
        """(L W + D)^-1 (-value); None where the matrix is singular."""
        if not self.matrix.factorise(D, L, diagonal):
            return None
        step = -self.matrix.solve(value)
        return step if np.isfinite(step).all() else None
