"""A ring of rubber that rolls: its nodes come down on cycloids, and what they travel in the air counts as slip in the
load step in which they touch."""

import numpy as np
import pytest
from rubber_blocks import RubberBlock

import coulomb
from coulomb.kinematics import LargeMotions

RADIUS, THICKNESS, PRESSED, ROLLS = 1.0, 0.4, 0.03, 0.96
"""Of the ring, by how much its hub comes down, and its way over its angle: less than the ring would roll freely."""

SECTOR, TURNED = np.radians(90.0), np.radians(30.0)


def lying(x):
    """A box as the sector that comes down: its middle is at the bottom after half of the turn."""
    angle, radius = SECTOR * (x[:, 0] - 0.5) + 0.5 * TURNED, RADIUS - x[:, 2]
    return np.column_stack([radius * np.sin(angle), x[:, 1], -radius * np.cos(angle)])


def hub(time, x):
    """Down until time 1, then on by the turn until time 2."""
    angle = TURNED * max(time - 1.0, 0.0)
    c, s = np.cos(angle) - 1.0, np.sin(angle)
    return np.array([c * x[0] + s * x[2] + ROLLS * angle, 0.0 * x[1], c * x[2] - s * x[0] - PRESSED * min(time, 1.0)])


def rolled(steps, friction_error=None):
    """The last load step of a turn in these steps."""
    ring = RubberBlock(
        hub, (22, 1, 2), (1.0, 0.2, THICKNESS), shape=lying, held="top", also=[("front", 1), ("back", 1)]
    )
    road = coulomb.Plane((0.0, 0.0, -RADIUS), (0.0, 0.0, 1.0))
    problem = LargeMotions(ring.body, coulomb.Contact("bottom", friction=0.5, foundation=road))
    times = [1.0, *(1.0 + np.arange(1, steps + 1) / steps)]
    *_, last = coulomb.LoadHistory(times, friction_error=friction_error).steps(problem)
    assert last.solution.valid
    return last


def pull(step):
    force = step.solution.at_nodes.totals()["force"]
    return force[0] / force[2]


def test_in_few_steps_to_an_error_a_ring_pulls_as_in_many():
    """Two steps as they are pull 40 % less."""
    many, few = rolled(16), rolled(2, 0.05)
    assert pull(few) == pytest.approx(pull(many), rel=0.05)
    assert 0.0 < few.state.friction_error < 0.05
    assert pull(rolled(2)) < 0.8 * pull(many)
