"""Load steps that would take bodies through each other from outside to outside are halved, or fail."""

import numpy as np
import pytest

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    NeoHookean,
    PrescribedDisplacement,
    RigidFace,
    Sphere,
    StepFailed,
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
