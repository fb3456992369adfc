"""Orthotropic friction: sliding directions and forces against the ellipse, curved faces, files, wrong inputs."""

import math

import numpy as np
import pytest

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory, Material, PrescribedDisplacement, Spring

F1, F2 = 0.3, 0.1
STEEL = Material(2.1e11, 0.3)
TIMES = [1.0, 2.0, 3.0, 6.0, 10.0, 11.0]
PRESSED = PrescribedDisplacement("top", (0.0, 0.0, -2e-4), "z", amplitude=[(0, 0), (1, 1)])


def unit(degrees):
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


def force_for_slip(slip, N, direction=0.0):
    """T on a body that slides along `slip`, by the associated rule: where the ellipse's outward normal is -slip."""
    turn = np.column_stack([unit(direction), unit(direction + 90.0)])
    along = turn.T @ slip
    scaled = np.array([F1**2, F2**2]) * along * N
    return -turn @ scaled / math.sqrt(F1**2 * along[0] ** 2 + F2**2 * along[1] ** 2)


def drawn(angle, cell="hexahedron", direction=(1.0, 0.0, 0.0), amplitude=1.0, **options):
    """A cube pressed on its foundation and drawn along an angle, until all of it slides by 5 mm a step."""
    way = PrescribedDisplacement("top", (*unit(angle), 0.0), "xy", amplitude=[(1, 0), (2, 1e-3), (11, 46e-3)])
    return ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (3, 3, 3), cell),
        STEEL,
        [PRESSED, way],
        Contact("bottom", (F1, F2), direction=direction, friction_amplitude=amplitude),
        **options,
    )


def sliding(problem):
    steps = list(LoadHistory(TIMES, tolerance=1e-11).steps(problem))
    assert all(step.solution.certificate.passed for step in steps), steps[-1].solution.certificate
    return steps


@pytest.mark.parametrize(
    ("cell", "direction", "angle"),
    [("hexahedron", 0.0, 20.0), ("hexahedron", 0.0, 90.0), ("tetrahedron", 30.0, 0.0), ("tetrahedron", 30.0, 70.0)],
)
def test_block_drawn_along_an_angle(cell, direction, angle):
    """T is the point of the ellipse whose normal is opposite to the given slip; |T| s is dissipated."""
    *_, before, last = sliding(drawn(angle, cell, (*unit(direction), 0.0)))
    total = last.solution.at_nodes.totals()
    expected = force_for_slip(unit(angle), total["normal_force"], direction)
    assert total["force"][:2] == pytest.approx(expected, abs=1e-7 * np.linalg.norm(expected))
    work = -expected @ unit(angle) * 5e-3
    assert last.state.energy.dissipated - before.state.energy.dissipated == pytest.approx(work, rel=1e-7)
    assert last.state.energy.prescribed - before.state.energy.prescribed == pytest.approx(work, rel=1e-7)
    fields = last.solution.at_nodes.fields()
    slip = fields["slip"][:, :2] / 5e-3
    assert np.allclose(slip, unit(angle), rtol=0.0, atol=1e-7) and np.allclose(fields["friction_use"], 1.0, atol=1e-9)
    sums = fields["friction_traction"] * fields["area"][:, None]
    assert sums.sum(axis=0) == pytest.approx([*total["force"][:2], 0.0], rel=1e-9, abs=1e-3)


@pytest.mark.parametrize(("cell", "angle"), [("hexahedron", 45.0), ("tetrahedron", 70.0)])
def test_amplitude_scales_the_ellipse(cell, angle):
    """T of a node is on the ellipse of A(t) F1, A(t) F2; where A is constant, the total is A times the known force."""
    steps = sliding(drawn(angle, cell, (*unit(30.0), 0.0), amplitude=[(2, 1.0), (4, 0.25)]))
    axes = np.column_stack([[*unit(30.0), 0.0], [*unit(120.0), 0.0]])
    for step, factor in zip(steps[2:], [0.625, 0.25, 0.25, 0.25], strict=True):
        fields = step.solution.at_nodes.fields()
        T, N = fields["contact_force"] @ axes, fields["contact_force"][:, 2]
        assert np.hypot(T[:, 0] / F1, T[:, 1] / F2) == pytest.approx(factor * N, abs=1e-8 * N.max())
    total = steps[-1].solution.at_nodes.totals()
    expected = 0.25 * force_for_slip(unit(angle), total["normal_force"], 30.0)
    assert total["force"][:2] == pytest.approx(expected, abs=1e-7 * np.linalg.norm(expected))


@pytest.mark.parametrize("angle", [0.0, 20.0, 70.0])
def test_direction_of_sliding_of_a_pulled_block(angle):
    """The pull is along x and `direction` turned from it: slip_2/slip_1 = (F1/F2)^2 T2/T1, by the associated rule.

    The top is free along y but for springs so soft that they carry less than a thousandth of the pull.
    """
    pull = PrescribedDisplacement("top", (1.0, 0.0, 0.0), "x", amplitude=[(1, 0), (2, 1e-3), (11, 46e-3)])
    problem = ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (3, 3, 3)),
        STEEL,
        [PRESSED, pull],
        Contact("bottom", (F1, F2), direction=(*unit(-angle), 0.0)),
        springs=[Spring("left", (0.0, 1e5, 0.0))],
    )
    *_, last = sliding(problem)
    axes = np.column_stack([unit(-angle), unit(90.0 - angle)])
    T = axes.T @ last.solution.at_nodes.totals()["force"][:2]
    N = last.solution.at_nodes.totals()["normal_force"]
    assert T == pytest.approx(-np.linalg.norm(T) * unit(angle), abs=1e-3 * np.linalg.norm(T))  # against the pull
    assert math.hypot(T[0] / F1, T[1] / F2) == pytest.approx(N, rel=1e-8)  # on the ellipse
    slip = last.solution.at_nodes.fields()["slip"][:, :2] @ axes
    normal = -T / np.array([F1, F2]) ** 2
    assert np.allclose(slip / np.linalg.norm(slip, axis=1)[:, None], normal / np.linalg.norm(normal), atol=1e-6)
    if 0.0 < angle < 90.0:
        assert slip[0, 1] / slip[0, 0] == pytest.approx(9.0 * math.tan(math.radians(angle)), rel=5e-3)
