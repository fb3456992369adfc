"""Siconos: its nonsmooth Newton method on the condensed problem, and its global ADMM on the whole body.

Newton's (Alart-Curnier) takes the dense W = B K^-1 B^T, formed by the Schur complement with which coulomb forms A:

    u = W r + q,  0 <= u_n _|_ r_n >= 0,  |r_t| <= mu r_n opposite to u_t;  W is coulomb's A, and q its -b.

ADMM takes sparse K and B:

    K v = f + H r,  u = H^T v + w,  0 <= u_n _|_ r_n >= 0,  |r_t| <= mu r_n opposite to u_t;  H = -B^T, w the gap.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse

from coulomb.arrays import FloatArray
from coulomb.linalg.compliance import DirectSolver, SchurCompliance
from coulomb.model.problem import ContactProblem

from ..block import block
from ..two_blocks import two_blocks
from .answer import Answer, Unsolved, free_system, on_body
from .ours import answer_of, second_order

NEWTON_TOLERANCE = 1e-9
"""Tolerance of the residual; the problem is scaled to a mean diagonal of W of 1 and a largest |q| of 1."""

ADMM_TOLERANCE = 1e-8
"""The same; the problem is scaled to a mean diagonal of K of 1 and a largest load of 1."""


def solve_newton(p: int) -> Answer:
    """Iterations are Newton's."""
    sn: Any = importlib.import_module("siconos.numerics")
    block(1).b  # noqa: B018  (compiles and warms up)
    began = time.perf_counter()
    problem = block(p, linear_solver=DirectSolver, explicit=True)
    assert isinstance(problem.A, SchurCompliance)
    W, q = problem.A.dense(), -problem.b
    a, size = float(np.mean(np.diag(W))), np.abs(q).max()
    r, u = np.zeros_like(q), np.zeros_like(q)
    contact = sn.FrictionContactProblem(3, len(q) // 3, W / a, q / size, problem.law.friction)
    options = sn.SolverOptions(sn.SICONOS_FRICTION_3D_NSN_AC)
    options.dparam[sn.SICONOS_DPARAM_TOL] = NEWTON_TOLERANCE
    status = sn.fc3d_driver(contact, r, u, options)
    forces = on_body(problem, r * size / a)
    seconds = time.perf_counter() - began
    iterations, residual = int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE]), options.dparam[sn.SICONOS_DPARAM_RESIDU]
    if status != 0:
        raise Unsolved(f"not converged in {iterations} steps, residual {residual:.1e}")
    return Answer(seconds, iterations, problem.surface.x, forces)


def solve_admm(p: int) -> Answer:
    """The block of hexahedra; iterations are ADMM's."""
    return _solve(block, p)


def solve_second_order(p: int) -> Answer:
    """The block of 10-node tetrahedra, with contact at vertices."""
    return _solve(second_order, p)


def _solve(make: Callable[[int], ContactProblem], p: int) -> Answer:
    _solved(make(1))  # compiles and warms up
    began = time.perf_counter()
    problem = make(p)
    _, x, iterations = _solved(problem)
    forces = on_body(problem, x)
    return Answer(time.perf_counter() - began, iterations, problem.surface.x, forces)


def solve_pair(p: int) -> Answer:
    """The two blocks."""
    _solved(two_blocks(2))
    began = time.perf_counter()
    problem = two_blocks(p)
    u, _, iterations = _solved(problem)
    return answer_of(problem, p, u, time.perf_counter() - began, iterations)


def _solved(problem: ContactProblem) -> tuple[FloatArray, FloatArray, int]:
    """Displacements (k, 3), contact forces (3 m,), and iterations."""
    sn: Any = importlib.import_module("siconos.numerics")
    K, B, f, c = free_system(problem)
    k, size = K.diagonal().mean(), np.abs(f).max()
    contact = sn.GlobalFrictionContactProblem(3)
    contact.numberOfContacts = len(problem.law.friction)
    contact.M, contact.H = _long(K / k), _long(-B.T)
    contact.q, contact.b, contact.mu = f / size, c * k / size, problem.law.friction
    r, w, v = np.zeros_like(c), np.zeros_like(c), np.zeros_like(f)
    options = sn.SolverOptions(sn.SICONOS_GLOBAL_FRICTION_3D_ADMM)
    options.dparam[sn.SICONOS_DPARAM_TOL] = ADMM_TOLERANCE
    status = sn.gfc3d_driver(contact, r, w, v, options)
    iterations, residual = int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE]), options.dparam[sn.SICONOS_DPARAM_RESIDU]
    if status != 0:
        raise Unsolved(f"not converged in {iterations} iterations, residual {residual:.1e}")
    u = np.zeros(problem.elasticity.held.components.shape)
    u[~problem.elasticity.held.components] = v * (size / k)
    return u, r * size, iterations


def _long(matrix: Any) -> Any:
    """Compressed columns with 64-bit indices, as Siconos requires."""
    matrix = scipy.sparse.csc_matrix(matrix)
    matrix.indices, matrix.indptr = matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
    return matrix
