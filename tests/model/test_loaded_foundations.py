"""Foundations under a given force and moment: formulas, the same foundation with the motion given, words."""

from dataclasses import replace

import numpy as np
import pytest

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    NeoHookean,
    NoEquilibrium,
    Plane,
    Rotation,
    Sphere,
)
from coulomb.io.summary import remarks
from coulomb.model.certificate import judge

TOP = Plane((0.5, 0.5, 0.5), (0.0, 0.0, -1.0))
LOAD = 1e6


def block(contact, young=1e9, poisson=0.3, degree=1, clamps=("bottom",), kinematics="small"):
    mesh = coulomb.box((1.0, 1.0, 0.5), (4, 3, 2) if kinematics == "small" else (3, 2, 1), degree=degree)
    if kinematics == "large":
        return ContactProblem(mesh, NeoHookean(young, poisson), [Clamp("bottom")], contact, kinematics=kinematics)
    return ContactProblem(mesh, Material(young, poisson), [Clamp(face) for face in clamps], contact)


def tool(friction=0.2, foundation=TOP, **given):
    return Contact("top", friction, foundation=foundation, **given)


def off(one, other):
    """The largest difference of contact forces over the largest of them."""
    most = [np.abs(values).max() for values in (one.force_on_body - other.force_on_body, one.force_on_body)]
    return most[0] / most[1]


def with_its_motion(solution, contact):
    """The answer of the same foundation that is moved in one load step as it was found to move."""
    (found,) = solution.loaded_foundations
    given = replace(contact, force=(None,) * 3, moment=(None,) * 3, force_point=None)
    if angle := float(np.linalg.norm(found.rotation)):
        point, ways = tuple(found.point - found.translation), [(0.0, 0.0), (1.0, angle)]
        given = replace(given, rotation=Rotation(point, tuple(found.rotation), ways))
    given = replace(given, motion=[(0.0, 0.0, 0.0, 0.0), (1.0, *found.translation)])
    (step,) = LoadHistory([1.0], tolerance=1e-11).steps(block(given))
    return step.solution


def test_a_column_and_its_bending():
    """d = F l/(E A) and theta = M l/(E I), without Poisson's effect, for a strain of 1e-7."""
    young, force, moment = 1e6, 0.1, 0.005
    contact = tool(0.0, force=(None, None, -force), moment=(None, moment, None))
    answer = block(contact, young, 0.0, degree=2).solve(1e-11)
    (found,) = answer.loaded_foundations
    assert answer.valid and found.translation[2] == pytest.approx(-force * 0.5 / young, rel=1e-6)
    assert found.rotation[1] == pytest.approx(moment * 0.5 / (young / 12.0), rel=1e-6)
    assert np.allclose(found.force, [0.0, 0.0, force], atol=1e-6 * force)
    assert np.allclose(found.moment, [0.0, -moment, 0.0], atol=1e-8 * force)
    assert answer.forces["centre_of_pressure"][0] == pytest.approx(0.5 + moment / force, rel=1e-6)
    aside = replace(contact, moment=(None, 0.0, None), force_point=(0.55, 0.5, 0.5))  # the same by an eccentric force
    (same,) = block(aside, young, 0.0, degree=2).solve(1e-11).loaded_foundations
    assert np.allclose(same.rotation, found.rotation, rtol=1e-6)


BALL = Sphere((0.45, 0.5, 50.5), 50.0)


@pytest.mark.parametrize(
    "contact",
    [
        tool(force=(None, None, -LOAD)),
        tool(force=(1e5, 0.0, -LOAD), moment=(0.0, 0.0, 0.0), force_point=(0.55, 0.47, 0.5)),
        tool(force=(None, None, -LOAD), foundation=BALL),
        tool(force=(None, None, -LOAD), moment=(0.0, 0.0, None), foundation=BALL),
    ],
    ids=["punch", "free punch", "ball", "ball that rolls"],
)
def test_the_same_as_with_the_motion_given(contact):
    """To 1e-8 of the largest force; slip along the foundation counts from where it was before the load."""
    answer = block(contact).solve(1e-11)
    assert answer.valid and answer.certificate["foundation balance"].value < 1e-9
    assert answer.force_on_body[:, 2].sum() == pytest.approx(contact.force[2], rel=1e-9)
    assert off(answer, with_its_motion(answer, contact)) < 1e-8


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_a_tilted_tool_in_a_history(kinematics):
    """Steps that are those of the motion found, given; in large motions by 7 % of the height and 3 degrees."""
    young, ways = 1e9 if kinematics == "small" else 8e6, [(0.0, 0.0), (1.0, 1.0), (2.0, 0.4)]
    contact = tool(force=(1e5, None, -LOAD), moment=(None, 0.0, None), force_amplitude=ways)
    steps = list(LoadHistory([1.0, 2.0], tolerance=1e-11).steps(block(contact, young, kinematics=kinematics)))
    found = [step.solution.loaded_foundations[0] for step in steps]
    point = tuple(found[0].point - found[0].translation)
    angles = [(0.0, 0.0), *((float(k), one.rotation[1]) for k, one in enumerate(found, 1))]
    motion = [(0.0, 0.0, 0.0, 0.0), *((float(k), *one.translation) for k, one in enumerate(found, 1))]
    given = tool(motion=motion, rotation=Rotation(point, (0.0, 1.0, 0.0), angles))
    others = list(LoadHistory([1.0, 2.0], tolerance=1e-11).steps(block(given, young, kinematics=kinematics)))
    for step, other in zip(steps, others, strict=True):
        assert step.solution.valid and off(step.solution, other.solution) < 1e-8
        assert step.state.energy.foundation == pytest.approx(other.state.energy.foundation, rel=1e-7)
    assert steps[1].solution.force_on_body[:, 0].sum() == pytest.approx(0.4e5, rel=1e-8)


def test_friction_holds_the_tool_up_to_its_bound():
    answer = block(tool(force=(0.99 * 0.2 * LOAD, 0.0, -LOAD))).solve()
    assert answer.valid and answer.forces["friction_force"] == pytest.approx(0.99 * 0.2 * LOAD, rel=1e-6)
    with pytest.raises(NoEquilibrium, match="the foundation of 'top' along x with 202 kN; friction holds at most 200"):
        block(tool(force=(1.01 * 0.2 * LOAD, 0.0, -LOAD))).solve()
    with pytest.raises(NoEquilibrium, match="nothing holds the foundation of 'top' against loads of 1 kN along z"):
        block(tool(force=(None, None, 1e3))).solve()
    aside = tool(force=(None, None, -LOAD), moment=(None, 0.0, None), force_point=(1.1, 0.5, 0.5))
    with pytest.raises(NoEquilibrium, match="nothing holds the foundation of 'top': it spins about y"):
        block(aside).solve()


def test_what_nothing_resists_is_named():
    """A plane without friction, free along itself; and a block that its tool alone holds on the floor."""
    free = block(tool(0.0, force=(0.0, 0.0, -LOAD))).solve()
    (said,) = remarks(free)
    assert free.valid and "nothing resists that the foundation of 'top' moves along x, nor that" in said
    floor = Contact("bottom", 0.3)
    held = block([floor, tool(force=(0.2e5, None, -LOAD), moment=(None, 0.0, None))], clamps=())
    answer = held.solve()
    assert answer.valid and not remarks(answer)
    assert answer.forces["bottom"]["force"] == pytest.approx([-0.2e5, 0.0, LOAD], rel=1e-6, abs=1e-6 * LOAD)


def test_the_certificate_knows_the_force():
    answer = block(tool(force=(None, None, -LOAD))).solve()
    e = answer.evidence
    more = replace(e, on_foundations=e.on_foundations * [1.0, 1.0, 1.0 + 1e-5])
    failing = [check.name for check in judge(more).checks if not check.passed]
    assert answer.valid and failing == ["foundation balance"]


def test_words():
    for given, said in (
        ({"force": 500.0}, "three numbers along x, y and z"),
        ({"force": (0.0, float("nan"), 1.0)}, "three numbers along x, y and z"),
        ({"force_amplitude": [(0.0, 0.0), (1.0, 1.0)]}, "go with a force or moment"),
        ({"moment": (0.0, 0.0, 0.0), "rotation": Rotation((0, 0, 0), (0, 0, 1), 0.1)}, "given rotation, or turns"),
        ({"force": (None, None, -1.0), "force_point": (0.0, 1.0)}, "force_point must be three finite numbers"),
    ):
        with pytest.raises(ValueError, match=said):
            tool(**given)
    with pytest.raises(ValueError, match="force is for rigid foundations"):
        Contact("top", 0.2, against="bottom", force=(None, None, -1.0))
