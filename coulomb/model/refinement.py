"""Iterative refinement of a displacement until all forces balance.

A solve with K leaves a residual relative to its own right-hand side.  That may be far larger than the forces on the
body: where a body is carried along by a prescribed displacement, it is K times that displacement; where soft springs
hold it, a residual that is small beside the loads moves it.  The residual is therefore assembled anew from the
displacement, and solved for again, until its sums are as small as rounding allows (Wilkinson 1963).

Where contact alone holds a body, K has springs at its anchors (`FreeMotions`).  They are among the forces in balance,
so that the displacement of loads that are not in equilibrium is refined as well; at a solution they are zero.
"""

from __future__ import annotations

import math

import numpy as np
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem.bodies import Deformable, Loading
from ..linalg.compliance import StiffnessSolver
from ..linalg.reductions import Reductions
from ..linalg.unsolved import Unsolved
from .rigid_balance import lengths

BALANCED = 1e-13
"""Resultant force and moment of the residual, and 1e-2 of its norm, relative to the forces on the body."""

_ACCURACY = 1e-6
"""Least relative residual of a correction: few more digits are left to gain by each."""

_BEYOND = 0.1
"""Part of BALANCED at which a correction aims: its residual is not distributed like the one before."""

_MOST = 4
"""Maximum number of corrections."""


def refined(
    elasticity: Deformable,
    solver: StiffnessSolver,
    loading: Loading,
    on_body: FloatArray,
    u: FloatArray,
) -> FloatArray:
    """The displacement u (k, 3) corrected until loads, springs, reactions and contact forces balance; collective.

    Args:
        elasticity: The body.
        solver: K^-1.
        loading: Loads and prescribed displacements.
        on_body: Contact forces on the body at this rank's nodes in newtons, shape (k, 3).
        u: An approximate displacement, with the prescribed ones, metres.
    """
    over, x = Reductions(elasticity.comm), elasticity.x
    ends = np.array([[over.min(axis), over.max(axis)] for axis in x.T])
    arms = (x - ends.mean(axis=1)) / (0.5 * np.linalg.norm(np.ptp(ends, axis=1)))

    def left_over(u: FloatArray) -> tuple[FloatArray, float]:
        """The residual at this rank's nodes, and its size relative to the forces on the body."""
        spring = elasticity.spring_force(u) - elasticity.anchoring * u
        imbalance = loading.load + spring + on_body - elasticity.internal_force(u)
        residual, reaction = elasticity.free_part(imbalance), elasticity.held_part(imbalance)
        outer = (loading.load, spring, on_body, reaction)
        sums = over.total(np.concatenate([residual.sum(axis=0), np.cross(arms, residual).sum(axis=0)]))
        scale = np.max([over.sum(lengths(part)) for part in outer])
        length = np.max([over.norm(part) for part in outer])
        return residual, float(
            np.max([np.max(np.abs(sums)) / (scale or 1.0), 1e-2 * over.norm(residual) / (length or 1.0)])
        )

    with np.errstate(all="ignore"):  # an answer that overflows fails its certificate
        residual, size = left_over(u)
        for _ in range(_MOST):
            if not BALANCED < size < math.inf:
                break
            accuracy = min(max(_BEYOND * BALANCED / size, _ACCURACY), _BEYOND)
            change, ended = _solved(elasticity.K, solver, residual, accuracy)
            changed = u + elasticity.free_part(change)
            after, smaller = left_over(changed)
            if not smaller < size:
                break
            u, residual, size, before = changed, after, smaller, size
            if ended or size > 0.5 * before:  # rounding
                break
    return u


def _solved(K: PETSc.Mat, solver: StiffnessSolver, residual: FloatArray, accuracy: float) -> tuple[FloatArray, bool]:
    """K^-1 of a residual (k, 3), this rank's part, to a relative residual; and whether the solve ended before."""
    rhs, change = K.createVecs()
    rhs.array[:] = residual.ravel()
    size = float(rhs.norm()) or 1.0  # scaled: solves start from combinations of earlier solutions of like size
    rhs.scale(1.0 / size)
    ended = False
    try:
        solver.solve(rhs, change, accuracy)
    except Unsolved:  # what was reached may still be better than before
        ended = True
    values: FloatArray = size * change.array_r.reshape(-1, 3)
    rhs.destroy()
    change.destroy()
    return values, ended
