"""A cold start that knows the free gaps: forces near the central path of the problem without friction."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import STEEL, make_block, random_tresca
from floating_blocks import FloatingBlock, floating_problem

import coulomb
from coulomb import InteriorPoint
from coulomb.solvers.frictionless_start import _Frictionless, frictionless_start
from coulomb.solvers.newton_systems import SchurComplementSystem
from coulomb.solvers.scaled_problem import ScaledProblem

EVEN = InteriorPoint(start_products=0, starts=(0.1, 1e3, 1e6))
"""Equal pressure on all nodes, as cold starts were before."""


@pytest.fixture(scope="module")
def lifted():
    """A thin plate clamped at one end, pressed down near it and lifted beyond: most of its sole opens."""

    def traction(x):
        return np.stack([np.full(x.shape[1], 2e4), np.zeros(x.shape[1]), np.where(x[0] < 0.5, -2e6, 4e4 * x[0])])

    return coulomb.ContactProblem(
        coulomb.box((3.0, 1.0, 0.1), (24, 8, 1), cell="tetrahedron"),
        STEEL,
        clamps=[coulomb.Clamp("left")],
        tractions=[coulomb.Traction("top", traction)],
        contact=coulomb.Contact("bottom", 0.3),
    ).friction_problem


def started(problem, most=12):
    scaled = ScaledProblem(problem)
    newton = SchurComplementSystem().system(scaled.A, scaled.sloped)
    v = frictionless_start(scaled, newton, most, 0.03)
    newton.destroy()
    return scaled, v


def test_a_plate_that_lifts(lifted):
    """Half the steps of a start from equal pressure, fewer products, and the same forces."""
    result, even = InteriorPoint().solve(lifted), EVEN.solve(lifted)
    assert np.mean(result.x[0::3] <= 1e-6 * result.x.max()) > 0.7
    assert np.linalg.norm(result.x - even.x) <= 1e-6 * np.linalg.norm(even.x)
    assert result.newton_steps <= 20 and result.newton_steps <= 0.6 * even.newton_steps
    assert result.products < even.products


def test_the_iteration_ends_on_the_central_path(lifted):
    """w_n (x_n - lower) = theta at every node, also with lower bounds that are not zero; theta as it is defined."""
    qp, _ = random_tresca(20, seed=31)
    for problem in (lifted, replace(qp, lower=np.linspace(-1e5, 1e5, 20))):
        scaled = ScaledProblem(problem)
        normal = _Frictionless(scaled, 0.0)
        for _ in range(60):
            normal.improve()
        x = np.zeros((scaled.nodes, 3))
        x[:, 0] = normal.x
        w = scaled.A.mult(x) - scaled.free
        assert normal.x.min() > scaled.lower.min()
        assert w[:, 0] * (normal.x - scaled.lower) == pytest.approx(np.full(scaled.nodes, normal.theta), rel=1e-3)
        above = normal.x - scaled.lower
        carrying = above.sum() ** 2 / (above @ above)
        if problem is lifted:
            assert normal.theta == pytest.approx(3e-3 * (normal.x @ scaled.A.mult(x)[:, 0]) / carrying, rel=1e-2)


def test_an_iterate_to_start_from(lifted):
    """Strictly inside, all products of multipliers and slacks alike, friction against the slip, few products."""
    before = lifted.A.products
    scaled, v = started(lifted)
    assert lifted.A.products - before <= 12 + 4
    z = scaled.slack(v.x_n, v.y)
    assert v.x_n.min() > 0.0 and np.linalg.norm(v.y, axis=1).max() < 1.0
    assert v.nu * z == pytest.approx(np.full(z.shape, scaled.theta(v.nu, z)))
    without = np.column_stack([v.x_n, np.zeros((scaled.nodes, 2))])
    slip = (scaled.A.mult(without) - scaled.free)[:, 1:]
    assert np.all(np.sum(v.y * slip, axis=1) <= 0.0) and np.abs(v.y).max() > 0.1
    assert v.A_x == pytest.approx(scaled.A.mult(scaled.forces(v.x_n, v.y)))


@pytest.mark.parametrize("law", [0.1, 0.8, 1.5, "tresca"])
def test_no_step_more_on_the_block(law):
    options = {"slip_stress": 1e7} if law == "tresca" else {"friction": law}
    problem = make_block(6, **options).friction_problem
    assert InteriorPoint().solve(problem).newton_steps <= EVEN.solve(problem).newton_steps


def test_bodies_that_only_contact_holds():
    """Equal pressure where that closes all gaps nearly; otherwise the free motion, from wherever the bodies are."""
    even = floating_problem(FloatingBlock(), 0.87)
    _, v = started(even)
    assert np.all(v.x_n == 1.0) and not v.y.any()
    b = even.b.copy()
    b[0::3] -= 2e2 * np.abs(b).max() * (np.arange(len(b) // 3) % 2)
    gaps = replace(even, b=b)
    high = replace(gaps, b=gaps.b - 1e3 * np.abs(b).max() * np.tile([1.0, 0.0, 0.0], len(b) // 3))
    results = [InteriorPoint().solve(problem) for problem in (gaps, high)]
    assert np.linalg.norm(results[1].x - results[0].x) <= 1e-6 * np.linalg.norm(results[0].x)
    assert abs(results[1].newton_steps - results[0].newton_steps) <= 2
    assert np.ptp(started(gaps)[1].x_n) > 0.1
