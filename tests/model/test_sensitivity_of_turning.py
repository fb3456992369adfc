"""Derivatives of answers of large motions with rigid faces, bolts and moments at points, which turn: against
differences of answers."""

from functools import partial

import numpy as np
import pytest
from answer_differences import differs

import coulomb
from coulomb import NeoHookean

RAMP = [(0.0, 0.0), (1.0, 1.0), (2.0, 1.2)]


def in_a_jaw(friction=1.0, moved=1.0, young=1.0, pushed=1.0, sprung=1.0, bent=1.0, cells=(2, 2, 1)):
    """A rubber block on a ball, turned by a jaw that is partly free, on springs and under a moment."""
    jaw = coulomb.RigidFace(
        "top",
        (0.4, 0.5, 0.5),
        (0.03 * moved, None, -0.06 * moved),
        (None, None, 0.2 * moved),
        RAMP,
        translation_stiffness=(0.0, 1e5 * sprung, 0.0),
        rotation_stiffness=(2e3 * sprung, 1e3 * sprung, 0.0),
    )
    moment = tuple(bent * np.array([2e3, -3e3, 1e3]))
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), cells),
        NeoHookean(1e6 * young, 0.3),
        [],
        coulomb.Contact("bottom", 0.4 * friction, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 2.99)),
        [
            coulomb.Pressure("right", 1e4 * pushed, amplitude=RAMP),
            coulomb.PointLoad("top", (1e3 * bent, 1e3 * bent, 0.0), moment, (0.45, 0.5, 0.5), RAMP),
        ],
        kinematics="large",
        rigid_faces=[jaw],
    )


def strut(lock=None, friction=1.0, pressed=1.0, lower=1.0, upper=1.0, pushed=1.0, bent=1.0):
    """A rubber bar of two halves, which a jack between them presses against an oblique wall; it is bent."""
    if lock is None:
        jack = coulomb.Pretension("upper:bottom", "lower:top", shortening=-0.1 * pressed, amplitude=RAMP)
    else:
        jack = coulomb.Pretension("upper:bottom", "lower:top", force=-3e4 * pressed, amplitude=RAMP, lock=lock)
    above = coulomb.moved(coulomb.box((0.5, 0.5, 0.6), (2, 1, 1)), (0.0, 0.0, 0.4))
    moment = 200.0 * bent, 0.0, 300.0 * bent
    return coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box((0.5, 0.5, 0.4), (1, 1, 1)), upper=above),
        {"lower": NeoHookean(1e6 * lower, 0.3), "upper": NeoHookean(2e6 * upper, 0.3)},
        [coulomb.Clamp("lower:bottom")],
        coulomb.Contact("upper:top", 0.2 * friction, foundation=coulomb.Plane((0.0, 0.0, 1.005), (0.2, 0.1, -1.0))),
        [
            coulomb.TotalForce("upper:left", (2e3 * pushed, 1e3 * pushed, 0.0), amplitude=RAMP),
            coulomb.PointLoad("upper:right", (0.0, 0.0, 0.0), moment, (0.5, 0.2, 0.7), RAMP),
        ],
        ties=[jack],
        kinematics="large",
    )


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
}


@pytest.mark.parametrize(
    "make, inputs",
    [
        (in_a_jaw, OF_JAW),
        (partial(strut, 0.5), {**OF_STRUT, "pretension": "pressed"}),
        (strut, {**OF_STRUT, "prescribed displacements": "pressed"}),
    ],
)
def test_they_are_those_of_central_differences(make, inputs):
    """Also of motion, force and moment of the jaw, of its springs, and of the jack, of which one is locked in the
    second step."""
    worst = differs(make, inputs, (0.5, 1.0))
    assert max(worst.values()) < 1e-6, worst
