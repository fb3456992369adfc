"""Contact forces that are exactly zero where the law has them zero.

An interior-point method leaves an open node a force of rounding size, and a projection that has not quite converged may
leave a little more.  It is set to zero before displacement and certificate are computed: what is judged is what is
written.  The answer changes by less than the residual that was asked for:

- The natural residual |x - P(x - (A x - b)/a)| has, at a node that P takes to be open, the force itself.  So a force
  that is small, and that P takes to be none, is none.
- A node may graze: neither force nor gap.  There P cannot say, and a force up to `OPEN_BELOW` of the largest is none.
- Where the slip bound is zero (Coulomb friction of an open node, or of one with F = 0), a small friction is none.

What is not small stays: it is a fault, which the certificate is to see.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .nodal_answer import OPEN_BELOW

if TYPE_CHECKING:
    from .problem import ContactProblem

SMALL = 1e-6
"""Part of the norm of all contact forces: the largest residual that can be asked for."""


def settled(problem: ContactProblem, x: FloatArray, u: FloatArray) -> FloatArray:
    """Contact forces in newtons, shape (3 m,), as a solver gives them, with exact zeros; collective.

    Args:
        problem: The contact problem.
        x: The forces, node by node (n, t1, t2), shape (3 m,).
        u: The displacement that they make, this rank's nodes, metres, shape (k, 3).
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
