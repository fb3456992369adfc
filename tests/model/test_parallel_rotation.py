"""Friction of a disc and of a drum that rotate, on any number of ranks."""

import numpy as np
import pytest
from mpi4py import MPI
from rotating_foundations import CELLS, puck, shoe, steps

from coulomb import Rotation
from coulomb.linalg.reductions import Reductions


@pytest.mark.parametrize("cell", CELLS)
def test_friction_of_a_disc_is_against_the_rotation(cell):
    """The table takes each node along, with friction along axis x r; the torque is F times the sum of N r, and 2/3 F N
    R up to the mesh."""
    *_, last = steps(puck(cell=cell), [1.0, 1.2, 2.0])
    at = last.solution.at_nodes
    r = at.x * [1, 1, 0]
    away = np.linalg.norm(r, axis=1) > 1e-6
    along = np.cross([0, 0, 1], r[away]) / np.linalg.norm(r[away], axis=1)[:, None]
    friction = at.on_body[away] * [1, 1, 0]
    use = 0.3 * at.force[away, 0]
    over = Reductions(MPI.COMM_WORLD)
    assert over.max(np.abs(friction - use[:, None] * along)) < 1e-3 * over.max(use)
    normal = over.sum(at.force[:, 0])
    expected = -0.3 * over.sum(at.force[:, 0] * np.linalg.norm(r, axis=1))
    assert last.row["bottom_torque"] == pytest.approx(expected, rel=1e-6)
    assert last.row["bottom_torque"] == pytest.approx(-2 / 3 * 0.3 * normal * 0.05, rel=0.02)
    assert last.row["bottom_power"] == pytest.approx(last.row["bottom_torque"] * 4.0, rel=1e-12)
    assert last.row["bottom_angle"] == 4.5


def test_a_drum_keeps_frames_and_compliance():
    rotation = Rotation((0.05, 9.0, -0.5), (0, 1, 0), [(0, 0), (1, 0), (2, 6.0)])
    problem = shoe(rotation)
    taken = steps(problem, [0.5, 1.0, 1.5, 2.0])
    for step in taken:
        assert step.solution.problem.A is problem.A
        assert step.solution.problem.surface.frames is problem.surface.frames
        assert step.solution.valid and step.solution.small_strain.gap_error < 0.01
    # a short pad on a drum: F N r with the nodes' radii
    at = taken[-1].solution.at_nodes
    over = Reductions(MPI.COMM_WORLD)
    radius = np.linalg.norm((at.x - [0.05, 0.0, -0.5]) * [1, 0, 1], axis=1)
    row = taken[-1].row
    assert row["slip"] + row["open"] == 7 * 4
    assert row["bottom_torque"] == pytest.approx(-0.3 * over.sum(at.force[:, 0] * radius), rel=1e-6)
    assert row["bottom_torque"] == pytest.approx(-0.3 * row["normal_force"] * 0.5, rel=0.01)
    assert row["force_x"] > 0.0  # the top of the drum goes towards +x, and takes the block along
