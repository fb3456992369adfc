"""Siconos on the condensed problem: its nonsmooth Newton method (Alart-Curnier) with the dense W = B K^-1 B^T.

u = W r + q,  0 <= u_n _|_ r_n >= 0,  |r_t| <= mu r_n opposite to u_t; W is coulomb's A, and q its -b.  W is formed by a
factorisation of K and one right-hand side per column of W; `siconos_our_w` uses the Schur complement with which coulomb
forms A.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ...arrays import FloatArray
from ...linalg.compliance import DirectSolver
from ...model.problem import ContactProblem
from ..block import block
from ..by_columns import compliance_by_columns
from .answer import Answer, Unsolved, on_body

TOLERANCE = 1e-9
"""Tolerance of Siconos' residual; the problem is scaled to a mean diagonal of W of 1 and a largest |q| of 1."""


def solve(p: int) -> Answer:
    """Iterations are Newton's."""
    return solve_with(p, by_right_hand_sides)


def by_right_hand_sides(problem: ContactProblem) -> FloatArray:
    """W column by column."""
    return compliance_by_columns(problem.surface.B, DirectSolver(problem.elasticity.K))


def solve_with(p: int, form: Callable[[ContactProblem], FloatArray]) -> Answer:
    """Solve with W formed by the given function."""
    sn: Any = importlib.import_module("siconos.numerics")
    block(1).b  # noqa: B018  (compiles and warms up)
    began = time.perf_counter()
    problem = block(p, linear_solver=DirectSolver, explicit=True)
    W, q = form(problem), -problem.b
    a, size = float(np.mean(np.diag(W))), np.abs(q).max()
    r, u = np.zeros_like(q), np.zeros_like(q)
    contact = sn.FrictionContactProblem(3, len(q) // 3, W / a, q / size, problem.law.friction)
    options = sn.SolverOptions(sn.SICONOS_FRICTION_3D_NSN_AC)
    options.dparam[sn.SICONOS_DPARAM_TOL] = TOLERANCE
    status = sn.fc3d_driver(contact, r, u, options)
    forces = on_body(problem, r * size / a)
    seconds = time.perf_counter() - began
    iterations, residual = int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE]), options.dparam[sn.SICONOS_DPARAM_RESIDU]
    if status != 0:
        raise Unsolved(f"not converged in {iterations} steps, residual {residual:.1e}")
    return Answer(seconds, iterations, problem.surface.x, forces)
