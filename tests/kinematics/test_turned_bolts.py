"""Bolts in large motions: formulas, small strains, and everything turned by a finite rotation."""

import json

import numpy as np
import pytest
from check_runs import made
from history_runs import TURNED_BOLT
from rubber_blocks import bolted_bar
from scipy.optimize import brentq

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Plane, Pretension
from coulomb.kinematics import StVenantKirchhoff

YOUNG, WIDE, LONG = 2e11, 0.01, 0.1
BOTTOM, TOP = ((WIDE, WIDE, 0.04), (2, 2, 2)), ((WIDE, WIDE, 0.06), (2, 3, 2))


def bar(supports, contact, bolt, cell="hexahedron", degree=1, **kinematics):
    law = StVenantKirchhoff(YOUNG, 0.0) if kinematics else coulomb.Material(YOUNG, 0.0)
    low, up = (coulomb.box(*one, cell, degree=degree) for one in (BOTTOM, TOP))
    both = coulomb.join(low=low, up=coulomb.moved(up, (0.0, 0.0, 0.04)))
    return ContactProblem(both, law, supports, contact, ties=[bolt], **kinematics)


FAR = Contact("low:left", 0.3, foundation=Plane((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
ENDS = [Clamp("low:bottom"), Clamp("up:top")]


@pytest.mark.parametrize(("cell", "degree", "force"), [("hexahedron", 1, 1e6), ("tetrahedron", 2, -1e5)])
def test_a_bar_between_two_clamps_has_the_stretch_of_the_force(cell, degree, force):
    """F = E A l (l^2 - 1) / 2 of St. Venant-Kirchhoff's law; at small forces the answer is that of small strains."""
    given = {"cell": cell, "degree": degree}
    solution = bar(ENDS, FAR, Pretension("up:bottom", "low:top", force=force), **given, kinematics="large").solve()
    (found,) = solution.bolts
    stretch = brentq(lambda one: 0.5 * YOUNG * WIDE**2 * one * (one**2 - 1.0) - force, 0.7, 2.0, xtol=1e-14)
    assert solution.valid and found.force == pytest.approx(force, rel=1e-9)
    assert found.shortening == pytest.approx(LONG * (stretch - 1.0), rel=1e-8)
    assert max(found.shear, found.bending / WIDE, abs(found.torsion) / WIDE) <= 1e-8 * abs(force)
    if degree == 1:
        weak = Pretension("up:bottom", "low:top", force=1e-6 * force)
        small, large = (bar(ENDS, FAR, weak, **kinematics).solve() for kinematics in ({}, {"kinematics": "large"}))
        size = np.abs(small.displacement).max()
        assert np.abs(large.displacement - small.displacement).max() < 1e-7 * size
        assert large.bolts[0].force == pytest.approx(small.bolts[0].force, rel=1e-9)


def test_a_locked_bolt_that_is_sheared_and_turned_by_30_degrees():
    """By rigid faces at its ends: forces turn, moments about the origin are in balance, nothing else changes."""
    problem, turned = bolted_bar()
    forces, energies = [], []
    for step in LoadHistory([1.0, 2.0, 3.0]).steps(problem):
        answer, time = step.solution, step.state.time
        R, ends, (bolt,) = turned(time), answer.rigid_faces, answer.bolts
        assert answer.valid and bolt.locked == (time > 1.0)
        assert answer.methods["linear_problems"] <= (3 if time == 1.0 else 6 if time == 2.0 else 8)
        if time == 1.0:
            shortened = bolt.shortening
            assert bolt.force == pytest.approx(500.0, rel=1e-9) and shortened > 0.04
        assert bolt.shortening == pytest.approx(shortened, rel=1e-9)
        assert np.abs(ends[0].force + ends[1].force).max() < 1e-8 * bolt.force
        moments = [one.moment + np.cross(one.point, one.force) for one in ends]
        assert np.abs(moments[0] + moments[1]).max() < 1e-8 * bolt.force  # without the levers of s n: 0.8 N m
        if time >= 2.0:
            energies.append(step.state.energy)
            forces.append([R.T @ ends[1].force, R.T @ ends[1].moment, [bolt.force, bolt.shear, bolt.bending]])
    assert np.linalg.norm(forces[0][0][:2]) > 10.0 and forces[0][2][1] > 1.0
    assert np.abs(np.array(forces[1]) - forces[0]).max() < 1e-8 * 500.0
    assert energies[1].elastic == pytest.approx(energies[0].elastic, rel=1e-9)
    assert energies[1].prescribed == pytest.approx(energies[0].prescribed, rel=1e-6)


def test_rows_of_a_turned_section_are_derivatives():
    """Of u_slave - W u - s n(u) with s given, by differences; a rigid motion turns it."""
    solid = bar((), FAR, Pretension("up:bottom", "low:top", force=1.0), kinematics="large").elasticity
    random = np.random.default_rng(5)
    u = 0.05 * LONG * random.standard_normal(solid.x.shape)
    u[solid.members[1].nodes, 2] -= 0.2 * LONG
    way = random.standard_normal(solid.x.shape)
    there, h = solid.constraints.at_place(solid.x + u, u), 1e-6 * LONG
    (bolt,), nodes = there.bolts_at(u), there.ties[0].nodes
    assert bolt.shortening == pytest.approx(0.2 * LONG, rel=0.3)

    def apart(u):
        (now,) = there.bolts_at(u)
        return (solid.reduction.apart(u))[nodes] - bolt.shortening * now.direction

    change = (apart(u + h * way) - apart(u - h * way)) / (2.0 * h)
    assert np.abs(there.reduction.apart(way)[nodes] - change).max() < 1e-7
    rigid = np.array([0.1, -0.2, 0.3]) + np.cross([3.0, 1.0, -2.0], solid.x + u)
    assert np.abs(there.reduction.apart(rigid)[nodes] - np.cross([3.0, 1.0, -2.0], apart(u))).max() < 1e-13


def test_a_strut_that_closes_a_gap():
    """A loose bolt that contact alone holds: s = -(gap + shortening of the bar)."""
    wall = Contact("up:top", 0.3, foundation=Plane((0.0, 0.0, LONG + 1e-3), (0.0, 0.0, -1.0)))
    problem = bar(ENDS[:1], wall, Pretension("up:bottom", "low:top", force=-1e5), kinematics="large")
    solution = problem.solve()
    stretch = brentq(lambda one: 0.5 * YOUNG * WIDE**2 * one * (one**2 - 1.0) + 1e5, 0.7, 1.0, xtol=1e-14)
    assert solution.valid and solution.bolts[0].force == pytest.approx(-1e5, rel=1e-9)
    assert solution.bolts[0].shortening == pytest.approx(-1e-3 - LONG * (1.0 - stretch), rel=1e-7)
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(1e5, rel=1e-9)


def test_a_case_whose_bolts_are_locked():
    run = made(TURNED_BOLT)
    steps = [json.loads((run / f"steps/000{k}/summary.json").read_text())["bolts"][0] for k in (1, 2)]
    assert steps[0]["force"] == pytest.approx(-2e8, rel=1e-8) and not steps[0]["locked"]
    assert steps[1]["locked"] and steps[1]["shear"] > 1e6
    assert steps[1]["shortening"] == pytest.approx(steps[0]["shortening"], rel=1e-9)


def test_bolts_that_cannot_be():
    bolt = Pretension("up:bottom", "low:top", force=1.0, lock=1.0)
    with pytest.raises(ValueError, match=r"at time 2 it is locked \(lock = 1\).*begin at the time of lock"):
        bar(ENDS, FAR, bolt, kinematics="large", time=2.0)
    problem = bar(ENDS, FAR, bolt, kinematics="large")
    with pytest.raises(ValueError, match="at time 2 it is locked"):
        problem.at(2.0).solve()
    block, far = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), Plane((-9.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    both = coulomb.join(low=block, up=coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), (0.7, 0.0, 1.0)))
    pair = Pretension("up:bottom", "low:top", slave=True, force=1.0)
    contact, law = Contact("low:left", 0.3, foundation=far), StVenantKirchhoff(YOUNG, 0.0)
    with pytest.raises(ValueError, match="nodes that follow the other side are on a line"):
        ContactProblem(both, law, [Clamp("low:bottom")], contact, ties=[pair], kinematics="large")
