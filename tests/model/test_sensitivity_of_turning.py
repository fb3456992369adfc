"""Derivatives of answers of large motions with rigid faces, bolts and moments at points, which turn: against
differences of answers."""

from functools import partial

import pytest
from answer_differences import differs
from rubber_blocks import in_a_jaw, strut

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
