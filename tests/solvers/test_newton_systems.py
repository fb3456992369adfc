"""The Newton systems against dense algebra."""

from fractions import Fraction

import numpy as np
import pytest
from conftest import dense_compliance, random_spd

from coulomb.solvers import AugmentedSystem, DenseSystem, SchurComplementSystem
from coulomb.solvers.linearization import Linearization
from coulomb.solvers.newton_systems import NewtonEquations, augmented_matrix
from coulomb.solvers.scaled_problem import ScaledCompliance

NODES = 9
ONE = np.ones((NODES, 3))
ZERO_ONE = np.zeros(NODES), np.ones(NODES)  # no slope, and unit discs


@pytest.fixture
def system():
    """A random system with a node that has no disc: A, the linearisation, right-hand sides."""
    rng = np.random.default_rng(31)
    A = random_spd(3 * NODES, 1e3, rng)
    angle, radius = rng.uniform(0.0, 6.28, NODES), rng.uniform(0.0, 0.999, NODES)
    y = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    h, D22 = 10.0 ** rng.uniform(-6, 1, NODES), 10.0 ** rng.uniform(-8, 8, (NODES, 2))
    frictional = np.ones(NODES, dtype=bool)
    frictional[4] = False
    y[4], h[4], D22[4, 1] = 0.0, 0.0, 1.0
    r1, r2 = rng.standard_normal((NODES, 3)), rng.standard_normal((NODES, 2)) * np.minimum(D22, 1.0)
    r1[4, 1:], r2[4, 1] = 0.0, 0.0
    return A, Linearization(*ZERO_ONE, h, y, D22, frictional), r1, r2


def dense_blocks(A, at):
    """J11, J12, D22 as matrices; the tangential pair of a node without a disc replaced by the identity."""
    J11 = A + np.diag(np.column_stack([np.zeros(NODES), at.h, at.h]).ravel())
    for node in np.flatnonzero(~at.frictional):
        pair = [3 * node + 1, 3 * node + 2]
        J11[pair], J11[:, pair] = 0.0, 0.0
        J11[pair, pair] = 1.0
    J12 = np.zeros((3 * NODES, 2 * NODES))
    for i in range(NODES):
        J12[3 * i, 2 * i] = -1.0
        J12[3 * i + 1 : 3 * i + 3, 2 * i + 1] = at.y[i]
    return J11, J12, np.diag(at.D22.ravel())


def make(kind, A):
    scaled = ScaledCompliance(dense_compliance(A), np.ones((NODES, 3)), 1.0, 1.0)
    return kind.system(scaled, False), scaled.A


@pytest.mark.parametrize("kind", [AugmentedSystem(rank=0), SchurComplementSystem(rank=0), DenseSystem()])
def test_solves_the_newton_system(kind, system):
    A, at, r1, r2 = system
    J11, J12, D22 = dense_blocks(A, at)
    J = np.block([[J11, J12], [J12.T, -D22]])
    assert np.array_equal(augmented_matrix(A, at), J)
    exact = np.linalg.solve(J, np.concatenate([r1.ravel(), r2.ravel()]))
    newton, compliance = make(kind, A)
    step = newton.solve(NewtonEquations(at, r1, r2, ONE, 1e-13, np.inf))
    newton.destroy()
    dx, dnu = exact[: 3 * NODES].reshape(-1, 3), exact[3 * NODES :].reshape(-1, 2)
    assert np.allclose(step.dx, dx, rtol=1e-8, atol=1e-10 * np.abs(dx).max())
    assert np.allclose(step.dnu, dnu, rtol=1e-6, atol=1e-9 * np.abs(dnu).max())
    assert compliance.products == step.iterations  # one product an iteration, and none for A dx
    assert np.allclose(step.A_dx.ravel(), A @ step.dx.ravel(), rtol=1e-10, atol=1e-12)


def test_both_systems_make_the_same_iterates(system):
    """CG on J_AM from the projected start is CG on J_SC, step by step."""
    A, at, r1, r2 = system
    for tolerance in (0.3, 1e-2, 1e-4, 1e-8):
        steps = []
        for kind in (AugmentedSystem(rank=0), SchurComplementSystem(rank=0)):
            newton, _ = make(kind, A)
            steps.append(newton.solve(NewtonEquations(at, r1, r2, ONE, tolerance, np.inf)))
            newton.destroy()
        am, sc = steps
        assert am.iterations == sc.iterations
        assert np.abs(am.dx - sc.dx).max() <= 1e-6 * np.abs(sc.dx).max()


def test_preconditioners_are_the_papers(system):
    """P_AM = [D11 J12; J21 -D22] and P_SC = D11 + J12 D22^-1 J21, inverted exactly, node by node."""
    A, at, r1, r2 = system
    J11, J12, D22 = dense_blocks(np.diag(np.diag(A)), at)
    rng = np.random.default_rng(3)
    r1, r2 = rng.standard_normal((NODES, 3)), rng.standard_normal((NODES, 2))
    r1[4, 1:], r2[4, 1] = 0.0, 0.0

    newton, _ = make(AugmentedSystem(rank=0), A)
    newton.solve(NewtonEquations(at, r1, r2, ONE, 0.5, np.inf))
    z = newton._preconditioner(np.hstack([r1, r2]))
    exact = np.linalg.solve(np.block([[J11, J12], [J12.T, -D22]]), np.concatenate([r1.ravel(), r2.ravel()]))
    assert np.allclose(z[:, :3].ravel(), exact[: 3 * NODES], rtol=1e-9, atol=1e-12)
    assert np.allclose(z[:, 3:].ravel(), exact[3 * NODES :], rtol=1e-9, atol=1e-9 * np.abs(exact).max())

    newton, _ = make(SchurComplementSystem(rank=0), A)
    newton.solve(NewtonEquations(at, r1, r2, ONE, 0.5, np.inf))
    exact = np.linalg.solve(J11 + J12 @ np.linalg.solve(D22, J12.T), r1.ravel())
    assert np.allclose(newton._preconditioner(r1).ravel(), exact, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", [AugmentedSystem(rank=0), SchurComplementSystem(rank=0)])
def test_preconditioners_do_not_cancel(kind):
    """Active constraints have D22 -> 0: the remaining dx is then small, and must be accurate in all digits."""
    rng = np.random.default_rng(32)
    A = random_spd(3 * NODES, 10.0, rng)
    y = rng.standard_normal((NODES, 2))
    y *= 0.9999999 / np.linalg.norm(y, axis=1)[:, None]
    at = Linearization(*ZERO_ONE, np.full(NODES, 0.3), y, np.full((NODES, 2), 1e-14), np.ones(NODES, dtype=bool))
    newton, _ = make(kind, A)
    newton.solve(NewtonEquations(at, np.ones((NODES, 3)), np.zeros((NODES, 2)), ONE, 0.5, np.inf))
    r = rng.standard_normal((NODES, 3))
    z = newton._preconditioner(np.hstack([r, np.zeros((NODES, newton._block - 3))]))[:, :3]
    newton.destroy()
    for i in range(NODES):  # the same in exact arithmetic
        d = [Fraction(v) for v in (np.diag(A).reshape(-1, 3)[i] + [0.0, 0.3, 0.3])]
        (y1, y2), (rn, r1, r2), e = map(Fraction, y[i]), map(Fraction, r[i]), Fraction(1e-14)
        a, b, c = d[1] + y1 * y1 / e, y1 * y2 / e, d[2] + y2 * y2 / e
        exact = [rn / (d[0] + 1 / e), (c * r1 - b * r2) / (a * c - b * b), (a * r2 - b * r1) / (a * c - b * b)]
        assert z[i, 0] == pytest.approx(float(exact[0]), rel=1e-12)
        along = float(y1 * exact[1] + y2 * exact[2])  # the part against the active disc
        assert np.allclose(z[i, 1:], [float(v) for v in exact[1:]], rtol=1e-11, atol=1e-12 * np.abs(z[i, 1:]).max())
        assert abs(along) < 1e-12
