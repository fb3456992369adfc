"""Products that are solves with multigrid: accurate enough where small differences of large numbers decide."""

from dataclasses import replace

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Traction
from coulomb.solvers import IterativeSolver


def test_steps_between_which_the_load_returns():
    """Most nodes then stick, with friction at its bound and no slip: A dx is small beside dx.  With products of
    a fixed accuracy, the third step needs 16 597 of them and ends in successive Tresca problems."""
    problem = ContactProblem(
        coulomb.box((2.0, 1.0, 0.5), (8, 4, 3), "tetrahedron"),
        Material(2e9, 0.3),
        [Clamp("left")],
        Contact("bottom", 0.3),
        [
            Traction("top", (0.0, 0.0, -1e5), [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0), (1.5, 1.0)]),
            Traction("right", (2000.0, 0.0, 0.0)),
        ],
        (0.0, 0.0, -77e3),
        linear_solver=IterativeSolver,
    )
    for step in LoadHistory([0.5, 1.0, 1.5]).steps(problem):
        result = step.solution.result
        assert step.solution.certificate.passed
        assert "Tresca" not in result.method and result.products <= 1000


@pytest.mark.parametrize("linear_solver", [coulomb.solvers.DirectSolver, IterativeSolver])
@pytest.mark.parametrize("what", ["nothing", "loads", "motion"])
def test_a_step_with_nothing_but_rounding_errors(what, linear_solver):
    """Everything is 0 again: exactly, where a part of the displacement before, however small, would be all there is;
    but for a load of sin(pi) = 1.2e-16; but for 4e-20 m of the foundation, and for the gaps of a block that was moved.
    """
    block, floor, top = coulomb.box((0.6, 0.3, 0.2), (4, 3, 2)), Contact("bottom", friction=0.3), Clamp("top")
    if what == "motion":
        block = coulomb.moved(block, (0.1, 0.7, 0.3), coulomb.Rotation((0.1, 0.0, 0.0), (1.0, 2.0, 0.5), 0.4))
        floor = replace(floor, motion=lambda time: (0.0, 0.0, 3e-4 * np.sin(np.pi * time)))
    else:
        wave = [(0.0, 0.0), (0.5, 1.0), (1.0, 0.0)] if what == "nothing" else lambda time: np.sin(np.pi * time)
        top = coulomb.PrescribedDisplacement("top", (0.0, 0.0, -3e-4), amplitude=wave)
    problem = ContactProblem(block, Material(7e10, 0.33), [top], floor, linear_solver=linear_solver)
    pressed, free = LoadHistory([0.5, 1.0]).steps(problem)
    assert pressed.solution.certificate.passed and np.any(pressed.solution.contact_force)
    assert free.halvings == 0 and free.solution.certificate.passed and not np.any(free.solution.contact_force)
