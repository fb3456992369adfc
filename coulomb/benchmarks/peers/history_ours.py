"""coulomb itself on the load history: every step certified."""

from __future__ import annotations

import time

from ...fem.bodies import Clamp, Material, Traction
from ...fem.meshes import box
from ...model.contact import Contact
from ...model.load_history import LoadHistory
from ...model.problem import ContactProblem
from .answer import FRICTION, LENGTHS, POISSON, TRACTIONS, YOUNG, Answer, Unsolved, on_body
from .history import STEPS, dragged, pressed, stacked

TOLERANCE = 1e-8


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


def solve(p: int) -> Answer:
    """Iterations are Newton steps."""
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
