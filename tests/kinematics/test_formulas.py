"""Large motions against formulas of mechanics: belts, inclines, homogeneous strains; loads of rubber by themselves."""

import pytest
from rubber_blocks import RubberBlock

import coulomb
from coulomb.kinematics import LargeMotions


def answers(body, contacts, times, **history):
    problem = LargeMotions(body, contacts)
    return [step.solution for step in problem.steps(coulomb.LoadHistory(times, **history))]


def test_a_dead_load_in_an_energy_presses_with_its_force():
    """Its part of the tangent is none."""
    one = RubberBlock(held="front", components=(1,), also=[("left", 0)], loads={"top": lambda time: [0.0, 0.0, -2e5]})
    (answer,) = answers(one.body, coulomb.Contact("bottom", friction=0.0), [1.0])
    assert answer.valid
    assert answer.at_nodes.totals()["force"] == pytest.approx([0.0, 0.0, 2e5], abs=1e-3)
