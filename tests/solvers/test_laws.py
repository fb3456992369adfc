"""The law of friction |x_t| <= min(c a + F(x_n) x_n, q): Tresca's, Coulomb's, with a limit, by pressure, and mixed."""

import numpy as np
import pytest
from conftest import dense_compliance, random_spd, random_tresca
from mpi4py import MPI
from shared_problems import by_clarabel

from coulomb import InteriorPoint, SuccessiveTresca, solve_coulomb, solve_tresca
from coulomb.linalg.reductions import Reductions
from coulomb.solvers import Automatic, DenseSystem, FrictionLaw, FrictionProblem

SOLVERS = {
    "auto": Automatic(1e-10),
    "interior point": InteriorPoint(1e-10),
    "interior point, dense": InteriorPoint(1e-10, newton=DenseSystem()),
    "successive Tresca": SuccessiveTresca(1e-10),
}
NODES = 24


def mohr_coulomb(seed):
    """A third of the nodes with Tresca's law, a third with Coulomb's, a third with both; some without any friction."""
    rng = np.random.default_rng(seed)
    A = 1e-9 * random_spd(3 * NODES, 50.0, rng)
    b = 1e-4 * rng.standard_normal(3 * NODES)
    kind, none = np.arange(NODES) % 3, np.arange(NODES) % 8 == 5
    cohesion = np.where((kind == 1) | none, 0.0, 5e4 * rng.uniform(0.2, 2.0, NODES))
    friction = np.where((kind == 0) | none, 0.0, rng.uniform(0.1, 0.8, NODES))
    return A, b, FrictionLaw(cohesion, friction)


def test_radius_and_slope():
    law = FrictionLaw(np.array([2.0, 0.0, 3.0]), np.array([0.0, 0.5, 0.1]))
    assert law.radius(np.array([10.0, 10.0, 10.0])).tolist() == [2.0, 5.0, 4.0]
    assert law.radius(np.array([-10.0, -10.0, -10.0])).tolist() == [2.0, 0.0, 3.0]  # tension does not reduce the bound
    assert law.slope(np.ones(3)).tolist() == [0.0, 0.5, 0.1] and law.frictional.all()
    assert FrictionLaw(np.zeros(2), np.array([0.0, 0.1])).frictional.tolist() == [False, True]
    assert law.scaled(10.0).radius(np.ones(3)) == pytest.approx(law.radius(np.full(3, 10.0)) / 10.0)


def limited(seed, **parts):
    """That with a largest friction at two thirds of the nodes, F by pressure (falling at half of them), or both."""
    rng = np.random.default_rng([seed, 1])
    A, b, law = mohr_coulomb(seed)
    held = np.where(np.arange(NODES) % 3 < 2, 5e4 * rng.uniform(0.1, 1.0, NODES), np.inf)
    knots = np.sort(1e5 * rng.uniform(0.0, 3.0, (NODES, 3)), axis=1)
    values = np.sort(rng.uniform(0.1, 0.8, (NODES, 3)), axis=1)
    values[::2] = values[::2, ::-1]
    values[law.friction == 0.0] = 0.0
    by_pressure = parts.get("by_pressure", False)
    return (
        A,
        b,
        FrictionLaw(
            law.cohesion,
            values if by_pressure else law.friction,
            held if parts.get("limit", False) else None,
            knots if by_pressure else None,
        ),
    )


KINDS = {"limit": {"limit": True}, "by pressure": {"by_pressure": True}, "both": {"limit": True, "by_pressure": True}}


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_by_numpy(kind):
    """Radius against interpolation by NumPy, slope against differences, units, parts, and bounds from above."""
    _, _, law = limited(4, **KINDS[kind])
    limit = np.full(NODES, np.inf) if law.limit is None else law.limit
    table = [
        (law.knots[k], law.friction[k]) if law.knots is not None else ([0.0], [law.friction[k]]) for k in range(NODES)
    ]
    for x in np.linspace(1e3, 5e5, 97):
        F = np.array([np.interp(x, *row) for row in table])
        r, at = np.minimum(law.cohesion + F * x, limit), np.full(NODES, x)
        assert np.allclose(law.radius(at), r, rtol=1e-13) and np.allclose(law.coefficient(at), F, rtol=1e-13)
        steps = (law.radius(at + 1e-2) - law.radius(at - 1e-2)) / 2e-2
        smooth = np.abs(law.slope(at - 1e-2) - law.slope(at + 1e-2)) < 1e-6
        assert smooth.sum() > NODES - 4 and np.allclose(law.slope(at)[smooth], steps[smooth], atol=1e-6)
        assert np.allclose(2e3 * law.scaled(1e3, 2e3).radius(at / 1e3), r, rtol=1e-12)
        assert all(np.all(one.radius(at) >= r * (1 - 1e-12)) for one in law.majorants())
        parts = FrictionLaw.joined([law.at(np.arange(5)), FrictionLaw.coulomb(np.full(2, 0.3))])
        assert np.allclose(parts.radius(np.full(7, x)), [*r[:5], 0.3 * x, 0.3 * x], rtol=1e-12)
    far = np.min([one.radius(np.full(NODES, 1e9)) for one in law.majorants()], axis=0)
    assert np.all(far <= limit * (1 + 1e-12)) and np.all(far <= 1.001 * law.radius(np.full(NODES, 1e9)) + 1e5)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SOLVERS)
def test_limits_and_tables_node_by_node(kind, name):
    """The answer is that of Clarabel with the bounds that it has; these are the law's, and their kinds all occur."""
    A, b, law = limited(5, **KINDS[kind])
    x = SOLVERS[name].solve(FrictionProblem(dense_compliance(A), b, law)).x
    theirs = by_clarabel(A, b, law.radius(x[0::3]), np.zeros(NODES))
    assert np.linalg.norm(x - theirs) <= 1e-6 * np.linalg.norm(theirs)
    size, slips = np.hypot(x[1::3], x[2::3]), np.hypot(x[1::3], x[2::3]) > 0.999 * law.radius(x[0::3])
    if law.limit is not None:
        assert np.any(slips & (size > 0.999 * law.limit)) and np.any(
            slips & (size < 0.9 * law.limit) & (law.slope(x[0::3]) > 0)
        )
    if law.knots is not None:
        assert np.any(slips & (x[0::3] > law.knots[:, 0]) & (x[0::3] < law.knots[:, -1]))


def test_projection_with_given_bounds():
    law = FrictionLaw(np.array([1.0]), np.array([0.5]))
    assert law.project(np.array([-1.0, 6.0, 8.0]), np.array([8.0])).tolist() == [0.0, 3.0, 4.0]
    assert law.project(np.array([-1.0, 0.6, 0.8]), np.array([-3.0]), 2.0).tolist() == [2.0, 0.6, 0.8]


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


def test_natural_residual_by_hand():
    """x = (2, 0, 0), gradient (0, -3, 0), a = 1: x - w = (2, 3, 0) is cut to the bound 1 + 0.5 * 2 = 2."""
    law, over = FrictionLaw(np.array([1.0]), np.array([0.5])), Reductions(MPI.COMM_SELF)
    assert law.natural_residual(np.array([2.0, 0, 0]), np.array([0.0, -3.0, 0.0]), 1.0, over) == pytest.approx(1.0)
    assert law.natural_residual(np.zeros(3), np.array([1.0, 0, 0]), 1.0, over) == 0.0
    assert law.natural_residual(np.zeros(3), np.array([-1.0, 0, 0]), 1.0, over) == np.inf


def test_residual_of_a_separable_problem():
    """With A = a I the solution is the projection of b/a: residual 0 there, and by hand beside it."""
    b = np.array([2.0, 3.0, 4.0, -1.0, 0.1, 0.0])
    qp = FrictionProblem.tresca(dense_compliance(2.0 * np.eye(6)), b, np.array([1.0, 1.0]))
    x = np.array([1.0, 0.6, 0.8, 0.0, 0.05, 0.0])
    assert qp.residual(x) <= 1e-16
    off = x + np.array([0.0, 0.0, 0.0, 0.0, 0.05, 0.0])  # P(x - (Ax-b)/a) is x again: the distance is 0.05
    assert qp.residual(off) == pytest.approx(0.05 / 0.1)  # of the force of this contact


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("seed", [0, 3])
def test_conditions_node_by_node(name, seed):
    """Contact and friction written out, with products by plain numpy."""
    A, b, law = mohr_coulomb(seed)
    result = SOLVERS[name].solve(FrictionProblem(dense_compliance(A), b, law))
    x, w = result.x.reshape(-1, 3), (A @ result.x - b).reshape(-1, 3)
    force, length = np.abs(x).max(), np.abs(w).max()
    bound, size, slip = law.cohesion + law.friction * x[:, 0], np.hypot(x[:, 1], x[:, 2]), np.hypot(w[:, 1], w[:, 2])
    assert x[:, 0].min() >= -1e-12 * force and w[:, 0].min() >= -1e-8 * length
    assert np.abs(x[:, 0] * w[:, 0]).max() <= 1e-8 * force * length
    assert np.max(size - bound) <= 1e-9 * force
    assert np.max((bound - size) * slip) <= 1e-7 * force * length
    assert np.abs(x[:, 1] * w[:, 2] - x[:, 2] * w[:, 1]).max() <= 1e-7 * force * length
    assert np.max(x[:, 1] * w[:, 1] + x[:, 2] * w[:, 2]) <= 1e-7 * force * length
    kinds = [(law.cohesion > 0) & (law.friction == 0), (law.cohesion == 0) & (law.friction > 0)]
    kinds.append((law.cohesion > 0) & (law.friction > 0))
    slipping = slip > 1e-3 * length
    assert all(np.any(kind & slipping) and np.any(kind & (x[:, 0] > 1e-3 * force)) for kind in kinds)


def test_without_slope_it_is_trescas_problem():
    A, b, law = mohr_coulomb(12)
    law = FrictionLaw(law.cohesion, np.zeros(NODES))
    known = solve_tresca(A, b, law.cohesion, solver=InteriorPoint(1e-10)).x
    for solver in SOLVERS.values():
        x = solve_coulomb(A, b, 0.0, solver, cohesion=law.cohesion).x
        assert np.linalg.norm(x - known) <= 1e-8 * np.linalg.norm(known)
    result = SuccessiveTresca(1e-9).solve(FrictionProblem(dense_compliance(A), b, law))
    assert result.outer_steps == 1


def test_lower_bounds():
    """x_n >= l with l >= 0 where friction grows, any l elsewhere; Clarabel has the slip bounds of the solution."""
    A, b, law = mohr_coulomb(13)
    lower = np.where(law.friction > 0.0, 2e4, -3e4) * np.random.default_rng(13).uniform(0.0, 1.0, NODES)
    problem = FrictionProblem(dense_compliance(A), b, law, lower)
    for solver in SOLVERS.values():
        x = solver.solve(problem).x
        theirs = by_clarabel(A, b, law.radius(x[0::3]), lower)
        assert np.linalg.norm(x - theirs) <= 1e-6 * np.linalg.norm(theirs)


def test_one_node_by_hand():
    """A = I, b = (2, 3, 4): x_n = 2, friction 0.4 + 0.3 * 2 = 1 along (3, 4)/5."""
    assert np.allclose(solve_coulomb(np.eye(3), [2.0, 3.0, 4.0], 0.3, cohesion=0.4).x, [2.0, 0.6, 0.8], atol=1e-7)
    open_ = solve_coulomb(np.eye(3), [-2.0, 3.0, 4.0], 0.3, cohesion=0.5).x  # cohesion acts without pressure
    assert np.allclose(open_, [0.0, 0.3, 0.4], atol=1e-7)


@pytest.mark.parametrize(
    ("law", "lower", "message"),
    [
        (FrictionLaw(np.ones(3), np.ones(2)), 0.0, r"cohesion must have shape \(2,\)"),
        (FrictionLaw(np.ones(2), np.ones(3)), 0.0, r"friction must have shape \(2,\)"),
        (FrictionLaw(-np.ones(2), np.ones(2)), 0.0, "cohesion has entries that are negative"),
        (FrictionLaw(np.ones(2), np.array([0.1, np.nan])), 0.0, "friction has entries that are .* not finite"),
        (
            FrictionLaw(np.ones(2), np.ones(2), np.array([1.0, 0.0])),
            0.0,
            r"limit must have shape \(2,\), .* be positive",
        ),
        (FrictionLaw(np.ones(2), np.ones((2, 2)), None, np.array([[0, 1], [1, 0]])), 0.0, "knots must be ascending"),
        (
            FrictionLaw(np.ones(2), np.ones(2), None, np.array([[0, 1], [0, 1]])),
            0.0,
            r"friction must have shape \(2, 2\)",
        ),
        (FrictionLaw(np.ones(2), np.ones(2)), np.zeros(3), r"lower must be a number or have shape \(2,\)"),
        (FrictionLaw(np.ones(2), np.array([0.1, 0.0])), -1.0, "lower must be >= 0 where friction > 0"),
    ],
)
def test_bad_input(law, lower, message):
    with pytest.raises(ValueError, match=message):
        FrictionProblem(dense_compliance(np.eye(6)), np.zeros(6), law, lower)
