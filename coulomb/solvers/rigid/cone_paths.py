"""The curve of smoothed problems, for problems of rigid bodies on which the interior-point path is blocked.

    Z = W X + q + (eta |Z_t|_tau + tau) e,   X o Z = tau^2 e / rho,   |z|_tau = sqrt(|z|^2 + tau^2) - tau,
    eta = max(0, 1 - tau),   tau from 1 to 0

For every tau > 0 this has a solution wherever X in L, W X + q in L^* has one (V. Acary, F. Cadoux, C. Lemarechal, J.
Malick, ZAMM 91, 2011: their fixed point of the slip by Brouwer's theorem, here with the barrier of the cones), and at
tau = 1, where eta = 0, it is a convex problem with one solution.  So, generically, the solutions form a curve from
there to tau = 0, with the forces at its end or with forces that grow without bound.  Friction makes it turn: tau may
increase again for a part of it, and there Newton's method at a given, smaller tau is blocked.  Here tau is one of the
unknowns, and the curve is followed in predictor and corrector steps (E. L. Allgower, K. Georg: Introduction to
Numerical Continuation Methods, 2003): tau decreases where the determinant of the Newton matrix is positive, and
increases where it is negative.  That needs no knowledge of the last direction, so that a step to another part of the
curve does no harm.

X and Z are functions of one unknown V = X - rho Z: with its eigenvalues l in the algebra of the cone, those of X are
(l + r)/2, r = sqrt(l^2 + 4 tau^2), those of rho Z (r - l)/2.  Lengths are measured in V/r, and across the root of both
r: the size of a step relative to where a contact changes its state, or turns so far that it does.

Where bodies slide far on contacts of large friction no W X + q is in L^* with room to spare: there is no start at
tau = 1, or forces grow along the curve.  A curve from open contacts has tau (g + k X) in place of tau e, gaps g decades
apart and springs k of the contacts' own compliance: for every tau > 0 it has a solution (W + tau k is definite), and
at tau = 1 hardly any force.  Each g gives another curve, and some of them lead to a solution; not proved: that one
does.

Before it, the interior-point path of the same problem:

    Z = W X + q + |Z_t| e, X o Z = theta e, X and Z inside L (cones.py), theta to 0

X o Z is linearised with the scaling of Nesterov and Todd: with dZ = P c - P^2 dX,

    (W + E P^2) dX = E P c + F, E = 1 - e (0, Z_t)^T/|Z_t|, F = Z - W X - q - |Z_t| e

which is regular in the cone even where W is not: P^2 is positive definite, and at a contact that sticks or slips it
is small only along forces that W leaves undetermined.  Steps have Mehrotra's predictor and corrector.

|Z_t| is not differentiable at Z_t = 0, the sticking contacts, and the problem is not a minimisation: steps of the
linearisation may be blocked.  After such a step the next ones keep |Z_t| (E = 1), a step of the convex problem with
given slip (V. Acary, F. Cadoux, C. Lemarechal, J. Malick: A formulation of the linear discrete Coulomb friction problem
via convex optimization, ZAMM 91, 2011); Z stays inside L, and |Z_t| is updated after each step.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ...arrays import FloatArray
from .cones import ConeProblem, determinant, product, quotient, radius, scaling, step_to_boundary, times

_TO_BOUNDARY: Final = 0.99  # largest fraction of the distance to the boundary
_NEAR_PATH: Final = 1e-2  # smallest sqrt(det X det Z) over theta
_BLOCKED: Final = 0.1  # a step shorter than this is blocked
_KEPT: Final = 3  # steps with the slip kept after it, and more as long as they are blocked
_FEASIBLE: Final = 0.3  # with the slip kept, theta decreases where F is below this fraction of it ...
_CENTRING: Final = 0.3  # ... by this factor
_LEAST: Final = 0.05  # least centring


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
    """The path, step by step."""

    def __init__(self, problem: ConeProblem):
        self._problem, self._kept = problem, 0
        self._e = np.zeros((problem.contacts, 3))
        self._e[:, 0] = 1.0

    def start(self) -> ConeStep:
        """Equal pressure and gaps."""
        return self._point(self._e.copy(), self._e.copy())

    def _F(self, X: FloatArray, Z: FloatArray) -> FloatArray:
        F = Z - self._problem.w(X)
        F[:, 0] -= radius(Z)
        return F

    def _point(self, X: FloatArray, Z: FloatArray, sigma: float = 0.0, alpha: float = 0.0) -> ConeStep:
        m = self._problem.contacts
        size = float(np.linalg.norm(self._F(X, Z))) / np.sqrt(m)
        return ConeStep(X, Z, float(np.vdot(X, Z)) / m, size, sigma, alpha)

    def step(self, point: ConeStep) -> ConeStep | None:
        """The next point, by one Newton matrix; None if there is none."""
        X, Z, m = point.X, point.Z, self._problem.contacts
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            P = scaling(X, Z)
            keep = self._keeps(point)
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
            sigma = self._centring(point, keep, min(1.0, step_to_boundary(X, dX), step_to_boundary(Z, dZ)))
            second = product(times(P.P, dX), times(P.inverse, dZ))
            dX, dZ = direction(sigma * point.theta * self._e - square - second)
            alpha = min(1.0, _TO_BOUNDARY * min(step_to_boundary(X, dX), step_to_boundary(Z, dZ)))
        return self._centred(point, dX, dZ, sigma, alpha)

    def _keeps(self, point: ConeStep) -> bool:
        """Whether this step keeps the slip."""
        blocked = 0.0 < point.alpha < _BLOCKED
        self._kept = max(self._kept - 1, int(blocked)) if self._kept else _KEPT * int(blocked)
        return self._kept > 0

    def _centring(self, point: ConeStep, keep: bool, alpha: float) -> float:
        """sigma, from the length of the predictor; with the slip kept, theta must not decrease faster than F."""
        if keep:
            return _CENTRING if point.infeasibility < _FEASIBLE * point.theta else 1.0
        return max((1.0 - alpha) ** 3, _LEAST)

    def _centred(self, point: ConeStep, dX: FloatArray, dZ: FloatArray, sigma: float, alpha: float) -> ConeStep | None:
        """The longest step that stays near the path."""
        if not np.isfinite(alpha):
            return None
        while alpha > 1e-9:
            X, Z = point.X + alpha * dX, point.Z + alpha * dZ
            product_ = determinant(X) * determinant(Z)
            theta = float(np.vdot(X, Z)) / len(X)
            if float(product_.min()) >= (_NEAR_PATH * theta) ** 2:
                return self._point(X, Z, sigma, alpha)
            alpha *= 0.8
        return None


_FIRST, _LARGEST, _SHORTEST = 0.3, 3.0, 1e-6  # steps along the curve
_REACHED: Final = 1e-13  # tau over the largest force at which the curve ends
_APART: Final = (0.0, 2.0)  # log10 of the gaps of open contacts, over the largest of q
_STARTING: Final = 100  # Newton steps to its start


_ACCEPTED, _CONTRACTING = 0.3, 1.0  # largest correction of a point, and largest first one after a predictor
_AIM, _CORRECTIONS = 0.5, 4  # first correction that steps aim at, and the largest number of corrections
_WEIGHT: Final = 0.1
"""Rho over that of the natural map; on 13 problems whose forces oppose each other half the steps of 1."""


class CurvePoint:
    """A point (V, log tau), near the curve, with V = X - rho Z of shape (m, 3), rho forces over displacements, (m, 1).

    The gaps at tau = 1 have shape (m,), the springs' compliances `soft` (m, 1); both are without units.

    Attributes:
        X: Forces, inside L, shape (m, 3).
        Z: Displacements, inside L, shape (m, 3).
        G: Z - W X - q - (eta |Z_t|_tau + tau gaps) e - tau soft X, shape (m, 3), 0 on the curve.
    """

    def __init__(
        self, problem: ConeProblem, V: FloatArray, log: float, rho: FloatArray, gaps: FloatArray, soft: FloatArray
    ):
        self.V, self.log, self.tau = V, log, float(np.exp(log))
        tau, size = self.tau, radius(V)
        self._direction = V[:, 1:] / np.where(size > 0.0, size, 1.0)[:, None]
        self._l = np.stack([V[:, 0] - size, V[:, 0] + size])
        self._r = np.hypot(self._l, 2.0 * tau)
        larger = 0.5 * (np.abs(self._l) + self._r)
        smaller = tau**2 / larger
        self._x = np.where(self._l > 0.0, larger, smaller)
        self._z = np.where(self._l > 0.0, smaller, larger)
        self.X, self.Z = self._vectors(self._x), self._vectors(self._z) / rho
        eta, smoothed = max(0.0, 1.0 - tau), np.sqrt(radius(self.Z) ** 2 + tau**2)
        self._soft = tau * soft
        self.G: FloatArray = self.Z - problem.w(self.X) - self._soft * self.X
        self.G[:, 0] -= eta * (smoothed - tau) + tau * gaps
        self._E = np.tile(np.eye(3), (len(V), 1, 1))
        self._E[:, 0, 1:] = -eta * self.Z[:, 1:] / smoothed[:, None]
        moved = self._vectors(2.0 * tau**2 / self._r)  # dX/d(log tau) at this V, and rho dZ/d(log tau)
        problem.products += 1
        self.G_log = times(self._E, moved / rho) - (problem.W @ moved.ravel()).reshape(-1, 3)
        self.G_log -= self._soft * (self.X + moved)
        widened = tau * (smoothed - tau) if eta > 0.0 else 0.0
        self.G_log[:, 0] -= eta * (tau**2 / smoothed - tau) + tau * gaps - widened
        self._rho = rho

    def _vectors(self, eigenvalues: FloatArray) -> FloatArray:
        """Those with these eigenvalues (2, m) and the frames of V."""
        first, second = eigenvalues
        x = np.empty_like(self.V)
        x[:, 0], x[:, 1:] = 0.5 * (first + second), (0.5 * (second - first))[:, None] * self._direction
        return x

    def _blocks(self, eigenvalues: FloatArray, across: FloatArray) -> FloatArray:
        """Symmetric matrices with these eigenvalues (2, m) in the frames of V, and (m,) across, shape (m, 3, 3)."""
        first, second = eigenvalues
        d, B = self._direction, np.zeros((len(self.V), 3, 3))
        along = d[:, :, None] * d[:, None, :]
        B[:, 0, 0] = 0.5 * (first + second)
        B[:, 0, 1:] = B[:, 1:, 0] = (0.5 * (second - first))[:, None] * d
        B[:, 1:, 1:] = B[:, :1, :1] * along + across[:, None, None] * (np.eye(2) - along)
        return B

    def newton_blocks(self) -> tuple[FloatArray, FloatArray]:
        """L and D of the transposed matrix L W + D for dV at constant tau; with those for dX, that are as far apart as
        z/x, a contact that slips would lose to rounding errors what resists it along its slip."""
        dX, dZ = (self._blocks(v / self._r, v.sum(axis=0) / self._r.sum(axis=0)) for v in (self._x, self._z))
        return dX, (self._E @ dZ / self._rho[:, :, None] + self._soft[:, :, None] * dX).transpose(0, 2, 1)

    def moved(self, dV: FloatArray) -> FloatArray:
        """V + dV, with the smaller r's eigenvalue l linear in dV: |V_t| is not, where V_t turns."""
        before, after = np.hypot(radius(self.V), self.tau), np.hypot(radius(self.V + dV), self.tau)
        second = after - before - np.einsum("ij,ij->i", self.V[:, 1:], dV[:, 1:]) / before
        V = self.V + dV
        V[:, 0] += second * (self._r[1] - self._r[0]) / self._r.sum(axis=0)
        return V

    def relative(self, dV: FloatArray) -> FloatArray:
        """dV over r, per contact, shape (m, 3)."""
        return times(self._blocks(1.0 / self._r, 1.0 / np.sqrt(self._r[0] * self._r[1])), dV)


class _Directions(NamedTuple):
    """What a factorised Newton matrix says at a point: steps in V.

    Attributes:
        correction: To the curve at constant tau.
        along: dV/d(log tau) of the curve.
        forward: Sign of log tau along the curve, from its start to its end.
    """

    correction: FloatArray
    along: FloatArray
    forward: float


class ConeCurve:
    """The curve, step by step; `opened` is the number of one from open contacts, None for gaps of 1 without springs.

    Attributes:
        rejected: Steps that were too long.
        h: Length of the next step.
    """

    def __init__(self, problem: ConeProblem, opened: int | None = None):
        self._problem, self.h, m = problem, _FIRST, problem.contacts
        self._gaps: FloatArray = np.ones(m)
        self._soft: FloatArray = np.zeros((m, 1))
        if opened is not None:
            apart = 10.0 ** np.random.default_rng(opened).uniform(*_APART, m)
            self._gaps, self._soft = apart * float(np.abs(problem.q).max()), 1.0 / problem.rho
        self._rho: FloatArray = _WEIGHT * problem.rho
        self.rejected = 0

    def start(self) -> CurvePoint | None:
        """The solution at tau = 1, by damped Newton steps; None where they fail."""
        problem = self._problem
        point = self._point(np.zeros((problem.contacts, 3)), 0.0)
        for _ in range(_STARTING):
            directions = self._directions(point)
            if directions is None:
                return None
            self._found = directions
            if float(np.abs(point.relative(directions.correction)).max()) < 0.1 * _ACCEPTED:
                return point
            size, alpha = float(np.linalg.norm(point.G)), 1.0
            new = self._point(point.moved(directions.correction), 0.0)
            while not np.linalg.norm(new.G) < (1.0 - 1e-4 * alpha) * size and alpha > _SHORTEST:
                alpha *= 0.5
                new = self._point(point.moved(alpha * directions.correction), 0.0)
            point = new
        return None

    def _point(self, V: FloatArray, log: float) -> CurvePoint:
        return CurvePoint(self._problem, V, log, self._rho, self._gaps, self._soft)

    def _directions(self, point: CurvePoint) -> _Directions | None:
        matrix = self._problem.matrix
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            L, D = point.newton_blocks()
            if not matrix.factorise(D, L):
                return None
            correction, along = matrix.solve(point.G, transposed=True), matrix.solve(point.G_log, transposed=True)
            if not (np.isfinite(correction).all() and np.isfinite(along).all()):
                return None
        return _Directions(correction, along, -matrix.sign())

    def step(self, point: CurvePoint) -> CurvePoint | None:
        """The next point; None at the end of the curve, or where no step succeeds."""
        if point.tau < _REACHED * float(np.abs(point.X).max()):
            return None
        directions = self._found
        length = _norm(point, directions.along, 1.0)
        t, t_log = directions.forward * directions.along / length, directions.forward / length
        back = -_inner(point, t, t_log, directions.correction, 0.0) / _inner(point, t, t_log, directions.along, 1.0)
        dV, log = directions.correction + back * directions.along, point.log + back
        while self.h > _SHORTEST:
            new, first = self._corrected(self._point(point.moved(dV + self.h * t), log + self.h * t_log), t, t_log)
            if new is not None:
                grown = min(2.0, max(0.3, np.sqrt(_AIM / max(first, 1e-9))))
                self.h = min(self.h * grown, _LARGEST / max(abs(t_log), 0.1))
                return new
            self.rejected += 1
            self.h *= 0.5
        return None

    def _corrected(self, point: CurvePoint, t: FloatArray, t_log: float) -> tuple[CurvePoint | None, float]:
        """A point near the curve, by Newton steps orthogonal to (t, t_log), and the size of the first correction."""
        first, last = 0.0, np.inf
        for number in range(_CORRECTIONS):
            directions = self._directions(point)
            if directions is None:
                break
            along = _inner(point, t, t_log, directions.along, 1.0)
            d_log = -_inner(point, t, t_log, directions.correction, 0.0) / along if along else np.inf
            dV = directions.correction + d_log * directions.along
            size = max(float(np.sqrt((point.relative(dV) ** 2).sum(axis=1)).max()), abs(d_log))
            first = first if number else size
            if size < _ACCEPTED:
                self._found = directions
                return point, first
            if not size < min(_CONTRACTING, 0.5 * last):
                break
            last = size
            point = self._point(point.moved(dV), point.log + d_log)
        return None, first


def _inner(point: CurvePoint, V: FloatArray, log: float, dV: FloatArray, dlog: float) -> float:
    """The scalar product of two steps, that of V/r in the mean over the contacts."""
    return float(np.vdot(point.relative(V), point.relative(dV))) / len(V) + log * dlog


def _norm(point: CurvePoint, dV: FloatArray, dlog: float) -> float:
    return float(np.sqrt(_inner(point, dV, dlog, dV, dlog)))
