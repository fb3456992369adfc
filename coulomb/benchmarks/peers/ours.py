"""coulomb itself, up to a certified answer: the reference for the others."""

from __future__ import annotations

import time
from collections.abc import Callable

from ...model.problem import ContactProblem
from ..block import block
from .answer import Answer, Unsolved, on_body

TOLERANCE = 1e-8


def second_order(p: int) -> ContactProblem:
    """The block of 10-node tetrahedra, 6 per cube of edge 1/p."""
    return block(p, cell="tetrahedron", degree=2)


def solve(p: int) -> Answer:
    """The block of hexahedra; iterations are path-following steps."""
    return _solve(block, p)


def solve_second_order(p: int) -> Answer:
    """The block of 10-node tetrahedra."""
    return _solve(second_order, p)


def _solve(make: Callable[[int], ContactProblem], p: int) -> Answer:
    make(1).solve(TOLERANCE)  # compiles and warms up
    began = time.perf_counter()
    problem = make(p)
    solution = problem.solve(TOLERANCE)
    seconds = time.perf_counter() - began
    if not solution.certificate.passed:
        raise Unsolved("its answer was not certified")
    return Answer(seconds, solution.result.newton_steps, problem.surface.x, on_body(problem, solution.contact_force))
