"""Taylor remainders of second order, central differences and the adjoint, of derivatives along all inputs at once, on
any number of ranks: of parts of machines, of load histories, and in large motions."""

from functools import partial

import numpy as np
import pytest
import ufl
from drawn_block import OVER, backwards, drawn, summed, weights
from rubber_blocks import RISING, in_a_jaw, strut
from test_parallel_gradients import bolted, owed_by_name
from test_sensitivity import block, bonded, free, heated, pair
from user_forms import Script

import coulomb

OF_JAW = {
    "prescribed": "moved",
    "young": "young",
    "pressure": "pushed",
    "stiffness": "sprung",
    "point load": "bent",
}
OF_STRUT = {
    "young of 'lower'": "lower",
    "young of 'upper'": "upper",
    "total force": "pushed",
    "point load": "bent",
    "stiffness": "sprung",
    "prescribed": "turned",
}
ONCE, TWICE = [(0.0, 0.0), (1.0, 1.0)], [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]


def bracket(friction=1.0, pulled=1.0, young=1.0, sprung=1.0, gap=1.0):
    """A bar bent by 90 degrees, one end of which is held on the ground; the other end, on a spring, is pulled."""

    def bent(x):
        angle = 0.5 * np.pi * np.clip(2.0 * x[0] - 0.6, 0.0, 1.0)
        r, foot, leg = 0.03 + 0.01 * x[2], np.minimum(x[0] - 0.3, 0.0), np.maximum(x[0] - 0.8, 0.0)
        return np.stack([0.2 * foot + r * np.sin(angle), 0.04 * x[1], 0.04 - r * np.cos(angle) + 0.2 * leg])

    mesh = coulomb.box((1.0, 1.0, 1.0), (5, 2, 1), place=bent)
    return coulomb.ContactProblem(
        mesh,
        coulomb.Material(2e11 * young, 0.3),
        [coulomb.Clamp("left")],
        coulomb.Contact(
            "top", 0.2 * friction, foundation=coulomb.Plane((0.0, 0.0, -1e-9), (0.0, 0.0, 1.0)), gap=1e-6 * gap
        ),
        [coulomb.TotalForce("right", (-200.0 * pulled, 100.0 * pulled, -300.0 * pulled))],
        springs=[coulomb.Spring("right", (1e9 * sprung, 0.0, 1e9 * sprung))],
        small_strain="warn",
    )


def press_fit(friction=1.0, interference=1.0, young=1.0, pulled=1.0):
    """A quarter of a hub that is pressed onto a pin, which is pulled."""

    def place(x):
        r, angle = 0.1 + 0.1 * x[0], 0.5 * np.pi * x[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.1 * x[2]])

    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (1, 2, 3), place=place),
        coulomb.Material(2e11 * young, 0.3),
        [coulomb.SymmetryPlane("front"), coulomb.SymmetryPlane("back"), coulomb.Clamp("right", "z")],
        coulomb.Contact(
            "left",
            0.15 * friction,
            foundation=coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.1),
            gap=-5e-5 * interference,
            gap_amplitude=ONCE,
            motion=lambda t: np.array([0.0, 0.0, 3e-6 * pulled * t**2]),
        ),
    )


def of_forms(friction=1.0, pushed=1.0):
    """A body of the user's forms on a ball."""
    script = Script(coulomb.box((1.0, 1.0, 0.5), (3, 2, 1)), 1)
    load = ufl.dot(script.constant((2e5 * pushed, 0.0, -1e6 * pushed)), script.v) * script.ds("top")
    held, stiffness = script.bc((0.0, 0.0, 0.0), "right"), script.elasticity(1e7, 0.3)
    contact = coulomb.Contact("bottom", 0.3 * friction, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 3.0))
    return coulomb.ContactProblem(
        coulomb.Body(stiffness, load, [held], faces=script.mesh.faces), contact, small_strain="warn"
    )


def tread_block(friction=1.0, pressed=1.0, rubber=1.0, dragged=1.0):
    """A block of rubber, wider where its carcass presses it onto a road, which moves."""

    def place(x):
        wide = 1.0 + 0.2 * x[2]
        return np.stack([0.03 * wide * (x[0] - 0.5), 0.02 * wide * (x[1] - 0.5), 0.01 * x[2]])

    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (3, 1, 1), place=place),
        coulomb.MooneyRivlin(5e5 * rubber, 1e5 * rubber, 2e7 * rubber),
        [coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3 * pressed), amplitude=ONCE)],
        coulomb.Contact("bottom", 0.8 * friction, motion=lambda t: np.array([dragged * 1e-3 * t**2, 0.0, 0.0])),
        kinematics="large",
    )


def tied(friction=1.0, turned=1.0, lower=1.0, upper=1.0):
    """Two rubber blocks that are tied to each other, pressed onto a ball and turned."""
    above = coulomb.moved(coulomb.box((0.7, 0.7, 0.3), (1, 1, 1)), translate=(0.15, 0.15, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)), upper=above),
        {"lower": coulomb.NeoHookean(1e6 * lower, 0.3), "upper": coulomb.NeoHookean(2e6 * upper, 0.3)},
        [
            coulomb.PrescribedRotation("upper:top", (0.5, 0.5, 0.0), (0.0, 0.1, 1.0), 0.1 * turned, TWICE, "free"),
            coulomb.PrescribedDisplacement("upper:top", (0.0, 0.0, -0.06 * turned), "z", amplitude=RISING),
        ],
        coulomb.Contact("lower:bottom", 0.3 * friction, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 2.99)),
        ties=[coulomb.Tied("upper:bottom", "lower:top")],
        kinematics="large",
    )


TURNING = [(partial(in_a_jaw, cells=(1, 1, 1)), [1.0], OF_JAW), (strut, [1.0], OF_STRUT)]
"""On several ranks alone: on one, test_sensitivity_of_turning compares them with central differences."""


@pytest.mark.parametrize(
    ("make", "times", "inputs"),
    [
        (block, [1.0], {"gap": "gap", "traction on 'top'": "top", "traction on 'right'": "right", "young": "young"}),
        (bracket, [1.0], {"gap": "gap", "total force": "pulled", "young": "young", "stiffness": "sprung"}),
        (pair, [1.0], {"prescribed": "pushed", "young of 'upper'": "rubber", "young of 'lower'": "steel"}),
        (free, [1.0], {"point load": "load", "young": "young"}),
        (bonded, [1.0], {"cohesion": "cohesion", "friction limit": "limit", "prescribed": "pushed", "young": "young"}),
        (
            heated,
            [1.0],
            {"total force": "pushed", "young of 'a'": "lower", "young of 'b'": "upper", "temperature change": "hot"},
        ),
        (press_fit, [1.0, 2.0], {"gap": "interference", "young": "young", "motion": "pulled"}),
        (bolted, [1.0, 2.0, 3.0], {"pretension": "force", "young": "young", "total force": "pulled"}),
        (drawn, [1.0, 2.0, 3.0], {"pressure": "pressed", "prescribed": "pulled", "young": "young"}),
        (of_forms, [1.0], {"load": "pushed"}),
        (tread_block, [1.0, 1.5], {"prescribed": "pressed", "young": "rubber", "motion": "dragged"}),
        (tied, [1.0], {"prescribed": "turned", "young of 'lower'": "lower", "young of 'upper'": "upper"}),
        *(TURNING if OVER.comm.size > 1 else ()),
    ],
)
def test_the_remainder_is_of_second_order(make, times, inputs):
    """Of a function of the answers of all steps, along a direction in which every input has its own share."""
    inputs, forward = {"friction of": "friction", **inputs}, {}
    shares = dict(zip(inputs.values(), np.linspace(1.0, -0.6, len(inputs)), strict=True))

    def share(name):
        return next(shares[of] for begin, of in inputs.items() if name.startswith(begin))

    def answers(change=0.0):
        made = make(**{name: 1.0 + change * part for name, part in shares.items()})
        return [one.solution for one in coulomb.LoadHistory(times, tolerance=1e-12).steps(made)]

    present, found = answers(), []
    at = [weights(one) for one in present]
    for one, (of_x, of_u) in zip(present, at, strict=True):
        found = one.sensitivities(found)
        for of in found:
            value = OVER.sum(of_x * of.contact_force) + OVER.sum((of_u * of.displacement).ravel())
            size = OVER.norm(of_x) * OVER.norm(of.contact_force) + OVER.norm(of_u) * OVER.norm(of.displacement)
            forward[of.name] = np.array([value, size]) + forward.get(of.name, 0.0)
    along = sum(share(name) * value for name, (value, _) in forward.items())
    h = min(1e-3, 0.5 / sum(abs(share(of.name)) / of.step for of in found))
    value, whole, half, less = (summed(at, answers(change)) for change in (0.0, h, 0.5 * h, -0.5 * h))
    assert along == pytest.approx((half - less) / h, rel=1e-5)
    remainders = abs(whole - value - h * along), abs(half - value - 0.5 * h * along)
    assert np.log2(remainders[0] / remainders[1]) == pytest.approx(2.0, abs=0.02)
    owed, large = dict[str, float](), present[0].problem.body.undeformed is not None
    if large and OVER.comm.size > 1:
        return  # half a minute
    for answer, gradient in backwards(present):
        for name, part in owed_by_name(answer, gradient).items():
            owed[name] = owed.get(name, 0.0) + OVER.comm.allreduce(float(part))
    for name, (value, size) in forward.items():
        if not name.startswith("motion"):
            assert owed[name] == pytest.approx(value, abs=(4e-10 if large else 1e-10) * size), name
