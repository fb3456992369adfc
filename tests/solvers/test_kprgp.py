"""KPRGP, the active-set baseline: right answers, and the same problem, residual and result as path following."""

import numpy as np
import pytest
from conftest import dense_compliance, make_block, random_tresca

from coulomb import InteriorPoint, NotConverged
from coulomb.solvers import KPRGP, FrictionProblem
from coulomb.solvers.kprgp import _split, norm_of


def test_counts_its_steps_and_products():
    qp, _ = random_tresca(60, seed=14)
    before = qp.A.products
    result = KPRGP(tolerance=1e-6).solve(qp)
    kinds = [result.steps(kind) for kind in ("cg", "expansion", "proportioning")]
    assert sum(kinds) == len(result.history) and all(kinds)
    assert result.products == qp.A.products - before
    # one product a CG step, two an expansion, one a proportioning step; besides: start, |A|, the last check
    assert result.products - (kinds[0] + 2 * kinds[1] + kinds[2]) <= 102


def test_free_and_chopped_gradient_by_hand():
    """A free node, one on its bound, and three on their circles: drawn inward, along, and outward by -gradient."""
    g, a = np.ones(5), 0.1
    qp = FrictionProblem.tresca(dense_compliance(np.eye(15)), np.zeros(15), g)
    x = np.array([[1.0, 0.2, 0.0], [0.0, 0.0, 0.3], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    r = np.array([[2.0, 3.0, 4.0], [-5.0, 1.0, 1.0], [0.0, 2.0, 1.0], [0.0, 0.0, 1.0], [0.0, -2.0, 0.0]])
    split = _split(qp, x.ravel(), r.ravel(), a)
    assert split.free.tolist() == [[True] * 3, [False, True, True]] + 3 * [[True, False, False]]
    assert np.array_equal(split.phi, np.where(split.free, r, 0.0))
    assert split.beta[0].tolist() == [0.0, 0.0, 0.0] and split.beta[1].tolist() == [-5.0, 0.0, 0.0]
    assert split.beta[2, 1:].tolist() == [2.0, 1.0]  # -gradient leads inward: all of it
    turned = np.array([1.0, -a]) / np.hypot(1.0, a)
    assert np.allclose(split.beta[3, 1:], (np.array([1.0, 0.0]) - turned) / a)  # along the circle
    assert np.allclose(split.beta[4, 1:], 0.0)  # against the circle: stays


def test_norm_by_the_power_method():
    qp, A = random_tresca(40, seed=71)
    exact = np.linalg.eigvalsh(A)[-1]
    assert 0.96 * exact <= norm_of(qp) <= 1.02 * exact


def test_starts_from_given_forces():
    qp, _ = random_tresca(30, seed=72)
    answer = KPRGP(tolerance=1e-8).solve(qp)
    assert KPRGP(tolerance=1e-7).solve(qp, answer.x).history == ()


def test_block_needs_many_more_products_than_path_following():
    problem = make_block(6, slip_stress=1e7)
    qp = problem.friction_problem
    active, interior = KPRGP(tolerance=1e-6).solve(qp), InteriorPoint(tolerance=1e-6).solve(qp)
    assert np.linalg.norm(active.x - interior.x) <= 1e-4 * np.linalg.norm(active.x)
    assert active.products > 3.1 * interior.products  # the largest advantage in the paper


def test_failure():
    qp, _ = random_tresca(30, seed=73)
    with pytest.raises(NotConverged, match=r"KPRGP ended with a residual of .* after 3 steps \(max_iterations\)"):
        KPRGP(max_iterations=3).solve(qp)
