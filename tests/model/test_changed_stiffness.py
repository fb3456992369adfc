"""A stiffness that changes during a run: the answer is that of a problem that is set up anew."""

import numpy as np
import pytest
import ufl
from conftest import STEEL
from user_forms import Script

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, Traction
from coulomb.fem.compat import fem
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
def test_a_stiffness_changed_values(linear_solver, explicit):
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


def values(change=0.0):
    """Of contact, loads, supports and material."""
    return {
        "friction": 0.3 - change,
        "gap": 1e-6 * (1.0 + change),
        "load": np.array((2e6, 0.0, -5e6 * (1.0 + change))),
        "moved": np.array((0.0, 1e-6 * change, 0.0)),
        "young": 2e11 * (1.0 + change),
    }


def of_values(mesh, v, **options):
    return ContactProblem(
        mesh,
        Material(v["young"], 0.3),
        [coulomb.PrescribedDisplacement("left", v["moved"])],
        Contact("bottom", v["friction"], gap=v["gap"]),
        tractions=[Traction("top", v["load"])],
        **options,
    )


@pytest.mark.parametrize("order", [1, 2])
def test_changed_constants_keep_what_they_do_not_change(order):
    """K and its factors by loads, supports and contacts, the order of elimination by a modulus; answers are those of
    problems that are posed anew."""
    mesh = MESH if order == 1 else coulomb.second_order(coulomb.box((0.4, 0.2, 0.2), (2, 1, 1)))
    options, tolerance = ({}, 1e-11) if order == 1 else ({"linear_solver": "iterative"}, 1e-9)
    constants = {name: fem.Constant(mesh.domain, value) for name, value in values().items()}
    now = values()
    posed = of_values(mesh, constants, **options)
    first = posed.solve(tolerance)
    kept = [first.problem.linear.stiffness]
    for name in ("friction", "gap", "load", "moved", "young", "load"):
        constants[name].value = now[name] = values(0.1 if name != "load" else 0.1 * len(kept))[name]
        other = posed.solve(tolerance, start=first.contact_force)
        expected = of_values(mesh, now, **options).solve(tolerance)
        assert other.valid
        scale = np.abs(expected.displacement).max()
        assert other.displacement == pytest.approx(expected.displacement, abs=100.0 * tolerance * scale), name
        kept.append(other.problem.linear.stiffness)
        same = kept[-1].elasticity.K is kept[-2].elasticity.K
        assert (kept[-1] is kept[-2]) == same == (name != "young")
    if order == 1:
        assert kept[-1].solver.fronts is kept[0].solver.fronts


def test_a_changed_modulus_of_forms_keeps_the_order_of_elimination():
    """And a changed load keeps K and its factors; a start from the last answer takes fewer Newton steps."""
    script = Script(MESH, 1)
    young, load = script.constant(2e11), script.constant((2e6, 0.0, -5e6))
    L = ufl.inner(load, script.v) * script.ds("top")
    body = coulomb.Body(script.elasticity(young, 0.3), L, [script.bc((0.0, 0.0, 0.0), "left")], MESH)
    posed = ContactProblem(body, Contact("bottom", 0.3))
    first = posed.solve()
    load.value[:] = (2.1e6, 0.0, -5.1e6)
    second = posed.solve(start=first.contact_force)
    assert second.problem.linear.stiffness is first.problem.linear.stiffness and second.valid
    assert second.result.newton_steps < first.result.newton_steps
    young.value = 1e11
    third = posed.solve(start=second.contact_force)
    assert third.problem.linear.stiffness is not first.problem.linear.stiffness
    assert third.problem.linear.stiffness.solver.fronts is first.problem.linear.stiffness.solver.fronts
    assert third.displacement == pytest.approx(2.0 * second.displacement, abs=1e-6 * np.abs(second.displacement).max())


def test_constants_of_a_pair_of_bodies_and_a_tie():
    """A traction and the friction of a pair between tied bodies: K, the mortar matrix and factors are kept."""
    upper = coulomb.moved(coulomb.box((0.3, 0.2, 0.1), (4, 2, 1)), translate=(0.0, 0.0, 0.2))
    glued = coulomb.moved(coulomb.box((0.3, 0.2, 0.1), (2, 3, 1)), translate=(0.0, 0.0, 0.3))
    bodies = coulomb.join(lower=MESH, upper=upper, glued=glued)
    domain = MESH.domain
    load, friction = fem.Constant(domain, (1e5, 0.0, -1e6)), fem.Constant(domain, 0.4)

    def made(load, friction):
        return ContactProblem(
            bodies,
            STEEL,
            [Clamp("lower:bottom")],
            Contact("upper:bottom", friction, against="lower:top"),
            [Traction("glued:top", load)],
            ties=[coulomb.Tied("glued:bottom", "upper:top")],
        )

    posed = made(load, friction)
    first = posed.solve(1e-11)
    load.value[:], friction.value = (2e5, 0.0, -1.5e6), 0.35
    second, expected = posed.solve(1e-11), made((2e5, 0.0, -1.5e6), 0.35).solve(1e-11)
    assert second.problem.linear.stiffness is first.problem.linear.stiffness and second.valid
    scale = np.abs(expected.displacement).max()
    assert second.displacement == pytest.approx(expected.displacement, abs=1e-9 * scale)
