"""Contacts of very different compliance, each judged by its own: as right together as alone."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import dense_compliance
from floating_blocks import FloatingBlock, floating_problem

from coulomb import InteriorPoint, NotConverged, SuccessiveTresca, solve_coulomb
from coulomb.solvers import Automatic, DenseSystem, FrictionLaw, FrictionProblem
from coulomb.solvers.rigid.cone_interior_point import ConeInteriorPoint
from coulomb.solvers.scaled_problem import ScaledProblem

SOLVERS = {
    "sweeps": None,
    "cones": ConeInteriorPoint(sweeps=False),
    "auto": Automatic(),
    "dense": InteriorPoint(newton=DenseSystem()),
    "successive Tresca": SuccessiveTresca(),
}


def two_contacts(seed, s):
    """A, b of two contacts whose compliances are s apart; both forces (1, 0.1, 0), which stick for F = 0.3."""
    G = np.random.default_rng(seed).normal(size=(9, 6))
    D = np.repeat([np.sqrt(s), 1.0], 3)
    A = D[:, None] * (G.T @ G / 6) * D
    x = np.array([1.0, 0.1, 0.0] * 2)
    return A, A @ x, x


@pytest.mark.parametrize("s", [1e-4, 1e-7, 1e-10])
@pytest.mark.parametrize("name", SOLVERS)
def test_two_contacts_that_act_on_each_other(name, s):
    """By one scale 29 of 100 answers for s = 1e-8 were CONVERGED and wrong by more than a tenth."""
    refused = 0
    for seed in range(20):
        A, b, x = two_contacts(seed, s)
        try:
            result = solve_coulomb(A, b, 0.3, SOLVERS[name])
        except NotConverged:
            refused += 1
            continue
        assert np.abs(result.x - x).max() <= 1e-4, seed
    assert refused <= (0 if name in ("sweeps", "cones") else 2)


def posed(A, x, body=None):
    """With the forces x as solution, F = 0.3."""
    law = FrictionLaw.coulomb(np.full(len(x) // 3, 0.3))
    return FrictionProblem(dense_compliance(A), A @ x, law, elastic=True, body=body)


@pytest.mark.parametrize("bodies", [1, 2])
def test_an_error_of_the_stiff_contact_is_seen(bodies):
    """Foam beside steel, that have nothing to do with each other: a tenth of its force is 1e-7 on the foam's scale."""
    body = np.array([0, 1]) if bodies == 2 else None
    problem = posed(np.diag([1.0, 1.0, 1.0, 1e-6, 1e-6, 1e-6]), np.array([2.0, 0, 0, 2.0, 0, 0]), body)
    assert problem.residual(np.array([2.0, 0, 0, 2.0, 0, 0])) == 0.0
    assert problem.residual(np.array([2.0, 0, 0, 2.2, 0, 0])) == pytest.approx(0.2 / 2.2)


def test_forces_that_are_small_on_their_own_body():
    """An error of 1e-6 of the force of a contact, and of a hundredth of the largest on its body, at least."""
    for small, body, expected in ((1e-1, None, 1e-6), (1e-5, None, 1e-8), (1e-5, np.array([0, 1]), 1e-6)):
        x = np.array([1.0, 0, 0, small, 0, 0])
        off = x + np.array([0, 0, 0, 1e-6 * (small if expected == 1e-6 else 1e-2 * 1e-2), 0, 0])
        assert posed(np.eye(6), x, body).residual(off) == pytest.approx(expected, rel=1e-3)


def test_a_small_error_of_a_soft_contact_counts_where_it_moves_a_stiff_one():
    """1e-7 of the soft force moves the other contact, 1e10 times stiffer, by a hundredth of its force."""
    A, b, x = two_contacts(0, 1e-10)
    problem = FrictionProblem.coulomb(dense_compliance(A), b, np.full(2, 0.3))
    change = np.concatenate([-np.linalg.solve(A[:3, :3], A[:3, 3:] @ [1e-7, 0, 0]), [1e-7, 0, 0]])
    assert np.abs(change[:3]).max() > 1e-3
    left = problem.left_over(x + change, problem.gradient(x + change))
    assert np.abs(left).max() <= 1e-6
    assert problem.residual(x + change) >= 1e-5


def test_floating_bodies_of_one_stiffness_have_one_nominal_force():
    """Forces go on from body to body: what the loads close at the contacts of one says little of them."""
    floating, m = floating_problem(FloatingBlock(), 0.5), len(FloatingBlock().bottom)
    b = np.where(np.arange(3 * m) < 24, 1.0, 1e-4) * floating.b
    scaled = ScaledProblem(replace(floating, b=b, body=np.arange(m) // 8))
    assert not scaled.mixed and np.all(scaled.energy == 1.0)
