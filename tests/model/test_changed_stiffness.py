"""A stiffness that changes during a run: the answer is that of a problem that is set up anew."""

import numpy as np
import pytest
from conftest import STEEL

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, Traction
from coulomb.solvers import DirectSolver, IterativeSolver

SOFT = Material(1e11, 0.2)
METHODS = [(DirectSolver, True), (DirectSolver, False), (IterativeSolver, False)]
MESH = coulomb.box((0.4, 0.2, 0.2), (6, 3, 3))
PRESSED = [Clamp("left")], [Traction("top", (2e6, 0.0, -5e6))]


def product(problem, x):
    y = np.empty_like(x)
    problem.A.mult(x, y)
    return y


def posed(material, linear_solver, explicit):
    held, loads = PRESSED
    options = {"linear_solver": linear_solver, "explicit": explicit}
    return ContactProblem(MESH, material, held, Contact("bottom", 0.3), tractions=loads, **options)


@pytest.mark.parametrize(("linear_solver", "explicit"), METHODS)
def test_a_replaced_stiffness(linear_solver, explicit):
    """After a solve, with what the Krylov methods have learnt of A in it."""
    problem = posed(STEEL, linear_solver, explicit)
    problem.solve()
    held, loads = PRESSED
    problem.body.replace(Elasticity(MESH, SOFT, held, loads))
    then, fresh = problem.at(0.0), posed(SOFT, linear_solver, explicit)
    x = np.random.default_rng(3).standard_normal(len(fresh.b))
    assert then.b == pytest.approx(fresh.b, rel=1e-9, abs=1e-9 * np.abs(fresh.b).max())
    expected = product(fresh, x)
    assert product(then, x) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    answer, anew = then.solve(), fresh.solve()
    assert answer.valid and anew.valid
    error = np.abs(answer.displacement - anew.displacement).max() / np.abs(anew.displacement).max()
    assert error < 1e-7


@pytest.mark.parametrize(("linear_solver", "explicit"), METHODS)
def test_a_stiffness_changed_in_place(linear_solver, explicit):
    """Twice K is half A, and half the displacement without contact; nothing is kept of the first."""
    problem = posed(STEEL, linear_solver, explicit)
    A, b = product(problem, np.ones(len(problem.b))), problem.b
    problem.elasticity.K.scale(2.0)
    problem.body.replace(problem.elasticity)
    problem = problem.at(0.0)
    assert product(problem, np.ones(len(b))) == pytest.approx(0.5 * A, rel=1e-6)
    if explicit:  # others are refined with the form of the body, which is as it was
        assert problem.b == pytest.approx(0.5 * b, rel=1e-6)


def test_another_mesh_is_refused():
    problem = posed(STEEL, None, None)
    held, loads = PRESSED
    for mesh, supports in ((coulomb.box((0.4, 0.2, 0.2), (5, 3, 3)), held), (MESH, [Clamp("top")])):
        with pytest.raises(ValueError, match="same mesh"):
            problem.body.replace(Elasticity(mesh, STEEL, supports, loads))


def test_posing_another_step_leaves_products_alone():
    """A is shared by all load steps; only a solve tells it of its load."""
    problem = posed(STEEL, IterativeSolver, False)
    problem.solve()
    latest = problem.A.matrix_free.latest
    assert latest is not None and problem.at(1.0).friction_problem.A is problem.A
    assert problem.A.matrix_free.latest is latest
