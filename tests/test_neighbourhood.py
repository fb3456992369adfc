"""How long a step may be: of PF and of the one loop, each condition by a step made to break that one alone."""

import numpy as np
import pytest
from conftest import dense_compliance, random_spd

from coulomb import FrictionProblem, OneLoop, PathFollowing
from coulomb.solvers.cone import ConeIterate, ScaledCoulomb
from coulomb.solvers.newton_systems import NewtonStep
from coulomb.solvers.one_loop import _Step
from coulomb.solvers.path_following import Iterate
from coulomb.solvers.scaling import ScaledQP

NODES, BETA, SIGMA = 5, 10.0, 0.1


def start(solver):
    """Of the scaled problem: equal pressure, no friction, multipliers with nu z = 1 everywhere, gradient 0."""
    rng = np.random.default_rng(3)
    A, b = dense_compliance(random_spd(3 * NODES, 10.0, rng)), rng.standard_normal(3 * NODES)
    zero = np.zeros((NODES, 3))
    if isinstance(solver, PathFollowing):
        problem = ScaledQP(FrictionProblem.tresca(A, b, np.ones(NODES)))
        x = zero + [1.0, 0.0, 0.0]
        z = problem.slack(x)
        return problem, Iterate(x, 1.0 / z, z, -problem.gradient(x, 1.0 / z, zero))
    scaled = ScaledCoulomb(FrictionProblem.coulomb(A, b, np.full(NODES, 0.5)))
    v = ConeIterate(np.ones(NODES), zero[:, 1:], np.zeros((NODES, 2)), zero)
    v = v._replace(nu=1.0 / scaled.slack(v.x_n, v.y))
    return scaled, v._replace(A_x=-scaled.gradient(v))


def length(solver, dnu, A_dx=0.0):
    """Of a step that leaves the forces, changes nu by dnu nu (m, 2), and the gradient's rms by A_dx."""
    problem, v = start(solver)
    dnu, rows = dnu * v.nu, np.zeros((NODES, 3))
    A_dx = rows + [A_dx * np.sqrt(3.0), 0.0, 0.0]  # normal rows: they have the weight 1
    if isinstance(solver, PathFollowing):
        return solver._step_length(problem, v, NewtonStep(rows, dnu, A_dx, 1), BETA, 1.0, SIGMA)
    step = _Step(v, rows[:, 0], rows[:, 1:], dnu, A_dx, rows, 1)
    return solver._step_length(problem, step, BETA)


def longest(allowed):
    """The largest of 1, 0.9, 0.81, ... that is allowed."""
    return next(alpha for alpha in 0.9 ** np.arange(100) if allowed(alpha))


@pytest.fixture(params=[PathFollowing, OneLoop], ids=["PF", "one loop"])
def solver(request):
    return request.param(gamma=0.2)


def test_a_good_step_is_taken_whole(solver):
    alpha, new = length(solver, -0.9 * np.ones((NODES, 2)))
    assert alpha == 1.0 and new is not None


def test_the_gradient_stays_below_beta_theta(solver):
    """|gradient| = alpha beta/2 beside theta = 1 - 0.9 alpha."""
    _, v = start(solver)  # of the change of the gradient, the normal multipliers have a part
    alpha, _ = length(solver, -0.9 * np.ones((NODES, 2)), -0.9 * v.nu[0, 0] / np.sqrt(3.0) + 0.5 * BETA)
    assert alpha == pytest.approx(longest(lambda alpha: 0.5 * alpha <= 1.0 - 0.9 * alpha))


def test_products_stay_near_their_mean(solver):
    """One nu z falls by 0.95, the others by half: below gamma = 0.2 of the mean at the end."""
    dnu = -0.5 * np.ones((NODES, 2))
    dnu[0, 0] = -0.95
    alpha, _ = length(solver, dnu)
    mean = dnu.mean()
    assert alpha == pytest.approx(longest(lambda alpha: 1.0 - 0.95 * alpha >= 0.2 * (1.0 + mean * alpha)))
    assert alpha < 1.0


def test_theta_decreases():
    """Asked of PF by its theory; the one loop never took a step on which theta grew."""
    alpha, new = length(PathFollowing(gamma=0.2), 0.05 * np.ones((NODES, 2)))
    assert new is None and alpha < 1e-9


def test_theta_waits_for_the_gradient():
    """sigma of the one loop: (1 - alpha)^2 within [0.1, 0.5], or three times the part of beta theta that is taken."""
    solver = OneLoop()
    for alpha, used, sigma in ((1.0, 0.0, 0.1), (0.5, 0.0, 0.25), (0.1, 0.1, 0.5), (1.0, 0.2, 0.6), (0.5, 0.5, 0.9)):
        assert solver._centring(alpha, used) == pytest.approx(sigma)


def test_a_warm_start_is_on_the_central_path_of_its_projection():
    """D (x - q) balances the multipliers at every node, and nu z = theta: q far outside, near the edge, and inside."""
    rng = np.random.default_rng(6)
    A, g = dense_compliance(random_spd(60, 10.0, rng)), 10.0 ** rng.uniform(-2, 1, 20)
    g[3] = 0.0
    problem = ScaledQP(FrictionProblem.tresca(A, rng.standard_normal(60), g))
    q = rng.standard_normal((20, 3)) * 10.0 ** rng.uniform(-2, 1, (20, 1))
    for theta in (1.0, 1e-4, 1e-9):
        x, nu = problem.smoothed_projection(q, theta)
        z, d, f = problem.slack(x), problem._isotropic, problem.frictional
        assert np.all(z[:, 0] > 0.0) and np.all(z[f, 1] > 0.0) and not x[~f, 1:].any()
        assert np.allclose(nu[:, 0] * z[:, 0], theta, rtol=1e-6) and np.allclose((nu * z)[f, 1], theta, rtol=1e-6)
        assert np.allclose(d[:, 0] * (x - q)[:, 0], nu[:, 0], rtol=1e-6, atol=1e-9)
        friction = (nu[:, 1] / problem._g)[:, None] * x[:, 1:]
        assert np.allclose((d[:, 1:] * (x - q)[:, 1:])[f], -friction[f], rtol=1e-4, atol=1e-6)
