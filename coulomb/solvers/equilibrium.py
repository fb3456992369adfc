"""Whether contact forces can balance the loads of bodies that contact alone holds, and which part of them they can.

Contact forces under the law of friction, x_n >= lower and |x_t| <= r(x_n), have the resultants G x along the rigid
motions: a convex set, the sum of the cones of all nodes and of a bounded set where there is cohesion.  Loads e outside
of it are in equilibrium with no contact forces, whatever the bodies are made of; the difference between e and the
nearest resultant is a rigid motion alpha on which the loads do more work than any contact forces resist,

    e . alpha  >  max over x of (G x) . alpha

The set is described from inside by extreme resultants, as many as needed: a linear programme over those known so far
gives a motion, and each node its extreme force along it, in closed form; when none is better than those known, the
distance is exact (column generation; Dantzig and Wolfe 1960).  The programme has as many rows as there are motions.

Coulomb's law is not associated: a sliding contact does not open, whereas on alpha it does, with F times the slip.  If
there are no forces in equilibrium, Coulomb's problem has no solution.  The converse does not hold: a body between two
walls could be held by any squeezing force, but if nothing squeezes it, the loads drag it along.  Then no method finds
an answer while alpha grows along the motion; `sliding` names it, without a proof.

scipy.optimize takes 20 ms to load, and is needed only where contact alone holds a body.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .friction_problem import FrictionProblem
from .laws import FrictionLaw
from .results import NotConverged, SolverResult, Status
from .rigid_motions import NO_MOTION, Equilibrium, RigidMotions

BALANCED: Final = 1e-5
"""Loads may be in equilibrium if what is left over is at most this part of them: the solver then decides."""

EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
"""Of the linear programmes; the smallest that HiGHS accepts."""

_BETTER: Final = 1e-8
"""A force is no better than those known if its gain is below this, relative to the largest possible gain."""

_PER_ROUND: Final = 40
"""Forces that a rank adds at most in a round."""

_ROUNDS: Final = 200

_PENALTY: Final = 1e4
"""Weight of what is left over, against the part of the loads that is held."""


@dataclass
class LimitLoad:
    """The resultants that contact forces can have along rigid motions.

    Args:
        rigid: The motions and the loads along them.
        law: Of friction at this rank's m contact nodes, without limits, and F constant (`FrictionLaw.majorants`).
        over: The ranks.
    """

    rigid: RigidMotions
    law: FrictionLaw
    over: Reductions
    _rays: list[FloatArray] = field(default_factory=list)
    _bounded: list[FloatArray] = field(default_factory=list)
    _own: list[tuple[int, int, FloatArray]] = field(default_factory=list)
    _frictions: list[FloatArray] = field(default_factory=list)
    _weights: tuple[FloatArray, FloatArray] = (NO_MOTION, NO_MOTION)

    def forces(self) -> FloatArray:
        """This rank's part of the forces nearest to equilibrium that were found last, newtons, shape (m, 3)."""
        x = np.zeros((len(self.law.friction), 3))
        rays, bounded = self._weights
        for ray, node, force in self._own:
            if ray < len(rays):
                x[node] += self._size * rays[ray] * force
        for weight, friction in zip(bounded, self._frictions, strict=False):
            x[:, 1:] += weight * friction
        return x

    def unbalanced(self) -> FloatArray | None:
        """The motion along which loads do work and contact does not resist, largest component 1, shape (q,); None if
        contact forces can balance the loads; collective.

        It is the difference between the loads and the nearest resultant of contact forces.
        """
        if self._size == 0.0:
            return None
        balance = self._solve(self.rigid.e / self._size, None)
        if balance is None or balance.left <= BALANCED:
            return None
        for _ in range(_ROUNDS):
            motion = self.over.comm.bcast(self._difference(balance) if self.over.comm.rank == 0 else None)
            balance = replace(balance, motion=motion)
            if not self._extended(balance):
                break
        return balance.motion

    def drives(self, motion: FloatArray) -> bool:
        """Whether loads do work on a motion (q,) and no contact force resists it; collective."""
        _, gain, _, bounded = self._resistance(motion)
        size = self.over.max(np.abs(self.rigid.G)) or 1.0
        work = float(motion @ self.rigid.e) / self._size
        free = self.over.max(gain) <= _BETTER * size * float(np.max(np.abs(motion)))
        return free and work - float(motion @ bounded) > BALANCED

    def resistance(self, motion: FloatArray) -> float:
        """The most work of the bounded forces against a motion (q,), newtons; collective."""
        return self._size * float(motion @ self._resistance(motion)[3])

    def _difference(self, balance: _Found) -> FloatArray:
        """Between the loads, less bounded forces, and the nearest resultant of the known rays, largest component 1."""
        from scipy.optimize import lsq_linear  # nnls of SciPy 1.15 ends before the nearest

        target = self.rigid.e / self._size - balance.bounded
        columns = np.array(self._rays).reshape(-1, len(target)).T
        left = target
        if columns.size:
            left = target - columns @ lsq_linear(columns, target, (0.0, np.inf), method="bvls", tol=1e-14).x
        return left / (np.max(np.abs(left)) or 1.0)

    def held_part(self, changed: FloatArray) -> float | None:
        """The largest part s <= 1 of the loads `changed` (q,) which contact forces balance beside the others, e -
        changed + s changed; None if they do not even balance the others; collective."""
        balance = self._solve((self.rigid.e - changed) / self._size, changed / self._size)
        return None if balance is None or balance.left > BALANCED else balance.part

    @cached_property
    def _size(self) -> float:
        """Size of the loads, by which all resultants are divided, newtons."""
        return float(np.sum(np.abs(self.rigid.e)))

    def _solve(self, fixed: FloatArray, scaled: FloatArray | None) -> _Found | None:
        for _ in range(_ROUNDS):
            balance: _Found = self.over.comm.bcast(self._programme(fixed, scaled) if self.over.comm.rank == 0 else None)
            self._weights = balance.rays, balance.frictions
            if scaled is None and balance.left <= 0.01 * BALANCED:
                return balance
            if not self._extended(balance):
                return balance
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
        answer = linprog(cost, below, [1.0], equal, fixed, bounds, method="highs", options=EXACT)
        left = float(np.sum(answer.x[count : count + 2 * q]))
        motion = np.asarray(answer.eqlin.marginals)
        motion = motion / (np.max(np.abs(motion)) or 1.0)
        used = float(np.asarray(answer.ineqlin.marginals)[0]) / (np.max(np.abs(answer.eqlin.marginals)) or 1.0)
        bounded = columns[len(self._rays) :].T @ answer.x[len(self._rays) : count]
        part, weights = float(answer.x[-1]) if parts else 0.0, answer.x[:count]
        return _Found(left, motion, -used, part, bounded, weights[: len(self._rays)], weights[len(self._rays) :])

    def _extended(self, balance: _Found) -> bool:
        """Add the extreme forces along a motion; whether there are any that are better; collective."""
        G = self.rigid.G.reshape(len(balance.motion), -1, 3)
        forces, gain, friction, bounded = self._resistance(balance.motion)
        size = self.over.max(np.abs(G)) or 1.0
        better = np.flatnonzero(gain > _BETTER * size)
        better = better[np.argsort(-gain[better], kind="stable")[:_PER_ROUND]]
        rays = np.einsum("jmc,mc->mj", G[:, better], forces[better])
        gathered = self.over.comm.allgather(list(rays))
        first = len(self._rays) + sum(len(own) for own in gathered[: self.over.comm.rank])
        self._own += [(first + k, int(node), forces[node]) for k, node in enumerate(better)]
        new = [ray for own in gathered for ray in own]
        self._rays += new
        gained = float(balance.motion @ bounded)
        if gained > balance.used + _BETTER * float(np.sum(np.abs(bounded))):
            self._bounded.append(bounded)
            self._frictions.append(friction)
            return True
        return len(new) > 0

    def _resistance(self, motion: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The extreme force of each node against a motion, shape (m, 3), the work that it does, shape (m,), the
        bounded forces, shape (m, 2), and their resultant over the size of the loads, shape (q,); collective."""
        G, law = self.rigid.G.reshape(len(motion), -1, 3), self.law
        moved = np.einsum("j,jmc->mc", motion, G)
        slip = np.hypot(moved[:, 1], moved[:, 2])
        along = moved[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
        weight = 1.0 / (1.0 + law.friction)  # of a force with pressure 1
        gain = weight * (moved[:, 0] + law.friction * slip)
        forces = weight[:, None] * np.column_stack([np.ones(len(gain)), law.friction[:, None] * along])
        friction = np.where(slip > 0.0, law.cohesion, 0.0)[:, None] * along
        bounded = self.over.total(np.einsum("jmc,mc->j", G[:, :, 1:], friction)) / self._size
        return forces, gain, friction, bounded


@dataclass(frozen=True, eq=False)
class _Found:
    """Answer of the linear programme."""

    left: float  # over, relative to the loads
    motion: FloatArray  # along which it is, largest component 1, shape (q,)
    used: float  # largest known resultant of the bounded forces along the motion
    part: float  # of the changed loads that is held
    bounded: FloatArray  # resultants of the bounded forces, relative to the loads, shape (q,)
    rays: FloatArray  # weights of the known forces without bound, ...
    frictions: FloatArray  # ... and of the bounded ones


_BALANCED: Final = 1e-8  # relative error of equilibrium along motions that nothing resists
_SHARP: Final = 1e-3  # squared part of the largest pressure-weighted opening below which a motion keeps contact closed
_FAR: Final = 5.0  # rigid motion over deformation of a body that slides away


def equilibrium(problem: FrictionProblem) -> Equilibrium:
    """Forces in equilibrium within the bounds of friction, or a motion that shows that there are none; collective.

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
    for line in problem.law.majorants():  # what not even a larger bound holds, this one does not
        law = FrictionLaw(line.radius(x[:, 0]), line.friction).only(problem.frictional, 0.0)
        limit = LimitLoad(RigidMotions(basis.rows, resisted), law, over)
        resisting = limit.unbalanced()
        if resisting is not None:
            break
    x += limit.forces()
    if resisting is None:
        return Equilibrium(True, x.ravel())
    motion = basis.T.T @ resisting
    closed = _closed(rigid, x[:, 0] - problem.lower, over)
    direction = closed @ (closed.T @ motion)
    if np.linalg.norm(direction) < 0.01 * np.linalg.norm(motion):  # nothing but opening: a body is lifted
        direction = motion
    unit, load = float(np.linalg.norm(direction)), float(rigid.e @ direction)
    resistance = limit.resistance(resisting) + float(motion @ (rigid.e - loads)) - float(rigid.e @ (motion - direction))
    if abs(resistance) < _SHARP * load:
        resistance = max(resistance, 0.0)  # of the accuracy of the certificate
    motion /= np.linalg.norm(motion)
    return Equilibrium(False, x.ravel(), motion, direction / unit, load / unit, resistance / unit)


def _closed(rigid: RigidMotions, pressure: FloatArray, over: Reductions) -> FloatArray:
    """Orthonormal motions (q, k) that do not open or close the contact where there is pressure (m,)."""
    rows = rigid.G[:, 0::3] * np.sqrt(np.maximum(pressure, 0.0))
    squares, V = np.linalg.eigh(over.total(rows @ rows.T))
    return V[:, squares < _SHARP * squares[-1]] if squares[-1] > 0.0 else V


def balanced_forces(problem: FrictionProblem, method: str) -> FloatArray | None:
    """Forces in equilibrium within the bounds of friction, newtons, shape (3 m,); None if supports hold all bodies.

    Raises:
        NotConverged: If there are none, with the status NO_EQUILIBRIUM, named after the method; collective.
    """
    if problem.rigid is None:
        return None
    balance, products = equilibrium(problem), problem.A.products
    if balance.exists:
        return balance.x
    without = problem.without_motion(balance.x)
    alpha = problem.rigid_motion(balance.x, without)
    gradient = without - problem.rigid.displacement(alpha)
    message = f"no equilibrium: {push(problem.rigid, balance)}"
    result = SolverResult(
        x=balance.x,
        gradient=gradient,
        slip_bound=problem.slip_bound(balance.x),
        multipliers=np.zeros((problem.A.nodes, 2)),
        status=Status.NO_EQUILIBRIUM,
        products=problem.A.products - products,
        residual=problem.residual(balance.x, gradient),
        method=method,
        message=message,
        rigid=alpha,
        equilibrium=balance,
    )
    raise NotConverged(message, result)


def sliding(problem: FrictionProblem, x: FloatArray, gradient: FloatArray, alpha: FloatArray) -> Equilibrium | None:
    """Whether the bodies slide away in an iteration that has ended; None if it does not look so; collective.

    They do if alpha is far larger than deformation and gaps where there is pressure, and the loads do more work on it
    than contact forces with the present pressures and all friction against the motion.  This is an observation, not a
    proof.  Forces x (3 m,) in newtons, their w (3 m,) in metres, rigid motions alpha (q,).
    """
    rigid, over = problem.rigid, problem.reductions
    if rigid is None:
        return None
    moved = rigid.displacement(alpha)
    weights = np.sqrt(np.repeat(np.maximum(x[0::3], 0.0), 3))
    far, deformed = (over.norm(weights * w) for w in (moved, gradient + moved))
    if far <= _FAR * deformed:
        return None
    direction = alpha / np.linalg.norm(alpha)
    v, load = rigid.displacement(direction).reshape(-1, 3), float(rigid.e @ direction)
    resistance = over.dot(x[0::3], v[:, 0]) + over.dot(problem.slip_bound(x), np.hypot(v[:, 1], v[:, 2]))
    return Equilibrium(False, x, NO_MOTION, direction, load, resistance, False) if load > resistance else None


def push(rigid: RigidMotions, limit: Equilibrium) -> str:
    """The motion along which the loads do more work than contact resists, in words."""
    forces = "contact within the bounds of friction" if limit.proven else "contact at the pressures of the last iterate"
    return (
        f"the loads push along {rigid.described(limit.direction)} with {limit.load:.3g} (force times displacement), "
        f"and {forces} resists with at most {limit.resistance:.3g}"
    )
