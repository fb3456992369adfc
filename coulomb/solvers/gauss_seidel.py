"""Nonsmooth Gauss-Seidel sweeps in C (native/gauss_seidel.c), for the problems on which they are the quickest method.

M. Jean, J. J. Moreau: Unilaterality and dry friction in the dynamics of rigid body collections (1992).  A sweep costs
little and many problems of few contacts need few of them; on stacks and towers the rate is near 1.  So their number is
limited by the work of the other methods, and they are given up early where the rate observed will not do.
"""

from __future__ import annotations

import ctypes
import functools
import logging
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..arrays import FloatArray
from ..compiled import compiled_library
from .cone_problem import Scales
from .friction_problem import FrictionProblem

_log = logging.getLogger(__name__)

_SOURCE = Path(__file__).parent / "native" / "gauss_seidel.c"
_SWEEP, _CONTACT, _BLOCK = 1.0, 0.15, 0.012  # microseconds of a sweep, for each contact and block: orders of magnitude
_STEP, _STEP_CONTACT, _STEP_WORK, _STEPS = 600.0, 8.0, 2e-4, 25.0  # of a step of the path, and number of its steps
_TRIAL = 0.1  # of the work of the path: sweeps that are made in any case


class Sweeps(NamedTuple):
    """What the sweeps have reached.

    Attributes:
        x: Forces in newtons, shape (3 m,).
        residual: The larger of the cone and the natural residual.
        made: Number of sweeps.
    """

    x: FloatArray
    residual: float
    made: int


@functools.cache
def _kernel() -> Any:
    try:
        library = compiled_library("gauss_seidel", [_SOURCE])
    except (OSError, subprocess.SubprocessError) as error:
        _log.info("no kernels in C, contact of few rigid bodies is slower: %s", error)
        return None
    pointers, numbers = ctypes.c_void_p, ctypes.c_double
    library.gauss_seidel.restype = ctypes.c_long
    library.gauss_seidel.argtypes = (
        [ctypes.c_long] * 2 + [pointers] * 3 + [numbers] + [pointers] * 2 + [numbers] * 4 + [pointers] * 2
    )
    return library.gauss_seidel


def swept(
    problem: FrictionProblem, A: Any, scales: Scales, tolerance: float, start: FloatArray | None = None
) -> Sweeps | None:
    """Forces by sweeps, as long as they promise to be quicker than other methods.

    Args:
        problem: Coulomb's law without cohesion, lower bounds 0, no rigid motions.
        A: Its compliance, compressed rows, shape (3 m, 3 m).
        scales: Its units.
        tolerance: Residual at which to stop, the larger of cone and natural residual.
        start: Forces in newtons, shape (3 m,); 0 if None.

    Returns:
        None without a compiler, and for an A with a diagonal entry that is not positive.
    """
    kernel = _kernel()
    if kernel is None:
        return None
    m, indptr, indices = problem.A.nodes, A.indptr, A.indices
    if indptr.dtype != np.int32 or indices.dtype != np.int32:
        indptr, indices = indptr.astype(np.int32), indices.astype(np.int32)
    friction, fill = np.ascontiguousarray(problem.law.friction), len(A.data) / 9.0
    path = _STEPS * (_STEP + (_STEP_WORK * 18.0 * m**3 if m <= 30 or fill > 0.25 * m * m else _STEP_CONTACT * m))
    q = problem.b * (-1.0 / (scales.compliance * scales.force))
    r: FloatArray = np.zeros(3 * m) if start is None else start / scales.force
    report = np.empty(2)
    arrays = [v.ctypes.data for v in (indptr, indices, A.data, q, friction, r, report)]
    cost = _SWEEP + _CONTACT * m + _BLOCK * fill
    limits = (tolerance, cost, _TRIAL * path, path)
    count = kernel(m, min(len(A.data), m * m), *arrays[:3], 1.0 / scales.compliance, *arrays[3:5], *limits, *arrays[5:])
    return None if count < 0 else Sweeps(r * scales.force, float(report[0]), count)
