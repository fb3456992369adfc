"""A without full rank: forces in its null space neither hide an error nor grow without need."""

import functools
import itertools
import time
from dataclasses import replace

import clarabel
import numpy as np
import pytest
import scipy.sparse
from conftest import dense_compliance, make_block, random_tresca
from mpi4py import MPI
from shared_problems import residual_of
from singular_problems import singular_problem

from coulomb import InteriorPoint, NotConverged, Status, SuccessiveTresca, solve_coulomb, solve_tresca
from coulomb.linalg.reductions import Reductions
from coulomb.solvers import Automatic, DenseSystem, FrictionProblem, MatrixAutomatic, RegularisedNewton, RigidMotions
from coulomb.solvers.laws import FrictionLaw
from coulomb.solvers.rigid import gauss_seidel
from coulomb.solvers.rigid.cones import Scales

OVER = Reductions(MPI.COMM_SELF)


def tresca_seeds(count):
    problems = (singular_problem(seed) for seed in range(1000, 2000))
    return list(itertools.islice((P for P in problems if not P.friction.any()), count))


def by_clarabel(P, at=None):
    """The Tresca problem by a conic solver; with forces `at` of one solution, the solution of least norm: that is the
    smallest x in the set with the same H x and b.x."""
    m, a, n = P.m, P.compliance, 3 * P.m
    f = np.abs(P.b).max() / a if at is None else np.linalg.norm(at)
    H, b = P.H / np.sqrt(a), P.b / (a * f)
    r = len(H)
    least = at is not None
    normal = scipy.sparse.csr_matrix((-np.ones(m), (np.arange(m), 3 * np.arange(m))), shape=(m, n))
    rows = [scipy.sparse.hstack([H, scipy.sparse.csr_matrix((r, r)) if least else -scipy.sparse.identity(r)])]
    right, cones = [H @ at / f if least else np.zeros(r)], [clarabel.ZeroConeT(r), clarabel.NonnegativeConeT(m)]
    rows.append(scipy.sparse.hstack([normal, scipy.sparse.csr_matrix((m, r))]))
    right.append(np.zeros(m))
    for i in range(m):
        rows.append(scipy.sparse.csr_matrix(([-1.0, -1.0], ([1, 2], [3 * i + 1, 3 * i + 2])), shape=(3, n + r)))
        right.append([P.cohesion[i] / f, 0.0, 0.0])
        cones.append(clarabel.SecondOrderConeT(3))
    if least:
        rows.append(scipy.sparse.csr_matrix(np.r_[-b / np.linalg.norm(b), np.zeros(r)]))
        right.append([-(b @ at) / f / np.linalg.norm(b) + 1e-9])
        cones.append(clarabel.NonnegativeConeT(1))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10 if least else 1e-12
    P_ = scipy.sparse.diags(np.r_[np.ones(n), np.zeros(r)] if least else np.r_[np.zeros(n), np.ones(r)])
    q = np.zeros(n + r) if least else np.r_[-b, np.zeros(r)]
    A = scipy.sparse.csc_matrix(scipy.sparse.vstack(rows))
    solution = clarabel.DefaultSolver(P_.tocsc(), q, A, np.concatenate(right), cones, settings).solve()
    assert "Solved" in str(solution.status)
    return f * np.array(solution.x)[:n]


@functools.cache
def least_objective(number):
    """Forces of one of the problems, by a conic solver."""
    return by_clarabel(tresca_seeds(10)[number])


# --- the measure -----------------------------------------------------------------------------------------------------


def test_forces_that_move_nothing_do_not_make_an_error_small():
    """Two contacts that press against each other by c: the same error of the displacements, whatever c."""
    A = np.array([[1.0, -1.0], [-1.0, 1.0]])
    A = np.kron(A, np.diag([1.0, 0.0, 0.0])) + np.kron(np.eye(2), np.diag([0.0, 1.0, 1.0]))
    b = A @ np.array([1.0, 0.1, 0.0, 0.0, 0.0, 0.2])
    problem, error = FrictionProblem.tresca(dense_compliance(A), b, np.ones(2)), np.array([0, 0, 1e-6, 0, 0, 0])
    small = problem.residual(np.array([1.0, 0.1, 0.0, 0.0, 0.0, 0.2]) + error)
    assert small == pytest.approx(1e-6 / np.sqrt(1.01), rel=1e-5)  # of the force of that contact
    for c in (1e3, 1e6):
        x = np.array([1.0 + c, 0.1, 0.0, c, 0.0, 0.2]) + error
        felt = 10.0 * (x @ A @ x) / np.linalg.norm(x)  # x^T A x of the forces without c; the mean diagonal is 1
        assert problem.residual(x) == pytest.approx(1e-6 / felt, rel=1e-3)
        assert problem.residual(x) > small


def test_errors_of_displacements_are_measured_by_the_loads():
    """Forces that grow until they swallow a penetration of 1 in rounding errors: A x is not exactly 0 any more."""
    h = np.array([1.0, 0.0, 0.0, -1.0 / 3.0, 0.0, 0.0])
    A = np.outer(h, h) + np.diag([0.0, 1.0, 1.0] * 2)
    problem = FrictionProblem.coulomb(dense_compliance(A), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0]), np.full(2, 0.3))
    for c in 10.0 ** np.arange(0, 18):
        assert problem.residual(np.array([c, 0.0, 0.0, 3.0 * c, 0.0, 0.0])) >= 1e-2


def test_natural_residual_where_forces_swallow_the_displacements():
    """1e20 - 1 is 1e20 in double precision: the gap of -1 and the slip inside the disc count all the same."""
    law = FrictionLaw.coulomb(np.ones(1))
    x = np.array([1e20, 1e10, 0.0])
    assert law.natural_residual(x, np.array([-1.0, 0.0, 0.0]), 1.0, OVER) == pytest.approx(1e-20, rel=1e-12, abs=0.0)
    assert law.natural_residual(x, np.array([0.0, 1e-9, 0.0]), 1.0, OVER) == pytest.approx(1e-29, rel=1e-12, abs=0.0)


def test_elastic_bodies_feel_all_of_their_forces():
    """Their measure is that of the worst contact alone."""
    block = make_block(4).friction_problem
    for problem in (block, block.with_slip_bound(np.full(block.A.nodes, 1e6))):
        result = InteriorPoint().solve(problem)
        assert problem.dilution(result.x, result.gradient) == 1.0
        own = residual_of(problem.A.dense(), problem.b, problem.law.radius, result.x, elastic=True)
        assert problem.residual(result.x, result.gradient) == pytest.approx(own, rel=1e-3)


def test_rigid_motions_do_not_hide_an_error_either():
    """Four contacts of a body that they alone hold: forces along the diagonals, and far gaps that a motion closes."""
    rng = np.random.default_rng(3)
    H = rng.standard_normal((4, 15))
    G = rng.standard_normal((2, 15))
    null = np.linalg.svd(np.vstack([H, G]))[2][-1]
    x = np.column_stack([rng.uniform(1.0, 2.0, 5), rng.uniform(-0.2, 0.2, (5, 2))]).ravel()
    A = H.T @ H
    for far in (0.0, 1e6):
        motion = np.array([far, -far])
        problem = FrictionProblem(
            dense_compliance(A),
            A @ x - G.T @ motion,
            FrictionLaw.tresca(np.full(5, 1e12)),
            lower=-1e12,
            rigid=RigidMotions(G, G @ x),
        )
        error = 1e-4 * np.linalg.svd(G)[2][-1] * np.linalg.norm(x)
        assert problem.residual(x, A @ x - problem.b - G.T @ motion) <= 1e-9
        for c in (0.0, 1e5):
            y = x + error + c * np.linalg.norm(x) * null
            w = A @ y - problem.b - G.T @ motion
            assert problem.residual(y, w) >= 1e-6


def test_sweeps_measure_likewise():
    for seed in range(40):
        P = singular_problem(seed)
        friction = np.maximum(P.friction, 0.1)
        found = gauss_seidel.sweep(P.A, P.b, friction, 1e-8, work=1.0)
        problem = FrictionProblem.coulomb(dense_compliance(P.A), P.b, friction)
        expected = Scales.of(problem).residual(problem, found.x, P.A @ found.x - P.b)
        assert found.residual == pytest.approx(expected, rel=1e-4, abs=1e-13)


# --- the solvers -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "solver",
    [None, InteriorPoint(), InteriorPoint(newton=DenseSystem()), SuccessiveTresca()],
    ids=["default", "interior point", "dense", "successive Tresca"],
)
def test_the_objective_is_that_of_a_conic_solver(solver):
    """With a residual relative to |x| alone 5 of these were CONVERGED up to 4e-4 above the minimum."""
    problems, found = tresca_seeds(10), 0
    for k, P in enumerate(problems):
        least = P.objective(least_objective(k))
        try:
            x = solve_tresca(P.A, P.b, P.cohesion, solver=solver).x
        except NotConverged:
            continue
        found += 1
        assert P.objective(x) <= least + 1e-6 * abs(least), P.title
        assert P.off(x) <= 1e-7, P.title
    assert found >= (1.0 if solver is None else 0.9) * len(problems)


def test_forces_of_least_norm():
    """No larger than those of the conic solver, which looks for them among all solutions to 1e-9; this is a larger set
    where A has eigenvalues over six decades."""
    for P in (P for P in tresca_seeds(20) if "half" not in P.title):
        result = solve_tresca(P.A, P.b, P.cohesion)
        least = np.linalg.norm(by_clarabel(P, result.x))
        assert np.linalg.norm(result.x) <= (1.0 + 1e-3) * least, P.title


def test_rigid_motions_without_full_rank():
    """From a solution; the displacements of Tresca problems are unique, up to rigid motions."""
    for P in tresca_seeds(20):
        if "made" not in P.title or P.m < 3:
            continue
        rng = np.random.default_rng(P.m)
        x = solve_tresca(P.A, P.b, P.cohesion).x
        w = P.A @ x - P.b
        G = rng.standard_normal((3, 3 * P.m))
        motion = np.linalg.norm(P.b) * rng.standard_normal(3)
        b = P.b - G.T @ motion  # closes and opens the contacts, and the motion takes it back
        result = solve_tresca(P.A, b, P.cohesion, rigid=RigidMotions(G, G @ x))
        assert result.status is Status.CONVERGED
        assert np.linalg.norm(G @ (result.x - x)) <= 1e-6 * np.linalg.norm(G @ x)
        moved = replace(P, b=b + G.T @ result.rigid)
        assert moved.off(result.x) <= 1e-6 and np.linalg.norm(w) > 0.0, P.title


def test_a_definite_matrix_takes_the_interior_point_method():
    problem, A = random_tresca(20, 5)
    ours, plain = solve_tresca(A, problem.b, problem.law.cohesion), Automatic().solve(problem)
    assert ours.method == "auto: interior point" and ours.products == plain.products
    assert np.array_equal(ours.x, plain.x) and ours.newton_steps == plain.newton_steps


@pytest.mark.parametrize("cohesion", [0.0, 1.0])
def test_a_refusal_takes_seconds(cohesion):
    """Of rank 4, and pressed so that no forces close the contacts: all methods are tried."""
    rng, began = np.random.default_rng(0), time.process_time()
    H, b = rng.standard_normal((4, 90)), rng.standard_normal(90)
    b[0::3] += 1.0
    with pytest.raises(NotConverged):
        solve_coulomb(H.T @ H, b, np.full(30, 0.5), cohesion=cohesion)
    assert time.process_time() - began < 5.0


def test_successive_tresca_ends_after_newton_steps():
    """The last of the methods, whose twenty problems took up to 100 Newton steps each: no problem begins after 300."""
    P, outer = singular_problem(53), []
    problem = FrictionProblem(dense_compliance(P.A), P.b, FrictionLaw(P.cohesion, P.friction))
    with pytest.raises(NotConverged):
        MatrixAutomatic().solve(problem, progress=lambda at: outer.append(at.outer))
    steps = [number for number in outer if number > 0]
    assert len(steps) >= 300 > sum(number < steps[-1] for number in steps)


def test_sweeps_count_the_search_for_a_direction_of_slip():
    """At a contact that has none they took 2.4 million sweeps of 16 us each, for 0.1 s of work: this was 1.7 s."""
    P = singular_problem(6991)
    began = time.process_time()
    gauss_seidel.sweep(P.A, P.b, P.friction, 1e-8, work=1e5)
    assert time.process_time() - began < 0.5


def test_an_indefinite_matrix_is_refused():
    A = np.kron(np.array([[1.0, 2.0], [2.0, 1.0]]), np.eye(3))
    for matrix in (A, scipy.sparse.csr_matrix(A)):
        with pytest.raises(ValueError, match="A must be positive semidefinite, but has an eigenvalue of -1"):
            solve_tresca(matrix, np.ones(6), 1.0)
    assert solve_tresca(A + np.eye(6), np.ones(6), 1.0).status is Status.CONVERGED  # eigenvalues 0 and 4


@pytest.mark.parametrize("digits", [6, 7])
def test_entries_of_few_digits_are_a_warning(digits, caplog):
    """Rounding makes eigenvalues 0 negative; the answer is one of the rounded problem."""
    P = tresca_seeds(1)[0]
    unit = 10.0 ** (np.floor(np.log10(np.abs(P.A) + 1e-300)) + 1 - digits)
    A = np.round(P.A / unit) * unit
    least, size = np.linalg.eigvalsh(A)[0], np.linalg.norm(A)
    assert -1e-6 * size < least < -1e-8 * size
    result = solve_tresca(A, P.b, P.cohesion)
    assert f"A has an eigenvalue of {least:.3g}" in caplog.text and result.status is Status.CONVERGED
    assert residual_of(A, P.b, lambda _: P.cohesion, result.x) <= 1.01e-8


def test_the_method_refuses_interrupts_and_ends():
    P = tresca_seeds(1)[0]
    with pytest.raises(ValueError, match="A as a matrix on one rank"):
        RegularisedNewton().solve(make_block(2, explicit=False).friction_problem)
    with pytest.raises(ValueError, match="systems must be an integer at least 1"):
        RegularisedNewton(systems=0)
    problem, seen = FrictionProblem.tresca(dense_compliance(P.A), P.b, P.cohesion), []
    with pytest.raises(NotConverged) as failure:
        RegularisedNewton().solve(problem, progress=lambda at: seen.append(at) or len(seen) == 3)
    assert failure.value.result.status is Status.INTERRUPTED and failure.value.result.newton_steps == 3
    with pytest.raises(NotConverged, match=r"\(max_iterations\)") as failure:
        RegularisedNewton(systems=2).solve(problem)
    assert failure.value.result.newton_steps == 2
