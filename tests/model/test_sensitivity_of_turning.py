"""Derivatives of answers of large motions with rigid faces, bolts and moments at points, which turn: against
differences of answers."""

from functools import partial

import numpy as np
import pytest
from answer_differences import differs
from drawn_block import OVER, backwards, weights
from rubber_blocks import in_a_jaw, strut
from test_parallel_gradients import owed_by_name

import coulomb

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


@pytest.mark.parametrize(
    "make, inputs",
    [
        (in_a_jaw, OF_JAW),
        (partial(strut, 0.5), {**OF_STRUT, "pretension": "pressed"}),
    ],
)
def test_they_are_those_of_central_differences(make, inputs):
    """Also of motion, force and moment of the jaw, of its springs, and of the jack, of which one is locked in the
    second step."""
    worst = differs(make, inputs, (0.5, 1.0), h=5e-5)
    assert max(worst.values()) < 1e-6, worst


def test_backwards_in_large_motions_with_what_turns():
    """A rigid foot on springs, a jack that is locked, and a moment at a point."""
    answers, forward, earlier = [], {}, []
    for step in coulomb.LoadHistory([0.5, 1.0], tolerance=1e-12).steps(strut(0.5)):
        answers.append(step.solution)
        earlier, (of_x, of_u) = step.solution.sensitivities(earlier), weights(step.solution)
        for one in earlier:
            value = OVER.sum(of_x * one.contact_force) + OVER.sum((of_u * one.displacement).ravel())
            size = OVER.norm(of_x) * OVER.norm(one.contact_force) + OVER.norm(of_u) * OVER.norm(one.displacement)
            forward[one.name] = np.array([value, size]) + forward.get(one.name, 0.0)
    owed = dict.fromkeys(forward, 0.0)
    for answer, gradient in backwards(answers):
        for name, value in owed_by_name(answer, gradient).items():
            if name in owed:
                owed[name] += OVER.comm.allreduce(float(value))
    assert len(owed) == 8 and all(owed.values())
    assert owed == {name: pytest.approx(value, abs=2e-9 * size) for name, (value, size) in forward.items()}
