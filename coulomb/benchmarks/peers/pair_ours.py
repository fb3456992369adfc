"""coulomb itself on the two blocks, up to a certified answer: the reference for the others."""

from __future__ import annotations

import time

from scipy.spatial import cKDTree

from ...arrays import FloatArray
from ...model.problem import ContactProblem
from ..two_blocks import BLOCKS, grid, two_blocks
from .answer import Answer, Unsolved
from .ours import TOLERANCE
from .pair import answer


def solve(p: int) -> Answer:
    """Iterations are path-following steps."""
    two_blocks(2).solve(TOLERANCE)  # compiles and warms up
    began = time.perf_counter()
    problem = two_blocks(p)
    solution = problem.solve(TOLERANCE)
    seconds = time.perf_counter() - began
    if not solution.certificate.passed:
        raise Unsolved("its answer was not certified")
    return answer_of(problem, p, solution.displacement, seconds, solution.result.newton_steps)


def answer_of(problem: ContactProblem, p: int, displacement: FloatArray, seconds: float, iterations: int) -> Answer:
    """The answer of displacements of the problem's nodes in metres, shape (k, 3)."""
    u: dict[str, FloatArray] = {}
    for member in problem.elasticity.members:
        points = grid(BLOCKS[member.name], p).points
        _, own = cKDTree(problem.elasticity.x[member.nodes]).query(points)
        u[member.name] = displacement[member.nodes][own]
    return answer(p, u["lower"], u["upper"], seconds, iterations)
