"""The ironing of large motions, and beside other programs."""

import numpy as np
import pytest

import coulomb
from benchmarks.ironing import DEPTH, FRICTION, PRESSING, PROGRAMS, WAY, one_run, roughness, sliding, times, way
from benchmarks.ironing.ours import force_on_die, problem
from benchmarks.peers import missing


def pressed_and_drawn(p, ends):
    """Forces on the die at the ends of load steps; certificates pass."""
    found = [step.solution for step in coulomb.LoadHistory(ends).steps(problem(p))]
    assert all(one.valid for one in found)
    return np.array([force_on_die(one, p) for one in found])


def test_a_die_is_pressed_and_drawn_and_friction_comes_to_its_bound():
    """The surface that is slid on is not flat, so that T is not exactly F N."""
    (tangential, _, normal), (drawing, across, pressing) = pressed_and_drawn(1, [1.0, 1.5])
    assert normal > 0.5 and pressing > 0.5 and abs(across) < 1e-9
    assert abs(tangential) < 0.1 * normal  # nearly symmetric while it is pressed
    assert -drawing == pytest.approx(FRICTION * pressing, rel=0.1)


@pytest.mark.parametrize("name", ["GetFEM", "CalculiX"])
def test_other_programs_press_with_the_same_force(name):
    """Within 2 %: contact points are nodes here, and integration points there."""
    if reason := missing(PROGRAMS[name]):
        pytest.skip(reason)
    theirs = one_run(name, 2, 12)  # by few steps GetFEM does not always converge
    assert not isinstance(theirs, str), theirs
    assert theirs.forces[PRESSING - 1, 2] == pytest.approx(pressed_and_drawn(2, [1.0])[0, 2], rel=0.02)


def test_numbers_of_a_history():
    assert times(0) == [1.0, 2.0] and len(times(8)) == PRESSING + 8
    assert way(0.5) == (0.0, 0.0, -0.5 * DEPTH) and way(2.0) == (WAY, 0.0, -DEPTH)
    forces = np.array([[0.0, 1.0, 1.0]] * PRESSING + [[-0.1, 1.0, 1.0], [-0.3, 1.0, 1.0], [-0.33, 1.0, 1.2]])
    assert len(sliding(forces)) == 2
    assert roughness(forces[-2:]) == pytest.approx((0.03 / 0.315, 0.2 / 1.1))
