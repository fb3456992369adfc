"""Stability of equilibria of large motions: Euler's loads of a column, and the stable branch beyond them."""

import numpy as np
import pytest

import coulomb
from coulomb.kinematics import NeoHookean, StVenantKirchhoff


def column(friction=0.5, **settings):
    """Clamped below, pressed by a rough plate by 1 % of its length in 1 s."""
    return coulomb.ContactProblem(
        coulomb.box((0.1, 0.1, 1.0), (1, 1, 6), degree=2),
        NeoHookean(1e6, 0.0),
        [coulomb.Clamp("bottom")],
        coulomb.Contact(
            "top",
            friction=friction,
            foundation=coulomb.Plane((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)),
            motion=lambda time: (0.0, 0.0, -0.01 * time),
        ),
        kinematics="large",
        **settings,
    )


EULER = np.pi**2 / 12.0
"""Strain in per cent at Euler's load of a column of 10 : 1 whose ends do not turn and whose top is free to move along
the plate; where the top is held it is four times this."""


def test_a_column_is_stable_up_to_eulers_loads():
    """With the finite strain and the shear of a column that is not thin, 12 % are left to the formula."""
    times = np.array([0.88, 1.12, 3.52, 4.48]) * EULER
    found = [step.solution for step in coulomb.LoadHistory(list(times)).steps(column())]
    counts = [(one.small_strain.unstable, one.small_strain.by_friction) for one in found]
    assert counts == [(0, 0), (0, 2), (0, 2), (2, 0)]
    assert [one.valid for one in found] == [True, True, True, False]
    assert [one.certificate.passed for one in found] == 4 * [True]
    assert "unstable in 2 directions" in found[-1].outside[0]
    mode, place = found[-1].stability.mode, column().elasticity.x
    middle = np.isclose(place[:, 2], 0.5)
    sideways = np.linalg.norm(mode[:, :2], axis=1)
    assert sideways.max() == pytest.approx(1.0, rel=1e-6) and sideways[middle].min() > 0.95
    slope = np.pi * 0.05 * np.sqrt(2.0)  # of (1 - cos 2 pi z) / 2, at an edge of the column where it bends to a corner
    assert np.abs(mode[:, 2]).max() < slope and sideways[np.isclose(place[:, 2], 1.0)].max() < 1e-3


def test_without_friction_nothing_holds_a_column_beyond_eulers_load():
    """A rough plate holds its top aside, a smooth one does not."""
    steps = coulomb.LoadHistory([0.88 * EULER, 1.12 * EULER]).steps(column(friction=0.0))
    below, beyond = (step.solution for step in steps)
    assert below.valid and below.small_strain.unstable == 0
    assert not beyond.valid and beyond.certificate.passed and beyond.small_strain.unstable == 2
    mode, top = beyond.stability.mode, np.isclose(beyond.problem.elasticity.x[:, 2], 1.0, atol=0.05)
    assert np.linalg.norm(mode[top, :2], axis=1).min() > 0.99  # it sways


def test_what_is_stable_without_contact_is_not_looked_at_again():
    """Also on a curved foundation, whose normal forces are part of the tangent."""
    block = coulomb.ContactProblem(
        coulomb.box((1.0, 0.5, 0.5), (2, 1, 1)),
        NeoHookean(1e6, 0.3),
        [coulomb.PrescribedDisplacement("top", (0.0, 0.0, -0.02))],
        coulomb.Contact("bottom", friction=0.3, foundation=coulomb.Cylinder((0.5, 0.0, -2.0), (0.0, 1.0, 0.0), 2.0)),
        kinematics="large",
    )
    (answer,) = (step.solution for step in coulomb.LoadHistory([1.0], halvings=0).steps(block))
    assert np.any(answer.problem.geometric(answer.contact_force))
    assert answer.methods["definite"] and block.large.remedy == 0
    assert answer.problem.stability(answer.contact_force).unstable == 0  # by its inertia


def test_the_stable_branch_beyond_eulers_load_carries_less():
    """Pressed at once by 1.1 times the strain at which it buckles with its top held: it bends, and carries nearly
    Euler's load 4 pi^2 E I/L^2, of which shear takes a few per cent."""
    history = coulomb.LoadHistory([4.5 * EULER])
    (straight,) = (step.solution for step in history.steps(column()))
    (bent,) = (step.solution for step in history.steps(column(branch="stable")))
    assert not straight.valid and bent.valid and bent.small_strain.unstable == 0
    sideways = [np.linalg.norm(one.displacement[:, :2], axis=1).max() for one in (straight, bent)]
    carried = [-one.force_on_body[:, 2].sum() for one in (straight, bent)]
    euler = 4.0 * np.pi**2 * 1e6 * 0.1**4 / 12.0
    assert sideways[0] < 1e-2 < 3e-2 < sideways[1]
    assert carried[0] > 1.1 * euler and 0.93 * euler < carried[1] < euler
    with pytest.raises(ValueError, match='branch must be "any"'):
        column(branch="best")


def test_a_beam_that_slips_off_a_cylinder_snaps_back_and_is_free():
    """The cylinder bends it aside until its end slips off; from there no equilibrium is near, and the one that is left
    has no forces: what is no more than rounding errors of 1 + grad u is balanced."""
    beam = coulomb.moved(coulomb.box((0.1, 0.1, 1.0), (2, 1, 12)), translate=(0.0, 0.0, -1.0))
    problem = coulomb.ContactProblem(
        beam,
        StVenantKirchhoff(1e6, 0.3),
        [coulomb.Clamp("top"), coulomb.Clamp("front", components="y"), coulomb.Clamp("back", components="y")],
        coulomb.Contact(
            "left",
            friction=0.3,
            foundation=coulomb.Cylinder((-0.17, 0.0, -0.97), (0.0, 1.0, 0.0), 0.15),
            motion=lambda time: (0.9 * time, 0.0, 0.0),
        ),
        kinematics="large",
    )
    history = coulomb.LoadHistory([0.1, 0.2, 0.4, 1.2], halvings=4)
    steps = [step.solution for step in history.steps(problem)]
    pushed = [one.force_on_body[:, 0].sum() for one in steps]
    aside = [np.abs(one.displacement[:, 0]).max() for one in steps]
    assert max(pushed) > 1.0 and max(aside) > 0.1
    assert steps[-1].valid and pushed[-1] == 0.0 and np.abs(steps[-1].displacement).max() < 1e-8
