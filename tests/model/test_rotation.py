"""Foundations that rotate: torque, power, slip and energy against formulas."""

import math

import numpy as np
import pytest
from rotating_foundations import CELLS, RUBBER, TABLE, disc, puck, steps

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Cylinder,
    Material,
    Plane,
    PrescribedDisplacement,
    Rotation,
    Sphere,
    Spring,
    box,
)
from coulomb.fem.geometry.obstacles import Moved, RigidMotion, Turn, moved

POINTS = np.random.default_rng(7).uniform(-1.0, 1.0, (20, 3))


def test_the_torque_of_a_disc_converges():
    """To 2/3 F N R, with the square of the cells."""
    errors = []
    for n in (4, 8):
        *_, last = steps(puck(n=n), [1.0, 1.2, 2.0])
        normal = last.row["normal_force"]
        errors.append(abs(last.row["bottom_torque"] / (-2 / 3 * 0.3 * normal * 0.05) - 1.0))
    assert errors[1] < 0.02 and errors[1] < 0.35 * errors[0]


@pytest.mark.parametrize("cell", CELLS)
def test_a_dead_weight_on_a_turntable(cell):
    """2/3 F W R up to the mesh; turned the other way, by an axis that points down, the torque has the same sign."""
    table = Contact("bottom", 0.3, foundation=TABLE, rotation=Rotation((0, 0, 5), (0, 0, -1), [(0, 0), (1, 7)]))
    mesh, guide = box((1.0, 1.0, 1.0), (6, 6, 2), cell, place=disc), Spring("top", (0.0, 0.0, 1e3))
    problem = ContactProblem(
        mesh, Material(1e7, 0.3), [Clamp("top", "xy")], table, body_force=(0, 0, -1e6), springs=[guide]
    )
    *_, last = steps(problem, [0.01, 0.5, 1.0])
    weight = -float(np.sum(problem.loading.load[:, 2]))
    assert last.row["normal_force"] == pytest.approx(weight, rel=1e-6)
    assert last.row["bottom_torque"] == pytest.approx(-2 / 3 * 0.3 * weight * 0.05, rel=0.05)
    assert last.row["moment_z"] == pytest.approx(-last.row["bottom_torque"] * -1.0, rel=1e-9)  # on the body, about +z


def test_steady_sliding_dissipates_torque_times_angle():
    """In one step of a radian, or of more than a turn: the arc counts, not the chord."""
    taken = steps(puck(angle=[(1, 0), (2, 0.5), (3, 1.5), (4, 10.0)]), [1.0, 2.0, 3.0, 4.0])
    for before, after, angle in ((taken[1], taken[2], 1.0), (taken[2], taken[3], 8.5)):
        lost = after.state.energy.dissipated - before.state.energy.dissipated
        done = after.state.energy.foundation - before.state.energy.foundation
        assert lost == pytest.approx(-after.row["bottom_torque"] * angle, rel=1e-4)
        assert done == pytest.approx(lost, rel=1e-4)


def test_energies_balance_to_second_order():
    """A puck that is pressed while it slides, both in proportion to time: friction does the work of the mean of its
    forces at both ends of a step, but in the first, in which the puck touches, that of its end: 1/n^2 too much in n."""
    found = []
    for count in (4, 8):
        problem = puck(n=4, angle=[(0, 0), (1, 0.5)])
        energy = steps(problem, np.linspace(0, 1, count + 1)[1:])[-1].state.energy
        assert energy.imbalance == pytest.approx(-energy.dissipated / (count**2 + 1), rel=1e-6)
        found.append(energy.imbalance)
    assert found[0] / found[1] == pytest.approx(4.0, rel=1e-6)


DRUM = Cylinder((0.3, 5.0, -1.0), (0, 1, 0), 0.8)
BALL = Sphere((0.3, 0.1, -1.0), 0.8)
AXES = [
    (DRUM, (0.3, -7.0, -1.0), (0, -3, 0)),
    (BALL, (0.3, 0.1, 4.0), (0, 0, 1)),
    (BALL, (0.3 - 2, 0.1 - 4, -1.0 - 6), (1, 2, 3)),
    (Plane((0, 0, 0.1), (0, 1, 1)), (5, 5, 5), (0, 1, 1)),
]


def by_angle(point, axis, angle, translation=(0.0, 0.0, 0.0)):
    axis = np.array(axis, dtype=float)
    return RigidMotion(np.array(translation), Turn(np.array(point, dtype=float), axis / np.linalg.norm(axis), angle))


@pytest.mark.parametrize(("foundation", "point", "axis"), AXES)
def test_a_rotated_surface_of_revolution_is_unchanged(foundation, point, axis):
    """The same object; with the formulas of a rotated foundation the same up to rounding."""
    motion = by_angle(point, axis, 0.7)
    assert moved(foundation, motion) is foundation
    turned = Moved(foundation, motion)
    assert turned.signed_distance(POINTS) == pytest.approx(foundation.signed_distance(POINTS), abs=1e-13)
    assert turned.normal(POINTS) == pytest.approx(foundation.normal(POINTS), abs=1e-13)


@pytest.mark.parametrize(
    ("foundation", "point", "axis"),
    [
        (DRUM, (0.3, 0.0, -0.999), (0, 1, 0)),
        (DRUM, (0.3, 0.0, -1.0), (0, 1, 1e-6)),
        (BALL, (0.3, 0.101, 4.0), (0, 0, 1)),
        (Plane((0, 0, 0.1), (0, 1, 1)), (5, 5, 5), (0, 1, 1.001)),
    ],
)
def test_any_other_surface_rotates(foundation, point, axis):
    turned = moved(foundation, by_angle(point, axis, 0.7))
    assert isinstance(turned, Moved)
    assert np.abs(turned.signed_distance(POINTS) - foundation.signed_distance(POINTS)).max() > 1e-8


def test_rotated_first_and_then_translated():
    """A ball off the axis goes round; its centre is where the formula says."""
    turned = moved(Sphere((3.0, 0.0, 0.5), 0.1), by_angle((1.0, 0.0, 0.0), (0, 0, 5), math.pi / 2, (0.0, 0.0, 7.0)))
    ball = Sphere((1.0, 2.0, 7.5), 0.1)
    assert turned.signed_distance(POINTS) == pytest.approx(ball.signed_distance(POINTS), abs=1e-13)
    assert turned.normal(POINTS) == pytest.approx(ball.normal(POINTS), abs=1e-13)


def test_material_passes_a_point_along_the_arc():
    """The velocity of a rigid motion, integrated at the points: axis and translation move linearly in time."""
    before, now = (
        by_angle((1, 2, 3), (1, -2, 2), 0.4, (1.0, 0.0, 0.0)),
        by_angle((1, 2, 3), (1, -2, 2), 9.4, (0.0, 1, 3)),
    )
    times, weights = np.polynomial.legendre.leggauss(8)
    expected = np.zeros_like(POINTS)
    for s, weight in zip(0.5 + 0.5 * times, 0.5 * weights, strict=True):
        centre = np.array([1, 2, 3]) + (1 - s) * before.translation + s * now.translation
        velocity = 9.0 * np.cross(np.array([1, -2, 2]) / 3.0, POINTS - centre) + now.translation - before.translation
        expected += weight * velocity
    assert now.since(before, POINTS) == pytest.approx(expected, abs=1e-12)


def test_a_rotation_far_away_is_a_translation():
    """Through a point at a distance of 1e6 m: the block is dragged straight, with the same forces and energies."""
    far = Rotation((0.05, 1e6, 0.0), (0, 0, 1), [(0, 0), (1, 0), (2, 0.02e-6)])
    straight = [(0, 0, 0, 0), (1, 0, 0, 0), (2, 0.02, 0, 0)]
    rows = []
    for options in ({"rotation": far}, {"motion": straight}):
        press = PrescribedDisplacement("top", (0, 0, -1e-3), "z", [(0, 0), (1, 1)])
        contact = Contact("bottom", 0.3, foundation=TABLE, **options)
        problem = ContactProblem(box((0.1, 0.05, 0.05), (4, 2, 2)), RUBBER, [press, Clamp("top", "xy")], contact)
        rows.append(steps(problem, [0.5, 1.0, 1.1, 2.0])[-1].row)
    for name in ("force_x", "force_z", "energy_foundation", "energy_dissipated", "energy_imbalance"):
        assert rows[0][name] == pytest.approx(rows[1][name], rel=1e-5), name
    assert rows[0]["bottom_torque"] == pytest.approx(-1e6 * rows[0]["force_x"], rel=1e-6)


def test_the_work_of_a_cam_is_that_of_its_torque():
    """An eccentric drum without friction lifts the block: the work of its rotation is elastic energy."""
    errors = []
    for count in (4, 8, 16):
        cam = Cylinder((0.05, 0.0, -0.5), (0, 1, 0), 0.5)
        rotation = Rotation((0.04, 0.0, -0.5), (0, 1, 0), lambda time: -0.3 * time)
        contact = Contact("bottom", 0.0, foundation=cam, rotation=rotation)
        problem = ContactProblem(box((0.1, 0.05, 0.05), (4, 2, 2)), RUBBER, [Clamp("top")], contact)
        taken = steps(problem, np.linspace(0, 1, count + 1)[1:])
        torque = np.array([0.0, *(step.row["bottom_torque"] for step in taken)])
        energy = taken[-1].state.energy
        work = np.sum(0.5 * (torque[1:] + torque[:-1])) * 0.3 / count  # angle falls: -torque * -0.3
        assert energy.foundation == pytest.approx(work, rel=1e-9)
        assert energy.dissipated == 0.0
        errors.append(abs(energy.imbalance) / energy.elastic)
    assert errors[0] < 0.1 and errors[1] < 0.7 * errors[0] and errors[2] < 0.7 * errors[1], errors


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (lambda: Rotation((0, 0, 0), (0, 0, 0), 1.0), "rotation: axis must not be zero"),
        (lambda: Rotation((0, 0, math.nan), (0, 0, 1), 1.0), "rotation: point must be three finite numbers"),
        (lambda: Rotation((0, 0, 0), (0, 1), 1.0), "rotation: axis must be three finite numbers"),
        (lambda: puck(angle=lambda t: math.inf), "contact: foundation: rotation: the angle at time 0 is inf"),
    ],
)
def test_wrong_rotations(rotation, message):
    with pytest.raises(ValueError, match=message):
        rotation()
