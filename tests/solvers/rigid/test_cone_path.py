"""The interior-point path in second-order cones: its steps solve the equations that its derivation states."""

import numpy as np
import pytest
import scipy.linalg

from benchmarks.rigid_bodies import arch, random_rank, scattered, spheres, stack, walled
from coulomb.solvers import FrictionProblem
from coulomb.solvers.rigid.cone_paths import ConePath, ConeStep
from coulomb.solvers.rigid.cones import (
    ConeProblem,
    Scales,
    determinant,
    product,
    radius,
    scaling,
    step_to_boundary,
    times,
)
from coulomb.solvers.rigid.matrix_problems import _compliance


def cones(given):
    """A generated problem in the variables of the path."""
    problem = FrictionProblem.coulomb(_compliance(given.W), -given.q, given.mu)
    return ConeProblem(problem, problem.A.sparse(), Scales.of(problem))


def inside(rng, m, decades=1.0):
    """Points X and Z inside the cones, of sizes that are `decades` apart from contact to contact, and their theta."""
    X, Z = (np.column_stack([np.ones(m), rng.uniform(-0.6, 0.6, (m, 2))]) for _ in range(2))
    X *= 10.0 ** rng.uniform(-decades, decades, (m, 1))
    return X, Z, float(np.vdot(X, Z)) / m


def newton(problem, X, Z, kept, right):
    """dX, dZ of  point o (P dX + P^-1 dZ) = right  and  dZ - W dX - e d|Z_t| = -F, as one dense system of 6 m rows.

    Args:
        problem: The problem in cones.
        X, Z: The point.
        kept: |Z_t| where it does not change, else None.
        right: Shape (m, 3).
    """
    P, m, e = scaling(X, Z), problem.contacts, np.array([1.0, 0.0, 0.0])
    slip = radius(Z) if kept is None else kept
    F = Z - problem.w(X) - slip[:, None] * e
    of_slip = np.zeros((m, 3, 3))
    if kept is None:
        of_slip[:, 0, 1:] = Z[:, 1:] / radius(Z)[:, None]
    arrow = [np.array([[p[0], p[1], p[2]], [p[1], p[0], 0.0], [p[2], 0.0, p[0]]]) for p in P.point]  # arrow y = p o y
    J = np.block(
        [
            [scipy.linalg.block_diag(*(arrow @ P.P)), scipy.linalg.block_diag(*(arrow @ P.inverse))],
            [-problem.W.toarray(), scipy.linalg.block_diag(*(np.eye(3) - of_slip))],
        ]
    )
    d = np.linalg.solve(J, np.concatenate([right.ravel(), -F.ravel()]))
    return d[: 3 * m].reshape(m, 3), d[3 * m :].reshape(m, 3)


def expected(problem, at, kept, sigma):
    """Predictor and corrector (S. Mehrotra, SIAM J. Optim. 2, 1992): X, Z, sigma and the length of the step."""
    X, Z, e = at.X, at.Z, np.array([1.0, 0.0, 0.0])
    P = scaling(X, Z)
    square = product(P.point, P.point)
    dX, dZ = newton(problem, X, Z, kept, -square)
    if sigma is None:
        sigma = (1.0 - min(1.0, step_to_boundary(X, dX), step_to_boundary(Z, dZ))) ** 3
        sigma = max(sigma, 0.05 if kept is None else 1e-3)
    second = product(times(P.P, dX), times(P.inverse, dZ))
    dX, dZ = newton(problem, X, Z, kept, sigma * at.theta * e - square - second)
    alpha = min(1.0, 0.99 * min(step_to_boundary(X, dX), step_to_boundary(Z, dZ)))
    return X + alpha * dX, Z + alpha * dZ, sigma, alpha


def agrees(new, wanted):
    X, Z, sigma, alpha = wanted
    assert new.sigma == pytest.approx(sigma, rel=1e-6) and new.alpha == pytest.approx(alpha, rel=1e-6)
    assert np.allclose(new.X, X, rtol=1e-7, atol=1e-9) and np.allclose(new.Z, Z, rtol=1e-7, atol=1e-9)
    assert new.theta == pytest.approx(np.vdot(X, Z) / len(X), rel=1e-6)


def test_steps_solve_the_linearised_equations():
    problem = cones(random_rank(10, 25, 0.4, 3))
    X, Z, theta = inside(np.random.default_rng(1), 10)
    at = ConeStep(X, Z, theta, 1.0)
    for _ in range(3):
        new = ConePath(problem).step(at)
        agrees(new, expected(problem, at, None, None))
        at = new
    F = at.Z - problem.w(at.X) - radius(at.Z)[:, None] * np.array([1.0, 0.0, 0.0])
    assert at.infeasibility == pytest.approx(np.linalg.norm(F) / np.sqrt(10.0))


@pytest.mark.parametrize(("infeasibility", "centring"), [(1.0, 1.0), (0.29, 0.3), (0.31, 1.0)])
def test_after_a_blocked_step_the_slip_is_kept_for_three(infeasibility, centring):
    """theta then decreases by a factor, and only where F is smaller; infeasibility is given relative to theta."""
    problem = cones(random_rank(10, 25, 0.4, 3))
    X, Z, theta = inside(np.random.default_rng(1), 10)
    path = ConePath(problem)
    at = [ConeStep(X, Z, theta, infeasibility * theta, alpha=alpha) for alpha in (0.099, 1.0, 0.101)]
    kept, free = expected(problem, at[0], radius(Z), centring), expected(problem, at[0], None, None)
    for k in (0, 1, 1):  # blocked, and two more
        agrees(path.step(at[k]), kept)
    agrees(path.step(at[1]), free)
    agrees(path.step(at[2]), free)  # not blocked
    for k in (0, 1, 0, 0):  # blocked while the slip is kept: one more each time
        agrees(path.step(at[k]), kept)
    agrees(path.step(at[1]), free)


def test_steps_stay_near_the_centre():
    """sqrt(det X det Z) of every contact at least 0.01 theta; some steps would be longer without."""
    problem, rng, shorter = cones(walled(8, 0.8, 2)), np.random.default_rng(6), 0
    for _ in range(60):
        X, Z, theta = inside(rng, 8, 1.2)
        near = np.sqrt(np.min(determinant(X) * determinant(Z))) >= 0.012 * theta
        at = ConeStep(X, Z, theta, 1.0)
        if not near:
            continue
        new = ConePath(problem).step(at)
        assert np.sqrt(np.min(determinant(new.X) * determinant(new.Z))) >= 0.00999 * new.theta
        longest = expected(problem, at, None, None)[3]
        steps = np.log(new.alpha / longest) / np.log(0.8)
        assert steps == pytest.approx(round(steps), abs=1e-5) and steps > -1e-5
        shorter += steps > 0.5
        if steps > 0.5:  # the next longer one is too far from the centre
            X, Z = X + 1.25 * (new.X - X), Z + 1.25 * (new.Z - Z)
            assert np.sqrt(np.min(determinant(X) * determinant(Z))) < 0.01 * np.vdot(X, Z) / 8
    assert shorter


@pytest.mark.parametrize(
    "given",
    [
        stack(4, 0.7, 3),
        arch(5, 0.5, 1),
        walled(8, 0.8, 2),
        random_rank(10, 20, 0.4, 1),
        scattered(6, 20, 0.7, 2),
        spheres(6, 0.5, 1),
    ],
    ids=lambda given: given.title,
)
def test_ten_steps_are_enough(given):
    """To 1e-7: a path without second-order term, with constant centring or shorter steps takes 11 to 50."""
    problem = cones(given)
    path = ConePath(problem)
    at, steps = path.start(), 0
    while at.theta + at.infeasibility > 1e-7:
        at, steps = path.step(at), steps + 1
        assert steps <= 10
    assert problem.natural_map(at.X).size < 1e-3
