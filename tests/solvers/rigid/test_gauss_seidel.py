"""Gauss-Seidel sweeps in C: one contact by formulas, what they leave to the other methods, and work without them."""

import numpy as np
import pytest
import scipy.sparse

from benchmarks.rigid_bodies import arch, masonry, stack
from coulomb import NotConverged, Status, solve_coulomb
from coulomb.io.fclib import FCLIBProblem
from coulomb.solvers import FrictionProblem
from coulomb.solvers.rigid import gauss_seidel
from coulomb.solvers.rigid.cone_interior_point import ConeInteriorPoint
from coulomb.solvers.rigid.matrix_problems import _compliance


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8, 5.0])
def test_one_contact_by_hand(friction):
    """diag(2, 4, 4), free velocity (-3, 0.8, -0.6): r_n = 1.5; friction |0.25 v_t| = 0.25, or F r_n, against v_t."""
    q = np.array([-3.0, 0.8, -0.6])
    result = solve_coulomb(np.diag([2.0, 4.0, 4.0]), -q, friction)
    size = min(0.25, 1.5 * friction)
    assert np.allclose(result.x, [1.5, -0.8 * size, 0.6 * size], atol=1e-12)
    assert (result.newton_steps, result.products) == (0, 1)
    assert np.array_equal(solve_coulomb(np.diag([2.0, 4.0, 4.0]), np.array([-1.0, 5.0, 0.0]), friction).x, np.zeros(3))


def test_friction_along_the_slip_is_no_root():
    """A start with the friction reversed, where friction and slip are parallel as well, and have the same sign."""
    A, b = _compliance(np.diag([2.0, 4.0, 4.0])), np.array([3.0, -0.8, 0.6])
    problem = FrictionProblem.coulomb(A, b, np.array([0.1]))
    result = ConeInteriorPoint().solve(problem, np.array([1.5, 0.12, -0.09]))
    assert np.allclose(result.x, [1.5, -0.12, 0.09], atol=1e-12) and (result.newton_steps, result.products) == (0, 1)


def test_one_contact_of_any_compliance_by_the_law():
    """Open, or closed and sticking, or slipping against the friction: to rounding, in one or two sweeps."""
    rng, slipped = np.random.default_rng(7), 0
    for _ in range(300):
        G, q, F = rng.standard_normal((3, 3)), rng.standard_normal(3), rng.choice([0.1, 0.5, 1.0])
        A = G @ G.T + 0.3 * np.eye(3)
        r = solve_coulomb(A, -q, F).x
        u = A @ r + q
        if q[0] >= 0.0:
            assert not r.any()
            continue
        size, slip = np.hypot(r[1], r[2]), np.hypot(u[1], u[2])
        assert r[0] > 0.0 and abs(u[0]) < 1e-8 and size <= F * r[0] * (1.0 + 1e-8)
        if slip > 1e-7:
            slipped += 1
            assert size == pytest.approx(F * r[0], rel=1e-7) and r[1:] @ u[1:] == pytest.approx(-size * slip, rel=1e-7)
    assert slipped > 50


def test_a_singular_block_of_the_diagonal():
    """W of rank 2 at a contact that sticks: one combination of the tangential forces is not determined."""
    t = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    problem = FCLIBProblem(scipy.sparse.csr_matrix(t.T @ t), np.array([-1.0, 0.2, 0.2]), np.array([0.9]))
    result = solve_coulomb(problem.W, -problem.q, problem.mu)
    assert result.status is Status.CONVERGED and problem.residual(result.x) <= 1e-8
    assert result.x[0] == pytest.approx(1.0) and result.x[1:].sum() == pytest.approx(-0.2)


def test_a_singular_block_takes_few_sweeps():
    """The term that makes it regular is small against the block, and forces of the sweep before are beside it."""
    t = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    found = gauss_seidel.sweep(t.T @ t, np.array([1.0, -0.2, -0.2]), 0.9, 1e-10)
    assert found.residual <= 1e-10 and found.made <= 8


def test_open_contacts_without_friction_and_slip_have_no_residual():
    found = gauss_seidel.sweep(np.eye(6), np.array([1.0, 0.0, 0.0, -0.3, 0.0, 0.0]), 0.0, 1e-12)
    assert np.array_equal(found.x, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]) and (found.residual, found.made) == (0.0, 1)


def two_contacts(coupling, tolerance):
    """Sweeps for two closed contacts without friction, whose normal displacements are coupled."""
    W = np.eye(6)
    W[0, 3] = W[3, 0] = coupling
    return gauss_seidel.sweep(W, np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0]), 0.0, tolerance)


def test_sweeps_go_forwards_and_backwards():
    """Their rate is the coupling; in one direction it would be its square.  1e-12 is 0.6^54."""
    found = two_contacts(0.6, 1e-12)
    assert np.allclose(found.x[[0, 3]], 1.0 / 1.6, atol=1e-11) and 45 <= found.made <= 60


def test_sweeps_end_where_their_rate_will_not_do():
    """A stack of eight: a fifth of the work of the path, 10.3 ms, is spent in any case, 0.85 microseconds per sweep."""
    problem = stack(8, 1.0, 2)
    found = gauss_seidel.sweep(problem.W, -problem.q, problem.mu, 1e-8)
    assert found.residual > 1e-8 and 1000 <= found.made <= 12_000


@pytest.mark.parametrize("problem", [masonry(10, 4, 0.8, 1), arch(31, 0.6, 1), arch(31, 0.6, 2)])
def test_sweeps_go_on_while_less_is_left_than_the_path_takes(problem):
    """The residual falls in jumps: after a fifth of the work of the path its rate between two looks would not do."""
    found = gauss_seidel.sweep(problem.W, -problem.q, problem.mu, 1e-8)
    assert found.residual <= 1e-8 and found.made > 1000


def test_work_is_that_of_contacts_and_blocks_that_change():
    """Two coupled contacts beside 48 that stay open: these cost nothing; as many sweeps are made as without them."""
    m, coupling = 50, 1.0 - 3e-6
    W, b = np.eye(3 * m), np.full(3 * m, -1e-3)
    W[0, 3] = W[3, 0] = coupling
    b[1::3] = b[2::3] = 0.0
    b[[0, 3]] = 1.0
    found = gauss_seidel.sweep(scipy.sparse.csr_matrix(W), b, 0.0, 1e-8, work=1000.0)
    alone = gauss_seidel.sweep(W[:6, :6].copy(), b[:6].copy(), 0.0, 1e-8, work=1000.0)
    assert found.made == alone.made > 20_000


def test_forces_of_blocks_of_sweeps_are_combined():
    """Two contacts have one slow mode, which the third block leaves out; of a chain of 30 there are many."""
    assert two_contacts(1.0 - 1e-5, 1e-8).made <= 50
    m = 30
    W = np.eye(3 * m)
    for i in range(m - 1):
        W[3 * i, 3 * i + 3] = W[3 * i + 3, 3 * i] = -0.499
    b = np.tile([1.0, 0.0, 0.0], m)
    plain = gauss_seidel.sweep(W, b, 0.0, 1e-10, work=1e6)
    found = gauss_seidel.sweep(W, b, 0.0, 1e-10)
    assert max(plain.residual, found.residual) <= 1e-10 and found.made < 0.4 * plain.made
    assert np.allclose(found.x[::3], np.linalg.solve(W[::3, ::3], b[::3]), rtol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_a_combination_that_makes_the_residual_larger_is_taken_back(seed):
    problem = stack(5, 0.7, seed)
    found = gauss_seidel.sweep(problem.W, -problem.q, problem.mu, 1e-8)
    assert found.residual <= 1e-8 and found.made < 2000


def test_sweeps_with_work_that_is_given():
    """Of two contacts, 0.033 microseconds each, whatever they promise; from the end of the ones before."""
    W, b = np.eye(6), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    W[0, 3] = W[3, 0] = 1.0 - 3e-6
    first = gauss_seidel.sweep(W, b, 0.0, 1e-8, work=1000.0)
    assert first.made == pytest.approx(1000.0 / 0.033, rel=0.1) and first.residual > 1e-8
    second = gauss_seidel.sweep(W, b, 0.0, 1e-8, first.x, 2000.0)
    assert second.made == pytest.approx(2.0 * first.made, rel=0.01) and second.residual < 0.9 * first.residual


def test_known_slip_is_left_to_the_other_methods():
    """Zero rows along both tangents: friction at its bound against the slip -b_t of (3, 4)."""
    result = solve_coulomb(np.diag([2.0, 0.0, 0.0]), np.array([4.0, -3.0, -4.0]), 0.5)
    assert np.allclose(result.x, [2.0, -0.6, -0.8], atol=1e-8)


def test_interrupted_after_the_sweeps():
    problem, seen = stack(8, 1.0, 2), []

    class Stopped(ConeInteriorPoint):
        def solve(self, problem, start=None, **rest):
            return super().solve(problem, start, progress=lambda at: seen.append(at) or True)

    with pytest.raises(NotConverged) as failure:
        solve_coulomb(problem.W, -problem.q, problem.mu, Stopped())
    assert failure.value.result.status is Status.INTERRUPTED and [at.path_following for at in seen] == [0]
