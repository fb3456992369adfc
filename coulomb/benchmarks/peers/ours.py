"""coulomb itself, up to a certified answer: the reference for the others."""

from __future__ import annotations

import time

from ..block import block
from .answer import Answer, Unsolved, on_body

TOLERANCE = 1e-8


def solve(p: int) -> Answer:
    """Iterations are path-following steps."""
    block(1).solve(TOLERANCE)  # compiles and warms up
    began = time.perf_counter()
    problem = block(p)
    solution = problem.solve(TOLERANCE)
    seconds = time.perf_counter() - began
    if not solution.certificate.passed:
        raise Unsolved("its answer was not certified")
    return Answer(seconds, solution.result.newton_steps, problem.surface.x, on_body(problem, solution.contact_force))
