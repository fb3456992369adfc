"""Whether contact forces can balance the loads along rigid motions at all, and which part of them they can.

Contact forces under the law of friction, x_n >= 0 and |x_t| <= c + F x_n, have the resultants G x along the motions: a
convex set, the sum of the cones of all nodes and of a bounded set where there is cohesion.  Loads e outside of it are
in equilibrium with no contact forces, whatever the bodies are made of; the distance of e from it has a gradient y, a
rigid motion on which the loads do work, while contact does not resist it.

The set is described from inside by extreme resultants, as many as needed: a linear programme over those known so far
gives y, and each node its extreme force along y, in closed form; when none is better than those known, the distance is
exact (column generation; Dantzig and Wolfe 1960).  The programme has as many rows as there are motions.

The barrier method of `equilibrium` does not serve here: it bounds forces by a multiple of the mean one and decides to
1e-9 of a nominal force, whereas amounts are reported here, with forces as large as they need to be.

scipy.optimize takes 20 ms to load, and is needed only where contact alone holds a body.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .laws import FrictionLaw
from .rigid_motions import RigidMotions

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
