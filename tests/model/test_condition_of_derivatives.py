"""Where derivatives are near to those of no answer, of several, or on a border: condition, soft springs, holds."""

import numpy as np
import pytest

import coulomb
from coulomb.solvers import derivatives
from coulomb.solvers.semismooth_newton import SemismoothNewton


def pressed():
    """Clamped on the left, pressed and drawn: nodes that are open, stick and slip."""
    return coulomb.ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)),
        coulomb.Material(2.119e11, 0.277),
        [coulomb.Clamp("left")],
        coulomb.Contact("bottom", friction=0.3, gap=2e-6),
        [coulomb.Traction("top", (0.0, 1e7, -4e7)), coulomb.Traction("right", (2e7, 0.0, 0.0))],
    )


def leaning(friction=1.0):
    """A bar that leans by 20 degrees, lifted and pushed against its lean: it may stand free, stick, or slide."""

    def place(x):
        return np.stack([0.1 * x[0] + np.tan(np.radians(20.0)) * x[2], 0.1 * x[1], x[2]])

    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (1, 1, 8), place=place),
        coulomb.Material(1e9, 0.3),
        [coulomb.PrescribedDisplacement("top", (-3e-3, 0.0, 1e-3))],
        coulomb.Contact("bottom", friction),
        small_strain="warn",
    )


def test_where_the_answer_is_one_of_several(caplog):
    """Three valid ones: of that which slides the determinant is negative, which is said; its derivative is right."""
    found, solver = [], SemismoothNewton(1e-12)
    for pressed, friction in ((0.0, 0.0), (838.0, 0.5), (108.0, 1.0)):
        start = np.zeros((4, 3))
        start[::2, :2] = pressed, -friction * pressed
        found.append(leaning().solve(1e-12, solver, start=start.ravel()))
    assert all(one.valid for one in found) and [max(one.at_nodes.status) for one in found] == [0, 1, 2]
    assert [one.sensitivities()[0].condition.several for one in found] == [False, False, True]
    assert caplog.text.count("the problem has at least two other answers") == 1
    sliding, h = found[2], 1e-3
    assert sliding.gradient(displacement=sliding.displacement).condition.several
    more, less = (leaning(1.0 + d).solve(1e-12, solver, start=sliding.contact_force).forces for d in (h, -h))
    change = (more["normal_force"] - less["normal_force"]) / (2.0 * h)
    assert sliding.sensitivities()[0].totals["bottom"]["normal_force"] == pytest.approx(change, rel=1e-5)


def test_the_condition_of_the_equations(caplog, monkeypatch):
    """Of a block small, with A as a matrix and without it; where nodes of a rigid face touch, whose forces are
    undetermined one by one, there is a warning."""
    answer, found = pressed().solve(), []
    for formed in (4000, 0):
        monkeypatch.setattr(derivatives, "_FORMED", formed)
        found.append(answer.sensitivities()[0].condition)
    assert all(1.0 < one.number < 1e5 and not one.several for one in found) and not caplog.text
    monkeypatch.undo()
    rigid = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
        coulomb.Material(1e9, 0.3),
        [],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.TotalForce("top", (0.5e5, 0.0, -1e6))],
        rigid_faces=[coulomb.RigidFace("right", translation=(1e-4, None, None))],
    ).solve()
    assert rigid.sensitivities()[0].condition.number > 1e10
    assert "forces of single contact points are not determined" in caplog.text


def test_on_soft_springs_points_are_on_a_border_by_what_the_body_gives_way():
    """Of a corner 0.1 um apart, closer than the springs alone move by a part of 1e-9 of the forces: it is open, and
    nodes change their states as on stiffer springs, which matter by their softness."""

    def changes(softness):
        def posed(gap):
            return coulomb.ContactProblem(
                coulomb.box((1.0, 1.0, 0.5), (3, 3, 1)),
                coulomb.Material(2e11, 0.3),
                [],
                coulomb.Contact("bottom", 0.3, gap=lambda x: np.where((x[0] > 0.9) & (x[1] > 0.9), gap, 0.0)),
                [coulomb.Pressure("top", 1e7), coulomb.Traction("right", (1e6, 1e6, 0.0))],
                springs=[coulomb.Spring("top", 2e11 * softness)],
            ).solve(tolerance=1e-10)

        apart = posed(1e-3)
        corner = np.argmax(apart.at_nodes.x @ [1.0, 1.0, 0.0])
        answer = posed(apart.at_nodes.displacement[corner, 0] + 1e-7)
        found = answer.sensitivities()
        assert answer.at_nodes.status[corner] == 0 and all(one.border == 0 for one in found)
        return [one.step for one in found if "spring" not in one.name]

    assert changes(1e-8) == pytest.approx(changes(1e-4), rel=0.02)


def test_a_step_in_which_nothing_moves_leaves_sliding_points_on_a_border():
    """Held still after it has slid, a block has the derivatives of the step before, also as inputs fall."""
    problem = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)),
        coulomb.Material(1e9, 0.3),
        [coulomb.PrescribedDisplacement("top", (1e-2, 3e-3, 0.0), "xy", amplitude=[(0, 0), (1, 0), (2, 1), (3, 1)])],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.Pressure("top", 1e6, amplitude=[(0, 0), (1, 1), (3, 1)])],
    )
    found, slid = [], []
    for step in coulomb.LoadHistory([1.0, 2.0, 3.0], tolerance=1e-12).steps(problem):
        slid, found = found, step.solution.sensitivities(found)
    assert len(slid) == len(found) == 4
    for before, held in zip(slid, found, strict=True):
        assert held.border > 0 and held.step > 1e-3, held.name
        for side in (held, held.falling):
            assert side.step > 1e-3, held.name
            for of in ("contact_force", "displacement"):
                then = getattr(before, of)
                assert getattr(side, of) == pytest.approx(then, abs=1e-7 * np.abs(then).max()), (held.name, of)
