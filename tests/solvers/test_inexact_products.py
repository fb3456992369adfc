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


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.3])
def test_soft_springs(friction):
    """A dragged block on springs that a millionth of its own stiffness would move: b and A x nearly cancel.  Without
    the rigid motions in what the methods know of A it takes 187 products and more, of A as a whole 400 to 880."""
    problem = ContactProblem(
        coulomb.box((4.0, 1.0, 2.0), (8, 3, 4)),
        Material(2.1e11, 0.3),
        [coulomb.PrescribedDisplacement("top", (1e-2, 0.0, 0.0), "x")],
        Contact("bottom", friction=friction),
        [Traction("top", (0.0, 0.0, -1e6))],
        springs=[coulomb.Spring("top", (0.0, 1e6, 1e6))],
        linear_solver=IterativeSolver,
    )
    solution = problem.solve()
    assert solution.certificate.passed and solution.result.products <= (150 if friction > 0.0 else 400)
    x = solution.contact_force.reshape(-1, 3)
    assert np.hypot(x[:, 1].sum(), x[:, 2].sum()) / x[:, 0].sum() == pytest.approx(friction, rel=1e-6, abs=1e-12)


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
