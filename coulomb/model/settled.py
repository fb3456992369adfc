"""Contact forces set to exactly zero where the law requires it.

An interior-point method leaves forces of rounding size at open nodes, a projection method slightly larger ones.  They
are set to zero before displacement and certificate are computed, so that the certified answer is the written one.  The
change is below the requested residual:

- The natural residual |x - P(x - (A x - b)/a)| is the force itself where P sets it to zero.  So a small force
  that P sets to zero is zero.
- Where neither force nor gap is significant, P does not decide: a force up to `OPEN_BELOW` of the largest is zero.
- Where the slip bound is zero (Coulomb friction at open nodes, or F = 0), a small friction force is zero.

Larger forces are kept as faults for the certificate.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .nodal_answer import OPEN_BELOW
from .posed_problem import PosedProblem

SMALL = 1e-6
"""Fraction of the norm of all contact forces: the largest residual that can be requested."""


def settled(problem: PosedProblem, x: FloatArray, u: FloatArray) -> FloatArray:
    """Contact forces of a solver in newtons, shape (3 m,), with exact zeros; collective.

    Args:
        problem: The contact problem.
        x: The forces, node by node (n, t1, t2), shape (3 m,).
        u: The displacement under these forces, this rank's nodes, metres, shape (k, 3).
    """
    over, force = Reductions(problem.comm), x.reshape(-1, 3).copy()
    normal, small = force[:, 0], SMALL * over.norm(x)
    gap = problem.surface.gap - problem.closure(u)[:, 0]
    grazing = np.abs(normal) <= OPEN_BELOW * max(over.max(normal), 0.0)
    opened = (np.abs(normal) <= small) & (problem.mean_compliance * normal <= gap)
    normal[grazing | opened] = 0.0
    frictionless = (problem.slip_bound(force.ravel()) == 0.0) & (np.hypot(force[:, 1], force[:, 2]) <= small)
    force[frictionless, 1:] = 0.0
    return force.ravel()
