"""Algorithm PF: right answers, and its known pitfalls."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import (
    dense_compliance,
    make_block,
    random_spd,
    random_tresca,
)

from coulomb import InteriorPoint, NotConverged, Status
from coulomb.solvers import (
    AugmentedSystem,
    FrictionLaw,
    FrictionProblem,
    IterativeSolver,
)
from coulomb.solvers.scaled_problem import Iterate, ScaledProblem


def test_kkt_conditions_by_hand():
    """One node, A = I: x_n = b_n, friction on its disc along b_t; multipliers of both."""
    b = np.array([2.0, 3.0, 4.0])
    result = InteriorPoint(tolerance=1e-10).solve(
        FrictionProblem.tresca(dense_compliance(np.eye(3)), b, np.array([1.0]))
    )
    assert np.allclose(result.x, [2.0, 0.6, 0.8], atol=1e-8)
    assert np.allclose(result.gradient, [0.0, -2.4, -3.2], atol=1e-8)
    assert np.allclose(result.multipliers, [[0.0, 4.0]], atol=1e-7)


def test_open_contact_needs_no_step():
    qp = FrictionProblem.tresca(dense_compliance(np.eye(6)), np.array([-1.0, 0, 0, -2.0, 0, 0]), np.zeros(2))
    result = InteriorPoint().solve(qp)
    assert result.newton_steps == 0 and not result.x.any() and result.status is Status.CONVERGED


def test_block_takes_at_most_fifteen_steps_at_any_size():
    """At p = 4 and 10 to a residual of 1e-6."""
    steps = {p: make_block(p, slip_stress=1e7).solve(tolerance=1e-6).result.newton_steps for p in (4, 10)}
    assert max(steps.values()) <= 15


# --- the neighbourhood ----------------------------------------------------------------------------------------------


def test_inner_precision_follows_the_papers_rule():
    qp, _ = random_tresca(30, seed=17)
    solver = InteriorPoint(tolerance=1e-9, r_tol=0.3, c_fact=0.8)
    tolerances = [step.krylov_tolerance for step in solver.solve(qp).history]
    assert tolerances[0] == pytest.approx(solver.r_tol)
    assert all(new <= solver.c_fact * old * (1 + 1e-12) for old, new in pairwise(tolerances))


# --- known pitfalls of the algorithm -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Blocked(AugmentedSystem):
    """Steps that run into the boundary at once: alpha is tiny, and so is every change."""

    def system(self, A, sloped):
        system = super().system(A, sloped)
        solve = system.solve

        def blocked(*arguments):
            step = solve(*arguments)
            dx = step.dx.copy()
            dx[0, 0] = -1e9 * np.abs(dx).max()
            return step._replace(dx=dx)

        system.solve = blocked
        return system


def test_a_blocked_step_is_not_convergence():
    """err = |v_new - v|/|v_new| is tiny when alpha is; the residual alone decides on convergence."""
    qp, _ = random_tresca(10, seed=18)
    with pytest.raises(NotConverged) as failure:
        InteriorPoint(tolerance=1e-6, newton=Blocked()).solve(qp)
    result = failure.value.result
    assert result.status is Status.STAGNATED
    assert result.residual > 1e-6 and result.residual == pytest.approx(qp.residual(result.x))
    assert all(step.alpha < 1e-6 for step in result.history)


@pytest.mark.parametrize(("force", "length"), [(1e6, 1e-6), (2.0**-20, 2.0**30)])
def test_units_do_not_change_the_iteration(force, length):
    """The same problem with other units of force and length: the same steps, the same answer."""
    qp, A = random_tresca(25, seed=19)
    base = InteriorPoint().solve(qp)
    other = FrictionProblem.tresca(dense_compliance(A * length / force), qp.b * length, qp.law.cohesion * force)
    result = InteriorPoint().solve(other)
    assert result.newton_steps == base.newton_steps
    if force == 2.0**-20:  # powers of two: rounding is the same
        assert [step.krylov for step in result.history] == [step.krylov for step in base.history]
        assert np.array_equal(result.x, force * base.x)
    assert np.allclose(result.x, force * base.x, rtol=1e-6, atol=1e-9 * force * np.abs(base.x).max())


def test_slip_bounds_over_many_orders():
    problem = make_block(6, slip_stress=1e7)
    rng = np.random.default_rng(20)
    spread = problem.slip_bound(problem.b) * 10.0 ** -rng.uniform(0, 7, len(problem.surface.nodes))
    result = InteriorPoint(tolerance=1e-8).solve(problem.tresca(spread))
    assert result.newton_steps <= 30


def test_small_discs_are_scaled_to_unit_discs():
    qp, _ = random_tresca(8, seed=22)
    scaled = ScaledProblem(qp.with_slip_bound(qp.law.cohesion * np.geomspace(1e-8, 1e3, 8)))
    assert np.all(scaled.law.radius(np.ones(8)) >= 1.0) and scaled.A.W[:, 1:].min() < 1e-6
    radius = scaled.law.radius(np.ones(8)) * scaled.A.W[:, 1] * scaled._s  # in newtons
    assert np.allclose(radius, scaled.problem.law.cohesion) and scaled.A.W.max() == 1.0
    assert np.all((scaled.law.radius(np.ones(8)) == 1.0) | (scaled.A.W[:, 1] == 1.0))  # unit discs, or larger ones
    assert np.all(scaled.weight(np.ones(8)) == 1.0)  # the rows have their weight already
    sloped = ScaledProblem(FrictionProblem(qp.A, qp.b, FrictionLaw(1e-8 * qp.law.cohesion, np.full(8, 0.3))))
    assert np.all(sloped.A.W == 1.0) and np.all(sloped.weight(np.full(8, 1e-3))[:, 1:] < 1e-3)


def test_small_beta_is_widened_to_contain_the_start():
    qp, _ = random_tresca(30, seed=24)
    assert InteriorPoint(beta=1e-6).solve(qp).newton_steps <= 40


def test_inexact_stiffness_solver():
    """It must not end as converged."""

    class Loose(IterativeSolver):
        def __init__(self, K):
            super().__init__(K, tolerance=1e-2)

    problem = make_block(4, slip_stress=1e7, linear_solver=Loose)
    try:
        solution = problem.solve(solver=InteriorPoint(tolerance=1e-8))  # semismooth Newton steps need no such solutions
    except NotConverged as failure:
        assert failure.result.residual > 1e-8
        solution = problem.solution(failure.result)
    assert not solution.certificate.passed


def hard_tresca(seed):
    """Condition numbers up to 1e8, slip bounds far below and far above the forces, odd units, open contacts."""
    rng = np.random.default_rng(seed)
    nodes, condition = int(rng.integers(1, 40)), 10 ** rng.uniform(0, 8)
    A = 10 ** rng.uniform(-12, 3) * random_spd(3 * nodes, condition, rng)
    b = 10 ** rng.uniform(-6, 3) * rng.standard_normal(3 * nodes)
    b[0::3] += rng.choice([-1, 0, 3]) * np.abs(b).max()
    force = np.abs(b).mean() / np.diag(A).mean()
    spread = 10 ** -rng.uniform(0, rng.choice([0, 1, 4]), nodes)
    return FrictionProblem.tresca(dense_compliance(A), b, force * 10 ** rng.uniform(-3, 2) * spread)


@pytest.mark.parametrize("seed", [1072, 1083, 1112, 1153, 1209, 1219, 1236, 1277, 1288, 1299, *range(2000, 2010)])
def test_hard_problems(seed):
    """Starts too near the boundary block the steps, and cancellation in the preconditioner stalls CG."""
    qp = hard_tresca(seed)
    result = InteriorPoint(tolerance=1e-8).solve(qp)
    assert qp.residual(result.x) <= 1e-8
    assert result.newton_steps <= 45


# --- warm start -----------------------------------------------------------------------------------------------------


def test_warm_start_saves_steps_and_changes_nothing():
    qp, _ = random_tresca(60, seed=25)
    first = InteriorPoint(tolerance=1e-6).solve(qp)
    near = qp.with_slip_bound(1.0001 * qp.law.cohesion)
    cold = InteriorPoint().solve(near)
    warm = InteriorPoint().solve(near, first.x, gradient=first.gradient)
    assert warm.newton_steps < 0.7 * cold.newton_steps
    assert np.linalg.norm(warm.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)


def test_useless_warm_starts_lead_to_the_same_answer():
    qp, _ = random_tresca(60, seed=26)
    start = InteriorPoint().solve(qp)
    other = replace(qp, b=-np.roll(qp.b, 7))
    cold = InteriorPoint().solve(other)
    warm = InteriorPoint().solve(other, start.x, gradient=start.gradient)
    far = InteriorPoint().solve(other, 100.0 * start.x, gradient=100.0 * start.gradient)
    for other in (warm, far):
        assert np.linalg.norm(other.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)


def test_blocked_warm_start_falls_back_to_a_cold_one(monkeypatch):
    """A warm start forced onto the boundary: its steps block, and the following cold start gives the answer."""
    qp, _ = random_tresca(60, seed=27)
    solver = InteriorPoint(start_products=0, starts=(0.1, 1e3, 1e6))
    start = solver.solve(qp)
    other = replace(qp, b=-np.roll(qp.b, 7))
    cold = solver.solve(other)
    monkeypatch.setattr(ScaledProblem, "distance_from_solution", lambda *_: 1e-6)
    warm = solver.solve(other, start.x, gradient=start.gradient)
    assert warm.newton_steps > cold.newton_steps and [step.iteration for step in warm.history][-1] == warm.newton_steps
    assert np.linalg.norm(warm.x - cold.x) <= 1e-6 * np.linalg.norm(cold.x)


def test_longest_step_ends_on_the_boundary():
    """Bounds, multipliers and discs, each once the nearest: a slightly longer step is outside."""
    rng = np.random.default_rng(17)
    law, lower = FrictionLaw(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.0])), np.array([0.3, 0.1, 0.2])
    problem = ScaledProblem(FrictionProblem(dense_compliance(np.eye(9)), np.ones(9), law, lower))
    for _ in range(200):
        above, nu = rng.uniform(0.1, 1.0, 3), rng.uniform(0.1, 1.0, (3, 2))
        t, dt = rng.uniform(-0.6, 0.6, (3, 2)), rng.standard_normal((3, 2))
        d_above, dnu = rng.standard_normal(3), rng.standard_normal((3, 2))
        v = Iterate(problem.lower + above, t, nu, np.zeros((3, 3)))
        alpha = problem.distance_to_boundary(v, d_above, dt, dnu)

        def left(a, above=above, d_above=d_above, nu=nu, dnu=dnu, t=t, dt=dt):
            disc = 1.0 - np.hypot(*(t + a * dt)[:2].T)
            return min((above + a * d_above).min(), (nu + a * dnu)[:, 0].min(), (nu + a * dnu)[:2, 1].min(), disc.min())

        assert abs(left(alpha)) <= 1e-12 * max(alpha, 1.0) and left(0.999 * alpha) > 0.0
