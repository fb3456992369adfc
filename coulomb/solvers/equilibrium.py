"""Whether contact can balance the loads of bodies that it alone holds, before the friction problem is solved.

Is there x with x_n >= lower, |x_t| <= r(x_n), G x = e?  This is a convex question, a second-order cone problem with few
equations.  From the interior point x0 (equal pressure, no friction) to the loads,

    maximise mu  subject to  G x = e + mu (e - G x0),   x in the cones,   mu <= 1

mu = -1 is x0, and forces in equilibrium exist if mu reaches 0.  Otherwise the multiplier alpha of the equations is a
certificate, a rigid motion on which the loads do more work than any contact forces can resist:

    e . alpha  >  max over x of (G x) . alpha

Solved by a barrier method with Newton steps on (x, mu); a step costs q x q systems summed over nodes, and no product by
A.  Forces are bounded by a multiple of the mean one, so that bodies can be squeezed without end.

Coulomb's law is not associated: a sliding contact does not open, whereas on alpha it does, with F times the slip.  If
there are no forces in equilibrium, Coulomb's problem has no solution.  The converse does not hold: a body between two
walls could be held by any squeezing force, but if nothing squeezes it, the loads drag it along.  Then steps block while
alpha grows along the motion; `sliding` recognises that.

`limit_load` asks a similar question and does not serve here: its forces are extreme ones, zero at most nodes, whereas
the forces found here are where the interior-point method begins; nor does it solve problems with lower bounds.
"""

from __future__ import annotations
import math
import numpy as np
from ..arrays import FloatArray
from .friction_problem import FrictionProblem
from .results import NotConverged, SolverResult, Status
from .rigid_motions import NO_MOTION, Equilibrium, MotionBasis, RigidMotions
from dataclasses import dataclass, field, replace
from functools import cached_property
from ..linalg.reductions import Reductions
from .laws import FrictionLaw
from .rigid_motions import RigidMotions


# Whether contact forces can balance the loads along rigid motions at all, and which part of them they can.
#
# Contact forces under the law of friction, x_n >= 0 and |x_t| <= c + F x_n, have the resultants G x along the motions:
# a convex set, the sum of the cones of all nodes and of a bounded set where there is cohesion.  Loads e outside of it
# are in equilibrium with no contact forces, whatever the bodies are made of; the distance of e from it has a gradient
# y, a rigid motion on which the loads do work, while contact does not resist it.
#
# The set is described from inside by extreme resultants, as many as needed: a linear programme over those known so far
# gives y, and each node its extreme force along y, in closed form; when none is better than those known, the distance
# is exact (column generation; Dantzig and Wolfe 1960).  The programme has as many rows as there are motions.
#
# The barrier method of `equilibrium` does not serve here: it bounds forces by a multiple of the mean one and decides to
# 1e-9 of a nominal force, whereas amounts are reported here, with forces as large as they need to be.
#
# scipy.optimize takes 20 ms to load, and is needed only where contact alone holds a body.

BALANCED = 1e-5
"""Loads may be in equilibrium if what is left over is at most this part of them: the solver then decides."""

_EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
"""Of the linear programmes; the smallest that HiGHS accepts."""

_BETTER = 1e-8
"""A force is no better than those known if its gain is below this, relative to the largest possible gain."""

_PER_ROUND = 40
"""Forces that a rank adds at most in a round."""

_ROUNDS = 200

_PENALTY = 1e4
"""Weight of what is left over, against the part of the loads that is held."""


@dataclass
class LimitLoad:
    """The resultants that contact forces can have along rigid motions.

    Args:
        rigid: The motions and the loads along them.
        law: Of friction at this rank's m contact nodes.
        over: The ranks.
    """

    rigid: RigidMotions
    law: FrictionLaw
    over: Reductions
    _rays: list[FloatArray] = field(default_factory=list)
    _bounded: list[FloatArray] = field(default_factory=list)

    def unbalanced(self) -> FloatArray | None:
        """The motion along which loads do work and contact does not resist, largest component 1, shape (q,); None if
        contact forces can balance the loads; collective.

        It is the difference between the loads and the nearest resultant of contact forces.
        """
        if self._size == 0.0:
            return None
        found = self._solve(self.rigid.e / self._size, None)
        if found is None or found.left <= BALANCED:
            return None
        for _ in range(_ROUNDS):
            motion = self.over.comm.bcast(self._difference(found) if self.over.comm.rank == 0 else None)
            found = replace(found, motion=motion)
            if not self._extended(found):
                break
        return found.motion

    def drives(self, motion: FloatArray) -> bool:
        """Whether loads do work on a motion (q,) and no contact force resists it; collective."""
        gain, bounded = self._resistance(motion)[1:]
        size = self.over.max(np.abs(self.rigid.G)) or 1.0
        work = float(motion @ self.rigid.e) / self._size
        free = self.over.max(gain) <= _BETTER * size * float(np.max(np.abs(motion)))
        return free and work - float(motion @ bounded) > BALANCED

    def _difference(self, found: _Found) -> FloatArray:
        """Between the loads, less bounded forces, and the nearest resultant of the known rays, largest component 1."""
        from scipy.optimize import nnls

        target = self.rigid.e / self._size - found.bounded
        columns = np.array(self._rays).reshape(-1, len(target)).T
        left: FloatArray = target - columns @ nnls(columns, target)[0] if columns.size else target
        return left / (np.max(np.abs(left)) or 1.0)

    def held_part(self, changed: FloatArray) -> float | None:
        """The largest part s <= 1 of the loads `changed` (q,) which contact forces balance beside the others, e -
        changed + s changed; None if they do not even balance the others; collective."""
        found = self._solve((self.rigid.e - changed) / self._size, changed / self._size)
        return None if found is None or found.left > BALANCED else found.part

    @cached_property
    def _size(self) -> float:
        """Size of the loads, by which all resultants are divided, newtons."""
        return float(np.sum(np.abs(self.rigid.e)))

    def _solve(self, fixed: FloatArray, scaled: FloatArray | None) -> _Found | None:
        for _ in range(_ROUNDS):
            found: _Found = self.over.comm.bcast(self._programme(fixed, scaled) if self.over.comm.rank == 0 else None)
            if scaled is None and found.left <= 0.01 * BALANCED:
                return found
            if not self._extended(found):
                return found
        return None

    def _programme(self, fixed: FloatArray, scaled: FloatArray | None) -> _Found:
        """The linear programme over the known forces: the smallest sum of what is left over, or the largest part."""
        from scipy.optimize import linprog

        q = len(fixed)
        columns = np.array([*self._rays, *self._bounded]).reshape(-1, q)
        count, parts = len(columns), 0 if scaled is None else 1
        equal = np.hstack([columns.T, np.eye(q), -np.eye(q), *([] if scaled is None else [-scaled[:, None]])])
        cost = np.concatenate([np.zeros(count), np.full(2 * q, _PENALTY if parts else 1.0), -np.ones(parts)])
        below = np.zeros((1, equal.shape[1]))
        below[0, len(self._rays) : count] = 1.0
        bounds = [(0.0, None)] * (count + 2 * q) + [(0.0, 1.0)] * parts
        answer = linprog(cost, below, [1.0], equal, fixed, bounds, method="highs", options=_EXACT)
        left = float(np.sum(answer.x[count : count + 2 * q]))
        motion = np.asarray(answer.eqlin.marginals)
        motion = motion / (np.max(np.abs(motion)) or 1.0)
        used = float(np.asarray(answer.ineqlin.marginals)[0]) / (np.max(np.abs(answer.eqlin.marginals)) or 1.0)
        bounded = columns[len(self._rays) :].T @ answer.x[len(self._rays) : count]
        return _Found(left, motion, -used, float(answer.x[-1]) if parts else 0.0, bounded)

    def _extended(self, found: _Found) -> bool:
        """Add the extreme forces along a motion; whether there are any that are better; collective."""
        G = self.rigid.G.reshape(len(found.motion), -1, 3)
        forces, gain, bounded = self._resistance(found.motion)
        size = self.over.max(np.abs(G)) or 1.0
        better = np.flatnonzero(gain > _BETTER * size)
        better = better[np.argsort(-gain[better], kind="stable")[:_PER_ROUND]]
        rays = np.einsum("jmc,mc->mj", G[:, better], forces[better])
        new = [ray for own in self.over.comm.allgather(list(rays)) for ray in own]
        self._rays += new
        gained = float(found.motion @ bounded)
        if gained > found.used + _BETTER * float(np.sum(np.abs(bounded))):
            self._bounded.append(bounded)
            return True
        return len(new) > 0

    def _resistance(self, motion: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The extreme force of each node against a motion, shape (m, 3), the work that it does, shape (m,), and the
        resultant of the bounded forces over the size of the loads, shape (q,); collective."""
        G, law = self.rigid.G.reshape(len(motion), -1, 3), self.law
        moved = np.einsum("j,jmc->mc", motion, G)
        slip = np.hypot(moved[:, 1], moved[:, 2])
        along = moved[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
        weight = 1.0 / (1.0 + law.friction)  # of a force with pressure 1
        gain = weight * (moved[:, 0] + law.friction * slip)
        forces = weight[:, None] * np.column_stack([np.ones(len(gain)), law.friction[:, None] * along])
        cohesion = np.where(slip > 0.0, law.cohesion, 0.0)
        bounded = self.over.total(np.einsum("jmc,mc->j", G[:, :, 1:], cohesion[:, None] * along)) / self._size
        return forces, gain, bounded


@dataclass(frozen=True)
class _Found:
    """Answer of the linear programme.

    Attributes:
        left: What is left over, relative to the loads.
        motion: Along which it is, largest component 1, shape (q,).
        used: Largest known resultant of the bounded forces along the motion.
        part: The part of the changed loads that is held.
        bounded: Resultants of the bounded forces, relative to the loads, shape (q,).
    """

    left: float
    motion: FloatArray
    used: float
    part: float
    bounded: FloatArray


_LARGEST = 1e4  # bound of the normal forces over their nominal size
_BALANCED = 1e-8  # relative error of equilibrium along motions that nothing resists
_GAP = 1e-9  # bound of mu - mu* at the end; a smaller |mu*| is called equilibrium
_SHARP = 1e-3  # relative accuracy of the certificate
_STEPS = 300
_FAR = 5.0  # rigid motion over deformation of a body that slides away


def equilibrium(problem: FrictionProblem) -> Equilibrium:
    """Whether contact forces within the bounds of friction can balance the loads; collective.

    Args:
        problem: A problem with rigid motions.

    Returns:
        Forces in equilibrium, or a motion that shows that there are none.

    Raises:
        ValueError: If the problem has no rigid motions.
    """
    rigid, over, basis = problem.rigid, problem.reductions, problem.motion_basis
    assert rigid is not None
    m = problem.A.nodes
    x = np.zeros((m, 3))
    x[:, 0] = problem.lower
    loads = rigid.out_of_balance(x.ravel(), over)
    resisted, free = basis.T @ loads, basis.free.T @ loads
    size = float(np.linalg.norm(resisted))
    if np.linalg.norm(free) > _BALANCED * basis.size * size:
        motion = basis.free @ (free / np.linalg.norm(free))
        return Equilibrium(False, x.ravel(), motion, motion, float(motion @ rigid.e), 0.0)
    if size == 0.0:
        return Equilibrium(True, x.ravel())
    return _Cones(problem, basis, size / math.sqrt(over.sum(float(m)))).search(basis.T @ rigid.e)


def balanced_forces(problem: FrictionProblem, method: str) -> FloatArray | None:
    """Forces in equilibrium within the bounds of friction, newtons, shape (3 m,); None if supports hold all bodies.

    Args:
        problem: The problem.
        method: Name of the solver.

    Raises:
        NotConverged: If there are none, with the status NO_EQUILIBRIUM; collective.
    """
    if problem.rigid is None:
        return None
    found, products = equilibrium(problem), problem.A.products
    if found.exists:
        return found.x
    without = problem.without_motion(found.x)
    alpha = problem.rigid_motion(found.x, without)
    gradient = without - problem.rigid.displacement(alpha)
    message = no_equilibrium(problem.rigid, found)
    result = SolverResult(
        x=found.x,
        gradient=gradient,
        slip_bound=problem.slip_bound(found.x),
        multipliers=np.zeros((problem.A.nodes, 2)),
        status=Status.NO_EQUILIBRIUM,
        products=problem.A.products - products,
        residual=problem.residual(found.x, gradient),
        method=method,
        message=message,
        rigid=alpha,
        equilibrium=found,
    )
    raise NotConverged(message, result)


def sliding(
    problem: FrictionProblem, x: FloatArray, gradient: FloatArray, alpha: FloatArray, ended: bool = False
) -> Equilibrium | None:
    """Whether the bodies slide away in an iteration whose steps are blocked; None if it does not look so; collective.

    They do if alpha is far larger than the deformation, and the loads do more work on it than contact forces with the
    present pressures and all friction against the motion.  This is an observation, not a proof.  While the iteration
    may recover, alpha is compared with the deformation and the gap of all nodes, at its end with those where there is
    pressure.

    Args:
        problem: The problem.
        x: Contact forces in newtons, shape (3 m,).
        gradient: w in metres, shape (3 m,).
        alpha: Rigid motions, shape (q,).
        ended: Whether the iteration has ended.
    """
    rigid, over = problem.rigid, problem.reductions
    if rigid is None:
        return None
    moved = rigid.displacement(alpha)
    weights = np.sqrt(np.repeat(np.maximum(x[0::3], 0.0), 3))
    far, deformed = (over.norm(weights * w) if ended else over.max(np.abs(w)) for w in (moved, gradient + moved))
    if far <= _FAR * deformed:
        return None
    direction = alpha / np.linalg.norm(alpha)
    v, load = rigid.displacement(direction).reshape(-1, 3), float(rigid.e @ direction)
    resistance = over.dot(x[0::3], v[:, 0]) + over.dot(problem.slip_bound(x), np.hypot(v[:, 1], v[:, 2]))
    return Equilibrium(False, x, NO_MOTION, direction, load, resistance, False) if load > resistance else None


def no_equilibrium(rigid: RigidMotions, found: Equilibrium) -> str:
    """What an equilibrium that does not exist means, in words."""
    forces = "contact within the bounds of friction" if found.proven else "contact, at the pressures that it has,"
    return (
        f"no equilibrium: the loads push along {rigid.described(found.direction)} with {found.load:.3g} (force times "
        f"displacement), and {forces} resists with at most {found.resistance:.3g}"
    )


class _Cones:
    """The barrier method; forces in units of a nominal nodal force s above their lower bound.

    Args:
        problem: The problem.
        basis: Its motions with resistance.
        s: Newtons.
    """

    def __init__(self, problem: FrictionProblem, basis: MotionBasis, s: float):
        self._problem, self._basis, self._s, self._over = problem, basis, s, problem.reductions
        m, self._frictional = problem.A.nodes, problem.frictional
        self._G: FloatArray = (basis.T @ basis.G).T.reshape(m, 3, len(basis.T))
        self._lower = np.broadcast_to(np.asarray(problem.lower, dtype=float) / s, (m,))
        self._F = np.where(self._frictional, problem.law.friction, 0.0)
        self._c = np.where(self._frictional, problem.law.cohesion / s + self._F * self._lower, 1.0)

    def search(self, resultant: FloatArray) -> Equilibrium:
        """The largest mu, as far as it decides."""
        over = self._over
        x: FloatArray = np.zeros((len(self._F), 3))
        x[:, 0] = 1.0
        below = self._sum(np.column_stack([self._lower, np.zeros((len(x), 2))]))
        e = resultant / self._s - below
        d, mu, t = e - self._sum(x), -1.0, 1.0
        start = x.copy()
        if float(np.linalg.norm(d)) == 0.0:
            return Equilibrium(True, self._newtons(x))
        parameters = over.sum(2.0 + 2.0 * self._frictional) + 1.0
        alpha: FloatArray = np.zeros_like(e)
        bound, certificate = math.inf, alpha
        for _ in range(_STEPS):
            gradient, H = self._barrier(x)
            H_inverse = np.linalg.inv(H)
            HG, Hg = H_inverse @ self._G, np.einsum("iab,ib->ia", H_inverse, gradient)
            S = over.total(self._G.reshape(x.size, len(e)).T @ HG.reshape(x.size, len(e)))
            room = 1.0 - mu
            lacking = e + mu * d - self._sum(x)
            right = lacking + self._sum(Hg) + d * (t * room - 1.0) * room
            matrix = S + np.outer(d, d) * room**2
            alpha = np.linalg.lstsq(matrix, right, rcond=None)[0]
            dx = np.einsum("iaq,q->ia", HG, alpha) - Hg
            dmu = (t * room - 1.0 - float(d @ alpha) * room) * room
            decrement = math.sqrt(over.sum(np.einsum("ia,iab,ib", dx, H, dx)) + (dmu / room) ** 2)
            value, candidate = self._dual(alpha / t, e, d)
            if value < bound:
                bound, certificate = value, candidate
            length = 1.0 if decrement < 0.25 else self._length(x, mu, dx, dmu, t, decrement)
            x, mu = x + length * dx, mu + length * dmu
            if mu > 0.0:
                part = mu / (1.0 + mu)
                return Equilibrium(True, self._newtons((1.0 - part) * x + part * start))
            if bound < -_GAP and bound - mu <= _SHARP * abs(mu):
                break
            if decrement < 0.5:
                if parameters / t < 0.1 * _GAP:
                    break
                t *= 10.0
        if bound >= -_GAP:
            return Equilibrium(True, self._newtons(x))
        return self._none(x, certificate)

    def _sum(self, x: FloatArray) -> FloatArray:
        """G x over all ranks, shape (r,)."""
        return self._over.total(np.einsum("iaq,ia->q", self._G, x))

    def _newtons(self, x: FloatArray) -> FloatArray:
        forces = x.copy()
        forces[:, 0] += self._lower
        forces[~self._frictional, 1:] = 0.0
        return self._s * forces.ravel()

    def _barrier(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (m, 3) and Hessian (m, 3, 3) of -log x_n - log (r^2 - |x_t|^2) - log (largest - x_n)."""
        x_n, x_t, F, on = x[:, 0], x[:, 1:], self._F, self._frictional
        r = self._c + F * x_n
        D = np.where(on, r**2 - np.sum(x_t**2, axis=1), 1.0)
        dD = np.column_stack([2.0 * r * F, -2.0 * x_t]) * on[:, None]
        gradient = -dD / D[:, None]
        gradient[:, 0] += -1.0 / x_n + 1.0 / (_LARGEST - x_n)
        H: FloatArray = dD[:, :, None] * dD[:, None, :] / D[:, None, None] ** 2
        H[:, 0, 0] += 1.0 / x_n**2 + 1.0 / (_LARGEST - x_n) ** 2 - 2.0 * F**2 / D
        H[:, [1, 2], [1, 2]] += 2.0 / D[:, None]
        return gradient, H

    def _length(self, x: FloatArray, mu: float, dx: FloatArray, dmu: float, t: float, decrement: float) -> float:
        """A step length inside the cones that decreases -t mu - log (1 - mu) and the barrier."""
        F, on = self._F, self._frictional
        r, dr = self._c + F * x[:, 0], F * dx[:, 0]
        C = np.where(on, r**2 - np.sum(x[:, 1:] ** 2, axis=1), 1.0)
        B = np.where(on, r * dr - np.sum(x[:, 1:] * dx[:, 1:], axis=1), 0.0)
        A = np.where(on, dr**2 - np.sum(dx[:, 1:] ** 2, axis=1), 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = C / (-B + np.sqrt(B**2 - A * C))
            low = np.where(dx[:, 0] < 0.0, -x[:, 0] / dx[:, 0], math.inf)
            high = np.where(dx[:, 0] > 0.0, (_LARGEST - x[:, 0]) / dx[:, 0], math.inf)
        roots = np.where(roots > 0.0, roots, math.inf)  # NaN: no root
        length = min(1.0, 0.95 * min(self._over.min(roots), self._over.min(low), self._over.min(high)))
        if dmu > 0.0:
            length = min(length, 0.95 * (1.0 - mu) / dmu)

        def change(a: float) -> float:
            left = np.where(on, (C + 2.0 * a * B + a**2 * A) / C, 1.0)
            n = (1.0 + a * dx[:, 0] / x[:, 0]) * (1.0 - a * dx[:, 0] / (_LARGEST - x[:, 0]))
            barrier = -self._over.sum(np.log(left) + np.log(n))
            return barrier - t * a * dmu - math.log(1.0 - a * dmu / (1.0 - mu))

        while length > 1e-10 and change(length) > -0.1 * length * decrement**2:
            length *= 0.7
        return length

    def _reach(self, v: FloatArray) -> float:
        """The most work of forces within the cones on motions v (m, 3) of the nodes."""
        slip = np.where(self._frictional, np.hypot(v[:, 1], v[:, 2]), 0.0)
        opening = np.maximum(v[:, 0] + self._F * slip, 0.0)
        return self._over.sum(self._c * slip + _LARGEST * opening)

    def _dual(self, alpha: FloatArray, e: FloatArray, d: FloatArray) -> tuple[float, FloatArray]:
        """An upper bound of mu, and the motion that proves it."""
        alpha = alpha / max(1.0, float(alpha @ d))
        bound = 1.0 - float(alpha @ d) + self._reach(self._G @ alpha) - float(alpha @ e)
        return bound, alpha

    def _none(self, x: FloatArray, alpha: FloatArray) -> Equilibrium:
        """The certificate in the user's units, and its part that keeps the contact closed."""
        rigid = self._problem.rigid
        assert rigid is not None
        motion = self._basis.T.T @ alpha
        lower = np.column_stack([self._lower, np.zeros((len(x), 2))])
        reach = self._s * (self._reach(self._G @ alpha) + float(alpha @ self._sum(lower)))
        closed = self._closed(x)
        direction = closed @ (closed.T @ motion)
        if np.linalg.norm(direction) < 0.01 * np.linalg.norm(motion):  # nothing but opening: a body is lifted
            direction = motion
        unit = float(np.linalg.norm(direction))
        load, resistance = float(rigid.e @ direction) / unit, (reach - float(rigid.e @ (motion - direction))) / unit
        if abs(resistance) < _SHARP * load:
            resistance = max(resistance, 0.0)  # of the accuracy of the certificate
        return Equilibrium(False, self._newtons(x), motion / np.linalg.norm(motion), direction / unit, load, resistance)

    def _closed(self, x: FloatArray) -> FloatArray:
        """Orthonormal motions (q, k) that do not open or close the contact where there is pressure."""
        rigid = self._problem.rigid
        assert rigid is not None
        rows = rigid.G[:, 0::3] * np.sqrt(x[:, 0])
        squares, V = np.linalg.eigh(self._over.total(rows @ rows.T))
        kept: FloatArray = V[:, squares < _SHARP * squares[-1]]
        return kept
