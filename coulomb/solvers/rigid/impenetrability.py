"""Problems without solution: no contact forces keep all contacts from penetrating."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse

from ..friction_problem import FrictionProblem

_CLEAR = 1e-7  # least penetration that is called a contradiction, over the largest |b|
_LARGEST = 3_000_000  # entries of A beyond which the question is not asked
_NAMED = 4  # contacts that are named


def contradiction(problem: FrictionProblem, W: Any) -> str:
    """Why no contact forces x, of any sign and without any law of friction, make all gaps w_n >= 0; empty if some do.

    A linear programme, max t with (A x - b)_n >= t: if t < 0, its multipliers are normal forces d >= 0 with A d = 0 and
    b.d > 0, which no displacements w = A x - b with w_n >= 0 allow: w.d = -b.d < 0.  They are checked before they are
    believed.

    Args:
        problem: The problem, on one rank.
        W: Its compliance, sparse, its columns in any scaling; 0 along the tangents of contacts without friction.
    """
    from scipy.optimize import linprog  # takes time to load, and few problems have no solution

    m, size = problem.A.nodes, float(np.abs(problem.b).max()) or 1.0
    if W.nnz > _LARGEST:
        return ""
    b_n, rows = problem.b[0::3] / size, W[0::3]
    n = rows.shape[1]
    constraints = scipy.sparse.hstack([-rows, np.ones((m, 1))]).tocsr()
    bounds = [(None, None)] * n + [(None, 1.0)]
    costs = np.append(np.zeros(n), -1.0)
    found = linprog(costs, A_ub=constraints, b_ub=-b_n, bounds=bounds, options={"maxiter": 50 * n})
    if found.x is None or found.x[-1] > -_CLEAR:
        return ""
    d = np.maximum(-np.asarray(found.ineqlin.marginals), 0.0)
    against = float(b_n @ d)
    if not float(np.linalg.norm(rows.T @ d)) <= 1e-6 * against:
        return ""
    worst = np.argsort(-d)[: min(_NAMED, int(np.count_nonzero(d > 1e-6 * d.max())))]
    names = ", ".join(str(k) for k in np.sort(worst))
    short = against * size / float(d.sum())
    return (
        f"no contact forces keep all contacts from penetrating: normal forces on contacts {names} (numbered from 0) "
        f"balance each other and move nothing, but the gaps along them are {short:.1e} too small in the mean"
    )
