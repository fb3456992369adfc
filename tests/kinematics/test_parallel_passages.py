"""Load steps that would take bodies through each other from outside to outside are halved, or fail."""

import re

import numpy as np
import pytest

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Cylinder,
    LoadHistory,
    NeoHookean,
    PrescribedDisplacement,
    RigidFace,
    Sphere,
    StepFailed,
    SymmetryPlane,
    box,
    join,
    moved,
)

RUBBER = NeoHookean(1e6, 0.3)


def over_a_block(motion, gap=0.0):
    """A ball of radius 60 mm that moves in 1 s; its middle begins 0.1 m before the block and 50 mm above its top."""
    ball = Contact("top", 0.2, foundation=Sphere((-0.1, 0.05, 0.1), 0.06), motion=[(0, 0, 0, 0), (1, *motion)], gap=gap)
    return ContactProblem(box((0.2, 0.1, 0.05), (6, 4, 2)), RUBBER, [Clamp("bottom")], ball, kinematics="large")


def post_and_block(slave):
    """A block that begins beside a post is moved from one side of it to the other in 1 s."""
    bodies = join(
        post=box((0.05, 0.1, 0.2), (1, 1, 3)), block=moved(box((0.05, 0.05, 0.05), (1, 1, 1)), (-0.1, -0.055, 0.1))
    )
    way = PrescribedDisplacement("block:left", (0.3, 0.36, 0.0), amplitude=[(0.0, 0.0), (1.0, 1.0)])
    faces = ("block:right", "post:left")[:: 1 if slave == "block" else -1]
    contact = Contact(faces[0], 0.0, against=faces[1], slave=True)
    return ContactProblem(bodies, RUBBER, [Clamp("post:bottom"), way], contact, kinematics="large")


@pytest.mark.parametrize(
    ("problem", "names"),
    [
        (lambda: over_a_block((0.4, 0.0, 0.0)), "'top' passes through its foundation"),
        (lambda: post_and_block("block"), "'block:right' passes through 'post:left'"),
        (lambda: post_and_block("post"), "'post:left' passes through 'block:right'"),
    ],
    ids=["ball", "block", "post"],
)
def test_what_would_pass_through_a_body_in_one_step_is_no_answer(problem, names):
    with pytest.raises(StepFailed, match=f"{names} in the step, from x = .* m on: inside between"):
        list(LoadHistory([1.0], halvings=0).steps(problem()))


def test_half_of_the_step_meets_the_block():
    first, last = (step.solution for step in LoadHistory([1.0], halvings=1).steps(over_a_block((0.4, 0.0, 0.0))))
    assert first.forces["force"][2] < 0.0 and first.time == 0.5 and last.forces["normal_force"] == 0.0


def wire_on_a_block(cells, times, **history):
    """A wire of radius 2 mm, thinner than the facets, is pressed into a block by 10 mm in 1 s."""
    wire = Contact("top", 0.3, foundation=Cylinder((0.05, 0.0, 0.052), (0.0, 1.0, 0.0), 0.002), motion=DOWN)
    block = box((0.1, 0.02, 0.05), (cells, 1, cells // 2))
    supports = [Clamp("bottom"), SymmetryPlane("front"), SymmetryPlane("back")]
    problem = ContactProblem(block, NeoHookean(1e6, 0.45), supports, wire, kinematics="large")
    return LoadHistory(times, **history).steps(problem)


DOWN = [(0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, -0.01)]


@pytest.mark.parametrize("times", [[0.25], [0.1, 0.5]], ids=["pressing", "free"])
def test_a_wire_that_gets_behind_the_face_it_is_pressed_on_is_no_answer(times):
    """From the first touch on, and from a side on which it presses: its upper side lifted the node, or nothing.  By
    rounding errors iterates may also end beside it, by 15 problems, which does not count."""
    try:
        *_, last = wire_on_a_block(16, times, halvings=0)
    except StepFailed as failure:
        assert re.search(r"to 0\.\d+ s failed: the foundation of 'top' gets behind it .* x = \(0.05, 0", str(failure))
    else:
        assert not last.solution.valid and times == [0.25]


def test_in_steps_that_are_halved_a_wire_presses_as_far_as_it_is_moved():
    force = {step.state.time: -step.solution.forces["force"][2] for step in wire_on_a_block(16, [0.125, 0.25, 0.5])}
    assert force[0.25] / force[0.125] == pytest.approx(2.0, rel=0.01)
    assert force[0.5] / force[0.125] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.3), (0.4, 0.0, 0.06)], ids=["up", "above"])
def test_what_passes_by_is_an_answer(motion):
    (step,) = LoadHistory([1.0], halvings=0).steps(over_a_block(motion))
    assert step.solution.valid and step.solution.forces["normal_force"] == 0.0


def test_within_a_given_gap_nothing_is_passed_through():
    (step,) = LoadHistory([1.0], halvings=0).steps(over_a_block((0.4, 0.0, 0.0), gap=0.02))
    assert step.solution.valid


def test_bodies_that_turn_together_do_not_pass_through_each_other():
    """Two blocks with 0.1 mm between them, turned by 120 degrees about the middle of one, and moved by far, at once."""
    bodies = join(one=box((0.1, 0.1, 0.1), (2, 2, 2)), other=moved(box((0.1, 0.1, 0.1), (2, 2, 2)), (0.1001, 0.0, 0.0)))
    turned = [
        RigidFace(f"{name}:bottom", (0.05, 0.05, 0.0), (0.5, 0.2, 0.0), (0.0, 0.0, np.radians(120.0)))
        for name in ("one", "other")
    ]
    contact = Contact("other:left", 0.2, against="one:right")
    problem = ContactProblem(bodies, RUBBER, [], contact, kinematics="large", rigid_faces=turned)
    (step,) = LoadHistory([1.0], halvings=0).steps(problem)
    assert step.solution.valid and step.solution.forces["normal_force"] == 0.0
