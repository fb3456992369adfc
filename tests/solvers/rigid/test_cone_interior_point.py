"""Contact of rigid bodies, whose compliance has half rank or less: solved, or refused with a reason."""

import numpy as np
import pytest
import scipy.sparse

import coulomb
from benchmarks.rigid_bodies import TouchPoint, arch, assembled, capsules, scattered, stack, tower, walled
from coulomb import NotConverged, Status, solve_coulomb
from coulomb.solvers import Automatic, RegularisedNewton
from coulomb.solvers.friction_problem import Task
from coulomb.solvers.results import Goal
from coulomb.solvers.rigid import cone_interior_point
from coulomb.solvers.rigid.cone_interior_point import ConeInteriorPoint, _ConeRun, contradiction
from coulomb.solvers.rigid.cones import ConeProblem, Scales
from coulomb.solvers.rigid.matrix_problems import _compliance

UP = np.array([0.0, 0.0, 1.0])


def solved(problem, solver=None):
    return solve_coulomb(problem.W, -problem.q, problem.mu, solver)


NO_SWEEPS = ConeInteriorPoint(sweeps=False)


@pytest.mark.parametrize("solver", [None, NO_SWEEPS], ids=["auto", "no sweeps"])
@pytest.mark.parametrize(
    "problem",
    [stack(8, 2.0, 3), tower(3, 0.3, 1), arch(9, 0.8, 1), walled(20, 1.0, 2), scattered(10, 60, 0.7, 2)],
    ids=lambda problem: problem.title,
)
def test_generated_problems(problem, solver):
    """To 1e-8 by the collection's measure; most forces are not unique."""
    result = solved(problem, solver)
    assert result.status is Status.CONVERGED
    assert result.method == ("cone interior point" if solver else "auto: cone interior point")
    assert problem.residual(result.x) <= 1e-8


def test_resting_stack_carries_its_weight():
    """Boxes that fall straight and stick: the impulses of a joint stop all boxes above it."""
    problem = stack(6, 0.5, 4, push=0.0)
    r = solved(problem).x.reshape(6, 4, 3)
    assert np.allclose(r[:, :, 0].sum(axis=1), np.arange(6, 0, -1), atol=1e-7)
    assert np.allclose(problem.W @ r.ravel() + problem.q, 0.0, atol=1e-7)


@pytest.mark.parametrize("friction", [0.0, 0.2, 2.0])
def test_cube_thrown_along_the_ground(friction):
    """Unit cube, velocity (3, 0, -1): the impulse 1 stops its fall, and friction F brakes it, or 3 stops it."""
    corners = [(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
    points = [TouchPoint(-1, 0, np.array([x, y, 0.0]), UP) for x, y in corners]
    centre = np.array([[0.0, 0.0, 1e-9]])  # friction has no arm: it does not tilt
    v = np.array([[3.0, 0.0, -1.0, 0.0, 0.0, 0.0]])
    problem = assembled("cube", centre, np.array([[1.0, 1.0, 1.0, 6.0, 6.0, 6.0]]), v, points, friction)
    r = solved(problem).x.reshape(4, 3)
    assert r[:, 0].sum() == pytest.approx(1.0, abs=1e-7)
    assert np.linalg.norm(r[:, 1:].sum(axis=0)) == pytest.approx(min(friction, 3.0), abs=1e-7)


def test_no_forces_keep_a_body_between_closing_walls():
    """Both walls come nearer: refused, with the contacts."""
    points = [TouchPoint(-1, 0, np.array([0.0, 0.0, -1.0]), UP), TouchPoint(-1, 0, np.array([0.0, 0.0, 1.0]), -UP)]
    problem = assembled("walls", np.zeros((1, 3)), np.ones((1, 6)), np.zeros((1, 6)), points, 0.5)
    q = problem.q.copy()
    q[[0, 3]] -= 1e-2
    with pytest.raises(NotConverged, match=r"normal forces on contacts 0, 1 .* 1\.0e-02 too small") as failure:
        solve_coulomb(problem.W, -q, problem.mu)
    assert failure.value.result.status is Status.NO_EQUILIBRIUM
    q[3] += 2e-2  # one comes, the other goes: the body goes along
    assert solve_coulomb(problem.W, -q, problem.mu).status is Status.CONVERGED


def test_a_heavy_body_is_no_contradiction():
    """Compliances of 1 and 1e-12: a force on the second contact moves it, though little."""
    A, b = scipy.sparse.diags(np.repeat([1.0, 1e-12], 3)).tocsr(), np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    problem = coulomb.solvers.FrictionProblem.coulomb(_compliance(A), b, np.full(2, 0.5))
    assert contradiction(problem, A) == ""


def boxes_upon_each_other(decades, closing):
    """Ten boxes with four contacts at each joint, masses so many decades apart, and a ceiling: a problem and its W.

    Velocities at its contacts are those of the boxes, and the ceiling comes nearer by `closing`.
    """
    corners, rng = np.array([(x, y, 0.0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]), np.random.default_rng(3)
    centres = np.column_stack([np.cumsum(rng.uniform(-0.15, 0.15, (10, 2)), axis=0), np.arange(10) + 0.5])
    lower = centres[:, None] - [0.0, 0.0, 0.5] + corners
    points = [TouchPoint(k - 1, k, p, UP) for k in range(10) for p in lower[k]]
    points += [TouchPoint(-1, 9, p + UP, -UP) for p in lower[9]]
    inverse = 10.0 ** rng.uniform(-0.5 * decades, 0.5 * decades, (10, 1)) * [1.0, 1.0, 1.0, 6.0, 6.0, 6.0]
    given = assembled("boxes", centres, inverse, 0.3 * rng.standard_normal((10, 6)), points, 0.5)
    q = given.q.copy()
    q[-12::3] -= closing
    problem = coulomb.solvers.FrictionProblem.coulomb(_compliance(given.W), -q, given.mu)
    return problem, ConeProblem(problem, problem.A.sparse(), Scales.of(problem)).W


@pytest.mark.parametrize("decades", [0, 6])
def test_a_ceiling_that_comes_nearer_is_a_contradiction(decades):
    assert "no contact forces keep all contacts" in contradiction(*boxes_upon_each_other(decades, 1e-2))


@pytest.mark.parametrize("decades", [6, 12])
def test_masses_far_apart_are_no_contradiction(decades):
    """q = H^T v: forces that balance each other on light boxes move the heavy ones little, but enough."""
    assert contradiction(*boxes_upon_each_other(decades, 0.0)) == ""


def test_work_is_limited_by_counts():
    problem = scattered(10, 60, 0.7, 2)
    with pytest.raises(NotConverged, match=r"\(max_iterations\), above .* 4 factorisations") as failure:
        solved(problem, ConeInteriorPoint(systems=4, sweeps=False))
    result = failure.value.result
    assert result.newton_steps == 4 and problem.residual(result.x) <= result.residual
    with pytest.raises(NotConverged, match=r"of at most 1\.0e"):
        solved(problem, ConeInteriorPoint(work=1e6))


def test_forces_without_bound_are_no_answer():
    """Two contacts that press against each other: r = c (1, 0, 0, 1, 0, 0) has W r = 0, and the residual relative to r
    becomes small with large c, but the collection's measure does not."""
    points = [TouchPoint(-1, 0, np.array([0.0, 0.0, -1.0]), UP), TouchPoint(-1, 0, np.array([0.0, 0.0, 1.0]), -UP)]
    problem = assembled("walls", np.zeros((1, 3)), np.ones((1, 6)), np.zeros((1, 6)), points, 0.5)
    q = problem.q - np.array([1e-2, 0.0, 0.0] * 2)
    for solver in (ConeInteriorPoint(tolerance=1e-2), None):
        with pytest.raises(NotConverged) as failure:
            solve_coulomb(problem.W, -q, problem.mu, solver)
        assert failure.value.result.status is not Status.CONVERGED


def test_progress_interrupts():
    with pytest.raises(NotConverged) as failure:
        solve = NO_SWEEPS.solve
        matrix = _compliance(stack(3, 0.5, 1).W)
        problem = coulomb.solvers.FrictionProblem.coulomb(matrix, -stack(3, 0.5, 1).q, np.full(12, 0.5))
        solve(problem, progress=lambda at: at.path_following == 2)
    assert failure.value.result.status is Status.INTERRUPTED and failure.value.result.newton_steps == 2


def test_what_it_does_not_solve_is_refused():
    problem = stack(3, 0.5, 1)
    with pytest.raises(ValueError, match="Coulomb's law with constant coefficients, without cohesion"):
        solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(), cohesion=1.0)
    with pytest.raises(ValueError, match="work must be > 0"):
        ConeInteriorPoint(work=0.0)


def test_same_answer_as_the_krylov_method_where_forces_are_unique():
    rng = np.random.default_rng(142)
    G = rng.standard_normal((90, 90))
    A, b = scipy.sparse.csr_matrix(G @ G.T / 90 + 0.1 * np.eye(90)), rng.standard_normal(90)
    x, y, z = (solve_coulomb(A, b, 0.4, solver).x for solver in (None, Automatic(), NO_SWEEPS))
    assert max(np.linalg.norm(x - y), np.linalg.norm(z - y)) <= 1e-6 * np.linalg.norm(y)


def test_start_from_the_answer_takes_no_path():
    problem = stack(5, 0.7, 2)
    x = solved(problem, NO_SWEEPS).x
    friction = coulomb.solvers.FrictionProblem.coulomb(_compliance(problem.W), -problem.q, problem.mu)
    assert NO_SWEEPS.solve(friction, x).newton_steps <= 1
    again = ConeInteriorPoint().solve(friction, x)
    assert again.newton_steps == 0 and again.products == 1


# --- proximal steps ---


@pytest.mark.parametrize(
    "problem",
    [capsules(4, 4, 0.7, 800), capsules(6, 6, 0.3, 0), scattered(30, 120, 2.0, 3)],
    ids=lambda problem: problem.title,
)
def test_problems_on_which_the_path_is_blocked(problem, monkeypatch):
    """Proximal steps from the path's end, or where forces have grown along it by jamming, from the sweeps'."""
    monkeypatch.setattr(_ConeRun, "_take_turns", lambda run, X: [*run._proximal_steps(X)])
    result = solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint())
    assert result.status is Status.CONVERGED and problem.residual(result.x) <= 1e-8
    monkeypatch.setattr(_ConeRun, "_take_turns", lambda *_: None)
    monkeypatch.setattr(_ConeRun, "_proximal_steps", lambda *_: iter(()))
    with pytest.raises(NotConverged):
        solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint())


@pytest.mark.parametrize("friction", [0.0, 0.8])
def test_a_proximal_step_solves_the_problem_with_a_spring_to_its_centre(friction, monkeypatch):
    """Z = W X + q + c/rho (X - centre) + |w_t| e in L, X.Z = 0.  Along the normal W = 1, q = -1, rho = 1, and c = 1/2:
    without friction X - 1 + X/2 = 0."""
    monkeypatch.setattr(cone_interior_point, "_CLOSE", 1e-12)
    A, b = np.diag([2.0, 2.0, 2.0]), np.array([2.0, 1.0, 0.5])
    problem = coulomb.solvers.FrictionProblem.coulomb(_compliance(A), b, np.array([friction]))
    cones = ConeProblem(problem, problem.A.sparse(), Scales.of(problem))
    run = _ConeRun(NO_SWEEPS, problem, Task(Goal(1e-8, None), None, None, None))
    X, systems = run._proximal_step(np.zeros((1, 3)), 0.5)
    again = run._proximal_step(X, 0.5)[0]
    assert 1 <= systems <= 8 and again[0, 0] > X[0, 0]
    w = cones.w(X)
    Z = w + 0.5 / cones.rho * X
    Z[:, 0] += np.hypot(w[:, 1], w[:, 2])
    assert X[0, 0] >= np.hypot(X[0, 1], X[0, 2]) - 1e-9 and Z[0, 0] >= np.hypot(Z[0, 1], Z[0, 2]) - 1e-9
    assert np.vdot(X, Z) == pytest.approx(0.0, abs=1e-9)
    if not friction:
        assert X[0, 0] == pytest.approx(2.0 / 3.0)


# --- the run: lengths of its steps, its best answer, and how much each part may do ---


def refused(problem, **settings):
    with pytest.raises(NotConverged) as failure:
        solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False, **settings))
    return failure.value.result


def test_newton_steps_are_shortened_until_the_natural_map_decreases():
    problem = walled(20, 1.0, 2)
    result = solve_coulomb(problem.W, -problem.q, problem.mu, ConeInteriorPoint(sweeps=False))
    sizes, lengths = (np.array([getattr(step, name) for step in result.history]) for name in ("residual", "alpha"))
    assert set(lengths) == {1.0, 0.5} and np.all(np.diff(sizes) < 0.0) and sizes[-1] < 1e-8


def test_the_answer_of_a_refusal_is_the_best_one(monkeypatch):
    """Of the path's last point, and of ten times its forces."""
    seen = []
    monkeypatch.setattr(_ConeRun, "_proximal_steps", lambda *_: iter(()))
    monkeypatch.setattr(
        _ConeRun, "_take_turns", lambda self, _: seen.extend(map(self._judged, (self._X, 10 * self._X)))
    )
    result = refused(stack(8, 1.0, 2), newton=1, path=4)
    assert result.status is Status.MAX_ITERATIONS and seen[0] < seen[1]
    assert result.residual <= seen[0] * (1.0 + 1e-9)


def test_a_result_is_judged_by_the_measure_of_the_collection(monkeypatch):
    monkeypatch.setattr(Scales, "residual", lambda *_: 0.5)
    problem = stack(3, 0.5, 1)
    for solver in (ConeInteriorPoint(sweeps=False, systems=30), RegularisedNewton(systems=50)):
        with pytest.raises(NotConverged) as failure:
            solved(problem, solver)
        assert failure.value.result.residual == 0.5
