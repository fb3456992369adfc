"""Later steps of a load history: few Newton steps, and what was learnt of A is kept."""

import dataclasses

import numpy as np
import pytest
from conftest import dense_compliance, random_spd
from mpi4py import MPI

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    LoadHistory,
    Material,
    NotConverged,
    Plane,
    Rotation,
    Status,
    Traction,
    box,
)
from coulomb.fem.contact import KeptMatrix, contact_matrix, rows_of
from coulomb.linalg.compliance.low_rank import (
    LinearResponseCache,
    RecycledColumns,
    turned_diagonal,
)
from coulomb.solvers import Automatic, FrictionProblem, IterativeSolver
from coulomb.solvers.contact_equations import ContactEquations
from coulomb.solvers.laws import FrictionLaw
from coulomb.solvers.semismooth_newton import SemismoothNewton


def fine(load=lambda t: t / 20, **options):
    """The block of the benchmarks, pushed by a twentieth in each load step."""
    contact = options.pop("contact", Contact("bottom", 0.3))
    tractions = [
        Traction("top", (0.0, 0.0, -4e7)),
        Traction("top", (0.0, 1e7, 0.0), amplitude=load),
        Traction("right", (2e7, 0.0, 0.0), amplitude=load),
    ]
    material = Material(young=2.119e11, poisson=0.277)
    return ContactProblem(box((3.0, 1.0, 1.0), (12, 4, 4)), material, [Clamp("left")], contact, tractions, **options)


@pytest.fixture(scope="module")
def steps():
    """Six load steps, and one that repeats the last load."""
    return list(LoadHistory([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]).steps(fine(lambda t: min(t, 6.0) / 20)))


def newton(steps):
    return [step.solution.result.newton_steps for step in steps]


def test_a_fine_history_takes_few_newton_steps(steps):
    """From a cold start each takes 13 to 18."""
    assert all(step.solution.certificate.passed for step in steps)
    assert np.mean(newton(steps)[1:6]) <= min(5.0, 0.6 * newton(steps)[0])
    assert all(step.solution.result.method == "auto: semismooth Newton" for step in steps[1:])


def test_a_step_that_repeats_its_load_takes_at_most_one(steps):
    assert newton(steps)[6] <= 1


def test_answers_are_those_of_the_interior_point_method(steps):
    """At F = 0.3 the answer of a load step is unique."""
    other = LoadHistory([1.0, 2.0, 3.0], tolerance=1e-9, solver=InteriorPoint(1e-9)).steps(fine())
    for ours, theirs in zip(steps, other, strict=False):
        x, y = ours.solution.contact_force, theirs.solution.contact_force
        assert np.linalg.norm(x - y) <= 1e-6 * np.linalg.norm(y)


@pytest.mark.parametrize("solver", [None, IterativeSolver], ids=["factorised", "multigrid"])
def test_learnt_columns_turn_with_the_frames(solver):
    """Against a plane that tilts: U = A X in the frames of every step, and they are kept."""
    tilting = Contact(
        "bottom",
        0.3,
        foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        rotation=Rotation((1.5, 0.5, 0.0), (0.0, 1.0, 0.0), [(1, 0.0), (3, -1e-4)]),
    )
    columns = []
    for step in LoadHistory([1.0, 2.0, 3.0]).steps(fine(contact=tilting, linear_solver=solver)):
        A = step.solution.problem.A
        X, U = A.learnt.X, A.learnt.U
        y = np.empty(len(X))
        A.mult(X[:, 0].copy(), y)
        if solver is None:  # multigrid's products are as inexact as the steps allow
            assert np.linalg.norm(y - U[:, 0]) <= 1e-9 * np.linalg.norm(y)
        columns.append(X.shape[1])
    assert 20 < columns[0] <= columns[1] <= columns[2]


def test_matrix_of_the_evidence_is_that_of_its_points_and_frames(steps):
    """Kept as long as both stay; another face, frames that turn, or fewer points make a new one."""
    problem = steps[0].solution.problem
    points, frames, kept = problem.surface.points, problem.surface.frames, KeptMatrix()
    u = np.random.default_rng(8).standard_normal(problem.elasticity.x.shape)
    turned, some = frames[:, [1, 2, 0]], np.arange(len(frames)) > 3
    before = None
    for where, axes in ((points, frames), (points, turned), (points.only(some), turned[some]), (points, frames)):
        B = kept.of(where, axes)
        assert B is not before and kept.of(dataclasses.replace(where), axes.copy()) is B
        np.testing.assert_array_equal(rows_of(B, u), rows_of(contact_matrix(where, axes), u))
        before = B


def test_columns_and_diagonal_turn():
    rng = np.random.default_rng(3)
    A, X = random_spd(12, 1e3, rng), rng.standard_normal((12, 4))
    turn = np.array([np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(4)])
    T = np.zeros((12, 12))
    for i in range(4):
        T[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = turn[i]
    learnt = RecycledColumns()
    learnt.keep(X, A @ X, 0.5)
    turned = learnt.turned(turn)
    np.testing.assert_allclose(T @ A @ T.T @ turned.X, turned.U, atol=1e-12 * np.abs(A).max())
    whole = (
        RecycledColumns()
    )  # all of A in the columns: the diagonal turns exactly, up to the part that is kept as rest
    root = np.linalg.cholesky(0.85 * A)
    whole.keep(np.linalg.solve(A, root), root, 0.5)
    expected = np.diag(T @ (0.85 * A) @ T.T) + (turn**2 @ (0.15 * np.diag(A)).reshape(4, 3, 1)).ravel()
    np.testing.assert_allclose(turned_diagonal(np.diag(A), whole, turn), expected, rtol=1e-12)
    np.testing.assert_allclose(
        turned_diagonal(np.diag(A), learnt.turned(turn * 0 + np.eye(3)), turn * 0 + np.eye(3)), np.diag(A)
    )
    low = 0.3 * np.diag(A)  # an estimate of the diagonal below what the columns have: a tenth of it stays as rest
    assert np.all(turned_diagonal(low, whole, turn) > 0.0)
    np.testing.assert_allclose(turned_diagonal(low, whole, turn * 0 + np.eye(3)), low)
    left = turned_diagonal(low, whole, turn).reshape(4, 3) - 0.9 * 0.3 / 0.85 * np.sum(
        whole.turned(turn).U.reshape(4, 3, 12) ** 2, axis=2
    )
    np.testing.assert_allclose(left, 0.1 * (turn**2 @ low.reshape(4, 3, 1))[..., 0], rtol=1e-9)


def test_equations_have_their_derivative():
    """By differences, at forces that are open, stick and slip; where x and p are parallel the modification vanishes."""
    rng = np.random.default_rng(1)
    m = 30
    law = FrictionLaw(np.zeros(m), np.full(m, 0.4))
    equations = ContactEquations(law, np.zeros(m), np.ones(m, dtype=bool), np.ones(m), np.ones(m))
    x = rng.uniform(-1.0, 2.0, (m, 3))
    x[:, 0] = np.abs(x[:, 0])
    w = rng.uniform(-2.0, 2.0, (m, 3))
    e = x[:, 1:] / np.linalg.norm(x[:, 1:], axis=1)[:, None]
    x[:, 1:] = e * law.radius(x[:, 0])[:, None]  # friction at its bound, against the slip
    w[:10, 1:] = -e[:10]
    at = equations.at(x, w)
    assert set(at.status[:10]) <= {0, 2} and {0, 1, 2} >= set(at.status)
    dx, dw = rng.standard_normal((2, m, 3))
    t = 1e-6
    difference = (equations.at(x + t * dx, w + t * dw).value - equations.at(x - t * dx, w - t * dw).value) / (2 * t)
    np.testing.assert_allclose(at.apply(dx, dw)[:10], difference[:10], atol=1e-5)


def test_a_bad_start_ends_in_the_interior_point_method():
    """Forces of a wrong size and direction; the products of both methods count."""
    rng = np.random.default_rng(2)
    A = dense_compliance(1e-9 * random_spd(36, 1e4, rng))
    b = 1e-4 * rng.standard_normal(36)
    b[0::3] += 5e-5
    problem = FrictionProblem.coulomb(A, b, np.full(12, 0.6))
    cold = Automatic().solve(problem)
    near = SemismoothNewton(max_iterations=1)
    with pytest.raises(NotConverged) as failure:
        near.solve(problem, -1e9 * cold.x)
    assert failure.value.result.status is not Status.CONVERGED and failure.value.result.newton_steps <= 1
    warm = Automatic().solve(problem, np.array([-1e9 * cold.x, 1e9 * rng.standard_normal(36)]))
    assert warm.status is Status.CONVERGED and warm.residual <= 1e-8
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-6 * np.abs(cold.x).max())


def test_a_certificate_that_refuses_is_never_converged():
    rng = np.random.default_rng(2)
    A = dense_compliance(1e-9 * random_spd(36, 1e2, rng))
    problem = FrictionProblem.coulomb(A, np.full(36, 1e-4), np.full(12, 0.3))
    cold = Automatic().solve(problem)
    with pytest.raises(NotConverged) as failure:
        SemismoothNewton().solve(dataclasses.replace(problem, accept=lambda x: False), cold.x)
    assert failure.value.result.status is not Status.CONVERGED


def test_combinations_of_loads_need_no_solve():
    rng = np.random.default_rng(0)
    K, loads, calls = random_spd(9, 1e3, rng), rng.standard_normal((3, 9)), []
    kept = LinearResponseCache(MPI.COMM_SELF)

    def response(f):
        def solve():
            calls.append(f)
            return np.linalg.solve(K, f)

        return kept.response(f, np.zeros(9), solve)

    for f in [loads[0], 2.0 * loads[0], loads[1], loads[0] - 3.0 * loads[1], loads[2] + loads[0]]:
        np.testing.assert_allclose(response(f), np.linalg.solve(K, f), rtol=1e-11)
    assert len(calls) == 3


def test_loads_of_nearly_one_pattern_lose_no_digits():
    """What is prescribed besides must fit too; loads that differ little are not kept beside each other."""
    rng = np.random.default_rng(1)
    K = random_spd(9, 1e3, rng)
    f, g = rng.standard_normal((2, 9))
    held = np.where(np.arange(9) < 2, 1.0, 0.0)
    for other, something in ((f + 1e-7 * g, 1.0), (f + 1e-7 * g, 0.0), (f + 0.05 * g, 1.0)):
        kept, calls = LinearResponseCache(MPI.COMM_SELF), []

        def response(load, prescribed, kept=kept, calls=calls):
            calls.append(load)
            return kept.response(load, prescribed, lambda: np.linalg.solve(K, load) + 2.0 * prescribed)

        for load, amount in ((f, 1.0), (other, 1.0), (f, 3.0), (f - 2.0 * other, 1.0), (g - f, -1.0), (g, 0.0)):
            prescribed = something * amount * held
            expected = np.linalg.solve(K, load) + 2.0 * prescribed
            error = np.abs(response(load, prescribed) - expected).max()
            assert error <= 1e-12 * np.abs(expected).max()
