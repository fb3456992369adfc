"""Corrections that lengthen a step of path following (solvers/longer_steps.py)."""

from dataclasses import replace

import numpy as np
from conftest import dense_compliance, make_block, random_spd

from coulomb import DenseSystem, FrictionLaw, FrictionProblem, InteriorPoint, SchurComplementSystem
from coulomb.solvers import interior_point, longer_steps
from coulomb.solvers.dense_system import augmented_matrix
from coulomb.solvers.longer_steps import longer
from coulomb.solvers.scaled_problem import Iterate, ScaledProblem
from coulomb.solvers.steps import newton_step, step_length

NODES, BETA = 12, 1e4
SOLVER = InteriorPoint()


def inside(seed, condition=100.0):
    """A scaled problem with friction at all nodes, an iterate on which nu z = 1, and A."""
    rng = np.random.default_rng(seed)
    A = random_spd(3 * NODES, condition, rng)
    law = FrictionLaw(np.zeros(NODES), rng.uniform(0.1, 0.8, NODES))
    scaled = ScaledProblem(FrictionProblem(dense_compliance(A), rng.standard_normal(3 * NODES), law))
    x_n, y = 10.0 ** rng.uniform(-1, 1, NODES), rng.uniform(-0.5, 0.5, (NODES, 2))
    v = Iterate(x_n, y, 1.0 / scaled.slack(x_n, y), scaled.A.mult(scaled.forces(x_n, y)))
    return scaled, v


def knowing(scaled):
    """A Newton system whose approximation of A is A."""
    newton = SchurComplementSystem().system(scaled.A, True)
    units = np.eye(3 * NODES).reshape(-1, NODES, 3)
    newton.learn([(e, scaled.A.mult(e)) for e in units])
    return newton


def lengths(seed, condition=100.0):
    """A step, its correction, and the lengths of both."""
    scaled, v = inside(seed, condition)
    newton, target = knowing(scaled), 0.1
    step = newton_step(SOLVER, scaled, newton, v, target, 1e-12, BETA)
    after = longer(SOLVER, scaled, newton, step, target, BETA)
    newton.destroy()
    return scaled, step, after, *(step_length(SOLVER, scaled, one, BETA, target)[0] for one in (step, after))


def test_a_correction_solves_the_system_it_is_asked_for():
    """With an approximation that is A: J_AM (dx, dnu) = (0, r2), of the last step and of another linearisation."""
    scaled, v = inside(1)
    newton, r2 = knowing(scaled), np.random.default_rng(2).standard_normal((NODES, 2))
    newton_step(SOLVER, scaled, newton, v, 0.1, 1e-12, BETA)
    at = scaled.linearize(v)
    A = np.column_stack([scaled.A.mult(e).ravel() for e in np.eye(3 * NODES).reshape(-1, NODES, 3)])
    for asked, used in ((None, at), (replace(at, D22=1e-3 * at.D22), replace(at, D22=1e-3 * at.D22))):
        change = newton.correction(r2, asked)
        exact = np.linalg.solve(augmented_matrix(A, used), np.concatenate([np.zeros(3 * NODES), r2.ravel()]))
        assert np.allclose(change.dx.ravel(), exact[: 3 * NODES], atol=1e-6 * np.abs(exact).max())
        assert np.allclose(change.dnu.ravel(), exact[3 * NODES :], atol=1e-6 * np.abs(exact).max())
        assert np.allclose(change.A_dx, scaled.A.mult(change.dx), atol=1e-6 * np.abs(change.A_dx).max())
    newton.destroy()


def test_steps_become_longer_and_never_shorter():
    pairs = np.array([lengths(seed)[3:] for seed in range(20)])
    assert np.all(pairs[:, 1] >= pairs[:, 0])
    assert pairs[:, 1].mean() >= 1.2 * pairs[:, 0].mean()


def test_held_nodes_keep_a_tenth_and_the_equations_hold(monkeypatch):
    """The gradient goes to zero along the direction; nu z = target holds to first order at all nodes but those held."""
    monkeypatch.setattr(longer_steps, "_CORRECTORS", 0)
    seen = 0
    for seed in range(40):
        scaled, step, after, before, length = lengths(seed)
        if length <= before:
            continue
        v, at = step.v, scaled.linearize(step.v)
        held = np.abs(v.x_n + after.dx_n - 0.1 * v.x_n) <= 1e-4 * v.x_n
        assert held.any() and np.all(step.dx_n[held] < 0.0)
        dx = np.column_stack([after.dx_n, at.r[:, None] * after.dy + (at.slope * after.dx_n)[:, None] * v.y])
        residual = scaled.gradient(v) + scaled.A.mult(dx) + at.C(dx) + at.J12(after.dnu)
        assert np.abs(residual).max() <= 1e-4 * np.abs(scaled.gradient(v)).max()
        centred = v.nu * (-at.J21(dx)) + scaled.slack(v.x_n, v.y) * after.dnu + 1.0 - 0.1
        assert np.abs(centred[~held]).max() <= 1e-4 and np.abs(centred[:, 1]).max() <= 1e-4
        assert np.allclose(after.A_dx, scaled.A.mult(dx), atol=1e-6 * np.abs(after.A_dx).max())
        seen += 1
    assert seen >= 3


def held_and_through(seed, condition=100.0):
    """Of a step that has become longer: held nodes, and those that would lose more than 1.2 of their pressure."""
    _, step, after, before, length = lengths(seed, condition)
    x_n = step.v.x_n
    held = np.abs(x_n + after.dx_n - 0.1 * x_n) <= 1e-4 * x_n
    return (held, step.dx_n < -1.2 * x_n) if length > before else None


def test_nodes_that_would_open_are_held_and_released_where_their_gap_would_be_negative(monkeypatch):
    monkeypatch.setattr(longer_steps, "_CORRECTORS", 0)
    for seed in (51, 96, 142):
        held, through = held_and_through(seed, 1e4)
        assert held.any() and np.any(through & ~held)
    monkeypatch.setattr(longer_steps, "_ROUNDS", 1)
    first = [found for found in map(held_and_through, range(40)) if found is not None]
    assert len(first) >= 3 and all(np.array_equal(held, through) for held, through in first)


def test_a_system_without_an_approximation_of_A_leaves_the_step():
    scaled, v = inside(3)
    newton = DenseSystem().system(scaled.A, True)
    step = newton_step(SOLVER, scaled, newton, v, 0.1, 1e-12, BETA)
    assert longer(SOLVER, scaled, newton, step, 0.1, BETA) is step


def test_fewer_steps(monkeypatch):
    problems = [make_block(p, friction).friction_problem for p in (6, 8) for friction in (0.1, 0.3, 1.0)]
    corrected = [InteriorPoint(1e-8).solve(problem) for problem in problems]
    monkeypatch.setattr(interior_point, "longer", lambda settings, scaled, newton, step, target, beta: step)
    plain = [InteriorPoint(1e-8).solve(problem) for problem in problems]
    assert sum(result.newton_steps for result in corrected) < sum(result.newton_steps for result in plain)
    for one, other in zip(corrected, plain, strict=True):
        assert np.linalg.norm(one.x - other.x) <= 1e-5 * np.linalg.norm(other.x)
