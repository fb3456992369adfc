"""Bodies of large motions that contact alone holds, and bodies that leave each other."""

import numpy as np
import pytest

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    NeoHookean,
    Plane,
    PrescribedDisplacement,
    Pressure,
    Rotation,
    Spring,
    StepFailed,
    box,
    join,
    moved,
)
from coulomb.solvers import Automatic

RUBBER = NeoHookean(1e6, 0.3)


def test_jaws_lift_an_object():
    """Of its weight each jaw bears a half by friction, which needs N >= W/(2 F); it then moves with them by far."""
    friction, weight, raised = 0.4, 800.0, 0.2

    def jaw(closed):
        return lambda time: (-closed * min(time, 1.0), 0.0, raised * max(time - 2.0, 0.0))

    walls = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), Plane((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0))
    jaws = [
        Contact(face, friction, foundation=wall, motion=jaw(closed))
        for face, wall, closed in zip(("left", "right"), walls, (0.0, 0.01), strict=True)
    ]
    down = {
        "body_force": (0.0, 0.0, -weight / 1e-3),
        "body_force_amplitude": [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (3.0, 1.0)],
    }
    problem = ContactProblem(box((0.1, 0.1, 0.1), (2, 2, 2)), RUBBER, [], jaws, kinematics="large", **down)
    _, held, lifted = (step.solution for step in LoadHistory([1.0, 2.0, 3.0]).steps(problem))
    assert held.valid and lifted.valid
    for part in range(2):
        totals = lifted.at_nodes.totals(part)
        assert totals["force"][1:] == pytest.approx([0.0, 0.5 * weight], abs=1e-6 * weight)
        assert totals["normal_force"] * friction >= 0.5 * weight
    assert lifted.displacement - held.displacement == pytest.approx(np.tile([0.0, 0.0, raised], (27, 1)), abs=1e-9)


@pytest.mark.parametrize("by", ["motion", "gap"])
def test_jaws_that_close_and_turn_do_the_work_of_closing(by):
    """Whether the jaws come nearer or a given gap does; turned with the object, even at once, they do no work."""
    closed, ramp = 0.005, [(0.0, 0.0), (1.0, 1.0)]
    turn = Rotation((0.05, 0.05, 0.05), (0.0, 1.0, 0.0), lambda time: max(time - 1.0, 0.0))
    walls = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), Plane((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0))
    jaws = [
        Contact(face, 0.4, foundation=wall, gap=-closed, gap_amplitude=ramp, rotation=turn)
        if by == "gap"
        else Contact(face, 0.4, foundation=wall, motion=[(0.0, 0.0, 0.0, 0.0), (1.0, way, 0.0, 0.0)])
        for face, wall, way in zip(("left", "right"), walls, (closed, -closed), strict=True)
    ]
    problem = ContactProblem(box((0.1, 0.1, 0.1), (2, 2, 2)), RUBBER, [], jaws, kinematics="large")
    half, whole, turned = (step.state.energy for step in LoadHistory([0.5, 1.0, 2.0]).steps(problem))
    assert half.foundation > 0.0 and abs(whole.imbalance) < 0.01 * whole.foundation
    assert turned.foundation == pytest.approx(whole.foundation, rel=1e-9)
    assert turned.imbalance == pytest.approx(whole.imbalance, abs=1e-9 * whole.foundation)


def test_a_start_without_forces_is_none():
    """Newton's method from there put the object at 1e13 m, since no friction said where it ends."""
    gap = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), Plane((0.099, 0.0, 0.0), (-1.0, 0.0, 0.0))
    jaws = [Contact(face, 0.4, foundation=wall) for face, wall in zip(("left", "right"), gap, strict=True)]
    problem = ContactProblem(box((0.1, 0.1, 0.1), (2, 2, 2)), RUBBER, [], jaws, kinematics="large")
    assert problem.solve().valid
    small = ContactProblem(problem.mesh, Material(1e6, 0.3), [], jaws)
    answer = Automatic(1e-8).solve(small.friction_problem, np.zeros_like(small.b))
    assert np.max(np.abs(answer.rigid)) < 0.1


@pytest.mark.parametrize("small_first", [True, False])
def test_a_body_deep_in_another_is_refused(small_first):
    """Its face is not before the other any more: nothing touched, and the answer was valid."""
    mesh = join(low=box((0.1, 0.1, 0.1), (2, 2, 2)), up=moved(box((0.06, 0.06, 0.06), (2, 2, 2)), (0.02, 0.02, 0.07)))
    faces = ("up:bottom", "low:top")[:: 1 if small_first else -1]
    contact = Contact(faces[0], 0.3, against=faces[1], slave=True)
    with pytest.raises(
        ValueError, match=r"'up:bottom': at x = .* it is inside the body of 'low:top' before deformation"
    ):
        ContactProblem(mesh, RUBBER, [Clamp("low:bottom"), Clamp("up:top")], contact, kinematics="large")


def test_a_block_leaves_another():
    """Lifted off, nothing presses; put back, the force is the same as before."""
    mesh = join(low=box((0.2, 0.1, 0.05), (4, 2, 1)), up=moved(box((0.1, 0.1, 0.05), (3, 2, 1)), (0.05, 0.0, 0.05)))
    way = PrescribedDisplacement(
        "up:top", (0.0, 0.0, 0.1), amplitude=[(0.0, 0.0), (1.0, -0.02), (2.0, 1.0), (3.0, -0.02)]
    )
    contact = Contact("up:bottom", 0.0, against="low:top")
    problem = ContactProblem(mesh, RUBBER, [Clamp("low:bottom"), way], contact, kinematics="large")
    solutions = [step.solution for step in LoadHistory([1.0, 2.0, 3.0]).steps(problem)]
    first, apart, again = (one.at_nodes.totals()["normal_force"] for one in solutions)
    assert all(one.valid for one in solutions) and apart == 0.0 < first
    assert again == pytest.approx(first, rel=1e-6)


def test_a_step_that_loses_all_contact_fails():
    """The block below goes from under the other: an iterate in which nothing touches ended the run as a wrong model."""
    mesh = join(low=box((0.2, 0.1, 0.05), (4, 2, 1)), up=moved(box((0.1, 0.1, 0.05), (3, 2, 1)), (0.05, 0.0, 0.05)))
    away = PrescribedDisplacement("low:bottom", (0.5, 0.0, 0.0), amplitude=[(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)])
    loads, contact = [Pressure("up:top", 1e3)], Contact("up:bottom", 0.1, against="low:top")
    problem = ContactProblem(
        mesh, RUBBER, [away], contact, loads, springs=[Spring("up:left", (1e7, 0.0, 0.0))], kinematics="large"
    )
    steps = LoadHistory([1.0, 2.0], halvings=0).steps(problem)
    assert next(steps).solution.valid
    with pytest.raises(StepFailed, match="the load step from 1 s to 2 s failed"):
        next(steps)
