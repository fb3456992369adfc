"""Large motions against formulas of mechanics: belts, inclines, homogeneous strains; loads of rubber by themselves."""

import numpy as np
import pytest
from rubber_blocks import RubberBlock
from scipy.optimize import brentq

import coulomb
from coulomb.fem.compat import ufl
from coulomb.kinematics import LargeMotions, neo_hookean

DRUM = coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0)
"""Of the belts: of radius 1, along y."""


def answers(body, contacts, times, **history):
    problem = LargeMotions(body, contacts)
    return [step.solution for step in problem.steps(coulomb.LoadHistory(times, **history))]


def bent(x):
    """A box on the drum: the first coordinate is the angle from its top, the third the height above it."""
    angle, radius = x[:, 0], 1.0 + x[:, 2]
    return np.column_stack([radius * np.sin(angle), x[:, 1], radius * np.cos(angle)])


def belt(friction, angle, cells, thickness=0.01, width=0.1, strain=1e-3):
    """T2/T1 of a rubber belt on a drum that turns under it, and its last answer: the end on the top is held along the
    belt, at the other end there is a load, and soft springs hold what contact would have to hold first."""
    young = 1e6
    load = young * thickness * width * strain * np.array([np.cos(angle), 0.0, -np.sin(angle)])
    one = RubberBlock(
        cells=(cells, 1, 1),
        size=(angle, width, thickness),
        shape=bent,
        held="left",
        components=(0,),
        also=[("front", 1)],
        loads={"right": lambda time: min(time, 1.0) * load},
        energy=lambda u: neo_hookean(u, 0.5 * young, 0.0) + 0.5e-5 * young * ufl.inner(u, u),
    )
    turning = coulomb.Rotation((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), lambda time: 0.02 * max(time - 1.0, 0.0))
    contact = coulomb.Contact("bottom", friction=friction, foundation=DRUM, rotation=turning)
    *_, last = answers(one.body, contact, [1.0, 2.0])
    force = last.contact_force.reshape(-1, 3)
    assert last.valid
    assert np.linalg.norm(force[:, 1:], axis=1) == pytest.approx(friction * force[:, 0], rel=1e-6)  # all of it slides
    held = -(last.force_on_body.sum(axis=0) + load)
    return np.linalg.norm(held) / np.linalg.norm(load), last


def of_thin(friction, thickness):
    """The exponent over the angle, for a belt whose tension T is in its middle, at r, friction F n per angle at 1, and
    the bending moment the same everywhere: r T' = F n and T' - Q = F n, T + Q' = n with the shear force Q."""
    r = 1.0 + 0.5 * thickness
    return brentq(lambda k: k * (1.0 + friction * (r - 1.0) / r * k) - friction / r, 0.0, friction)


@pytest.mark.parametrize("friction", [0.2, 0.5])
def test_a_belt_on_a_drum_has_the_forces_of_the_formula(friction):
    """T2 = T1 exp(F angle), but for the thickness; with it the error of the mesh is of second order."""
    angle = 0.5 * np.pi
    ratios = np.array([belt(friction, angle, cells)[0] for cells in (8, 16)])
    assert ratios == pytest.approx(np.exp(friction * angle), rel=0.01)
    errors = ratios / np.exp(of_thin(friction, 0.01) * angle) - 1.0
    assert errors[1] < 2e-3 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


def test_a_dead_load_in_an_energy_presses_with_its_force():
    """Its part of the tangent is none."""
    one = RubberBlock(held="front", components=(1,), also=[("left", 0)], loads={"top": lambda time: [0.0, 0.0, -2e5]})
    (answer,) = answers(one.body, coulomb.Contact("bottom", friction=0.0), [1.0])
    assert answer.valid
    assert answer.at_nodes.totals()["force"] == pytest.approx([0.0, 0.0, 2e5], abs=1e-3)
