"""coulomb itself, up to a certified answer: the reference for the others."""

from __future__ import annotations

import time
from collections.abc import Callable

from scipy.spatial import cKDTree

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, Traction
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.load_history import LoadHistory
from coulomb.model.problem import ContactProblem

from ..block import block
from ..two_blocks import BLOCKS, grid, two_blocks
from .answer import (
    FRICTION,
    LENGTHS,
    POISSON,
    STEPS,
    TRACTIONS,
    YOUNG,
    Answer,
    Unsolved,
    dragged,
    on_body,
    pressed,
    stacked,
)
from .pair import answer

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


def history_block(p: int) -> ContactProblem:
    """The block with p cells per metre, its tractions as functions of time."""
    x, y, z = TRACTIONS["top"]
    return ContactProblem(
        box(LENGTHS, (3 * p, p, p)),
        Material(young=YOUNG, poisson=POISSON),
        [Clamp("left")],
        Contact("bottom", FRICTION),
        [
            Traction("top", (0.0, 0.0, z), amplitude=pressed),
            Traction("top", (x, y, 0.0), amplitude=dragged),
            Traction("right", TRACTIONS["right"], amplitude=dragged),
        ],
    )


def solve_history(p: int) -> Answer:
    """The load history, every step certified; iterations are Newton steps."""
    history = LoadHistory([float(number) for number in range(1, STEPS + 1)], tolerance=TOLERANCE)
    for _ in history.steps(history_block(1)):  # compiles and warms up
        pass
    began = time.perf_counter()
    problem, forces, first, steps, products = history_block(p), [], 0.0, 0, 0
    for step in history.steps(problem):
        if not step.solution.certificate.passed or step.halvings:
            raise Unsolved(f"step {step.state.number} was not certified, or was halved")
        forces.append(on_body(problem, step.solution.contact_force))
        steps += step.solution.result.newton_steps
        products += step.solution.result.products
        first = first or time.perf_counter() - began
    seconds = time.perf_counter() - began
    return Answer(seconds, steps, problem.surface.x, stacked(forces), first_seconds=first, products=products)


def solve_pair(p: int) -> Answer:
    """The two blocks; iterations are path-following steps."""
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
