"""Siconos on the whole body: its global ADMM, with sparse K and B.

K v = f + H r,  u = H^T v + w,  0 <= u_n _|_ r_n >= 0,  |r_t| <= mu r_n opposite to u_t;  H = -B^T, w the gap.
"""

from __future__ import annotations

import importlib
import time
from typing import Any

import numpy as np
import scipy.sparse

from ..block import block
from .answer import Answer, Unsolved, on_body
from .sparse import free_system

TOLERANCE = 1e-8
"""Tolerance of Siconos' residual; the problem is scaled to a mean diagonal of K of 1 and a largest load of 1."""


def solve(p: int) -> Answer:
    """Iterations are ADMM's."""
    sn: Any = importlib.import_module("siconos.numerics")
    free_system(block(1))  # compiles and warms up
    began = time.perf_counter()
    problem = block(p)
    K, B, f, c = free_system(problem)
    k, size = K.diagonal().mean(), np.abs(f).max()
    contact = sn.GlobalFrictionContactProblem(3)
    contact.numberOfContacts = len(problem.law.friction)
    contact.M, contact.H = _long(K / k), _long(-B.T)
    contact.q, contact.b, contact.mu = f / size, c * k / size, problem.law.friction
    r, u, v = np.zeros_like(c), np.zeros_like(c), np.zeros_like(f)
    options = sn.SolverOptions(sn.SICONOS_GLOBAL_FRICTION_3D_ADMM)
    options.dparam[sn.SICONOS_DPARAM_TOL] = TOLERANCE
    status = sn.gfc3d_driver(contact, r, u, v, options)
    forces = on_body(problem, r * size)
    seconds = time.perf_counter() - began
    iterations, residual = int(options.iparam[sn.SICONOS_IPARAM_ITER_DONE]), options.dparam[sn.SICONOS_DPARAM_RESIDU]
    if status != 0:
        raise Unsolved(f"not converged in {iterations} iterations, residual {residual:.1e}")
    return Answer(seconds, iterations, problem.surface.x, forces)


def _long(matrix: Any) -> Any:
    """Compressed columns with 64-bit indices, as Siconos requires."""
    matrix = scipy.sparse.csc_matrix(matrix)
    matrix.indices, matrix.indptr = matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
    return matrix
