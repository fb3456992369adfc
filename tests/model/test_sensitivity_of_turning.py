"""Derivatives of answers of large motions with rigid faces, bolts and moments at points, which turn: against
differences of answers."""

from functools import partial

import numpy as np
import pytest
from answer_differences import derived, differs
from drawn_block import OVER, backwards, weights
from rubber_blocks import in_a_jaw, strut
from test_parallel_gradients import owed_by_name

OF_JAW = {
    "friction of 'bottom'": "friction",
    "prescribed displacements": "moved",
    "young": "young",
    "pressure on 'right'": "pushed",
    "stiffness of the spring on 'top'": "sprung",
    "point load on 'top'": "bent",
}
OF_STRUT = {
    "friction of 'upper:top'": "friction",
    "young of 'lower'": "lower",
    "young of 'upper'": "upper",
    "total force on 'upper:left'": "pushed",
    "point load on 'upper:right'": "bent",
    "stiffness of the spring on 'lower:bottom'": "sprung",
    "prescribed displacements": "turned",
}


@pytest.fixture(scope="module")
def propped():
    """The strut with a jack that is locked before its second step, and its derivatives."""
    return derived(partial(strut, 0.5), TIMES, 1e-12)


TIMES = (0.5, 1.0)


def test_a_jaw_against_central_differences():
    """Also of its motion, force and moment, and of its springs."""
    worst = differs(partial(in_a_jaw, cells=(2, 1, 1)), OF_JAW, TIMES, h=5e-5)
    assert max(worst.values()) < 1e-6, worst


def test_a_strut_against_central_differences(propped):
    """Also of its jack, which is locked in the second step."""
    inputs = {**OF_STRUT, "pretension of 'upper:bottom'": "pressed"}
    worst = differs(partial(strut, 0.5), inputs, TIMES, h=5e-5, present=propped)
    assert max(worst.values()) < 1e-6, worst


def test_a_strut_backwards(propped):
    """A rigid foot on springs, a jack that is locked, and a moment at a point."""
    forward = {}
    for step, found in propped:
        of_x, of_u = weights(step.solution)
        for one in found:
            value = OVER.sum(of_x * one.contact_force) + OVER.sum((of_u * one.displacement).ravel())
            size = OVER.norm(of_x) * OVER.norm(one.contact_force) + OVER.norm(of_u) * OVER.norm(one.displacement)
            forward[one.name] = np.array([value, size]) + forward.get(one.name, 0.0)
    owed = dict.fromkeys(forward, 0.0)
    for answer, gradient in backwards([step.solution for step, _ in propped]):
        for name, value in owed_by_name(answer, gradient).items():
            if name in owed:
                owed[name] += OVER.comm.allreduce(float(value))
    assert len(owed) == 8 and all(owed.values())
    assert owed == {name: pytest.approx(value, abs=2e-9 * size) for name, (value, size) in forward.items()}
