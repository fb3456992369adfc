"""Slip from the touch: what a contact point travels in the air during a load step is no slip.

Let points that had a gap g0 at the start of the step land without friction, and let one of them be beyond the surface
by g1 if the forces of all landed points were taken away.  On its way it touches where the gap is 0, after s of the
step; from there it slips.  In the first step ways are straight, s = g0 / (g0 + g1); later parabolas through the place
one step before, since a point of a tread comes down on an arc.  A point that is open in the end slips from its last
place (s = 1), one that was closed at the start from where it was (s = 0).

Places of touch follow from one more contact problem, without friction at these points and of small displacements from
near the answer.  With A the compliance and x_L its normal forces of landed points, g1 is A x_L.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from ..solvers.results import NotConverged, Status
from .discrete_problem import DiscreteProblem
from .solution import Solution
from .stopping_criterion import CERTIFIED_FROM

_log = logging.getLogger(__name__)

_Problem = TypeVar("_Problem", bound=DiscreteProblem)

ACCURACY: Final = 1.1 * CERTIFIED_FROM
"""Residual of the problem without friction at points that land, which is not certified."""


_SMOOTH: Final = 0.28
"""Largest |c| over |w| of a motion that goes on as before; from 1.5 times as much ways are straight."""


def has_landed(problem: DiscreteProblem, x: FloatArray) -> bool:
    """Whether contact forces x (3 m,) press at points that had a gap; collective."""
    return Reductions(problem.comm).any(np.any(problem.state.in_the_air & (x[0::3] > 0.0)))


def place_of_touch(
    problem: _Problem, solve: Callable[[_Problem, FloatArray], Solution], x: FloatArray
) -> FloatArray | None:
    """Where slip begins in a load step, from `ContactState.slip_origin`, along n, t1, t2, metres, shape (m, 3); None
    if it is not found; collective.

    Args:
        problem: The problem at the end of the step, near the answer if that has large displacements.
        solve: Solves it to `ACCURACY` from forces.
        x: The first of these, shape (3 m,).
    """
    state, air = problem.state, problem.state.in_the_air
    smooth = problem.in_state(replace(state, law=state.law.without(air)), problem.seconds, problem.before)
    try:
        landing = solve(smooth, np.where(np.repeat(air, 3) & (np.arange(len(x)) % 3 > 0), 0.0, x))
    except NotConverged as failure:
        if failure.result.status is Status.INTERRUPTED:
            raise
        _log.debug("without friction where points land: %s", failure)
        return None
    way, kept = smooth.relative_displacement(landing.displacement), np.zeros_like(x)
    landing.problem.A.mult(np.where(np.repeat(air, 3), landing.contact_force, 0.0), kept)
    g0 = state.gap_at_start
    way[:, 0] += kept[0::3] - state.surface.gap + g0  # since the start, to the place beyond the surface
    bent = _bent(problem, way)
    straight, curved, s = way[:, 0] - bent[:, 0], bent[:, 0], np.ones_like(g0)
    through = air & (way[:, 0] > g0)
    root = np.sqrt(np.maximum(straight**2 + 4.0 * curved * g0, 0.0))
    np.divide(2.0 * g0, straight + root, out=s, where=through & (straight + root > 0.0))
    part = np.clip(s, 0.0, 1.0)[:, None]
    touch: FloatArray = np.where(air[:, None], part * (way - bent) + part**2 * bent, 0.0)
    touch[:, 0] = 0.0
    return touch


def _bent(problem: DiscreteProblem, way: FloatArray) -> FloatArray:
    """c of the way s (w - c) + s^2 c at the part s of a step in which points go by w: that through the place one load
    step before as well, 0 without one and where the motion has changed with the step; along n, t1, t2, metres, shapes
    (m, 3); collective."""
    before, surface = problem.before, problem.surface
    assert before is not None
    if before.before is None or not problem.time > before.time:
        return np.zeros_like(way)
    then, start = before.before, before.time
    last = surface.rows(before.displacement - then.displacement)
    last -= surface.components(problem.body.foundation_displacement(surface, then.time, start))
    ratio = (start - then.time) / (problem.time - start)
    bent = (ratio * way - last) / (ratio * (1.0 + ratio))
    size, whole = (np.linalg.norm(one, axis=1, keepdims=True) for one in (bent, way))
    smooth = np.divide(_SMOOTH * whole, size, out=np.ones_like(size), where=size > 0.0)
    return np.where(smooth >= 1.0, bent, bent * np.maximum(3.0 * smooth - 2.0, 0.0))


def from_touch(
    problem: _Problem, solve: Callable[[_Problem, FloatArray | None, float], Solution], start: FloatArray | None
) -> Solution:
    """The answer of a load step of small displacements with slip from the touch; collective.

    Args:
        problem: The problem at its end.
        solve: Solves a problem from forces, at least to this residual.
        start: The first of these.
    """
    answer = solve(problem, start, 0.0)
    x = answer.contact_force
    if problem.before is None or not has_landed(problem, x):
        return answer
    touch = place_of_touch(problem, lambda posed, x: solve(posed, x, ACCURACY), x)
    if touch is None:
        return answer
    posed = problem.in_state(replace(problem.state, touch=touch), problem.seconds, problem.before)
    return solve(posed, x, 0.0)
