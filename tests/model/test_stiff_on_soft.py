"""Forces of steel on rubber that cancel in a facet of the rubber, which the residual by diag(A) hardly feels."""

from dataclasses import replace

import numpy as np
import pytest

from coulomb import Clamp, Contact, ContactProblem, Material, NotConverged, TotalForce, box, join, moved
from coulomb.solvers import automatic

STEEL, RUBBER = Material(2e11, 0.3), Material(4.6e6, 0.4)


def stack():
    """Steel, rubber, and steel with smaller facets; pressed and pulled at the top."""
    blocks = {
        "base": box((0.1, 0.08, 0.1), (3, 2, 2)),
        "pad": moved(box((0.1, 0.08, 0.1), (2, 3, 2)), translate=(0.0, 0.0, 0.1)),
        "top": moved(box((0.07, 0.07, 0.1), (4, 4, 3), "tetrahedron"), translate=(0.015, 0.005, 0.2)),
    }
    contacts = [Contact("pad:bottom", 0.4, against="base:top"), Contact("top:bottom", 0.3, against="pad:top")]
    return ContactProblem(
        join(**blocks),
        {"base": STEEL, "pad": RUBBER, "top": STEEL},
        [Clamp("base:bottom")],
        contacts,
        [TotalForce("top:top", (-110.0, -33.0, -1030.0))],
        small_strain="warn",
    )


def test_every_force_is_right_to_a_millionth_of_the_largest(monkeypatch):
    problem = stack()
    answer, exact = problem.solve(), problem.solve(tolerance=1e-12).result.x

    def error(found):
        parts = [np.flatnonzero(problem.surface.part == k)[:, None] * 3 + np.arange(3) for k in (0, 1)]
        return max(np.abs(found.result.x - exact)[part].max() / np.abs(exact[part]).max() for part in parts)

    assert answer.valid and error(answer) < 1e-7
    monkeypatch.setattr(automatic, "_SETTLED", np.inf)
    before = problem.solve()
    known = before.certificate["resolution"]  # by the residual alone: not green
    assert (
        before.valid and 1e-6 < error(before) < 2.0 * known.value < 20.0 * error(before) and known.mark == "unresolved"
    )
    assert answer.certificate["resolution"].mark == "ok"


def test_steps_that_settle_solve_for_what_the_residual_hardly_feels():
    """A step that the residual ends, 1e-10 here, changes forces by 1.5e-9 and leaves 5e-6 of them."""
    felt = moved(box((0.1, 0.1, 0.03), (3, 3, 2), "tetrahedron"), translate=(0.0, 0.0, 0.05))
    carbide = moved(box((0.06, 0.06, 0.04), (5, 5, 2)), translate=(0.02, 0.02, 0.08))
    problem = ContactProblem(
        join(steel=box((0.1, 0.1, 0.05), (2, 2, 2)), felt=felt, carbide=carbide),
        {"steel": STEEL, "felt": Material(5e5, 0.1), "carbide": Material(6e11, 0.22)},
        [Clamp("steel:bottom")],
        [Contact("felt:bottom", 0.4, against="steel:top"), Contact("carbide:bottom", 0.25, against="felt:top")],
        [TotalForce("carbide:top", (4.0, 2.0, -30.0))],
        small_strain="warn",
    )
    answer, exact = (problem.solve(tolerance=tolerance) for tolerance in (1e-8, 1e-12))
    error = np.abs(answer.contact_force - exact.contact_force)[3 * np.flatnonzero(problem.surface.part == 1)].max()
    assert answer.valid and answer.result.unsettled < 1e-6 and error < 1e-7 * np.abs(exact.contact_force).max()


def test_forces_that_steps_do_not_settle_are_unresolved(monkeypatch):
    """Unless rounding errors explain it, or it is no more than 1e-4: the certificate says how much."""
    problem, settled = stack(), automatic.settled
    with monkeypatch.context() as patched:
        patched.setattr(automatic, "_SETTLED", np.inf)
        result = problem.solve().result
    posed, stiffness = problem.friction_problem, problem.linear.node_stiffness
    assert settled(posed, result, stiffness, 1e-8).newton_steps > result.newton_steps
    assert settled(posed, result, np.zeros_like(stiffness), 1e-8) is result
    monkeypatch.setattr(automatic, "_SETTLING", replace(automatic._SETTLING, max_iterations=1))
    assert 1e-6 < settled(posed, result, stiffness, 1e-8).unsettled < 1e-4
    with monkeypatch.context() as patched:
        patched.setattr(automatic, "_ACCEPTED", 1.0)
        with pytest.raises(NotConverged, match=r"forces are unresolved: .* wrong by about [1-9]\.\de-0[56] of the"):
            settled(posed, result, stiffness, 1e-8)
    monkeypatch.setattr(automatic, "_UNSETTLED", np.inf)
    assert settled(posed, result, stiffness, 1e-8).x is result.x
