"""Coulomb friction by successive Tresca problems."""

import dataclasses
import functools
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from conftest import dense_compliance, random_spd, solved_block

from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca
from coulomb.solvers import FrictionProblem


def small_coulomb(nodes, seed, friction):
    rng = np.random.default_rng(seed)
    A = 1e-9 * random_spd(3 * nodes, 50.0, rng)
    return FrictionProblem.coulomb(
        dense_compliance(A), 1e-4 * rng.standard_normal(3 * nodes), np.full(nodes, friction)
    ), A


def test_one_node_by_hand():
    """A = I, b = (2, 3, 4), F = 0.5: x_n = 2, friction 1 along (3, 4)/5."""
    problem = FrictionProblem.coulomb(dense_compliance(np.eye(3)), np.array([2.0, 3.0, 4.0]), np.array([0.5]))
    result = SuccessiveTresca(1e-9).solve(problem)
    assert np.allclose(result.x, [2.0, 0.6, 0.8], atol=1e-7)


@pytest.mark.parametrize("friction", [0.0, 0.1, 0.3, 0.8])
def test_answer_satisfies_coulombs_law(friction):
    problem, A = small_coulomb(30, 41, friction)
    result = SuccessiveTresca(1e-9).solve(problem)
    x, w = result.x.reshape(-1, 3), (A @ result.x - problem.b).reshape(-1, 3)
    force, length = np.abs(x).max(), np.abs(w).max()
    size = np.hypot(x[:, 1], x[:, 2])
    assert np.all(x[:, 0] >= 0.0) and np.all(w[:, 0] >= -1e-7 * length)
    assert np.max(np.abs(x[:, 0] * w[:, 0])) <= 1e-7 * force * length
    assert np.all(size <= friction * x[:, 0] + 1e-7 * force)
    inside = friction * x[:, 0] - size  # friction below its bound: no slip; at its bound: against the slip
    assert np.max(inside * np.hypot(w[:, 1], w[:, 2])) <= 1e-6 * force * length
    assert np.max(np.abs(x[:, 1] * w[:, 2] - x[:, 2] * w[:, 1])) <= 1e-6 * force * length
    assert np.all(x[:, 1] * w[:, 1] + x[:, 2] * w[:, 2] <= 1e-6 * force * length)


def test_residual_is_that_of_the_tresca_problem_with_its_own_bound():
    problem, _ = small_coulomb(10, 42, 0.4)
    x = np.abs(1e5 * np.random.default_rng(43).standard_normal(30))
    assert problem.residual(x) == problem.with_slip_bound(0.4 * x[0::3]).residual(x)


def test_stops_on_the_coulomb_residual(block6):
    """CONVERGED needs the residual of the Coulomb problem, recomputed from its definition."""
    result, problem = block6.result, block6.problem
    friction = np.full(len(problem.surface.nodes), 0.3)
    again = FrictionProblem.coulomb(problem.A, problem.b, friction).residual(result.x)
    assert result.status is Status.CONVERGED
    assert again <= 1e-8 and result.residual == pytest.approx(again, rel=1e-6)


@functools.cache
def solved6(memory=0):
    return SuccessiveTresca(1e-8, memory=memory).solve(solved_block(6).problem.friction_problem)


def test_contraction_is_measured():
    """About 0.12 per step at F = 0.3 on the block; for the plain iteration it is the ratio of changes."""
    result = solved6()
    assert 0.05 < result.contraction < 0.2
    g = [step.change for step in result.history]
    rates = [new / old for old, new in pairwise(g)]
    assert [step.contraction for step in result.history][2:6] == pytest.approx(rates[1:5], rel=1e-2)
    assert all(abs(step.slope) <= step.contraction * (1 + 1e-12) for step in result.history[1:])


def test_inner_accuracy_is_tied_to_the_outer_residual():
    for before, step in pairwise(solved6().history):
        assert step.inner_tolerance <= 1e-2 * before.residual or step.inner_tolerance == pytest.approx(1e-9)


def test_warm_starts_save_most_of_the_steps():
    """The whole Coulomb problem costs a few Tresca problems, not one for every outer step."""
    result = solved6()
    assert result.outer_steps <= 12
    assert result.newton_steps <= 80
    cold = InteriorPoint(tolerance=1e-9).solve(solved_block(6).problem.tresca(result.slip_bound))
    assert result.newton_steps <= 5 * cold.newton_steps


@pytest.mark.parametrize("friction", [0.8, 1.5])
def test_acceleration_saves_tresca_problems(friction):
    problem = solved_block(6).problem
    coulomb = FrictionProblem.coulomb(problem.A, problem.b, np.full(len(problem.surface.nodes), friction))
    plain, accelerated = SuccessiveTresca(memory=0).solve(coulomb), SuccessiveTresca().solve(coulomb)
    assert accelerated.outer_steps <= 0.8 * plain.outer_steps
    assert np.linalg.norm(plain.x - accelerated.x) <= 1e-6 * np.linalg.norm(plain.x)


@pytest.mark.parametrize("solver", [SuccessiveTresca(1e-10), InteriorPoint(1e-10)], ids=lambda s: s.name)
@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_down_to_a_residual_of_1e_10(solver, friction):
    problem = solved_block(6).problem
    coulomb = FrictionProblem.coulomb(problem.A, problem.b, np.full(len(problem.surface.nodes), friction))
    assert coulomb.residual(solver.solve(coulomb).x) <= 1e-10


def test_history_has_a_record_for_each_tresca_problem():
    result = solved6(5)
    assert [step.iteration for step in result.history] == list(range(1, result.outer_steps + 1))
    assert result.history[-1].residual <= 1e-8 < result.history[-2].residual
    assert sum(step.path_following for step in result.history) == result.newton_steps
    assert 0 <= result.products - sum(step.products for step in result.history) <= 2
    assert all(step.krylov < step.products for step in result.history)
    assert all(0.0 < step.damping <= 1.0 and step.seconds > 0.0 for step in result.history)
    assert not result.history[0].warm and all(step.warm for step in result.history[1:])


def test_failure_reports_why_and_carries_the_answer(block6):
    problem = FrictionProblem.coulomb(
        block6.problem.A, block6.problem.b, np.full(len(block6.problem.surface.nodes), 0.3)
    )
    with pytest.raises(NotConverged, match=r"residual of .* after 3 Tresca problems .*max_it") as failure:
        SuccessiveTresca(1e-8, max_iterations=3).solve(problem)
    result = failure.value.result
    assert result.status is Status.MAX_ITERATIONS
    assert result.residual > 1e-8 and len(result.history) == 3


def test_inner_failure_stops_the_outer_loop(block6):
    problem = FrictionProblem.coulomb(
        block6.problem.A, block6.problem.b, np.full(len(block6.problem.surface.nodes), 0.3)
    )
    with pytest.raises(NotConverged, match="the interior-point method ended with a residual") as failure:
        SuccessiveTresca(1e-8, InteriorPoint(max_iterations=2)).solve(problem)
    assert failure.value.result.status is Status.STAGNATED


@dataclass(frozen=True)
class Failing:
    """PF; from its third Tresca problem on it fails with a useless answer."""

    tolerance: float = 1e-8
    calls: list = field(default_factory=list)

    def solve(self, qp, start=None, *, gradient=None, tolerance=None, progress=None):
        result = InteriorPoint().solve(qp, tolerance=tolerance, progress=progress)
        self.calls.append(result)
        if len(self.calls) > 2:
            twice = 2.0 * (result.gradient + qp.b) - qp.b
            raise NotConverged("of no use", dataclasses.replace(result, x=2.0 * result.x, gradient=twice, residual=1.0))
        return result


def test_the_best_answer_is_kept_not_the_last():
    problem, _ = small_coulomb(8, 43, 0.3)
    with pytest.raises(NotConverged, match="of no use") as failure:
        SuccessiveTresca(1e-8, Failing()).solve(problem)
    result = failure.value.result
    residuals = [step.residual for step in result.history]
    assert residuals[-1] > 1.5 * min(residuals)
    assert result.residual == pytest.approx(min(residuals)) == pytest.approx(problem.residual(result.x))


def test_open_contact():
    problem = FrictionProblem.coulomb(dense_compliance(np.eye(6)), np.array([-1.0, 2, 0, -2.0, 0, 1]), np.full(2, 0.5))
    result = SuccessiveTresca().solve(problem)
    assert result.status is Status.CONVERGED and not result.x.any()


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"inner_precision": 1.0}, "inner_precision"),
        ({"max_iterations": 0}, "max_it"),
    ],
)
def test_constants_outside_their_bounds(field, message):
    with pytest.raises(ValueError, match=message):
        SuccessiveTresca(**field)


def test_bad_friction():
    A = dense_compliance(np.eye(6))
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        FrictionProblem.coulomb(A, np.zeros(6), np.ones(3))
    with pytest.raises(ValueError, match="negative"):
        FrictionProblem.coulomb(A, np.zeros(6), np.array([0.3, -0.1]))


def test_both_newton_systems_give_the_same_answer():
    """PF with J_SC in the loop gives the same forces as with J_AM."""
    from coulomb.solvers import SchurComplementSystem

    solution = solved_block(6)
    friction = np.full(len(solution.problem.surface.nodes), 0.3)
    problem = FrictionProblem.coulomb(solution.problem.A, solution.problem.b, friction)
    other = SuccessiveTresca(1e-8, InteriorPoint(newton=SchurComplementSystem(rank=0))).solve(problem)
    assert np.linalg.norm(other.x - solution.contact_force) <= 1e-7 * np.linalg.norm(other.x)
