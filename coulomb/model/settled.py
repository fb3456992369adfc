"""Contact forces set to exactly zero where the law requires it.

An interior-point method leaves forces of rounding size at open nodes, a projection method slightly larger ones.  They
are set to zero before displacement and certificate are computed, so that the certified answer is the written one.  The
change is below the requested residual:

- The natural residual |x - P(x - (A x - b)/a)| is the force itself where P sets it to zero.  So a small force
  that P sets to zero is zero.
- Where neither force nor gap is significant, P does not decide: a force up to `OPEN_BELOW` of the largest is zero.
- Where the slip bound is zero (Coulomb friction at open nodes, or F = 0), a small friction force is zero.
- Where a support prescribes the displacement in a tangential direction, and there is no slip in it, the law leaves
  friction in that direction undetermined, and it acts on the support alone: it is zero.

- A node that sticks and is held obliquely to its normal is wedged between support and foundation: the law leaves
  open how much each of them carries.  Friction in that plane is zero, if the friction that remains is within its bound.

Where supports prescribe all of the slip, friction is set by the law from the final normal force.

Larger forces are kept as faults for the certificate.
"""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..fem.contact import row_products
from ..linalg.reductions import Reductions
from .nodal_answer import OPEN_BELOW
from .posed_problem import PosedProblem

ROUNDING = 1e-13
"""Relative size of rounding errors of slips and of projections on free directions."""

SMALL = 1e-6
"""Fraction of the norm of all contact forces: the largest residual that can be requested."""


def settled(problem: PosedProblem, x: FloatArray, closed: FloatArray) -> FloatArray:
    """Contact forces of a solver in newtons, shape (3 m,), with exact zeros; collective.

    Args:
        problem: The contact problem.
        x: The forces, node by node (n, t1, t2), shape (3 m,).
        closed: `PosedProblem.closure` of the displacement under these forces, metres, shape (m, 3).
    """
    over, force = Reductions(problem.comm), x.reshape(-1, 3).copy()
    normal, small = force[:, 0], SMALL * over.norm(x)
    gap = problem.surface.gap - closed[:, 0]
    grazing = np.abs(normal) <= OPEN_BELOW * max(over.max(normal), 0.0)
    opened = (np.abs(normal) <= small) & (problem.mean_compliance * normal <= gap)
    normal[grazing | opened] = 0.0
    frictionless = (problem.slip_bound(force.ravel()) == 0.0) & (np.hypot(force[:, 1], force[:, 2]) <= small)
    force[frictionless, 1:] = 0.0
    if problem.surface.free_B is not problem.surface.B:
        _settle_friction_on_supports(problem, force, closed[:, 1:])
        _settle_wedged(problem, force)
    return force.ravel()


def _settle_friction_on_supports(problem: PosedProblem, force: FloatArray, slip: FloatArray) -> None:
    """Set friction (m, 2) at nodes whose slip is prescribed, or has a prescribed component of 0; collective.

    Friction v, along t1 and t2, acts on the support alone if P (t1, t2)^T v = 0, P the projection on the free
    directions of the node.
    """
    surface = problem.surface
    free = row_products(surface.free_B, surface.points)[:, 1:, 1:]
    sizes, directions = np.linalg.eigh(free)
    v = directions[:, :, 0]
    still = np.abs(np.einsum("ki,ki->k", v, slip)) <= ROUNDING * np.abs(slip).max(axis=1, initial=0.0)
    undetermined = still & (sizes[:, 0] <= ROUNDING * sizes[:, 1])
    force[:, 1:] -= np.where(undetermined, np.einsum("ki,ki->k", v, force[:, 1:]), 0.0)[:, None] * v
    known = np.all(free == 0.0, axis=(1, 2))
    force[known, 1:] = problem.law.at(known).against(slip[known], force[known, 0])


def _settle_wedged(problem: PosedProblem, force: FloatArray) -> None:
    """Change forces (m, 3) of sticking nodes that are held obliquely, by forces v, along n, t1, t2, on supports alone.

    These have P (n, t1, t2)^T v = 0, P the projection on the free directions of the node.
    """
    gram = row_products(problem.surface.free_B, problem.surface.points)
    diagonal = np.einsum("kii->ki", gram)
    diagonal[diagonal == 0.0] = 1.0  # friction along such rows is settled by itself
    sizes, directions = np.linalg.eigh(gram)
    v = directions[:, :, 0]
    across = np.sum(v[:, 1:] ** 2, axis=1)
    wedged = (sizes[:, 0] <= ROUNDING) & (sizes[:, 1] > ROUNDING) & (across > ROUNDING) & (np.abs(v[:, 0]) > ROUNDING)
    along = np.einsum("ki,ki->k", v[:, 1:], force[:, 1:]) / np.where(wedged, across, 1.0)
    moved = force - along[:, None] * v
    sticks = _friction(force) < (1.0 - SMALL) * problem.slip_bound(force.ravel())
    within = (moved[:, 0] > 0.0) & (_friction(moved) < (1.0 - SMALL) * problem.slip_bound(moved.ravel()))
    change = wedged & sticks & within
    force[change] = moved[change]


def _friction(force: FloatArray) -> FloatArray:
    size: FloatArray = np.hypot(force[:, 1], force[:, 2])
    return size
