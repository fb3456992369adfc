"""The run of the cone method: lengths of its steps, its best answer, and how much each part may do."""

import numpy as np
import pytest

from benchmarks.rigid_bodies import random_rank, stack, walled
from coulomb import NotConverged, Status, solve_coulomb
from coulomb.solvers.rigid import cone_interior_point as cone_run
from coulomb.solvers.rigid.cone_interior_point import ConeInteriorPoint, _ConeRun
from coulomb.solvers.rigid.cone_paths import ConeCurve
from coulomb.solvers.rigid.cones import ConeProblem


def refused(problem, **settings):
    with pytest.raises(NotConverged) as failure:
        solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False, **settings))
    return failure.value.result


def test_newton_steps_are_shortened_until_the_natural_map_decreases():
    problem = walled(20, 1.0, 2)
    result = solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False))
    sizes, lengths = (np.array([getattr(step, name) for step in result.history]) for name in ("residual", "alpha"))
    assert set(lengths) == {1.0, 0.5} and np.all(np.diff(sizes) < 0.0) and sizes[-1] < 1e-8


def test_proximal_terms_are_a_tenth_of_the_natural_map_within_bounds(monkeypatch):
    seen, newton_step = [], ConeProblem.newton_step
    monkeypatch.setattr(
        ConeProblem,
        "newton_step",
        lambda self, at, proximal: seen.append((at.size, proximal)) or newton_step(self, at, proximal),
    )
    problem = stack(5, 0.7, 2)
    solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False))
    sizes, terms = np.array(seen).T
    assert np.allclose(terms, np.clip(0.1 * sizes, 1e-11, 1e-3), rtol=1e-12)
    assert terms.max() == 1e-3 and terms.min() < 1e-5


def test_the_answer_of_a_refusal_is_the_best_one(monkeypatch):
    """Of the path's last point, and of ten times its forces."""
    seen = []
    monkeypatch.setattr(
        _ConeRun, "_successive_slips", lambda self, _: seen.extend(map(self._judged, (self._X, 10 * self._X)))
    )
    result = refused(stack(8, 1.0, 2), newton=1, path=4, curve=0)
    assert result.status is Status.STAGNATED and seen[0] < seen[1]
    assert result.residual <= seen[0] * (1.0 + 1e-9)


def test_the_curve_has_at_most_the_steps_of_the_setting(monkeypatch):
    steps, step = [], ConeCurve.step
    monkeypatch.setattr(ConeCurve, "step", lambda self, at: steps.append(self) or step(self, at))
    refused(stack(8, 1.0, 2), newton=1, path=1, curve=3, convex=0)
    assert len(steps) == 3


def test_slips_of_convex_problems_are_accelerated(monkeypatch):
    """What follows each is that of Anderson's acceleration, not negative."""
    seen, accelerated = [], cone_run.Anderson.next
    monkeypatch.setattr(cone_run.Anderson, "next", lambda *given: seen.append(accelerated(*given)) or seen[-1])
    slips, solved = [], _ConeRun._solved
    monkeypatch.setattr(_ConeRun, "_solved", lambda self, slip, tol: slips.append(slip) or solved(self, slip, tol))
    problem = random_rank(10, 20, 0.4, 1)
    solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False, newton=1, path=4))
    assert len(seen) >= len(slips) - 1 > 1 and not slips[0].any() and min(slip.min() for slip in slips) >= 0.0
    for slip, following in zip(slips[1:], seen, strict=False):
        assert np.array_equal(slip, np.maximum(following, 0.0))
