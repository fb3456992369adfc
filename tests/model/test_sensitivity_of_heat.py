"""Derivatives with heat: temperatures follow from contact and cause it, and heat flows are totals."""

from dataclasses import replace

import numpy as np
import pytest

import coulomb
from coulomb import HeatLoad, Material, ThermalContact
from coulomb.case.case import read_case
from coulomb.case.scaled import NotScaled, scaled
from coulomb.cli.bars import TaylorTest


def two_bars(thermal, hot=1.0, young=1.0, friction=1.0, pushed=1.0, expansion=1.0, flux=1e4):
    """A bar on another one, hot above: pushed aside, it rubs, conducts by its pressure, and expands."""
    lower = coulomb.box((0.02, 0.02, 0.05), (2, 1, 2))
    upper = coulomb.moved(coulomb.box((0.02, 0.02, 0.03), (2, 2, 1)), (0.0, 0.0, 0.05))
    way = (3e-5 * pushed, 0.0, -1e-5 * pushed)
    return coulomb.ContactProblem(
        coulomb.join(lower=lower, upper=upper),
        {
            "lower": Material(2e11, 0.3, expansion=1.2e-5 * expansion, conductivity=50.0),
            "upper": Material(7e10 * young, 0.3, expansion=2.3e-5 * expansion, conductivity=200.0),
        },
        [coulomb.Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", way, amplitude=[(0, 0), (1, 1)])],
        coulomb.Contact("upper:bottom", 0.3 * friction, against="lower:top", thermal=thermal),
        heat=[
            HeatLoad("lower:bottom", temperature=20.0),
            HeatLoad("upper:top", temperature=20.0 + 100.0 * hot, amplitude=[(0, 0), (1, 1)]),
            HeatLoad("upper:left", flux=flux),
        ],
        reference_temperature=20.0,
    )


def flows(answer):
    return {one.name: one.power for one in answer.heat.flows}


def test_in_series_heat_is_by_resistances():
    """q = dT/(R + 1/h): dq/dlog h = q (1/h)/(R + 1/h), dq/dlog dT = q, and nothing else matters without expansion."""
    bars = two_bars(ThermalContact(conductance=2e3), expansion=0.0, flux=0.0, friction=0.0)
    (step,) = coulomb.LoadHistory([1.0], tolerance=1e-11).steps(bars)
    resistance = 0.05 / 50.0 + 1.0 / 2e3 + 0.03 / 200.0
    q = 100.0 / resistance * 4e-4
    expected = {"temperature on 'upper:top'": q, "conductance of 'upper:bottom'": q / 2e3 / resistance}
    found = {one.name: one.others["heat_flows"] for one in step.solution.sensitivities()}
    assert expected.keys() <= found.keys() and "temperature on 'lower:bottom'" not in found
    for name, heat in found.items():
        into = heat["heat_temperature_upper:top"]["power"], -heat["heat_temperature_lower:bottom"]["power"]
        assert into == pytest.approx([expected.get(name, 0.0)] * 2, rel=1e-7, abs=1e-7 * q), name


def test_along_a_history_in_which_heat_and_contact_cause_each_other():
    """Of all inputs at once, each by a weight of its own, against central differences."""
    inputs = {
        "temperature on 'upper:top'": "hot",
        "young of 'upper'": "young",
        "conductance of 'upper:bottom'": "conductance",
        "friction of 'upper:bottom'": "friction",
        "prescribed displacements": "pushed",
    }
    weights = dict(zip(inputs.values(), np.linspace(1.0, -0.6, len(inputs)), strict=True))

    def steps(change=0.0):
        given = {name: 1.0 + change * weight for name, weight in weights.items()}
        better = given.pop("conductance")
        thermal = ThermalContact(conductance=1e3 * better, factor=2e4 * better, hardness=1e8)
        return coulomb.LoadHistory([0.5, 1.0], tolerance=1e-12).steps(two_bars(thermal, **given))

    found, h = [], 1e-3
    for step in steps():
        found = step.solution.sensitivities(found)
    with pytest.raises(ValueError, match="gradients are not known with heat"):
        step.solution.gradient()
    by = {one.name: one for one in found if one.name in inputs}
    assert by.keys() == inputs.keys() and min(one.step for one in found) > h
    more, less = ([step.solution for step in steps(change)][-1] for change in (h, -h))

    def along(of):
        return sum(weights[inputs[name]] * of(one) for name, one in by.items())

    change = (more.contact_force - less.contact_force) / (2.0 * h)
    assert along(lambda one: one.contact_force) == pytest.approx(change, abs=1e-5 * np.abs(change).max())
    for name in flows(more):
        change = (flows(more)[name] - flows(less)[name]) / (2.0 * h)
        value = along(lambda one, name=name: one.others["heat_flows"][name]["power"])
        assert value == pytest.approx(change, rel=1e-5, abs=1e-9)


CASE = """
reference_temperature = 20.0
[[body]]
name = "low"
box = [0.02, 0.02, 0.05]
cells = [1, 1, 1]
material = { young = 2e11, poisson = 0.3, expansion = 1e-5, conductivity = 50.0 }
[[body]]
name = "up"
box = [0.02, 0.02, 0.03]
cells = [1, 1, 1]
translate = [0.0, 0.0, 0.05]
material = { young = 7e10, poisson = 0.3, expansion = 2e-5, conductivity = 200.0 }
[[clamp]]
face = "low:bottom"
[[prescribed_displacement]]
face = "up:top"
value = [0.0, 0.0, -1e-5]
[[contact]]
face = "up:bottom"
against = "low:top"
friction = 0.3
thermal = { conductance = 1e3 }
[[heat]]
face = "low:bottom"
temperature = 25.0
[[heat]]
face = "up:left"
flux = 1e4
[[heat]]
face = "low:left"
film = 1e3
ambient = "30.0 + x"
[[heat]]
source = 1e5
body = "up"
[output]
sensitivity = true
"""


def test_inputs_of_heat_are_scaled_in_a_case(tmp_path):
    """Differences of temperatures from the reference, for Taylor tests of a case."""
    (tmp_path / "case.toml").write_text(CASE)
    case = read_case(tmp_path / "case.toml")
    names = ["temperature on 'low:bottom'", "heat flux on 'up:left'", "film on 'low:left'", "heat source of 'up'"]

    def given(of):
        conduction = of.problem().body.heat.conduction
        factors = conduction.factors(0.0)
        return conduction.heat(factors), conduction.prescribed(factors)

    heats, fixed = given(case)
    for number, name in enumerate(names):
        more, warmer = given(scaled(case, name, 1.5))
        assert more == pytest.approx(np.where(np.arange(4) == number, 1.5, 1.0)[:, None] * heats), name
        assert warmer == pytest.approx((1.5 if number == 0 else 1.0) * fixed), name
    for face in ("up:bottom", "low:top"):
        (contact,) = scaled(case, f"conductance of {face!r}", 1.5).problem().contacts
        assert contact.thermal.conductance == 1.5e3
    answer = case.problem().solve(tolerance=1e-12)
    verify, by = TaylorTest(case, answer), {one.name: one for one in answer.sensitivities()}
    assert verify.of(by[names[1]])["passed"]
    flows = {name: {"power": 2.0 * one["power"]} for name, one in by[names[1]].others["heat_flows"].items()}
    wrong = verify.of(replace(by[names[1]], others={"heat_flows": flows}))
    assert not wrong["passed"] and "heat flows" in wrong["words"]
    twice = case.model_copy(update={"heat": case.heat * 2})
    with pytest.raises(NotScaled, match="several"):
        scaled(twice, names[1], 1.5)
