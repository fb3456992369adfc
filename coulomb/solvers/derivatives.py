"""Derivatives of an answer along parameters of its problem, and of functions of it, by the sets of its contact points.

With P and Q of the equations of contact (contact_equations.py) they are P dx + Q dw = -(change of the equations), one
linear system for each parameter, by the Krylov method of a Newton step; and its transpose.  At points on a border the
states along each parameter are found (border.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from ..arrays import BoolArray, FloatArray
from ..linalg.compliance import BodyCompliance, ConstraintPreconditioner, Constraints, CoupledKrylov
from .border import Border
from .contact_equations import ContactDerivative
from .contact_preconditioner import ContactPreconditioner, FormedInverse, SprungInverse
from .friction_problem import FrictionProblem, Task
from .results import Goal
from .rigid_motions import NO_MOTION
from .semismooth_newton import SemismoothIteration, SemismoothNewton

_ACCURACY = (1e-12, 1e-10)
"""Relative residual of the systems of derivatives, with factors and by multigrid."""

_FORMED: Final = 4000
"""Contact unknowns up to which the systems have A as a matrix, where it is at hand."""

_SOLVED: Final = 1e-6
"""Relative residual of such a system above which it is singular, nearly."""

_RANDOM: Final = 1e-2
"""Relative residual of the system by whose answer the condition is estimated."""

_KNOWN: Final = 0.1
"""Condition number times the precision of factors up to which it is known, and the sign of their determinant."""

_DECIDED: Final = 1e-9
_TIMES: Final = 10.0
"""A node is on the border of two states if these are apart by less than this part of its force, and than this times the
largest residual of a node."""

_ATTEMPTS: Final = 30
_SETTLED: Final = 1e-8
"""Choices of the states of nodes on a border, and what their equations may leave over, over the largest change, where
these are found.  States may be several: a node that slides as far as the step before keeps, and its bound with it."""

_SLIGHT: Final = 1e-3
"""Derivative of the forces over these below which its accuracy is absolute: some are rounding errors."""


@dataclass(frozen=True, eq=False)
class Change:
    """The derivative of a problem along a parameter.

    Attributes:
        b: Of b, metres, shape (3 m,).
        bound: Of the bound r of friction at the present pressure, newtons, shape (m,).
        e: Of the loads along rigid motions, shape (q,).
        f: Of the loads along displacements, newtons, shape (n,), beside those of which b has the displacements.
    """

    b: FloatArray
    bound: FloatArray
    e: FloatArray
    f: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Derivative:
    """The derivative of an answer along a parameter.

    Attributes:
        x: Of the forces, newtons, shape (3 m,).
        u: Of the displacement K^-1 (f - B^T x), metres, this rank's unknowns, shape (n,).
        alpha: Of the rigid motions, shape (q,).
        step: Change of the parameter up to which, to first order, no node opens, closes, sticks or slips anew; the
            derivative is that of a smooth function in between.  0 if the states of nodes on a border were not found.
        border: Number of nodes on the border of two states in all; if there are any, x and alpha are those as the
            parameter grows, and the opposite change has another derivative.
    """

    x: FloatArray
    u: FloatArray
    alpha: FloatArray
    step: float
    border: int


def at_answer(
    problem: FrictionProblem, A: BodyCompliance, local: FloatArray, x: FloatArray, u: FloatArray | None = None
) -> AnswerDerivatives:
    """The derivatives at an answer x (3 m,) in newtons, and, where it is known, u (n,) in metres; collective.

    The linear systems are made of an A that may be another than that of the problem, if it is easier to form.  `local`
    is what a newton at a point does to the body next to it, metres per newton, shape (m,): diag(A) without motions of
    the body as a whole, which soft springs alone resist.  Displacements are judged by it.
    """
    settings = SemismoothNewton()
    derivatives = AnswerDerivatives(settings, problem, Task(Goal(settings.tolerance, None), None, None, None))
    derivatives.settle(A, local, x, u)
    return derivatives


class Condition(NamedTuple):
    """Of the equations of the derivatives at an answer.

    Attributes:
        number: Their condition number, estimated to an order of magnitude or two; inf where it is beyond the precision.
        several: Whether their determinant is negative, as known by factors on one rank where supports hold the bodies.
            Answers of a problem count by the signs of their determinants, in all 1, as without friction, where there is
            one (the degree of the map; J. M. Ortega, W. C. Rheinboldt: Iterative Solution of Nonlinear Equations in
            Several Variables, 1970, chapter 6).  So there are two others.
    """

    number: float
    several: bool


class _Right(NamedTuple):
    """A right-hand side of the derivative's equations: loads along displacements, newtons, shape (n,), what contact
    points owe, shape (m, 3), and loads along motions, shape (q,)."""

    f: FloatArray
    g: FloatArray
    e: FloatArray


class _Solved(NamedTuple):
    """dx (m, 3), du (n,) and dalpha (q,)."""

    dx: FloatArray
    u: FloatArray
    dalpha: FloatArray


class AnswerDerivatives(SemismoothIteration):
    """The iteration at an answer, with A and the equations there, for any number of changes and functions."""

    _inverse: ContactPreconditioner | FormedInverse | SprungInverse  # type: ignore[assignment]

    def derivatives(self, changes: Sequence[Change]) -> list[Derivative]:
        """Along parameters, by the sets of the answer: P dx + Q dw = -(change of the equations), one linear system for
        each (contact_equations.py; A. Beremlijski et al.: Shape optimization in contact problems with Coulomb friction,
        SIAM J. Optim. 13, 2002); collective.

        Raises:
            ValueError: If the systems are (nearly) singular: the answer is one of several.
        """
        slips, known, slope = self._slips, self._problem.known_slip, self._slope
        w = self._w(self._A_x, self._alpha)
        border = self._border(w)
        points = round(self._over.sum(border.points.astype(np.float64)))
        of_bounds = [np.where(self._at.status == 2, one.bound, 0.0)[:, None] * slips for one in changes]
        rights = [self._right(change, of_bound) for change, of_bound in zip(changes, of_bounds, strict=True)]
        first = self._solved_for(rights, self._here)
        results = []
        for change, of_bound, solved in zip(changes, of_bounds, first, strict=True):
            dx, dw, u, dalpha, settled = self._along(border, change, of_bound, solved)
            dx[known, 1:] = ((slope * dx[:, 0] + change.bound)[:, None] * slips)[known]
            step = self._equations.nearest_change(self._x, w, dx, dw, change.bound, self._over, border.points)
            results.append(Derivative(dx.ravel(), u, self._motion(dalpha), step if settled else 0.0, points))
        return results

    @property
    def closed(self) -> BoolArray:
        """Whether w = 0 along n, t1, t2 by the sets of the answer, shape (m, 3)."""
        sticks = (self._at.status == 1) & self._problem.frictional
        return np.column_stack([self._at.status > 0, sticks, sticks])

    @cached_property
    def condition(self) -> Condition:
        """Of the equations: with A as a matrix by its factors, else by the answer to random signs as right-hand side,
        whose norm is the root of their number (J. D. Dixon, Estimating extremal eigenvalues and condition numbers of
        matrices, SIAM J. Numer. Anal. 20, 1983); collective."""
        inverse = self._inverse
        inverse.move(self._at)
        if isinstance(inverse, FormedInverse):
            known = (number := inverse.condition) * inverse.precision < _KNOWN
            return Condition(number, not len(self._e) and inverse.negative) if known else Condition(math.inf, False)
        random = np.random.default_rng([1983, self._scaled.comm.rank])
        signs: FloatArray = random.choice([-1.0, 1.0], size=self._x.shape)
        scale = self._scale()[:, None]
        try:
            right = _Right(np.zeros(self._body.size), signs * scale, 0.0 * self._e)
            ((dx, *_),) = self._solved_for([right], self._system(), _RANDOM)
        except ValueError:
            return Condition(math.inf, False)
        return Condition(
            max(self._over.norm(dx / scale), 1.0), False
        )  # of signs, whose norm is the root of their number

    def _right(self, change: Change, of_bound: FloatArray) -> _Right:
        """The right-hand side at the present point, with what the bound does to friction, newtons, shape (m, 2)."""
        rhs = np.einsum("iab,ib->ia", self._at.Q, change.b.reshape(-1, 3) / self._a)
        rhs[:, 1:] += of_bound
        f = np.zeros(self._body.size) if change.f is None else change.f
        return _Right(f, rhs, self._T @ change.e if len(self._e) else NO_MOTION)

    def _border(self, w: FloatArray) -> Border:
        """The points whose state is not decided by the answer, as accurately as it is known; collective.

        Gaps and slips are forces there by what the body next to a point gives way, beside which springs may be soft."""
        scale, near = self._scale(), replace(self._equations, d_n=self._local, d_t=self._local)
        left = self._over.max(np.linalg.norm(near.at(self._x, w).value, axis=1) / scale)
        return Border.found(near, self._at, self._x, w, max(_DECIDED, _TIMES * left) * scale)

    def _along(
        self, border: Border, change: Change, of_bound: FloatArray, solved: _Solved
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, bool]:
        """dx, dw, du and dalpha along a change, and whether the states of points on a border have been found, from what
        the bound does at the answer, newtons, shape (m, 2), and the solution with it; collective."""
        answer: ContactDerivative = self._at
        closing, bound = change.b.reshape(-1, 3) / self._a, change.bound
        for attempt in range(_ATTEMPTS):
            if attempt:
                (solved,) = self._solved_for([self._right(change, of_bound)], self._system())
            dx, u, dalpha = solved
            dw = self._constraints.without(-self._body.rows(u).reshape(-1, 3) / self._a - closing, dalpha)
            border_rows, turned = border.along(dx, dw, bound)
            of_bound = np.where(border.rubbing[:, None], turned, of_bound)
            left = border_rows.apply(dx, dw)
            left[:, 1:] -= of_bound
            size = max(self._over.max(np.abs(dx).ravel()), _SLIGHT * self._over.max(np.abs(self._x).ravel()))
            settled = self._over.max(np.abs(left[border.points]).ravel()) <= _SETTLED * size
            if settled:
                break
            self._at = border_rows
        self._at = answer
        return dx, dw, u, dalpha, settled

    def gradient(
        self, of_x: FloatArray, of_u: FloatArray, of_alpha: FloatArray, undetermined: FloatArray, firm: bool = True
    ) -> tuple[Change, int]:
        """What a function of the answer owes to f, b without that of f, the bounds and e, and the number of points on a
        border; collective.

        By the transposed system K v - B^T Q^T z = of_u, P^T z + B v + G^T mu = of_x, -G Q^T z = of_alpha of multipliers
        (v, z, mu): v, Q^T z and mu are the derivatives along f, b and e.

        Args:
            of_x: Derivatives of the function along x, per newton, shape (3 m,),
            of_u: along displacements, per metre, this rank's unknowns, shape (n,),
            of_alpha: and along the rigid motions, shape (q,).
            undetermined: Directions along t1 and t2 in which supports hold a point, whose friction along these is 0
                while it sticks; 0 of others, shape (m, 2).
            firm: Whether points on the border of two states are closed and stick, or are open and slip.

        Raises:
            ValueError: If the system is (nearly) singular: the answer is one of several.
        """
        slips, known, slope = self._slips, self._problem.known_slip, self._slope
        answer, border = self._at, self._border(self._w(self._A_x, self._alpha))
        points = round(self._over.sum(border.points.astype(np.float64)))
        if points:
            self._at, directions = border.chosen(firm)
            slips = np.where(border.rubbing[:, None], directions, slips)
        g = of_x.reshape(-1, 3).copy()
        bound = np.where(known, np.einsum("ka,ka->k", slips, g[:, 1:]), 0.0)
        g[:, 0] += slope * bound
        g[known, 1:] = 0.0
        held = undetermined * (self._at.status == 1)[:, None]
        g[:, 1:] -= np.einsum("ka,ka->k", held, g[:, 1:])[:, None] * held
        P, Q = (of.transpose(0, 2, 1) for of in (self._at.P, self._at.Q))
        QG, r3 = self._at.Q @ self._scaled.G, NO_MOTION
        if len(self._e):
            r3 = -self._a * (self._T @ of_alpha)
        rows, inverse = np.repeat(self._scale()[:, None], 3, axis=1), self._inverse
        weight = self._over.max(self._scale() * self._local)
        inverse.move(self._at)
        constraints = Constraints(self._scaled.comm, self._scaled.G, QG)
        krylov = CoupledKrylov(
            self._body,
            self._a,
            constraints,
            lambda z: np.einsum("iab,ib->ia", Q, z),
            lambda z, w: np.einsum("iab,ib->ia", P, z) + w,
            ConstraintPreconditioner(inverse.transposed, constraints, 3, self._scaled.G),
            rows,
            weight,
        )
        f = -self._a * of_u
        size = math.hypot(self._over.norm(rows * g), weight * self._over.norm(f), float(np.linalg.norm(r3)))
        (u,), (z,), (mu,), (left,) = krylov.solve(f[None], g[None], r3[None], np.array([self._accuracy * size]))
        _refuse_unsolved(left, size)
        bound += np.where(self._at.status == 2, np.einsum("ka,ka->k", slips, z[:, 1:]), 0.0)
        e, self._at = -self._T.T @ mu if len(self._e) else NO_MOTION, answer
        return Change(np.einsum("iab,ib->ia", Q, z).ravel() / self._a, bound, e, -u / self._a), points

    def settle(self, A: BodyCompliance, local: FloatArray, x: FloatArray, u: FloatArray | None) -> None:
        """To the answer, as of `at_answer`; collective."""
        self._local, self._u = local / self._a, u
        self._one_by_one = A.matrix_free is not None  # as V-cycles are made
        self._body, self._accuracy = A.elimination(), _ACCURACY[self._one_by_one]
        if len(x) <= _FORMED and (formed := A.formed()) is not None:
            self._inverse = FormedInverse(formed / formed.dtype.type(self._a), self._scaled.diagonal)
        self._x = x.reshape(-1, 3).copy()
        self._x[~self._problem.frictional, 1:] = 0.0
        self._A_x = self._images.exact(self._x)
        self._alpha = self._closing(self._x, self._A_x)
        self._at = self._equations.at(self._x, self._w(self._A_x, self._alpha))
        tangential = x.reshape(-1, 3)[:, 1:]
        size = np.linalg.norm(tangential, axis=1)
        self._slips: FloatArray = tangential / np.where(size > 0.0, size, 1.0)[:, None]  # directions of friction
        self._slope = self._problem.law.slope(x[0::3])
        free = A.matrix_free
        if free is not None and free.stiffened and not len(self._e) and self._over.any(len(x) > 0):
            self._inverse = sprung = SprungInverse.at_points(free, self._a, self._local)
            sprung.move(self._at)
            self._body = free.elimination(sprung.springs(self._at) / self._a)

    def _scale(self) -> FloatArray:
        """The force of every node by which its equations are judged, newtons, shape (m,)."""
        scale = self._problem.force_scale(self._x.ravel(), self._a * self._w(self._A_x, self._alpha).ravel())
        return np.where(scale > 1e-290, scale, 1.0)

    @cached_property
    def _here(self) -> CoupledKrylov:
        """The derivative of the equations at the answer; collective.

        It knows the answer, of which loads, moduli and lengths change the scale: forces are in proportion to all loads,
        and to all stiffnesses and lengths, so that of such inputs one or two derivatives follow from the others."""
        system = self._system()
        if self._u is not None:
            none = np.zeros_like(self._u), np.zeros_like(self._x), np.zeros(len(self._e))
            system.know(self._u, *none[1:])
            system.know(none[0], self._x, none[2])
        return system

    def _system(self) -> CoupledKrylov:
        """The derivative of the equations at the present point; collective."""
        over, derivative = self._over, self._at
        scale, local = self._scale()[:, None], self._local[:, None]
        if self._one_by_one:  # a V-cycle moves a body on its springs by itself, beyond what contact lets it
            local = np.ones_like(local)
        rows = 1.0 / (scale * np.maximum(np.abs(derivative.P).sum(axis=2), np.abs(derivative.Q).sum(axis=2) * local))
        weight = over.min(1.0 / scale)
        weight = weight if np.isfinite(weight) else 1.0  # without contact points
        self._inverse.move(derivative)
        return CoupledKrylov(
            self._body,
            self._a,
            self._constraints,
            lambda x: x,
            derivative.apply,
            ConstraintPreconditioner(self._inverse, self._constraints, 3, derivative.Q @ self._scaled.G),
            rows,
            weight,
            not self._one_by_one,
        )

    def _solved_for(self, rights: Sequence[_Right], system: CoupledKrylov, accuracy: float = 0.0) -> list[_Solved]:
        """Of the derivative of the equations at the present point, to a relative residual, by default the usual one;
        collective."""
        over, rows, weight = self._over, system.rows, system.weight
        self._inverse.move(self._at)
        slight = _SLIGHT * over.norm(self._x / self._scale()[:, None])
        sizes = np.array(
            [
                max(math.hypot(over.norm(rows * g), weight * over.norm(f), weight * float(np.linalg.norm(e))), slight)
                for f, g, e in rights
            ]
        )
        f, g, e = (np.array(side) for side in zip(*rights, strict=True))
        u, dx, dalpha, left = system.solve(f, g, e, max(accuracy, self._accuracy) * sizes)
        for of, size in zip(left, sizes, strict=True):
            _refuse_unsolved(of, size, max(10.0 * accuracy, _SOLVED))
        return [_Solved(*one) for one in zip(dx, u, dalpha, strict=True)]


def _refuse_unsolved(left: float, size: float, part: float = _SOLVED) -> None:
    if not left <= part * size:
        raise ValueError(
            f"the equations of its derivatives are singular, nearly: a part of {left / size:.0e} of them is left over. "
            "The answer is nearly one of several, or the function depends on friction that supports leave undetermined"
        )
