"""Supports at any angle that meet a contact face: planes of symmetry across it, guides at an angle to it.

At such nodes contact forces act on the free directions and on the support.
"""

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    LoadHistory,
    Plane,
    PrescribedDisplacement,
    Pressure,
    SuccessiveTresca,
    SymmetryPlane,
)
from coulomb.solvers import DirectSolver, IterativeSolver

CELLS = ("hexahedron", "tetrahedron")
ANGLE = np.deg2rad(30.0)
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE), 0.0], [np.sin(ANGLE), np.cos(ANGLE), 0.0], [0.0, 0.0, 1.0]])


def rubbed(turn, cell="hexahedron", comm=MPI.COMM_WORLD, **ways):
    """Half of a block, pressed on a floor, squeezed from its side and drawn along its plane of symmetry.

    The plane of symmetry is at right angles to the first column of `turn`.
    """
    box = coulomb.box((1.0, 0.6, 0.5), (4, 3, 3), cell, comm, place=lambda x: turn @ x)
    supports = [
        PrescribedDisplacement("top", (0.0, 0.0, -2e-4), "z", amplitude=[(0, 0), (1, 1)]),
        PrescribedDisplacement(
            "top", tuple(3e-4 * turn[:, 1]), direction=tuple(turn[:, 1]), amplitude=[(1, 0), (2, 1), (3, -1)]
        ),
        Clamp("top", direction=tuple(turn[:, 0])),
        SymmetryPlane("left"),
    ]
    squeeze = [Pressure("right", 2e7)]
    return ContactProblem(box, STEEL, supports, Contact("bottom", friction=0.3), squeeze, **ways)


def forces(step):
    """Places of the contact nodes and nodal forces on the body, both (m, 3)."""
    surface = step.solution.problem.surface
    return surface.x, step.solution.force_on_body


HISTORY = LoadHistory([1.0, 2.0, 3.0], tolerance=1e-10)


@pytest.mark.parametrize(("cell", "linear_solver"), [("hexahedron", IterativeSolver), ("tetrahedron", DirectSolver)])
def test_a_plane_of_symmetry_at_30_degrees_is_one_along_an_axis(cell, linear_solver):
    upright = list(HISTORY.steps(rubbed(np.eye(3), cell, linear_solver=DirectSolver)))
    turned = list(HISTORY.steps(rubbed(TURN, cell, linear_solver=linear_solver)))
    for one, other in zip(upright, turned, strict=True):
        (x, expected), (y, found) = forces(one), forces(other)
        assert one.solution.certificate.passed and other.solution.certificate.passed
        assert np.allclose(x @ TURN.T, y) and len(x) == 20
        assert np.abs(expected @ TURN.T - found).max() <= 1e-8 * np.abs(expected).max()
        for name in ("prescribed", "loads", "elastic", "dissipated"):
            before, after = getattr(one.state.energy, name), getattr(other.state.energy, name)
            assert abs(before - after) <= 1e-8 * one.state.energy.elastic
    assert upright[-1].state.energy.dissipated > 0.01 * upright[-1].state.energy.elastic


SLOPE = np.deg2rad(20.0)
EPSILON = 1e-4


def wedged(cell, friction, turn=None, comm=MPI.COMM_WORLD, **ways):
    """A block on a floor, its left side on a frictionless guide that is inclined by 20 degrees.

    With the pressure p on its other sides and pressed by the strain -p (1 - 2 nu)/E, the stress is -p everywhere if
    there is no friction; the edge between guide and floor does not move.
    """
    turn = np.eye(3) if turn is None else turn
    p = EPSILON * STEEL.young / (1.0 - 2.0 * STEEL.poisson)

    def place(x):
        return turn @ np.array([x[0] + np.tan(SLOPE) * x[2] * (1.0 - x[0]), x[1], x[2]])

    box = coulomb.box((1.0, 0.5, 0.4), (4, 2, 2), cell, comm, place=place)
    supports = [
        SymmetryPlane("front"),
        PrescribedDisplacement("top", tuple(-EPSILON * 0.4 * turn[:, 2]), direction=tuple(turn[:, 2])),
        Clamp("left", "normal"),
    ]
    floor = Contact("bottom", friction=friction, foundation=Plane((0.0, 0.0, 0.0), tuple(turn[:, 2])))
    loads = [Pressure(face, p) for face in ("right", "back")]
    return ContactProblem(box, STEEL, supports, floor, loads, **ways), p


@pytest.mark.parametrize(
    ("ways", "cell", "turned"),
    [
        ({}, "hexahedron", True),
        ({}, "tetrahedron", False),
        ({"explicit": False}, "tetrahedron", True),
        ({"explicit": False, "linear_solver": IterativeSolver}, "hexahedron", True),
    ],
)
def test_equal_pressure_between_a_floor_and_an_inclined_guide(cell, ways, turned):
    """Without friction every node of the floor has the pressure p, also those that the guide holds at 20 degrees."""
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0] if turned else np.eye(3)
    turn = turn * np.linalg.det(turn)
    problem, p = wedged(cell, 0.0, turn, **ways)
    solution = problem.solve(1e-9)
    assert solution.certificate.passed
    pressures = solution.contact_force[0::3] / problem.surface.area
    assert np.allclose(pressures, p, rtol=1e-6) and len(pressures) == 15
    on_guide = next(reaction for reaction in solution.reactions if reaction.name == "clamp_left")
    normal = turn @ np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    assert np.allclose(on_guide.force, p * 0.5 * 0.4 / np.cos(SLOPE) * normal, rtol=0.0, atol=1e-6 * p)


@pytest.mark.parametrize("cell", CELLS)
def test_a_block_between_a_rough_floor_and_an_inclined_guide(cell):
    """The forces of guide and floor follow from those of the rest by hand: the guide's along its normal, the floor's
    friction within its bound, and at its bound where the block slides."""
    problem, p = wedged(cell, 0.2)
    solution = problem.solve(1e-9)
    assert solution.certificate.passed
    by_name = {reaction.name: np.array(reaction.force) for reaction in solution.reactions}
    floor, side = solution.force_on_body.sum(axis=0), np.array([-p * 0.5 * 0.4, 0.0, 0.0])
    guide = -(side[0] + floor[0]) / np.cos(SLOPE)
    normal = np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    assert np.allclose(by_name["clamp_left"], guide * normal, rtol=0.0, atol=1e-7 * p)
    top = by_name["prescribed_displacement_top"]
    assert abs(top[2] + floor[2] - guide * np.sin(SLOPE)) <= 1e-7 * p
    assert floor[0] > 0.1 * floor[2]
    force = solution.contact_force.reshape(-1, 3)
    friction, away = np.hypot(force[:, 1], force[:, 2]), problem.surface.x[:, 0] > 0.3
    assert np.sum(away) == 9 and np.allclose(friction[away], 0.2 * force[away, 0], rtol=1e-6)


@pytest.mark.parametrize(("friction", "turned"), [(0.2, True), (0.6, False)])
def test_a_wedged_node_has_the_same_forces_by_every_solver(friction, turned):
    """Between guide and floor a sticking node carries no friction towards the guide: the law does not determine it."""
    turn = TURN if turned else np.eye(3)
    found = []
    for solver in (InteriorPoint(), SuccessiveTresca()):
        problem, _ = wedged("hexahedron", friction, turn)
        solution = problem.solve(1e-10, solver=solver)
        assert solution.certificate.passed
        found.append(solution.force_on_body @ turn)
    assert np.abs(found[0] - found[1]).max() <= 1e-7 * np.abs(found[0]).max()
    x = problem.surface.x @ turn
    sticks = np.linalg.norm(found[0][:, :2], axis=1) < 0.99 * friction * found[0][:, 2]
    edge = x[:, 0] < 1e-9
    assert np.any(edge & sticks) and np.abs(found[0][edge & sticks, 0]).max() <= 1e-12 * np.abs(found[0]).max()
