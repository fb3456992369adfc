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
    SignedDistance,
    Spring,
    StepFailed,
    TotalForce,
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


def test_jaws_grip_turn_and_put_down_an_object():
    """Gripped beside the middle of its face, lifted, turned by 90 degrees, and let go on a table: jaws bear its weight,
    with its moment about their axis, the table in the end; there it stays."""
    weight, axis, down = 8.0, np.array([0.05, 0.03, 0.15]), (0.0, 0.0, -1.0)

    def jaw(side):
        closed = [0.0, 0.002, 0.002, -0.02]
        return lambda time: (
            side * np.interp(time, [0.0, 1.0, 6.0, 7.0], closed),
            0.0,
            np.interp(time, [2.0, 3.0, 4.0, 5.0, 6.0], [0.0, 0.05, 0.05, -0.12, -0.1202]),
        )

    turn = Rotation(axis, (1.0, 0.0, 0.0), lambda time: np.interp(time, [3.0, 4.0], [0.0, 0.5 * np.pi]))
    contacts = [
        Contact("left", 0.5, foundation=Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), motion=jaw(1.0), rotation=turn),
        Contact("right", 0.5, foundation=Plane((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0)), motion=jaw(-1.0), rotation=turn),
        Contact("front", 0.5, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
    ]
    problem = ContactProblem(
        moved(box((0.1, 0.1, 0.1), (2, 2, 2)), (0.0, 0.0, 0.1)),
        RUBBER,
        [],
        contacts,
        body_force=tuple(weight / 1e-3 * np.array(down)),
        body_force_amplitude=[(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)],
        kinematics="large",
    )
    steps = list(LoadHistory([1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0]).steps(problem))
    assert all(step.solution.valid for step in steps)
    for step, angle in zip(steps[1:5], (0.0, 0.0, 0.25 * np.pi, 0.5 * np.pi), strict=True):
        answer, surface = step.solution, step.solution.problem.surface
        for part in range(2):
            assert answer.at_nodes.totals(part)["force"][1:] == pytest.approx([0.0, 0.5 * weight], abs=1e-6 * weight)
        jaws = surface.part < 2
        arms = surface.x[jaws] - axis - answer.problem.motions[0]
        moment = np.cross(arms, answer.force_on_body[jaws]).sum(axis=0)
        torque = answer.problem.comm.allreduce(moment)[0]
        assert torque == pytest.approx(0.02 * np.cos(angle) * weight, abs=1e-4 * 0.02 * weight)
    put, let_go = (step.solution for step in steps[-2:])
    assert let_go.at_nodes.totals(2)["force"] == pytest.approx([0.0, 0.0, weight], abs=1e-6 * weight)
    assert let_go.at_nodes.totals(0)["normal_force"] == let_go.at_nodes.totals(1)["normal_force"] == 0.0
    shift = (let_go.displacement - put.displacement).mean(axis=0)
    assert np.abs(shift[:2]).max() < 1e-6


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


@pytest.mark.parametrize("on", ["body", "foundation"])
def test_a_step_that_fails_where_a_block_slides_off_says_so(on):
    """A block, pressed down by its weight, is pushed over an edge at x = 0.04 by more than half of its length, beyond
    which it tips over; the words were of a stiffness that is not positive definite, or of weights of pairs."""
    block = moved(box((0.04, 0.04, 0.02), (4, 1, 1)), (0.0, 0.0, 0.02))
    if on == "body":
        mesh, of, what = (
            join(up=block, low=moved(box((0.08, 0.06, 0.02), (3, 1, 1)), (-0.04, -0.01, 0.0))),
            "up:",
            "low:top",
        )
        supports, contact = [Clamp("low:bottom")], Contact("up:bottom", 0.3, against="low:top")
    else:
        mesh, of, what, supports = block, "", "its foundation", []
        edge = SignedDistance(lambda x: np.maximum(x[2] - 0.02, x[0] - 0.04))
        contact = Contact("bottom", 0.3, foundation=edge)
    push = PrescribedDisplacement(f"{of}left", (0.06, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), (2.0, 1.0)])
    weight = TotalForce(f"{of}top", (0.0, 0.0, -2.0), amplitude=[(0.0, 0.0), (1.0, 1.0)])
    supports += [push, Clamp(f"{of}left", "y")]
    problem = ContactProblem(mesh, RUBBER, supports, contact, [weight], kinematics="large")
    words = (
        rf"failed.*: '{of}bottom' slides off '?{what}'?, .* along a line alone, by x = \(0\.0(3\d+|4), 0\.02, .*\) m; "
    )
    with pytest.raises(StepFailed, match=words):
        list(LoadHistory([1.0, 1.2, 1.3, 1.5, 2.0], halvings=2).steps(problem))


RAMP = [(0.0, 0.0), (1.0, 1.0)]
PUSHED = (
    ([], Contact("bottom", 0.3)),
    [TotalForce("top", (0.0, 0.0, -100.0)), TotalForce("top", (60.0, 0.0, 0.0), amplitude=RAMP)],
    [1.0],
    "at the place where the step begins there is no equilibrium: loads push the body along x with 60 N; "
    "friction holds at most 30 N; ",
)
PRESSED_IN = (
    ([Clamp("top")], Contact("bottom", 0.3, gap=-0.06, gap_amplitude=RAMP)),
    [],
    [0.5, 1.0],
    "the interference of 'bottom' grows from 30 mm to 60 mm in the step: ",
)
GRIPPED = (
    (
        [Clamp("front", "y")],
        [
            Contact(face, 0.3, foundation=Plane((x, 0, 0), (n, 0, 0)), gap=-0.002, gap_amplitude=[(0, 0), (0.1, 1)])
            for face, x, n in (("left", 0.0, 1.0), ("right", 0.1, -1.0))
        ],
    ),
    [TotalForce("top", (0.0, 0.0, 150.0), amplitude=[(0.1, 0.0), (1.0, 1.0)])],
    [0.1, 0.8, 1.0],
    "99% of the friction of 'left' is used up where the step begins; 99% of the friction of 'right' is used up",
)


@pytest.mark.parametrize("given", [PUSHED, PRESSED_IN, GRIPPED], ids=["pushed", "pressed in", "gripped"])
def test_a_step_that_fails_says_what_holds_too_little_or_presses_too_far(given):
    """A block that is pushed along a floor by more than friction holds; an interference that becomes larger than the
    block; a block between jaws, pulled out.  The words were of residuals and stiffness alone."""
    (supports, contacts), loads, times, words = given
    problem = ContactProblem(box((0.1, 0.1, 0.05), (1, 1, 1)), RUBBER, supports, contacts, loads, kinematics="large")
    with pytest.raises(StepFailed, match=f"failed: {words}"):
        list(LoadHistory(times, halvings=0).steps(problem))
