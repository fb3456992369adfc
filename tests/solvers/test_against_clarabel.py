"""Tresca problems against a general conic solver (Clarabel), by residual, objective and answer."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import dense_compliance, objective, random_spd
from shared_problems import by_clarabel

from coulomb import InteriorPoint
from coulomb.solvers import KPRGP, FrictionProblem


def problem(nodes, condition, normal, bound, seed):
    """b with normal parts of a kind, slip bounds as a multiple of what sticking would take."""
    rng = np.random.default_rng(seed)
    A = 1e-9 * random_spd(3 * nodes, condition, rng)
    b = 1e-4 * rng.standard_normal(3 * nodes)
    b[0::3] = (
        {"open": -10.0, "closed": 10.0, "mixed": 1.0}[normal]
        * np.abs(b[0::3])
        * (rng.choice([-1, 1], nodes) if normal == "mixed" else 1.0)
    )
    return A, b, bound * np.abs(b).mean() / np.diag(A).mean() * rng.uniform(0.5, 1.5, nodes)


CASES = {
    "many contacts": problem(100, 1e3, "mixed", 0.5, 101),
    "condition 1e6": problem(30, 1e6, "mixed", 0.5, 102),
    "condition 1e8": problem(30, 1e8, "mixed", 0.5, 103),
    "all open": problem(30, 10.0, "open", 0.5, 104),
    "all stick": problem(30, 10.0, "mixed", 1e3, 105),
    "all slip": problem(30, 10.0, "closed", 1e-3, 106),
    "one node": problem(1, 10.0, "closed", 0.5, 107),
}


# KPRGP's products grow with the condition of A: thousands of steps at 1e6, millions at 1e8.
SOLVED = [pytest.param(InteriorPoint(tolerance=1e-10), name, id=f"PF-{name}") for name in CASES]
SOLVED += [
    pytest.param(KPRGP(tolerance=1e-7), name, id=f"KPRGP-{name}") for name in CASES if not name.startswith("condition")
]


@pytest.mark.parametrize(("solver", "name"), SOLVED)
def test_agrees_with_clarabel(solver, name):
    A, b, g = CASES[name]
    qp = FrictionProblem.tresca(dense_compliance(A), b, g)
    result, theirs = solver.solve(qp), by_clarabel(A, b, g, np.zeros(len(g)))
    assert result.residual <= solver.tolerance
    assert objective(qp, result.x) <= objective(qp, theirs) + 1e-9 * abs(objective(qp, theirs))
    assert objective(qp, result.x) == pytest.approx(objective(qp, theirs), rel=1e-7)
    # a feasible point's distance from the solution, in energy, is at most what its objective is above the minimum
    difference, above = result.x - theirs, objective(qp, theirs) - objective(qp, result.x)
    assert 0.5 * difference @ A @ difference <= max(above, 0.0) + 1e-9 * abs(objective(qp, theirs))
    x = result.x.reshape(-1, 3)
    use = np.hypot(x[:, 1], x[:, 2]) / g
    is_so = {
        "all open": x[:, 0].max() <= 1e-6 * np.abs(x).max(),
        "all stick": use.max() < 0.9,
        "all slip": use.min() > 0.999,
    }
    assert is_so.get(name, True)
    if np.linalg.cond(A) < 1e5:
        assert np.linalg.norm(difference) <= 1e-4 * np.linalg.norm(theirs)


def test_zero_bounds_and_lower_bounds():
    A, b, g = CASES["many contacts"]
    g, lower = np.where(np.arange(100) % 5, g, 0.0), np.linspace(-1.0, 1.0, 100) * g.mean()
    qp = replace(FrictionProblem.tresca(dense_compliance(A), b, g), lower=lower)
    theirs = by_clarabel(A, b, g, lower)
    ours, other = (solver.solve(qp) for solver in (InteriorPoint(tolerance=1e-9), KPRGP(tolerance=1e-7)))
    for result in (ours, other):
        assert np.linalg.norm(result.x - theirs) <= 1e-5 * np.linalg.norm(theirs)
        assert not result.x.reshape(-1, 3)[::5, 1:].any()
    assert np.allclose(ours.multipliers, other.multipliers, atol=1e-5 * np.abs(ours.multipliers).max())
