"""Derivatives of an answer along parameters of its problem, and of functions of it, by the sets of its contact points.

With P and Q of the equations of contact (contact_equations.py) they are P dx + Q dw = -(change of the equations), one
linear system for each parameter, by the Krylov method of a Newton step; and its transpose.  At points on a border the
states along each parameter are found (border.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from petsc4py import PETSc

from ..arrays import FloatArray
from ..linalg.compliance import CarryingKrylov, ConstraintPreconditioner, Constraints, Formed
from .border import Border
from .contact_equations import ContactDerivative
from .contact_preconditioner import ContactPreconditioner, FormedInverse
from .friction_problem import FrictionProblem, Task
from .results import Goal
from .rigid_motions import NO_MOTION
from .semismooth_newton import SemismoothIteration, SemismoothNewton

_SHARPEST: Final = 1e-12
_BY_PRODUCTS: Final = 1e-10
"""Relative residual of the systems of derivatives, with A formed and where each product by A takes a solve."""

_SPARE: Final = 0.1
"""Accuracy of the products of a system for derivatives, over that of a Newton system."""

_MANY: Final = 60
_FORMED: Final = 3000
"""Iterations of such a system from which on the others have A as a matrix, and its size up to which they may."""

_SOLVED: Final = 1e-6
"""Relative residual of such a system above which it is singular, nearly."""

_DECIDED: Final = 1e-9
_TIMES: Final = 10.0
"""A node is on the border of two states if these are apart by less than this part of its force, and than this times the
largest residual of a node."""

_ATTEMPTS: Final = 30
_SETTLED: Final = 1e-6
"""Choices of the states of nodes on a border, and the change of an equation up to which they are found."""

_SLIGHT: Final = 1e-3
"""Derivative of the forces over these below which its accuracy is absolute: some are rounding errors."""


@dataclass(frozen=True, eq=False)
class Change:
    """The derivative of a problem along a parameter.

    Attributes:
        b: Of b, metres, shape (3 m,).
        bound: Of the bound r of friction at the present pressure, newtons, shape (m,).
        e: Of the loads along rigid motions, shape (q,).
    """

    b: FloatArray
    bound: FloatArray
    e: FloatArray


@dataclass(frozen=True, eq=False)
class Derivative:
    """The derivative of an answer along a parameter.

    Attributes:
        x: Of the forces, newtons, shape (3 m,).
        alpha: Of the rigid motions, shape (q,).
        step: Change of the parameter up to which, to first order, no node opens, closes, sticks or slips anew; the
            derivative is that of a smooth function in between.  0 if the states of nodes on a border were not found.
        border: Number of nodes on the border of two states in all; if there are any, x and alpha are those as the
            parameter grows, and the opposite change has another derivative.
    """

    x: FloatArray
    alpha: FloatArray
    step: float
    border: int


def derivatives(problem: FrictionProblem, x: FloatArray, changes: Sequence[Change]) -> list[Derivative]:
    """Derivatives of an answer x (3 m,) in newtons along parameters, by its sets: P dx + Q dw = -(change of the
    equations), one linear system for each (contact_equations.py; A. Beremlijski et al.: Shape optimization in contact
    problems with Coulomb friction, SIAM J. Optim. 13, 2002); collective."""
    return _at_answer(problem).derivatives(x, changes)


def gradient(
    problem: FrictionProblem,
    x: FloatArray,
    of_x: FloatArray,
    of_alpha: FloatArray,
    undetermined: FloatArray,
    firm: bool = True,
) -> tuple[Change, int]:
    """What a function of an answer owes to b, the bounds and e: one linear system, the transpose of that of
    `derivatives`; collective.

    Args:
        problem: The problem,
        x: and its answer, newtons, shape (3 m,).
        of_x: Derivatives of the function along x, per newton, shape (3 m,),
        of_alpha: and along the rigid motions, shape (q,).
        undetermined: Directions along t1 and t2 in which supports hold a point, whose friction along these is 0 while
            it sticks; 0 of others, shape (m, 2).
        firm: Whether points on the border of two states are closed and stick, or are open and slip.

    Returns:
        Them, and the number of points on a border.

    Raises:
        ValueError: If the system is (nearly) singular: the answer is one of several.
    """
    return _at_answer(problem).gradient(x, of_x, of_alpha, undetermined, firm)


def _at_answer(problem: FrictionProblem) -> _Derivatives:
    settings = SemismoothNewton(sharpest=_SHARPEST if isinstance(problem.A, Formed) else _BY_PRODUCTS)
    return _Derivatives(settings, problem, Task(Goal(settings.tolerance, None), None, None, None))


class _Derivatives(SemismoothIteration):
    """The iteration at an answer; where Krylov methods converge slowly, with A as a matrix."""

    _inverse: ContactPreconditioner | FormedInverse  # type: ignore[assignment]

    def derivatives(self, x: FloatArray, changes: Sequence[Change]) -> list[Derivative]:
        """As of the function `derivatives`; collective."""
        a, slips = self._a, self._settle(x)
        w, known, slope = self._w(self._A_x, self._alpha), self._problem.known_slip, self._problem.law.slope(x[0::3])
        krylov = self._krylov = self._new_krylov(self._sharper_product)
        try:
            border = self._border(w)
            points = round(self._over.sum(border.points.astype(np.float64)))
            found = []
            for change in changes:
                loads = self._T @ change.e if len(self._e) else NO_MOTION
                dx, dw, dalpha, settled = self._along(border, slips, change.b.reshape(-1, 3) / a, change.bound, loads)
                dx[known, 1:] = ((slope * dx[:, 0] + change.bound)[:, None] * slips)[known]
                step = self._equations.nearest_change(self._x, w, dx, dw, change.bound, self._over, border.points)
                found.append(Derivative(dx.ravel(), self._motion(dalpha), step if settled else 0.0, points))
            return found
        finally:
            krylov.free()

    def _border(self, w: FloatArray) -> Border:
        """The points whose state is not decided by the answer, as accurately as it is known; collective."""
        scale = self._scale()
        left = self._over.max(np.linalg.norm(self._at.value, axis=1) / scale)
        return Border.found(self._equations, self._at, self._x, w, max(_DECIDED, _TIMES * left) * scale)

    def _along(
        self, border: Border, slips: FloatArray, closing: FloatArray, bound: FloatArray, loads: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
        """dx, dw and dalpha along a change of b (m, 3), the bound (m,) and loads along motions, and whether the states
        of points on a border have been found; collective."""
        answer: ContactDerivative = self._at
        of_bound = np.where(answer.status == 2, bound, 0.0)[:, None] * slips
        for _ in range(_ATTEMPTS):
            rhs = np.einsum("iab,ib->ia", self._at.Q, closing)
            rhs[:, 1:] += of_bound
            dx, A_dx, dalpha = self._solved_for(rhs, loads)
            dw = self._constraints.without(A_dx - closing, dalpha)
            at, turned = border.along(dx, dw, bound)
            other = np.any(at.status != self._at.status) or np.any(np.abs(at.P - self._at.P) > _SETTLED)
            settled = not self._over.any(bool(other))
            if settled:
                break
            self._at, of_bound = at, np.where(border.rubbing[:, None], turned, of_bound)
        self._at = answer
        return dx, dw, dalpha, settled

    def gradient(
        self, x: FloatArray, of_x: FloatArray, of_alpha: FloatArray, undetermined: FloatArray, firm: bool
    ) -> tuple[Change, int]:
        """As of the function `gradient`; collective.

        By the transposed system [P^T + A Q^T, G^T; -G Q^T, 0] of multipliers (z, mu): Q^T z and mu are the derivatives
        along b and e.  In place of A dx its Krylov method carries A Q^T z.
        """
        slips, known, slope = self._settle(x), self._problem.known_slip, self._problem.law.slope(x[0::3])
        border = self._border(self._w(self._A_x, self._alpha))
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
        rows, inverse = self._scale()[:, None], self._inverse
        inverse.move(self._at)
        constraints = Constraints(self._scaled.comm, self._scaled.G, QG)
        bordered = ConstraintPreconditioner(inverse.transposed, constraints, 3, self._scaled.G)
        krylov = self._krylov = CarryingKrylov(
            constraints,
            3,
            lambda z: self._sharper_product(np.einsum("iab,ib->ia", Q, z)),
            lambda z, w: rows * (np.einsum("iab,ib->ia", P, z) + w),
            lambda r, s: bordered(r / rows, s),
            PETSc.KSP.Type.FGMRES,
        )
        try:
            self._accuracy = self._settings.sharpest
            size = math.hypot(self._over.norm(rows * g), float(np.linalg.norm(r3)))
            z: FloatArray = np.zeros_like(g)
            mu: FloatArray = np.zeros(len(self._e))
            if size > 0.0:
                z, _, mu, _ = krylov.solve(rows * g, z, self._accuracy * size, r3)
                _refuse_unsolved(krylov.left, size)
        finally:
            krylov.free()
        bound += np.where(self._at.status == 2, np.einsum("ka,ka->k", slips, z[:, 1:]), 0.0)
        e = -self._T.T @ mu if len(self._e) else NO_MOTION
        return Change(np.einsum("iab,ib->ia", Q, z).ravel() / self._a, bound, e), points

    def _settle(self, x: FloatArray) -> FloatArray:
        """To an answer x (3 m,) and the equations there; the directions of friction, shape (m, 2); collective."""
        self._x = x.reshape(-1, 3).copy()
        self._x[~self._problem.frictional, 1:] = 0.0
        self._A_x = self._images.exact(self._x)
        self._alpha = self._closing(self._x, self._A_x)
        self._at = self._equations.at(self._x, self._w(self._A_x, self._alpha))
        tangential = x.reshape(-1, 3)[:, 1:]
        size = np.linalg.norm(tangential, axis=1)
        directions: FloatArray = tangential / np.where(size > 0.0, size, 1.0)[:, None]
        return directions

    def _scale(self) -> FloatArray:
        """The force of every node by which its equations are judged, newtons, shape (m,)."""
        scale = self._problem.force_scale(self._x.ravel(), self._a * self._w(self._A_x, self._alpha).ravel())
        return np.where(scale > 1e-290, scale, 1.0)

    def _solved_for(self, rhs: FloatArray, loads: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """dx, A dx and dalpha of the derivative of the equations at the present point, for a right-hand side (m, 3) and
        loads along motions; collective."""
        self._rows = 1.0 / self._scale()[:, None]
        self._inverse.move(self._at)
        self._bordered = ConstraintPreconditioner(self._inverse, self._constraints, 3, self._at.Q @ self._scaled.G)
        largest = float(np.linalg.norm(loads))
        over_largest = self._over.min(self._rows.ravel()) * largest if largest else 0.0
        size, self._accuracy = math.hypot(self._over.norm(self._rows * rhs), over_largest), self._settings.sharpest
        if size == 0.0:
            return np.zeros_like(rhs), np.zeros_like(rhs), np.zeros(len(loads))
        enough = self._accuracy * max(size, _SLIGHT * self._over.norm(self._rows * self._x))
        dx, A_dx, dalpha, iterations = self._krylov.solve(self._rows * rhs, np.zeros_like(rhs), enough, loads)
        _refuse_unsolved(self._krylov.left, enough / self._accuracy)
        small = self._over.comm.size == 1 and dx.size <= _FORMED
        if iterations > _MANY and small and isinstance(self._problem.A, Formed):
            self._inverse = FormedInverse(self._scaled.dense(), self._scaled.diagonal)
        return dx, A_dx, dalpha

    def _sharper_product(self, x: FloatArray) -> FloatArray:
        return self._scaled.mult(x, _SPARE * self._krylov.allowed(self._accuracy))


def _refuse_unsolved(left: float, size: float) -> None:
    if not left <= _SOLVED * size:
        raise ValueError(
            f"the equations of its derivatives are singular, nearly: a part of {left / size:.0e} of them is left over. "
            "The answer is nearly one of several, or the function depends on friction that supports leave undetermined"
        )
