"""Bodies that contact alone holds and no load presses: where all contacts can be open, no forces are an answer."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from .friction_problem import FrictionProblem

_BALANCED = 1e-12
"""Loads along the motions below this part of |b|/a are rounding errors."""

_OPEN = 1e-9
"""Gap that is left open, over the largest |b_n|."""


def open_motion(problem: FrictionProblem) -> FloatArray | None:
    """Amounts alpha (q,) of the rigid motions, the smallest, with which all contact points are open; collective.

    None if supports hold all bodies, loads have to be balanced, nodes have cohesion, or there are no such amounts.
    """
    rigid, over, b = problem.rigid, problem.reductions, problem.b[0::3]
    if rigid is None or over.any(bool(np.any(problem.law.cohesion > 0.0) or np.any(np.asarray(problem.lower) != 0.0))):
        return None
    largest = over.max(np.append(np.abs(b), 0.0))
    if np.max(np.abs(rigid.e)) > _BALANCED * over.norm(problem.b) / problem.mean_diagonal or largest == 0.0:
        return None
    rows = over.comm.gather(np.column_stack([rigid.G[:, 0::3].T, -b / largest - _OPEN]))
    alpha = None
    if rows is not None:
        from scipy.optimize import linprog  # its import takes 0.2 s, and few runs need it

        whole = np.concatenate(rows)
        G, room = whole[:, :-1], whole[:, -1]
        found = linprog(np.ones(2 * rigid.count), np.hstack([G, -G]), room)
        if found.success:
            alpha = largest * (found.x[: rigid.count] - found.x[rigid.count :])
    answer: FloatArray | None = over.comm.bcast(alpha)
    return answer
