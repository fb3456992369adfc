"""The curve of smoothed problems: its derivative, its orientation, and problems that the other methods do not solve."""

from itertools import groupby

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from singular_problems import rigid_bodies

from benchmarks.rigid_bodies import capsules, scattered, stack
from coulomb import NotConverged, Status, solve_coulomb
from coulomb.solvers import FrictionProblem
from coulomb.solvers.rigid import cone_paths
from coulomb.solvers.rigid.cone_interior_point import ConeInteriorPoint, _ConeRun
from coulomb.solvers.rigid.cone_paths import ConeCurve, CurvePoint
from coulomb.solvers.rigid.cones import ConeProblem, Scales, product
from coulomb.solvers.rigid.matrix_problems import _compliance
from coulomb.solvers.rigid.newton_matrix import NewtonMatrix


def cones(problem):
    friction = FrictionProblem.coulomb(_compliance(problem.W), -problem.q, problem.mu)
    return ConeProblem(friction, friction.A.sparse(), Scales.of(friction))


@pytest.mark.parametrize("problem", [stack(10, 2.0, 1203), capsules(4, 4, 0.7, 800)], ids=lambda problem: problem.title)
def test_problems_on_which_the_path_is_blocked(problem, monkeypatch):
    """The curve turns; without it, sweeps and proximal steps the path does not lead to an answer."""
    monkeypatch.setattr(_ConeRun, "_take_turns", lambda run, X: [*run._curve()])
    result = solve_coulomb(problem.W, -problem.q, problem.mu)
    assert result.status is Status.CONVERGED and problem.residual(result.x) <= 1e-8
    monkeypatch.setattr(_ConeRun, "_take_turns", lambda *_: None)
    monkeypatch.setattr(_ConeRun, "_proximal_steps", lambda *_: iter(()))
    with pytest.raises(NotConverged):
        solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False))


@pytest.mark.parametrize("seed", [0, 3, 6, 9])
def test_bodies_that_slide_far_on_rough_contacts(seed):
    """Twelve contacts with F = 5, open, sticking or slipping: no w has F |w_t| <= w_n at all of them, all other methods
    end.  The answer, not always the one that was put in, satisfies the law contact by contact.
    """
    rng, m, F = np.random.default_rng(seed), 12, 5.0
    H = rigid_bodies(m, rng)
    A, state, x, w = H.T @ H, rng.integers(0, 3, m), np.zeros((m, 3)), np.zeros((m, 3))
    a, push = np.diag(A).mean(), rng.normal(size=(m, 2))
    push /= np.linalg.norm(push, axis=1)[:, None]
    x[:, 0], w[:, 0] = np.where(state > 0, rng.uniform(0.1, 10.0, m), 0.0), np.where(state == 0, a, 0.0)
    x[:, 1:] = (F * x[:, 0] * np.where(state == 1, 0.5, 1.0))[:, None] * push
    w[:, 1:] = -push * np.where(state == 2, a * 10.0 ** rng.uniform(-1.0, 1.0, m), 0.0)[:, None]
    b = A @ x.ravel() - w.ravel()
    found = solve_coulomb(A, b, F, ConeInteriorPoint(sweeps=False)).x.reshape(m, 3)
    v = found - (A @ found.ravel() - b).reshape(m, 3) / a
    bound, size = F * found[:, 0], np.hypot(v[:, 1], v[:, 2])
    assert np.abs(found[:, 0] - np.maximum(v[:, 0], 0.0)).max() <= 1e-7 * np.abs(found).max()
    assert np.abs(found[:, 1:] - v[:, 1:] * np.minimum(1.0, bound / size)[:, None]).max() <= 1e-7 * np.abs(found).max()


def test_a_curve_goes_on_after_the_turns_of_others():
    """Its solution is 390 points away; proximal steps and curves from open contacts do not find one by then."""
    problem = scattered(30, 120, 2.0, 103)
    result = solve_coulomb(problem.W, -problem.q, problem.mu)
    assert result.status is Status.CONVERGED and problem.residual(result.x) <= 1e-8


def test_methods_take_turns_and_go_on_where_they_were(monkeypatch):
    """The curve, proximal steps and a new curve from open contacts, until all systems are spent: 40 each of the 2560
    first, then twice as many."""
    taken = []

    def spending(name):
        def steps(run, given=None):
            number = 0
            while True:
                run._cones.matrix.factorisations += 1
                run._recorded(run._X, 1.0)
                taken.append((name, given if name == "curve" else None, number := number + 1))
                yield run._X

        return steps

    monkeypatch.setattr(_ConeRun, "_curve", spending("curve"))
    monkeypatch.setattr(_ConeRun, "_proximal_steps", spending("steps"))
    problem = stack(8, 1.0, 2)
    with pytest.raises(NotConverged, match="max_iterations"):
        solve_coulomb(
            problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False, newton=1, path=4, systems=2560)
        )
    turns = [[number for *_, number in turn] for _, turn in groupby(taken, lambda step: step[:2])]
    assert turns[0] == [*range(1, 25)]  # from the path's end
    for first in (1, 2):
        assert turns[first] == [*range(1, 41)] and turns[first + 3] == [*range(41, 121)]
        assert turns[first + 6] == [*range(121, 281)]
    assert [len(turn) for turn in turns[3:12:3]] == [40, 80, 160] and all(turn[0] == 1 for turn in turns[3:12:3])
    assert len(taken) < 2560 < len(taken) + 100


def test_a_refusal_has_spent_all_work_and_has_the_best_answer():
    problem = scattered(30, 120, 2.0, 803)
    with pytest.raises(NotConverged, match="Newton steps") as failure:
        solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(work=4e9))
    result = failure.value.result
    assert result.status is Status.MAX_ITERATIONS
    friction = FrictionProblem.coulomb(_compliance(problem.W), -problem.q, problem.mu)
    whole = Scales.of(friction).residual(friction, result.x, friction.gradient(result.x))
    assert result.residual == pytest.approx(whole, rel=1e-6) and whole >= 0.999 * problem.residual(result.x)


@pytest.mark.parametrize("log", [-0.5, -4.0])
def test_derivative_along_the_curve(log):
    """Of G by V, through the Newton matrix, and by log tau: central differences; X o Z = tau^2 e / rho."""
    problem, rng = cones(stack(3, 0.7, 1)), np.random.default_rng(2)
    V, dV, h = rng.standard_normal((12, 3)), rng.standard_normal((12, 3)), 1e-6
    fixed = (rho := 0.1 * problem.rho), rng.uniform(1.0, 9.0, 12), rng.uniform(0.5, 2.0, (12, 1))
    at = CurvePoint(problem, V, log, *fixed)
    expected = np.zeros((12, 3))
    expected[:, 0] = at.tau**2
    assert np.allclose(product(at.X, rho * at.Z), expected, atol=1e-14)
    by_log = (CurvePoint(problem, V, log + h, *fixed).G - CurvePoint(problem, V, log - h, *fixed).G) / (2 * h)
    assert np.allclose(at.G_log, by_log, atol=1e-8)
    by_V = (CurvePoint(problem, V + h * dV, log, *fixed).G - CurvePoint(problem, V - h * dV, log, *fixed).G) / (2 * h)
    assert np.allclose(-newton_matrix(problem, at) @ dV.ravel(), by_V.ravel(), atol=1e-6 * np.abs(by_V).max())


def newton_matrix(problem, at):
    """(L W + D)^T, dense."""
    L, D = (scipy.linalg.block_diag(*blocks) for blocks in at.newton_blocks())
    return (L @ problem.W + D).T


def test_the_smaller_eigenvalue_of_a_point_is_linear_in_a_step():
    """Where V_t turns by 0.3; at V_t = 0 a step is V + dV."""
    problem, dV = cones(stack(3, 0.7, 1)), np.tile([0.2, 0.1, 0.9], (12, 1))
    fixed = problem.rho, np.ones(12), np.zeros((12, 1))
    V = CurvePoint(problem, np.tile([3.0, 3.0, 0.0], (12, 1)), -8.0, *fixed).moved(dV)
    assert V[:, 1:] == pytest.approx(np.tile([3.1, 0.9], (12, 1)))
    assert V[:, 0] - np.hypot(V[:, 1], V[:, 2]) == pytest.approx(np.full(12, 0.2 - 0.1), abs=1e-3)
    still = CurvePoint(problem, np.tile([3.0, 0.0, 0.0], (12, 1)), -1.0, *fixed)
    assert still.moved(dV) == pytest.approx(np.tile([3.2, 0.1, 0.9], (12, 1)))


def test_what_resists_a_contact_along_its_slip_is_not_lost():
    """At tau = 1e-12 the blocks for dX are 1e24 apart, and along the force that slips there is only W."""
    A = np.array([[2.0, 0.5, 0.0], [0.5, 3.0, 0.0], [0.0, 0.0, 1.0]])
    friction = FrictionProblem.coulomb(_compliance(A), np.array([1.0, 20.0, 7.0]), np.array([0.5]))
    problem = ConeProblem(friction, friction.A.sparse(), Scales.of(friction))
    curve = ConeCurve(problem)
    at = curve._point(np.array([[0.1, 0.6, 0.3]]), np.log(1e-12))
    matrix = newton_matrix(problem, at)
    assert np.linalg.cond(matrix) < 1e3
    assert curve._directions(at).correction.ravel() == pytest.approx(np.linalg.solve(matrix, at.G.ravel()), rel=1e-9)


@pytest.mark.parametrize("contacts", [5, 60], ids=["dense", "sparse"])
@pytest.mark.parametrize("seed", range(4))
def test_sign_of_the_determinant(contacts, seed):
    rng = np.random.default_rng(seed)
    W = scipy.sparse.diags([1.0, -0.3, -0.3], [0, 7, -7], shape=(3 * contacts, 3 * contacts)).tocsr()
    matrix, D = NewtonMatrix(W), rng.standard_normal((contacts, 3, 3))
    assert matrix.factorise(D) and matrix.dense == (contacts == 5)
    full = W.toarray()
    for k in range(contacts):
        full[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += D[k]
    assert matrix.sign() == np.linalg.slogdet(full)[0]
    assert matrix.factorise(D) and matrix.sign() == np.linalg.slogdet(full)[0]  # in the order of the first
    right = rng.standard_normal((contacts, 3))
    for transposed, expected in ((False, full), (True, full.T)):
        assert np.allclose(expected @ matrix.solve(right, transposed).ravel(), right.ravel(), atol=1e-9)


def determinants_sign(problem, at):
    return np.linalg.slogdet(newton_matrix(problem, at))[0]


def distance(curve, at):
    """Of a point from the curve: the largest correction of a contact, orthogonal to its direction."""
    found = curve._directions(at)
    along = found.along / cone_paths._norm(at, found.along, 1.0)
    log = 1.0 / cone_paths._norm(at, found.along, 1.0)
    back = cone_paths._inner(at, along, log, found.correction, 0.0)
    return np.sqrt((at.relative(found.correction - back * along) ** 2).sum(axis=1)).max()


def test_points_are_near_the_curve_and_its_direction_is_that_of_the_determinant():
    """log tau decreases where the determinant is positive, and increases where it is negative: both are met."""
    problem = cones(stack(10, 2.0, 1203))
    curve, signs = ConeCurve(problem), set()
    at = curve.start()
    while at.tau > 1e-5:
        new = curve.step(at)
        at, forward = new, curve._found.forward
        assert forward == -determinants_sign(problem, at)
        assert distance(curve, at) < 0.5
        signs.add(forward)
    assert signs == {-1.0, 1.0} and curve.rejected > 0


def test_the_curve_ends_where_tau_is_small(monkeypatch):
    monkeypatch.setattr(cone_paths, "_REACHED", 1e-2)  # over the largest force
    curve = ConeCurve(cones(stack(3, 0.7, 1)))
    points = [curve.start()]
    while (new := curve.step(points[-1])) is not None:
        points.append(new)
    last, before = ((at.tau, 1e-2 * np.abs(at.X).max()) for at in (points[-1], points[-2]))
    assert last[0] < last[1] and before[0] >= before[1] and curve.h > 1e-2


def test_first_correction_is_of_second_order_in_the_step(monkeypatch):
    """Predictors are tangents at the curve itself, not at the point that is near it."""
    problem = cones(stack(3, 0.7, 1))
    curve, first = ConeCurve(problem), []
    at = curve.start()
    for _ in range(3):
        at = curve.step(at)
    found, corrected = curve._directions(at), curve._corrected
    t, t_log = (x / cone_paths._norm(at, found.along, 1.0) for x in (found.forward * found.along, found.forward))
    monkeypatch.setattr(cone_paths, "_ACCEPTED", 1e-3)
    monkeypatch.setattr(cone_paths, "_CORRECTIONS", 8)
    at, _ = curve._corrected(at, t, t_log)
    monkeypatch.undo()
    curve._corrected = lambda *given: first.append(corrected(*given)[1]) or (at, first[-1])
    found = curve._found
    for h in (0.02, 0.01):
        curve.h, curve._found = h, found
        curve.step(at)
    assert 0.0 < first[0] < 0.01 and 3.0 < first[0] / first[1] < 5.0
