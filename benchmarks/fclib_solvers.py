"""One rigid contact problem by coulomb or by one of Siconos' solvers: `python -m benchmarks.fclib_solvers NAME
FILE`.

Siconos gets the problem scaled to a mean diagonal of W of 1 and a largest |q| of 1, and its own tolerance.  The time
is that of the processor from the matrix in memory, in each package's own format, to the forces, by a call from Python;
the least of a few runs where it is short.  Imports and the scaling for Siconos are not counted.
"""

from __future__ import annotations

import importlib
import json
import math
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse

from coulomb.arrays import FloatArray
from coulomb.io.fclib import FCLIBProblem, read_fclib
from coulomb.solvers.results import NotConverged
from coulomb.solvers.rigid import solve_coulomb

TOLERANCE = 1e-8
OURS = "coulomb"
SICONOS = {
    "NSGS": ("SICONOS_FRICTION_3D_NSGS", 10_000_000),
    "NSN_AC": ("SICONOS_FRICTION_3D_NSN_AC", 2_000),
    "ADMM": ("SICONOS_FRICTION_3D_ADMM", 1_000_000),
    "DSFP": ("SICONOS_FRICTION_3D_DSFP", 10_000_000),
}
"""Siconos' solvers with their names there and their largest number of iterations: beyond the limit of time."""

_SHORT = 0.05  # seconds: shorter runs are repeated
_REPEATS = 50


Answer = tuple[FloatArray, bool, str]
"""Forces, whether success is reported, and the reason if not."""


def by_coulomb(problem: FCLIBProblem) -> Callable[[], Answer]:
    """What solves the problem, to be called for each timing."""
    b = -problem.q

    def run() -> Answer:
        try:
            return solve_coulomb(problem.W, b, problem.mu).x, True, ""
        except NotConverged as failure:
            return failure.result.x, False, str(failure)

    return run


def by_siconos(problem: FCLIBProblem, name: str) -> Callable[[], Answer]:
    """As `by_coulomb`, by a solver in `SICONOS`."""
    sn: Any = importlib.import_module("siconos.numerics")
    attribute, iterations = SICONOS[name]
    a, size = float(problem.W.diagonal().mean()), float(np.abs(problem.q).max()) or 1.0
    W, q = scipy.sparse.csc_matrix(problem.W / a), problem.q / size
    W.indices, W.indptr = W.indices.astype(np.int64), W.indptr.astype(np.int64)

    def run() -> Answer:
        contact = sn.FrictionContactProblem(3, len(problem.mu), W, q, problem.mu)
        options = sn.SolverOptions(getattr(sn, attribute))
        options.dparam[sn.SICONOS_DPARAM_TOL], options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = TOLERANCE, iterations
        r: FloatArray = np.zeros_like(q)
        status = sn.fc3d_driver(contact, r, np.zeros_like(r), options)
        return r * size / a, status == 0, "" if status == 0 else f"status {status}"

    return run


def solve(problem: FCLIBProblem, name: str) -> dict[str, object]:
    """Seconds, residual by the collection's measure, whether success was reported, and what was said.

    The time is that of the thread: the clock of a process with a limit has a resolution of milliseconds.
    """
    run, spent = by_coulomb(problem) if name == OURS else by_siconos(problem, name), []
    while True:
        began = time.thread_time()
        r, claimed, said = run()
        spent.append(time.thread_time() - began)
        if sum(spent) > _SHORT or len(spent) == _REPEATS:
            break
    residual = problem.residual(r) if np.isfinite(r).all() else float("inf")
    return {"seconds": min(spent), "residual": residual, "claimed": claimed, "said": said}


if __name__ == "__main__":
    given = read_fclib(sys.argv[2])
    _small = FCLIBProblem(scipy.sparse.identity(3, format="csr"), np.array([-1.0, 0.5, 0.0]), np.array([0.3]))
    solve(_small, sys.argv[1])  # loads what is loaded late
    _end = math.ceil(time.process_time() + float(sys.argv[3]))
    resource.setrlimit(resource.RLIMIT_CPU, (_end, _end))
    sys.stdout.write("\n" + json.dumps(solve(given, sys.argv[1])) + "\n")
