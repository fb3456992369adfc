"""Coulomb friction by successive Tresca problems."""

import dataclasses
import functools
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from conftest import dense_compliance, random_spd, solved_block

from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca, solve_coulomb
from coulomb.solvers import Automatic, FrictionProblem


def small_coulomb(nodes, seed, friction):
    rng = np.random.default_rng(seed)
    A = 1e-9 * random_spd(3 * nodes, 50.0, rng)
    return FrictionProblem.coulomb(
        dense_compliance(A), 1e-4 * rng.standard_normal(3 * nodes), np.full(nodes, friction)
    ), A


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


def test_what_was_tried_is_not_advised():
    """Of successive Tresca alone the interior point is; not after it."""
    M = np.random.default_rng(19).normal(size=(90,))
    A, b = M[:81].reshape(9, 9) @ M[:81].reshape(9, 9).T + 0.01 * np.eye(9), 3.0 * M[81:]
    for solver in (SuccessiveTresca(), Automatic(interior_point=InteriorPoint(max_iterations=1))):
        with pytest.raises(NotConverged, match="the slip bound does not converge") as failure:
            solve_coulomb(A, b, 8.0, solver)
        assert str(failure.value).endswith("method = interior-point") is isinstance(solver, SuccessiveTresca)
