"""Orthotropic friction in large motions: axes and coefficients by place belong to the face, and turn with it."""

import numpy as np
import pytest

import coulomb
from coulomb.kinematics import NeoHookean

ALONG, ACROSS, PRESSED, DRAWN = 0.1, 0.5, 4e-5, 0.01
"""Coefficients along the direction and across it; by how much the block is pressed, and its way along x, metres."""

MIDDLE = (0.02, 0.02, 0.04)
"""Of the upper face of the block, about which it is turned."""


def drawn(angle, deformable, friction=(ALONG, ACROSS), direction=(1.0, 0.0, 0.0)):
    """The contact of a block on a plate that is rigid, or deformable, at the end: it is pressed until time 1, all is
    turned about z by an angle until time 2, and the block is drawn along x until time 3."""
    down, turned, on = [(0.0, 0.0), (1.0, 1.0)], [(1.0, 0.0), (2.0, angle)], [(2.0, 0.0), (3.0, DRAWN)]
    block = coulomb.moved(coulomb.box((0.04, 0.04, 0.02), (2, 1, 1)), (0.0, 0.0, 0.02))
    jaw = coulomb.RigidFace(
        "block:top", MIDDLE, (1.0, 0.0, -PRESSED), (0.0, 0.0, 1.0), amplitudes=[on, 0.0, down, 0.0, 0.0, turned]
    )
    plate = coulomb.moved(coulomb.box((0.12, 0.12, 0.02), (3, 3, 1)), (-0.04, -0.04, 0.0))
    table = coulomb.RigidFace("plate:bottom", (0.02, 0.02, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, angle), [(1, 0), (2, 1)])
    floor = (
        {"against": "plate:top", "slave": True}
        if deformable
        else {"foundation": coulomb.Plane((0, 0, 0.02), (0, 0, 1))}
    )
    problem = coulomb.ContactProblem(
        coulomb.join(block=block, plate=plate),
        NeoHookean(1e9, 0.3),
        [],
        coulomb.Contact("block:bottom", friction, direction=direction, **floor),
        rigid_faces=[jaw, table],
        kinematics="large",
    )
    *_, last = coulomb.LoadHistory([1.0, 1.5, 2.0, 3.0]).steps(problem)
    assert last.solution.valid
    return last.solution


@pytest.mark.parametrize("deformable", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.5 * np.pi])
def test_axes_turn_with_the_face(angle, deformable):
    along, across, pressed = drawn(angle, deformable).at_nodes.totals()["force"]
    assert abs(along / pressed) == pytest.approx(ACROSS if angle else ALONG, rel=2e-3)
    assert abs(across) < 1e-3 * abs(pressed)


@pytest.mark.parametrize("deformable", [False, True])
def test_coefficients_by_place_are_of_the_place_before_deformation(deformable):
    found = drawn(0.5 * np.pi, deformable, (ALONG, lambda x: 0.3 + 2.0 * x[0] + 3.0 * x[1])).at_nodes
    x, y = MIDDLE[0] + found.x[:, 1] - MIDDLE[1], MIDDLE[1] + MIDDLE[0] + DRAWN - found.x[:, 0]  # turned back
    friction = np.linalg.norm(found.friction_traction, axis=1)
    assert friction == pytest.approx(found.pressure * (0.3 + 2.0 * x + 3.0 * y), rel=1e-3)
