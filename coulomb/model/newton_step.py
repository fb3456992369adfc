"""The exact Newton step of large motions, from the answer of a linear contact problem.

The linear problem leaves out what turns and moves with the displacement: normals, weights of pairs, loads that follow
their surface, forces of bolts and rigid faces.  Where bodies slide on each other, the most is that contact forces move
along the face opposite; without it iterates of ironing converge with a factor of 0.35.  With the derivative P of the
linear problem on the sets of its answer z0, and J that of the whole one, the Newton step z on these sets is

    z = z0 + P^-1 (P - J) z

where (P - J) z is a difference of the equations along z (`geometric_terms`).  Springs that stand for contact in P
(`Iterate.supported`) are no part of J: their whole force at z is left out, which is 0 where conditions of contact hold
as equations.  As the derivatives of an answer (`sensitivity`) z is found as a fixed point, by Anderson's method: along
combinations of other ways, as of GMRES, gaps and pairings may have kinks.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged
from ..solvers.derivatives import Change, at_answer
from ..solvers.successive_tresca import Anderson
from .discrete_problem import DiscreteProblem
from .geometric_terms import GeometricTerms, Way

_ACCURACY = (0.01, 0.06)
"""Least and largest change of the step, over itself, at which it is found: in between the root of the residual, so that
convergence is faster than linear (S. C. Eisenstat, H. F. Walker, SIAM J. Sci. Comput. 17, 1996)."""

_LAST: Final = 1e-3
"""Residual below which the step may be the last: it is found so accurately that it is, as more differences cost less
than another linear problem; to a change of `_CLOSEST` at most, as differences are not more accurate."""

_CLOSEST: Final = 1e-5

_MOST: Final = 8
"""Largest number of differences for a step."""


class Step(NamedTuple):
    """Change of the displacement (k, 3) in metres, contact forces after it (3 m,) in newtons along the frames before,
    and amounts of free motions (q,)."""

    displacement: FloatArray
    contact_force: FloatArray
    rigid: FloatArray


def newton_step(
    problem: DiscreteProblem, posed: DiscreteProblem, u: FloatArray, linear: Step, residual: float, within: float
) -> Step | None:
    """The Newton step from a displacement u (k, 3); None where its equations are singular, nearly, or it is not found;
    collective.

    Args:
        problem: The linear problem there,
        posed: and as it was posed, without springs where contact presses.
        u: The displacement, metres, shape (k, 3).
        linear: The answer of the linear problem.
        residual: Of the certificate at u,
        within: and to which it has to become.
    """
    du, x, alpha = linear
    over, reduction = Reductions(problem.comm), problem.elasticity.reduction
    terms, mixing = GeometricTerms(problem, x, u, start=posed), Anderson(_MOST, over)
    here = problem.comm.rank == 0  # which has the amounts of free motions
    point, count = np.concatenate([du.ravel(), here * alpha]), du.size
    linear_problem, local = problem.linear, 1.0 / problem.linear.node_stiffness
    surface, springs = problem.surface, problem.elasticity.added_springs
    w = np.column_stack([surface.gap, problem.state.slip_origin[:, 1:]])
    accuracy = np.clip(np.sqrt(residual), *_ACCURACY)
    if residual < _LAST:
        accuracy = min(accuracy, max(within / residual, _CLOSEST))
    try:
        derivatives = at_answer(problem.friction_problem, linear_problem.formed_A, local, x)
    except (ValueError, CGNotConverged):
        return None
    for _ in range(_MOST):
        way = Way(point[:count].reshape(-1, 3), over.total(point[count:]))
        left_out = terms.along(way)
        load = left_out.load
        if springs is not None:
            load = load - springs.force
            if springs.along is not None:
                not_closed = w + left_out.c - surface.rows(way.u) + terms.relative(way.alpha)
                load += surface.at_nodes((springs.along * derivatives.closed * not_closed).ravel())
        change = Change(-left_out.c.ravel(), left_out.bound, left_out.e, reduction.along(load, None).ravel())
        try:
            (owed,) = derivatives.derivatives([change])
        except (ValueError, CGNotConverged):
            return None
        step = du + problem.moved(reduction.displacement(owed.u.reshape(-1, 3)), owed.alpha)
        after = np.concatenate([step.ravel(), here * (alpha + owed.alpha)])
        off, size = over.norm(after - point), over.norm(after)
        if off <= accuracy * size:
            break
        point = mixing.next(point, after - point, 1.0)
    return Step(step, x + owed.x, alpha + owed.alpha) if off <= _ACCURACY[1] * size else None
