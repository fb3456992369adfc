"""Step lengths, with one step per condition that violates it alone; sigma; starting points; correctors."""

import numpy as np
import pytest
from conftest import dense_compliance, make_block, random_spd
from floating_blocks import FloatingBlock, floating_problem

from coulomb import InteriorPoint
from coulomb.solvers import DenseSystem, FrictionLaw, FrictionProblem, SchurComplementSystem, interior_point
from coulomb.solvers.interior_point import correct_step, newton_step, step_length
from coulomb.solvers.newton_systems import augmented_matrix
from coulomb.solvers.scaled_problem import Iterate, ScaledProblem, Step

NODES, BETA, SIGMA = 5, 10.0, 0.1
SOLVER = InteriorPoint(gamma=0.2)


@pytest.fixture(params=["Tresca", "Coulomb", "both"])
def at(request):
    """A scaled problem, and its iterate with equal pressure, no friction, nu z = 1 everywhere and gradient 0."""
    rng = np.random.default_rng(3)
    A, b = dense_compliance(random_spd(3 * NODES, 10.0, rng)), rng.standard_normal(3 * NODES)
    cohesion, friction = {"Tresca": (1.0, 0.0), "Coulomb": (0.0, 0.5), "both": (1.0, 0.5)}[request.param]
    law = FrictionLaw(np.full(NODES, cohesion), np.full(NODES, friction))
    scaled = ScaledProblem(FrictionProblem(A, b, law))
    v = Iterate(np.ones(NODES), np.zeros((NODES, 2)), np.zeros((NODES, 2)), np.zeros((NODES, 3)))
    v = v._replace(nu=1.0 / scaled.slack(v.x_n, v.y))
    return scaled, v._replace(A_x=-scaled.gradient(v))


def length(at, dnu, A_dx=0.0):
    """Length of a step that keeps the forces, changes nu by dnu nu (m, 2), and the gradient's rms by A_dx."""
    scaled, v = at
    rows = np.zeros((NODES, 3))
    A_dx = rows + [A_dx * np.sqrt(3.0), 0.0, 0.0]  # normal rows: they have the weight 1
    return step_length(SOLVER, scaled, Step(v, rows[:, 0], rows[:, 1:], dnu * v.nu, A_dx, 1), BETA, SIGMA)


def longest(allowed):
    """The largest permitted length of 1, 0.9, 0.81, ..."""
    return next(alpha for alpha in 0.9 ** np.arange(100) if allowed(alpha))


def test_a_full_step_is_accepted(at):
    alpha, new = length(at, -0.9 * np.ones((NODES, 2)))
    assert alpha == 1.0 and new is not None


def test_the_gradient_stays_below_beta_theta(at):
    """|gradient| = alpha beta/2 beside theta = 1 - 0.9 alpha."""
    _, v = at  # of the change of the gradient, the normal multipliers have a part
    alpha, _ = length(at, -0.9 * np.ones((NODES, 2)), -0.9 * v.nu[0, 0] / np.sqrt(3.0) + 0.5 * BETA)
    assert alpha == pytest.approx(longest(lambda alpha: 0.5 * alpha <= 1.0 - 0.9 * alpha))


def test_products_stay_near_their_mean(at):
    """One nu z falls by 0.95, the others by half: below gamma = 0.2 of the mean at the end."""
    dnu = -0.5 * np.ones((NODES, 2))
    dnu[0, 0] = -0.95
    alpha, _ = length(at, dnu)
    mean = dnu.mean()
    assert alpha == pytest.approx(longest(lambda alpha: 1.0 - 0.95 * alpha >= 0.2 * (1.0 + mean * alpha)))
    assert alpha < 1.0


def test_theta_decreases(at):
    alpha, new = length(at, 0.05 * np.ones((NODES, 2)))
    assert new is None and alpha < 1e-9
    small = 0.5 * SOLVER.omega * (1.0 - SIGMA)
    assert length(at, -small * np.ones((NODES, 2)))[1] is None  # not enough
    assert length(at, -4.0 * small * np.ones((NODES, 2)))[0] == 1.0


def test_a_step_goes_to_the_boundary_and_not_over_it(at):
    scaled, v = at
    rows = np.zeros((NODES, 3))
    dx_n = np.where(np.arange(NODES) == 2, -1.0, 0.0)
    step = Step(v, 4.0 * dx_n, rows[:, 1:], -0.9 * v.nu, rows, 1)
    alpha, _ = step_length(InteriorPoint(gamma=1e-9), scaled, step, 1e9, SIGMA)
    assert alpha == pytest.approx(SOLVER.to_boundary / 4.0)


@pytest.mark.parametrize("blocked_at", [10, 13])
def test_steps_that_end_near_an_answer_go_on_from_there(monkeypatch, blocked_at):
    """Not from a cold start, which throws the iterate away."""
    problem, calls = floating_problem(FloatingBlock(), 0.7), []

    def once(*arguments):
        calls.append(arguments)
        return (0.0, None) if len(calls) == blocked_at else step_length(*arguments)

    monkeypatch.setattr(interior_point, "correct_step", lambda settings, scaled, newton, step, target, beta: step)
    at_once = InteriorPoint().solve(problem)
    monkeypatch.setattr(interior_point, "step_length", once)
    answer = InteriorPoint().solve(problem)
    assert blocked_at < answer.newton_steps <= at_once.newton_steps + 2
    assert answer.x == pytest.approx(at_once.x, abs=1e-6 * np.abs(at_once.x).max())


def test_a_warm_start_is_on_the_central_path_of_its_projection():
    """D (x - q) balances the multipliers at every node, and nu z = theta: q far outside, near the edge, and inside."""
    rng = np.random.default_rng(6)
    A, g = dense_compliance(random_spd(60, 10.0, rng)), 10.0 ** rng.uniform(-2, 1, 20)
    g[3] = 0.0
    problem = ScaledProblem(FrictionProblem.tresca(A, rng.standard_normal(60), g))
    q = rng.standard_normal((20, 3)) * 10.0 ** rng.uniform(-2, 1, (20, 1))
    for theta in (1.0, 1e-4, 1e-9):
        x_n, y, nu = problem.smoothed_projection(q, theta)
        x, z, d, f = problem.forces(x_n, y), problem.slack(x_n, y), problem.isotropic(), problem.frictional
        assert np.all(z[:, 0] > 0.0) and np.all(z[f, 1] > 0.0) and not x[~f, 1:].any()
        assert np.allclose(nu[:, 0] * z[:, 0], theta, rtol=1e-6) and np.allclose((nu * z)[f, 1], theta, rtol=1e-6)
        assert np.allclose(d[:, 0] * (x - q)[:, 0], nu[:, 0], rtol=1e-6, atol=1e-9)
        friction = nu[:, 1:] * y
        assert np.allclose((d[:, 1:] * (x - q)[:, 1:])[f], -friction[f], rtol=1e-4, atol=1e-6)


def test_a_start_from_forces_alone_is_well_inside():
    """x_n at least 0.3 nominal forces over its lower bound, |y| at most 0.9; nearest to the forces given."""
    rng = np.random.default_rng(8)
    law = FrictionLaw(rng.uniform(0.0, 1.0, 20), np.where(np.arange(20) % 2, 0.4, 0.0))
    A = dense_compliance(random_spd(60, 10.0, rng))
    problem = ScaledProblem(FrictionProblem(A, rng.standard_normal(60), law, lower=0.1))
    x = problem._s * rng.standard_normal((20, 3))
    x_n, y = problem.inside(x.ravel(), 0.3, 0.9)
    assert np.allclose(x_n, np.maximum(x[:, 0] / problem._s, problem.lower + 0.3))
    kept, forces = np.linalg.norm(y, axis=1) < 0.9 - 1e-9, problem.forces(x_n, y) * problem._W * problem._s
    assert np.linalg.norm(y, axis=1).max() <= 0.9 + 1e-12 and 0 < kept.sum() < 20
    assert np.allclose(forces[kept, 1:], x[kept, 1:])
    assert np.allclose(forces[:, 1] * x[:, 2], forces[:, 2] * x[:, 1])  # the direction is unchanged


# --- correctors -------------------------------------------------------------------------------------------------------

MANY, WIDE = 12, 1e4
CORRECTED = InteriorPoint()


def interior(seed, condition=100.0):
    """A scaled problem with friction at all nodes, and an iterate on which nu z = 1."""
    rng = np.random.default_rng(seed)
    A = random_spd(3 * MANY, condition, rng)
    law = FrictionLaw(np.zeros(MANY), rng.uniform(0.1, 0.8, MANY))
    scaled = ScaledProblem(FrictionProblem(dense_compliance(A), rng.standard_normal(3 * MANY), law))
    x_n, y = 10.0 ** rng.uniform(-1, 1, MANY), rng.uniform(-0.5, 0.5, (MANY, 2))
    v = Iterate(x_n, y, 1.0 / scaled.slack(x_n, y), scaled.A.mult(scaled.forces(x_n, y)))
    return scaled, v


def knowing(scaled):
    """A Newton system whose approximation of A is A."""
    newton = SchurComplementSystem().system(scaled.A, True)
    units = np.eye(3 * MANY).reshape(-1, MANY, 3)
    newton.learn([(e, scaled.A.mult(e)) for e in units])
    return newton


def lengths(seed, condition=100.0):
    """A step, its correction, and the lengths of both."""
    scaled, v = interior(seed, condition)
    newton, target = knowing(scaled), 0.1
    step = newton_step(scaled, newton, v, target, 1e-12, WIDE)
    after = correct_step(CORRECTED, scaled, newton, step, target, WIDE)
    newton.destroy()
    return scaled, step, after, *(step_length(CORRECTED, scaled, one, WIDE, target)[0] for one in (step, after))


def test_a_correction_solves_the_system_it_is_asked_for():
    """With an approximation that is A: J_AM (dx, dnu) = (0, r2)."""
    scaled, v = interior(1)
    newton, r2 = knowing(scaled), np.random.default_rng(2).standard_normal((MANY, 2))
    newton_step(scaled, newton, v, 0.1, 1e-12, WIDE)
    at = scaled.linearize(v)
    A = np.column_stack([scaled.A.mult(e).ravel() for e in np.eye(3 * MANY).reshape(-1, MANY, 3)])
    change = newton.correction(r2)
    exact = np.linalg.solve(augmented_matrix(A, at), np.concatenate([np.zeros(3 * MANY), r2.ravel()]))
    assert np.allclose(change.dx.ravel(), exact[: 3 * MANY], atol=1e-6 * np.abs(exact).max())
    assert np.allclose(change.dnu.ravel(), exact[3 * MANY :], atol=1e-6 * np.abs(exact).max())
    assert np.allclose(change.A_dx, scaled.A.mult(change.dx), atol=1e-6 * np.abs(change.A_dx).max())
    newton.destroy()


def test_steps_become_longer_and_never_shorter():
    pairs = np.array([lengths(seed)[3:] for seed in range(20)])
    assert np.all(pairs[:, 1] >= pairs[:, 0])
    assert np.count_nonzero(pairs[:, 1] > pairs[:, 0]) >= 6


def test_a_system_without_an_approximation_of_A_leaves_the_step():
    scaled, v = interior(3)
    newton = DenseSystem().system(scaled.A, True)
    step = newton_step(scaled, newton, v, 0.1, 1e-12, WIDE)
    assert correct_step(CORRECTED, scaled, newton, step, 0.1, WIDE) is step


def test_fewer_steps(monkeypatch):
    problems = [make_block(p, friction).friction_problem for p, friction in ((4, 0.1), (4, 0.3), (6, 1.0))]
    corrected = [InteriorPoint(1e-8).solve(problem) for problem in problems]
    monkeypatch.setattr(interior_point, "correct_step", lambda settings, scaled, newton, step, target, beta: step)
    plain = [InteriorPoint(1e-8).solve(problem) for problem in problems]
    assert sum(result.newton_steps for result in corrected) < sum(result.newton_steps for result in plain)
    for one, other in zip(corrected, plain, strict=True):
        assert np.linalg.norm(one.x - other.x) <= 1e-5 * np.linalg.norm(other.x)
