"""Contact of two deformable faces: gaps that meshes leave, slips beyond the theory, wrong input."""

import numpy as np
import pytest

from coulomb import Clamp, Contact, ContactProblem, Material, PrescribedDisplacement, box, join, moved

STEEL, ALUMINIUM = Material(2.1e11, 0.3), Material(7e10, 0.33)


def pressed(gap=0.0, adjust=0.0, push=1e-5, friction=0.3, given=0.0):
    """A block on a block, its top pressed down by 1e-4 m and pushed along x."""
    lower = box((1.0, 1.0, 0.5), (3, 3, 2))
    upper = moved(box((0.8, 0.8, 0.4), (4, 4, 2)), (0.1, 0.1, 0.5 + gap))
    supports = [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", (push, 0.0, -1e-4))]
    pair = Contact("upper:bottom", against="lower:top", friction=friction, adjust=adjust, gap=given)
    return ContactProblem(join(lower=lower, upper=upper), {"lower": STEEL, "upper": ALUMINIUM}, supports, pair)


def force(problem):
    solution = problem.solve()
    assert solution.certificate.passed
    return np.array(solution.at_nodes.totals()["force"])


def same(one, other, tolerance):
    return np.linalg.norm(one - other) <= tolerance * np.linalg.norm(other)


@pytest.mark.parametrize("gap", [2e-5, -2e-5])
def test_gaps_of_meshes_are_closed_without_strain(gap):
    closed = force(pressed())
    left = force(pressed(gap))
    assert np.sign(left[2] - closed[2]) == -np.sign(gap)
    assert np.abs(left[2] - closed[2]) == pytest.approx(abs(gap) / 1e-4 * closed[2], rel=0.02)  # where all press
    assert same(force(pressed(gap, adjust=1e-4)), closed, 1e-4)  # the body is elsewhere by the gap
    assert same(force(pressed(gap, adjust=1e-6)), left, 1e-9)


def test_slip_beyond_the_nodes_opposite_is_a_warning():
    """Frictionless: the block slides by more than a cell, where other nodes would be opposite."""
    few, many = pressed(push=0.02, friction=0.0).solve(), pressed(push=0.3, friction=0.0).solve()
    assert few.small_strain.slip_over_cell < 1.0 < many.small_strain.slip_over_cell
    assert any("nodes opposite" in text for text in many.small_strain.warnings)


def test_a_given_gap_adds_to_the_distance():
    assert same(force(pressed(given=3e-5)), force(pressed(3e-5)), 1e-4)
