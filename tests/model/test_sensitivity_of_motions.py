"""Derivatives of answers of large motions and of foundations under load: against differences of answers, all inputs at
once, each by a weight of its own."""

import json
from functools import partial

import numpy as np
import pytest
from answer_differences import differs
from conftest import run_coulomb
from drawn_block import backwards, weights
from test_parallel_gradients import owed_by_name

import coulomb


def on_a_ball(friction=1.0, pressed=1.0, pulled=1.0, young=1.0, far=1.0, cells=(2, 2, 1), poisson=0.3):
    """A rubber block that is turned on a ball, which moves."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), cells),
        coulomb.NeoHookean(1e6 * young, poisson),
        [
            coulomb.PrescribedRotation("top", (0.4, 0.5, 0.5), (0.0, 0.1, 1.0), 0.1 * pulled, [(0, 0), (1, 1)], "free"),
            coulomb.PrescribedDisplacement(
                "top", (0.0, 0.0, -0.07 * pulled), "z", amplitude=[(0, 0), (1, 1), (2, 0.9)]
            ),
        ],
        coulomb.Contact(
            "bottom",
            friction=0.3 * friction,
            foundation=coulomb.Sphere((0.5, 0.5, -3.0), 2.99),
            motion=lambda t: far * np.array([0.02 * t * (2.0 - t), 0.0, 0.01 * t]),
        ),
        [coulomb.Pressure("right", 1e5 * pressed, amplitude=[(0, 0), (1, 1), (2, 0.8)])],
        kinematics="large",
        probes=[coulomb.Probe("below", (0.4, 0.3, 0.0))],
    )


def pressed_far(pressed=1.0, young=1.0, friction=1.0):
    """A column that only springs where contact presses make stable, which its supports carry along."""
    way = (0.02 * pressed, 0.0, -0.35 * pressed)
    return coulomb.ContactProblem(
        coulomb.box((0.3, 0.3, 1.0), (2, 2, 5)),
        coulomb.NeoHookean(1e6 * young, 0.45),
        [coulomb.PrescribedDisplacement("top", way, amplitude=[(0, 0), (1, 1)])],
        coulomb.Contact("bottom", friction=0.6 * friction),
        kinematics="large",
    )


def on_each_other(friction=1.0, pushed=1.0, lower=1.0, upper=1.0):
    """Two rubber blocks, which turn each other."""
    above = coulomb.moved(coulomb.box((0.8, 0.8, 0.4), (2, 2, 1)), translate=(0.13, 0.11, 0.5))
    way = (0.05 * pushed, 0.02 * pushed, -0.06 * pushed)
    return coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)), upper=above),
        {"lower": coulomb.NeoHookean(3e6 * lower, 0.3), "upper": coulomb.NeoHookean(1e6 * upper, 0.3)},
        [coulomb.Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", way, amplitude=[(0, 0), (1, 1)])],
        coulomb.Contact("upper:bottom", friction=0.3 * friction, against="lower:top"),
        kinematics="large",
    )


def hot_on_a_ball(friction=1.0, moved=1.0, young=1.0, hot=1.0):
    """A rubber block between its clamp and a ball, which expands by place."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)),
        coulomb.MooneyRivlin(2e5 * young, 1e5 * young, 1e6 * young, expansion=1e-3 * hot),
        [coulomb.PrescribedDisplacement("top", (0.05 * moved, 0.02 * moved, 0.0), amplitude=[(0, 0), (1, 1), (2, 2)])],
        coulomb.Contact("bottom", friction=0.4 * friction, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 3.0)),
        kinematics="large",
        temperature=lambda x: 60.0 + 30.0 * x[0] * x[2],
        temperature_amplitude=[(0, 0), (1, 1), (2, 0.9)],
    )


def under_a_tool(friction=1.0, pressed=1.0, young=1.0, pushed=1.0, far=1.0):
    """A block under a plane that comes down, tilts and is moved aside."""
    contact = coulomb.Contact(
        "top",
        friction=0.3 * friction,
        foundation=coulomb.Plane((0.0, 0.0, 0.5), (0.0, 0.0, -1.0)),
        force=(None, None, -2e5 * pressed),
        moment=(2e3 * pressed, 1e4 * pressed, None),
        force_point=(0.5, 0.5, 0.5),
        force_amplitude=[(0.0, 0.0), (1.0, 1.0), (2.0, 0.7)],
        motion=lambda t: far * np.array([0.01 * t * (2.0 - t), 0.0, 0.0]),
    )
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 2, 1)),
        coulomb.Material(1e7 * young, 0.3),
        [coulomb.Clamp("bottom")],
        contact,
        [coulomb.Pressure("right", 1e5 * pushed)],
        small_strain="warn",
        probes=[coulomb.Probe("above", (0.0, 1.0, 0.5))],
    )


@pytest.mark.parametrize(
    "make, times, inputs",
    [
        (
            on_a_ball,
            (0.5, 1.0),
            {
                "friction of 'bottom'": "friction",
                "pressure on 'right'": "pressed",
                "prescribed displacements": "pulled",
                "young": "young",
                "motion of the foundation of 'bottom'": "far",
            },
        ),
        (
            pressed_far,
            (0.5, 1.0),
            {"prescribed displacements": "pressed", "young": "young", "friction of 'bottom'": "friction"},
        ),
        (
            on_each_other,
            (1.0,),
            {
                "friction of 'upper:bottom'": "friction",
                "prescribed displacements": "pushed",
                "young of 'lower'": "lower",
                "young of 'upper'": "upper",
            },
        ),
        (
            hot_on_a_ball,
            (1.0, 2.0),
            {
                "friction of 'bottom'": "friction",
                "prescribed displacements": "moved",
                "temperature change": "hot",
                "young": "young",
            },
        ),
        (
            under_a_tool,
            (0.6, 1.2),
            {
                "friction of 'top'": "friction",
                "load on the foundation of 'top'": "pressed",
                "young": "young",
                "pressure on 'right'": "pushed",
                "motion of the foundation of 'top'": "far",
            },
        ),
    ],
)
def test_along_motions_they_are_those_of_central_differences(make, times, inputs):
    worst = differs(make, inputs, times)
    assert max(worst.values()) < 1e-6, worst


@pytest.mark.parametrize("make", [partial(on_a_ball, cells=(1, 1, 1), poisson=0.47), hot_on_a_ball])
def test_backwards_along_motions_they_agree_with_those_forward(make):
    """The adjoint, of the sum of a function over the steps, with what it owes to the loads as they are at each; volumes
    of cells change by their mean."""
    answers, forward, earlier = [], {}, []
    for step in coulomb.LoadHistory([1.0, 2.0], tolerance=1e-12).steps(make()):
        answers.append(step.solution)
        earlier, (of_x, of_u) = step.solution.sensitivities(earlier), weights(step.solution)
        for one in earlier:
            value = np.sum(of_x * one.contact_force) + np.sum(of_u * one.displacement)
            forward[one.name] = forward.get(one.name, 0.0) + value
    owed = dict[str, float]()
    for answer, gradient in backwards(answers):
        for name, part in owed_by_name(answer, gradient).items():
            owed[name] = owed.get(name, 0.0) + part
    known = {name: owed[name] for name in forward if not name.startswith("motion")}
    assert known == {name: pytest.approx(forward[name], rel=1e-6, abs=1e-3) for name in known}
    assert min(map(abs, known.values())) > 1.0
    with pytest.raises(ValueError, match="small strains alone"):
        gradient.places()


def test_along_a_support_that_begins():
    """From where the step before has left its nodes, which depends on the input as well."""

    def make(far=1.0):
        ways = [(0.0, 0.0), (3.0, 1.0)]
        return coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (3, 2, 1)),
            coulomb.Material(1e9, 0.3),
            [
                coulomb.PrescribedDisplacement("right", (0.02 * far, 0.0, 0.0), "x", amplitude=ways, end=1.0),
                coulomb.Clamp("left", "xy", end=1.0),
                coulomb.PrescribedDisplacement("top", (0.03 * far, 0.01 * far, -0.02 * far), amplitude=ways, begin=1.0),
            ],
            coulomb.Contact("bottom", friction=0.4 * far),
            [coulomb.Pressure("top", 1e6 * far)],
            small_strain="warn",
        )

    inputs = dict.fromkeys(("prescribed displacements", "friction of 'bottom'", "pressure on 'top'", "young"), "far")
    del inputs["young"]
    found = []
    times = [1.0, 2.0]
    for step in coulomb.LoadHistory(times, tolerance=1e-11).steps(make()):
        found = step.solution.sensitivities(found)
    along = sum(one.displacement for one in found if one.name in inputs)
    more, less = (
        [step.solution.displacement for step in coulomb.LoadHistory(times, tolerance=1e-11).steps(make(1.0 + h))][-1]
        for h in (1e-4, -1e-4)
    )
    assert along == pytest.approx((more - less) / 2e-4, abs=1e-6 * np.abs(along).max())


CASE = """
[mesh]
box = [1.0, 1.0, 0.5]
cells = [2, 2, 1]
[material]
law = "neo-hookean"
young = 1e7
poisson = 0.3
[[clamp]]
face = "bottom"
[contact]
face = "top"
friction = 0.3
foundation = { shape = "sphere", centre = [0.5, 0.5, 3.5], radius = 3.0 }
force = { z = -2e5 }
motion = [[0, 0, 0, 0], [1, 0.01, 0, 0]]
[history]
end = 1
steps = 1
[solver]
kinematics = "large"
[output]
picture = false
"""


def test_each_is_verified_on_the_command_line(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(CASE)
    run_coulomb("run", case, "--sensitivity", "--verify", cwd=tmp_path)
    (summary,) = (tmp_path / "results" / "steps").glob("*/summary.json")
    entries = {one["input"]: one for one in json.loads(summary.read_text())["sensitivity"]}
    inputs = {"friction of 'top'", "load on the foundation of 'top'", "motion of the foundation of 'top'"}
    assert set(entries) == inputs | {"young"}
    assert all(one["verified"]["passed"] for one in entries.values()), entries
    pressed = entries["load on the foundation of 'top'"]
    assert pressed["totals"]["top"]["force"][2] == pytest.approx(-2e5, rel=1e-6)
    assert pressed["loaded_foundations"]["top"]["translation"][2] < 0.0
