import numpy as np
import pytest
from conftest import dense_compliance, random_tresca

from coulomb.solvers import FrictionProblem


def test_projection_is_the_nearest_feasible_point():
    qp, _ = random_tresca(40, seed=7)
    rng = np.random.default_rng(8)
    x = 1e5 * rng.standard_normal(120)
    p = qp.project(x)
    assert np.all(p[0::3] >= 0.0)
    assert np.all(np.hypot(p[1::3], p[2::3]) <= qp.law.cohesion * (1 + 1e-15))
    for _ in range(50):  # (x - p)^T (y - p) <= 0 for all feasible y
        y = qp.project(1e5 * rng.standard_normal(120))
        assert (x - p) @ (y - p) <= 1e-6 * (np.linalg.norm(x - p) * np.linalg.norm(y - p))
    assert np.allclose(qp.project(p), p, rtol=1e-15, atol=0.0)


def test_projection_with_zero_slip_bound_and_lower_bound():
    qp = FrictionProblem.tresca(
        dense_compliance(np.eye(6)), np.zeros(6), np.array([0.0, 1.0]), lower=np.array([2.0, -1.0])
    )
    assert np.allclose(qp.project(np.array([1.0, 3.0, 4.0, -5.0, 3.0, 4.0])), [2.0, 0.0, 0.0, -1.0, 0.6, 0.8])


def test_residual_of_a_separable_problem():
    """With A = a I the solution is the projection of b/a: residual 0 there, and by hand beside it."""
    b = np.array([2.0, 3.0, 4.0, -1.0, 0.1, 0.0])
    qp = FrictionProblem.tresca(dense_compliance(2.0 * np.eye(6)), b, np.array([1.0, 1.0]))
    x = np.array([1.0, 0.6, 0.8, 0.0, 0.05, 0.0])
    assert qp.residual(x) <= 1e-16
    off = x + np.array([0.0, 0.0, 0.0, 0.0, 0.05, 0.0])  # P(x - (Ax-b)/a) is x again: the distance is 0.05
    assert qp.residual(off) == pytest.approx(0.05 / np.linalg.norm(off))


def test_residual_does_not_depend_on_units():
    qp, A = random_tresca(12, seed=21)
    x = qp.project(qp.b / qp.mean_diagonal)
    other = FrictionProblem.tresca(dense_compliance(1e6 * A), 1e3 * qp.b, 1e-3 * qp.law.cohesion)  # kN and mm
    assert other.residual(1e-3 * x) == pytest.approx(qp.residual(x), rel=1e-12)


def test_residual_at_zero_force():
    open_ = FrictionProblem.tresca(dense_compliance(np.eye(3)), np.array([-1.0, 0.0, 0.0]), np.array([1.0]))
    assert open_.residual(np.zeros(3)) == 0.0
    closed = FrictionProblem.tresca(dense_compliance(np.eye(3)), np.array([1.0, 0.0, 0.0]), np.array([1.0]))
    assert closed.residual(np.zeros(3)) == np.inf


@pytest.mark.parametrize(
    ("b", "slip_bound", "lower", "message"),
    [
        (np.zeros(5), np.ones(2), 0.0, r"b must have shape \(6,\)"),
        (np.zeros(6), np.ones(3), 0.0, r"slip_bound must have shape \(2,\)"),
        (np.zeros(6), np.ones(2), np.zeros(3), r"lower must be a number or have shape \(2,\)"),
        (np.full(6, np.nan), np.ones(2), 0.0, "b has entries that are not finite"),
        (np.zeros(6), np.array([1.0, -1.0]), 0.0, "slip_bound has negative entries"),
    ],
)
def test_bad_input(b, slip_bound, lower, message):
    with pytest.raises(ValueError, match=message):
        FrictionProblem.tresca(dense_compliance(np.eye(6)), b, slip_bound, lower)
