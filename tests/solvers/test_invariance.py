"""The answer does not depend on the description of the problem: orientation, numbering, mirror image, units.

Each problem is solved to 1e-10; relative to the forces, two answers may differ by that times the amplification of the
problem, (1 + L)/m with the extreme eigenvalues L and m of A over its mean diagonal: below 1e3 here.  Ranks are in
tests/model/test_parallel.py.
"""

import functools

import numpy as np
import pytest
from conftest import STEEL, indentation

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Plane, Traction

AGREE = 1e-10 * 1e3


def random_rotation(seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return turn * np.linalg.det(turn)


def forces(problem, solution):
    """Nodal forces on the body and places, both (m, 3)."""
    return -problem.surface.vectors(solution.contact_force.reshape(-1, 3)), problem.surface.x


def sorted_by_place(force, x):
    return force[np.lexsort(x.round(6).T)]


def steps(**how):
    problem, history = indentation(**how)
    return list(history.steps(problem))


@functools.cache
def indented(cell="hexahedron"):
    """As it is in metres and newtons."""
    return steps(cell=cell)


def test_the_history_has_all_states_of_contact():
    """Contact and gap, stick and slip, and forces in all directions: otherwise the tests below prove little."""
    rows = [step.row for step in indented()]
    assert all(row["certified"] and row["open"] > 10 and row["slip"] > 1 for row in rows)
    assert sum(row["stick"] > 5 for row in rows) == 3 and rows[-1]["stick"] == 0
    assert min(abs(rows[-1][f"force_{axis}"]) for axis in "xy") > 0.05 * rows[-1]["normal_force"]
    problem = indented()[0].solution.problem
    eigenvalues = np.linalg.eigvalsh(problem.A.dense()) / problem.mean_compliance
    assert 1e-10 * (1.0 + eigenvalues[-1]) / eigenvalues[0] <= AGREE


def dragged(turn, cell):
    """The block of the benchmarks, p = 4, on its plane, turned in space."""
    return ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (12, 4, 4), cell, place=lambda x: turn @ x),
        STEEL,
        [Clamp("left")],
        Contact("bottom", friction=0.3, foundation=Plane((0.0, 0.0, 0.0), tuple(turn[:, 2]))),
        [Traction("top", tuple(turn @ (0.0, 1e7, -4e7))), Traction("right", tuple(turn @ (2e7, 0.0, 0.0)))],
    )


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_block_turned_in_space(cell):
    """Forces turn along; the tangents t1, t2, made from the coordinate axes, do not: the friction cone is round."""
    turn = random_rotation(2718)
    upright, turned = dragged(np.eye(3), cell).solve(1e-10), dragged(turn, cell).solve(1e-10)
    expected, _ = forces(upright.problem, upright)
    force, _ = forces(turned.problem, turned)
    assert np.linalg.norm(force - expected @ turn.T) <= AGREE * np.linalg.norm(expected)
    displacement = upright.displacement @ turn.T
    assert np.linalg.norm(turned.displacement - displacement) <= AGREE * np.linalg.norm(displacement)
    tangents = turned.problem.surface.frames[0] @ turn
    assert np.abs(np.abs(tangents) - np.eye(3)).max() > 0.1  # the tangents have not turned


def test_history_over_a_ball_turned_in_space():
    turn = random_rotation(1618)
    for plain, turned in zip(indented(), steps(turn=turn), strict=True):
        expected, _ = forces(plain.solution.problem, plain.solution)
        force, _ = forces(turned.solution.problem, turned.solution)
        assert np.linalg.norm(force - expected @ turn.T) <= AGREE * np.linalg.norm(expected)
        assert turned.state.energy.dissipated == pytest.approx(plain.state.energy.dissipated, rel=1e-6)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_other_numbering(cell):
    """The axes of the regular box in another order: other numbers of nodes, cells and facets, the same body."""
    for plain, other in zip(indented(cell), steps(order=(1, 2, 0), cell=cell), strict=True):
        force, x = forces(plain.solution.problem, plain.solution)
        renumbered, elsewhere = forces(other.solution.problem, other.solution)
        assert np.abs(x - elsewhere).max() > 0.1  # the numbering differs
        expected = sorted_by_place(force, x)
        difference = sorted_by_place(renumbered, elsewhere) - expected
        assert np.linalg.norm(difference) <= AGREE * np.linalg.norm(expected)


def test_mirror_image():
    """Ball and motion mirrored in the plane y = 1/2."""
    for plain, image in zip(indented(), steps(mirror=True), strict=True):
        force, x = forces(plain.solution.problem, plain.solution)
        mirrored, _ = forces(image.solution.problem, image.solution)
        expected = sorted_by_place(force * [1, -1, 1], np.array([0, 1, 0]) + x * [1, -1, 1])
        assert np.linalg.norm(sorted_by_place(mirrored, x) - expected) <= AGREE * np.linalg.norm(expected)


@pytest.mark.parametrize(("metre", "newton", "steps_off"), [(1e3, 1e-3, 1), (2.0**10, 2.0**-10, 0)])
def test_other_units(metre, newton, steps_off):
    """Other numbers, the same answer; a joule is a kN mm.

    With powers of two rounding is the same too, and so is every iteration count; with powers of ten rounding may move a
    last step over the tolerance.
    """
    for plain, other in zip(indented(), steps(metre=metre, newton=newton), strict=True):
        ours, theirs = plain.solution, other.solution
        force, displacement = theirs.contact_force / newton, theirs.displacement / metre
        assert np.linalg.norm(force - ours.contact_force) <= AGREE * np.linalg.norm(ours.contact_force)
        assert np.linalg.norm(displacement - ours.displacement) <= AGREE * np.linalg.norm(ours.displacement)
        assert abs(theirs.result.newton_steps - ours.result.newton_steps) <= steps_off
        mine, yours = plain.row, other.row
        for name in ("energy_foundation", "energy_elastic", "energy_dissipated"):
            assert yours[name] == pytest.approx(mine[name], rel=1e-6)
        assert yours["contact_area"] == pytest.approx(metre**2 * mine["contact_area"], rel=1e-9)
        assert yours["greatest_pressure"] == pytest.approx(newton / metre**2 * mine["greatest_pressure"], rel=1e-6)
