"""Slip from the touch: rubber rolls on a plane by a few long load steps as by many short ones."""

import numpy as np
import pytest
from rubber_blocks import RubberBlock

import coulomb
from coulomb.kinematics import LargeMotions

OUTER, THICK, SPAN, DEPTH, ROLLING = 1.0, 0.4, np.radians(120.0), 0.03, 0.98
TURN = np.radians(30.0)


def rolled(steps):
    """Friction over normal force, and energy dissipated, of a sector on a rigid hub, rolled by its hub."""

    def sector(x):
        angle, r = (x[:, 0] - 0.55) * SPAN, OUTER - x[:, 2]
        return np.column_stack([r * np.sin(angle), x[:, 1], -r * np.cos(angle)])

    def way(time, x):
        angle = TURN * max(time - 1.0, 0.0)
        c, s = np.cos(angle), np.sin(angle)
        across, down = c * x[0] + s * x[2] - x[0] + ROLLING * angle, c * x[2] - s * x[0] - x[2]
        return np.array([across, 0.0 * x[1], down - DEPTH * min(time, 1.0)])

    ring = RubberBlock(
        way, (24, 1, 2), (1.0, 0.2, THICK), shape=sector, also=[("front", 1), ("back", 1)], components=(0, 1, 2)
    )
    ground = coulomb.Contact("bottom", friction=0.3, foundation=coulomb.Plane((0.0, 0.0, -OUTER), (0.0, 0.0, 1.0)))
    *_, last = coulomb.LoadHistory([1.0, *np.linspace(1.0, 2.0, steps + 1)[1:]]).steps(LargeMotions(ring.body, ground))
    assert last.solution.valid
    force = last.solution.at_nodes.totals()["force"]
    return force[0] / force[2], last.state.energy.dissipated


def test_friction_of_rolling_does_not_depend_on_how_far_the_tread_flies_in_a_step():
    """6 steps of 5 degrees against 12: 31 % apart where the way in the air counts as slip."""
    (few, _), (many, _) = rolled(6), rolled(12)
    assert few == pytest.approx(many, rel=0.15)


@pytest.mark.parametrize("share", [0.5, 0.75])
def test_a_block_that_lands_while_it_is_drawn_slips_from_where_it_touches(share):
    """Without lateral contraction, on a straight way, with so little friction that shear is none of it: the face is at
    the part `share` of the way when it touches, and friction is at half of its bound in the mean from there."""
    depth, way, young, height, friction = 1e-4, 1e-3, 1e9, 0.1, 1e-6
    mesh = coulomb.box((0.1, 0.1, height), (1, 1, 1))
    moved = coulomb.PrescribedDisplacement("top", (way, 0.0, -depth), "xz", amplitude=[(0.0, 0.0), (1.0, 1.0)])
    contact = coulomb.Contact("bottom", friction, gap=share * depth)
    problem = coulomb.ContactProblem(mesh, coulomb.Material(young, 0.0), [moved, coulomb.Clamp("top", "y")], contact)
    (step,) = coulomb.LoadHistory([1.0]).steps(problem)
    pressure, slip = young * (1.0 - share) * depth / height, np.array([[(1.0 - share) * way, 0.0, 0.0]] * 4)
    assert step.solution.valid
    assert step.solution.at_nodes.pressure == pytest.approx(pressure, rel=1e-4)
    assert step.solution.at_nodes.slip == pytest.approx(slip, rel=1e-4, abs=1e-9)
    work = 0.5 * friction * pressure * 0.01 * (1.0 - share) * way
    assert step.state.energy.dissipated == pytest.approx(work, rel=1e-3)
