"""Clarabel: the Tresca problem as a sparse conic programme in the displacements, Coulomb by successive Tresca.

minimise 1/2 u^T K u - f^T u + g^T s   subject to   B_n u <= c,  |B_t u| <= s (one second-order cone per node)

The contact forces are the multipliers of the constraints; g = F x_n of the previous problem, until convergence.
"""

from __future__ import annotations

import importlib
import time
from typing import Any

import numpy as np
import scipy.sparse

from ..block import block
from .answer import Answer, Unsolved, free_system, on_body

TOLERANCE = 1e-10
"""Tolerance of Clarabel's gap and feasibility, of the problem scaled to a mean diagonal of K and a largest load of
1."""

SETTLED = 1e-7
"""Relative change of the contact forces at which successive Tresca ends."""

MOST_OUTER = 100


def solve(p: int) -> Answer:
    """Iterations are Clarabel's of all Tresca problems together."""
    clarabel: Any = importlib.import_module("clarabel")
    free_system(block(1))  # compiles and warms up
    began = time.perf_counter()
    problem = block(p)
    K, B, f, c = free_system(problem)
    k, size, m = K.diagonal().mean(), np.abs(f).max(), len(c) // 3
    tangential = np.arange(3 * m) % 3 != 0
    BT = scipy.sparse.diags(tangential.astype(np.float64)) @ B
    S = scipy.sparse.csr_matrix((np.ones(m), (3 * np.arange(m), np.arange(m))), shape=(3 * m, m))
    none = scipy.sparse.csr_matrix((m, m))
    P = scipy.sparse.block_diag([scipy.sparse.triu(K / k), none], format="csc")
    A = scipy.sparse.bmat([[B[0::3], none], [-BT, -S]], format="csc")
    right = np.concatenate([c[0::3] * k / size, np.zeros(3 * m)])
    cones = [clarabel.NonnegativeConeT(m)] + [clarabel.SecondOrderConeT(3)] * m
    solver, iterations, x = None, 0, np.zeros((m, 3))
    for _ in range(MOST_OUTER):
        g = problem.law.radius(x[:, 0])
        linear = np.concatenate([-f / size, g])
        if solver is None:
            solver = clarabel.DefaultSolver(P, linear, A, right, cones, _settings(clarabel))
        else:
            solver.update(q=linear)
        solution = solver.solve()
        iterations += solution.iterations
        if "Solved" not in str(solution.status):
            raise Unsolved(f"Clarabel ended with {solution.status} after {iterations} iterations")
        z, last = np.array(solution.z), x
        x = np.column_stack([z[:m], -z[m:].reshape(m, 3)[:, 1:]])
        if np.linalg.norm(x - last) <= SETTLED * np.linalg.norm(x):
            forces = on_body(problem, x.ravel() * size)
            return Answer(time.perf_counter() - began, iterations, problem.surface.x, forces)
    raise Unsolved(f"successive Tresca did not converge in {MOST_OUTER} problems")


def _settings(clarabel: Any) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.direct_solve_method = "faer"  # three times as fast as its default at p = 10
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    return settings
