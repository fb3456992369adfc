"""Loads that contact cannot balance: found before the solve, or by a body that slides away."""

import numpy as np
import pytest
from conftest import dense_compliance
from floating_blocks import FRICTION, WEIGHT, FloatingBlock, floating_problem

from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca
from coulomb.solvers import Automatic, DenseSystem, FrictionLaw, FrictionProblem, RigidMotions
from coulomb.solvers.equilibrium import equilibrium

BLOCK = FloatingBlock()
TALL = FloatingBlock(size=(1.0, 1.0, 2.0), cells=(2, 2, 3))


def loaded(block, force, friction=FRICTION, cohesion=0.0, gap=0.0, everywhere=False):
    """The block under a force on its top, or on all of its nodes."""
    f = np.tile(np.asarray(force) / len(block.points), len(block.points)) if everywhere else block.load(force)
    A, b, G, e = block.parts(f)
    m = len(b) // 3
    b[0::3] -= gap
    law = FrictionLaw(np.full(m, cohesion), np.full(m, friction))
    return FrictionProblem(dense_compliance(A), b, law, rigid=RigidMotions(G, e, block.names))


def most_work(problem, motion):
    """Of contact forces on a motion: 0 if it opens every contact by at least F times its slip, else without bound."""
    v = (motion @ problem.rigid.G).reshape(-1, 3)
    slip = np.hypot(v[:, 1], v[:, 2])
    assert np.all(v[:, 0] + problem.law.friction * slip <= 1e-3 * np.abs(v).max())
    return float(problem.law.cohesion @ slip)


@pytest.mark.parametrize("ratio", [0.0, 0.52, 0.99, 0.9999])
def test_forces_in_equilibrium(ratio):
    problem = floating_problem(BLOCK, ratio)
    found = equilibrium(problem)
    assert found.exists and not len(found.motion)
    assert np.allclose(problem.rigid.G @ found.x, problem.rigid.e, atol=1e-8 * WEIGHT)
    assert np.all(found.x[0::3] >= 0.0)
    assert np.all(np.hypot(found.x[1::3], found.x[2::3]) <= problem.slip_bound(found.x) * (1.0 + 1e-12))


@pytest.mark.parametrize("ratio", [1.0001, 1.05, 1.3])
def test_a_push_over_the_friction(ratio):
    """Coulomb's formula: the loads push with T along themselves, friction holds F N."""
    problem = floating_problem(BLOCK, ratio)
    found = equilibrium(problem)
    assert not found.exists and found.proven
    assert np.allclose(found.direction, [0.8, 0.6, 0.0, 0.0, 0.0, 0.0], atol=1e-3)
    assert found.load == pytest.approx(ratio * FRICTION * WEIGHT, rel=1e-4)
    assert found.resistance == pytest.approx(FRICTION * WEIGHT, rel=3e-3) and found.resistance < found.load
    assert found.motion @ problem.rigid.e > most_work(problem, found.motion)


@pytest.mark.parametrize(
    "solver", [InteriorPoint(), InteriorPoint(newton=DenseSystem()), SuccessiveTresca(), Automatic()]
)
def test_solvers_end_at_once(solver):
    problem = floating_problem(BLOCK, 1.05)
    message = r'no equilibrium: the loads push along 0\.8 "x", 0\.6 "y" with 3\.15e\+05'
    with pytest.raises(NotConverged, match=message) as failure:
        solver.solve(problem)
    result = failure.value.result
    assert result.status is Status.NO_EQUILIBRIUM and result.newton_steps == 0 and result.products <= 2
    assert result.equilibrium.load > result.equilibrium.resistance
    assert result.residual > 1e-2 and str(failure.value) == result.message
    assert problem.residual(result.x, result.gradient) == result.residual


def test_tipping():
    """A block of width 1 and height 2, pushed at its top, tips at T = N/4, however rough the plane."""
    for friction in (0.3, 1.5):
        assert equilibrium(loaded(TALL, (0.0, 0.24 * WEIGHT, -WEIGHT), friction)).exists
        problem = loaded(TALL, (0.0, 0.26 * WEIGHT, -WEIGHT), friction)
        found = equilibrium(problem)
        assert not found.exists and np.argmax(np.abs(found.direction)) == 3  # about x
        assert abs(found.resistance) <= 5e-3 * found.load
        assert found.motion @ problem.rigid.e > most_work(problem, found.motion)


def test_a_body_is_lifted():
    found = equilibrium(loaded(BLOCK, (0.0, 0.0, 7.0)))
    assert np.allclose(found.direction, [0, 0, 1, 0, 0, 0], atol=1e-3)
    assert found.load == pytest.approx(7.0, rel=1e-3) and found.resistance == 0.0


def test_given_slip_bounds():
    """|T| <= m c, whatever presses."""
    m, c = len(BLOCK.bottom), 1e4
    assert equilibrium(loaded(BLOCK, (0.95 * m * c, 0.0, -WEIGHT), 0.0, c)).exists
    problem = loaded(BLOCK, (1.05 * m * c, 0.0, -WEIGHT), 0.0, c)
    found = equilibrium(problem)
    assert found.load == pytest.approx(1.05 * m * c, rel=1e-4) and found.resistance == pytest.approx(m * c, rel=1e-3)
    assert found.motion @ problem.rigid.e > most_work(problem, found.motion)


def test_motions_without_resistance():
    """Without friction a block spins, unless nothing turns it."""
    assert equilibrium(loaded(BLOCK, (0.0, 0.0, -WEIGHT), 0.0)).exists
    A, b, G, e = BLOCK.parts(BLOCK.load((0.0, 0.0, -WEIGHT), moment_about_z=1e3))
    problem = FrictionProblem(dense_compliance(A), b, FrictionLaw.coulomb(np.zeros(15)), rigid=RigidMotions(G, e))
    found = equilibrium(problem)
    assert not found.exists and np.allclose(np.abs(found.direction), [0, 0, 0, 0, 0, 1], atol=1e-9)
    assert found.load == pytest.approx(abs(e[5])) and found.resistance == 0.0


def test_a_body_slides_between_walls():
    """Any squeezing force would hold it, and so forces in equilibrium exist; but nothing squeezes more than the load.

    The solver notices after some steps that it slides away.  Pressed by N on one wall, it holds up to F N.
    """
    between = FloatingBlock(between=True)
    for pull, gap, slides in ((4e5, 0.0, True), (1e4, 1e-6, True), (2e5, 0.0, False), (4e5, -1e-6, False)):
        problem = loaded(between, (pull, 0.0, -WEIGHT if gap <= 0.0 else 0.0), gap=gap, everywhere=True)
        assert equilibrium(problem).exists
        if not slides:
            assert InteriorPoint().solve(problem).newton_steps <= 20
            continue
        with pytest.raises(NotConverged, match=r"stagnated.*the loads push along .*at the pressures") as failure:
            InteriorPoint().solve(problem)
        result = failure.value.result
        found = result.equilibrium
        assert result.status is Status.STAGNATED and result.newton_steps <= 100
        assert not found.proven and not len(found.motion)
        assert found.direction[0] > 0.9 and found.load == pytest.approx(pull, rel=0.1) and found.resistance < found.load


def test_a_body_slides_between_walls_that_curve_away():
    """Where most nodes are far from the wall, the motion is not larger than the gaps, but than those under pressure.
    The Tresca problems that follow find no answer either; here they are few."""
    few = SuccessiveTresca(qp_solver=InteriorPoint(max_iterations=5), max_iterations=1)
    problem = loaded(FloatingBlock(between=True), (4e5, 0.0, -WEIGHT), everywhere=True)
    b = problem.b.copy()
    b[9:36:3] -= 0.5
    with pytest.raises(
        NotConverged, match=r"the loads push along .*at the pressures.*Then successive Tresca"
    ) as failure:
        Automatic(successive_tresca=few).solve(FrictionProblem(problem.A, b, problem.law, rigid=problem.rigid))
    result = failure.value.result
    assert result.status is not Status.NO_EQUILIBRIUM


def test_a_problem_whose_bodies_are_held():
    problem = floating_problem(BLOCK, 0.5)
    with pytest.raises(ValueError, match="no rigid motions"):
        equilibrium(FrictionProblem(problem.A, problem.b, problem.law))
