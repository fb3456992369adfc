"""Nodes of contact faces whose displacement along the normal is prescribed are judged like others, on any number of
ranks: what holds them inside a foundation is refused, with face, number of nodes and depth."""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import same_error
from scipy.spatial.transform import Rotation
from user_forms import Script

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Pressure,
    RigidFace,
    Tied,
    Traction,
)
from coulomb.kinematics import NeoHookean
from coulomb.model.certificate import judge

RUBBER = Material(1e5, 0.3)
FLOOR = Contact("bottom", friction=0.3)
PRESSED = [Traction("top", (0.0, 0.0, -1e3))]
DEPTH = 0.01
TURN = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()


def cube(cells=3, **kind):
    return coulomb.box((1.0, 1.0, 1.0), (cells,) * 3, **kind)


def turned(**kind):
    return cube(place=lambda x: TURN @ x, **kind)


def push(vector=(0.0, 0.0, -DEPTH), **along):
    return PrescribedDisplacement("left", tuple(vector), **along)


def rising(to=DEPTH, **others):
    return Contact("bottom", friction=0.3, motion=[(0, 0, 0, 0), (1, 0, 0, to)], **others)


def own_forms():
    script = Script(cube(), 1)
    conditions = [script.bc((0.0, 0.0, -DEPTH), "left")]
    return ContactProblem(coulomb.Body(script.elasticity(1e5, 0.3), None, conditions, faces=script.mesh.faces), FLOOR)


CONTRADICTIONS = {
    "hexahedra": (4, lambda: ContactProblem(cube(), RUBBER, [push()], FLOOR)),
    "27-node hexahedra": (7, lambda: ContactProblem(cube(degree=2), RUBBER, [push()], FLOOR)),
    "10-node tetrahedra": (7, lambda: ContactProblem(cube(cell="tetrahedron", degree=2), RUBBER, [push()], FLOOR)),
    "one direction": (
        4,
        lambda: ContactProblem(cube(), RUBBER, [push(direction=(0, 0, 1)), Clamp("right", "xy")], FLOOR),
    ),
    "oblique": (4, lambda: ContactProblem(turned(), RUBBER, [push(TURN @ [0, 0, -DEPTH])], FLOOR)),
    "normals of the body": (
        4,
        lambda: ContactProblem(cube(), RUBBER, [push()], Contact("bottom", friction=0.3, normals="body")),
    ),
    "own forms": (4, own_forms),
    "floor": (4, lambda: ContactProblem(cube(), RUBBER, [Clamp("left")], rising(), time=1.0)),
    "interference": (4, lambda: ContactProblem(cube(), RUBBER, [Clamp("left")], Contact("bottom", 0.3, gap=-DEPTH))),
    "large motions": (4, lambda: ContactProblem(cube(), NeoHookean(1e5, 0.3), [push()], FLOOR, kinematics="large")),
    "rigid face": (
        4,
        lambda: ContactProblem(
            cube(),
            RUBBER,
            [Clamp("left")],
            FLOOR,
            rigid_faces=[RigidFace("right", translation=(None, None, -DEPTH), rotation=(0.0, 0.0, 0.0))],
        ),
    ),
    "rigid contact face": (
        16,
        lambda: ContactProblem(
            cube(),
            RUBBER,
            [Clamp("top")],
            FLOOR,
            rigid_faces=[RigidFace("bottom", translation=(None, None, -DEPTH), rotation=(0.0, 0.0, 0.0))],
        ),
    ),
    "whole face": (
        16,
        lambda: ContactProblem(cube(), RUBBER, [PrescribedDisplacement("bottom", (0, 0, -DEPTH))], FLOOR),
    ),
}


@pytest.mark.parametrize(("count", "make"), CONTRADICTIONS.values(), ids=CONTRADICTIONS)
def test_supports_that_hold_nodes_inside_are_refused_before_the_solve(count, make):
    error = same_error(lambda: make().solve())
    assert f"contact face 'bottom': supports, or what its nodes follow, hold {count} of its nodes inside" in error
    assert "up to 10 mm deep" in error


@pytest.mark.parametrize("large", [False, True])
def test_a_history_is_refused_before_its_first_step(large):
    material = NeoHookean(1e5, 0.3) if large else RUBBER
    kind = {"kinematics": "large"} if large else {}
    motion = [(0, 0, 0, 0), (1, 0, 0, 0), (2, 0, 0, DEPTH), (3, 0, 0, 0)]
    problem = ContactProblem(cube(), material, [Clamp("left")], Contact("bottom", 0.3, motion=motion), PRESSED, **kind)
    steps = LoadHistory([1.0, 1.5, 3.0]).steps(problem)
    assert "up to 5 mm deep at time 1.5" in same_error(lambda: next(steps))


def seven_digits(x):
    return np.round(3.0 * TURN @ x, 7)


TOUCHING = {
    "hexahedra": lambda: (cube(), Clamp("left"), FLOOR),
    "10-node tetrahedra": lambda: (cube(cell="tetrahedron", degree=2), Clamp("left"), FLOOR),
    "turned": lambda: (turned(), Clamp("left"), FLOOR),
    "seven digits": lambda: (cube(place=seven_digits), Clamp("left"), FLOOR),
    "lifted": lambda: (cube(), push((0.0, 0.0, DEPTH)), FLOOR),
    "floor lowered": lambda: (cube(), Clamp("left"), rising(-DEPTH)),
    "moved together": lambda: (cube(), push((0.0, 0.0, DEPTH)), rising()),
}


@pytest.mark.parametrize("make", TOUCHING.values(), ids=TOUCHING)
def test_held_nodes_that_touch_or_are_open_are_right(make):
    mesh, support, contact = make()
    load = [Pressure("top", 1e3)]
    assert ContactProblem(mesh, RUBBER, [support], contact, load, time=1.0).solve().certificate.passed


def test_the_certificate_measures_held_nodes_by_the_displacement_alone():
    """Independently of what is prescribed: held nodes of an answer are moved into the foundation."""
    answer = ContactProblem(cube(), RUBBER, [Clamp("left")], FLOOR, PRESSED).solve()
    problem, wrong = answer.problem, answer.displacement.copy()
    held = problem.elasticity.nodes("left", "test")
    wrong[held, 2] -= 1e-4
    certificate = judge(problem.evidence(answer.contact_force, wrong))
    assert not certificate["penetration"].passed
    assert certificate.penetration == pytest.approx(1e-4)
    assert "at a node that supports hold" in certificate["penetration"].meaning


def test_nodes_that_face_away_are_judged_as_well():
    """The upper half of a half ring that stands on a plane."""

    def ring(x):
        r, angle = 1.2 - x[2], x[0]
        return np.stack([r * np.sin(angle), x[1], -r * np.cos(angle)])

    mesh = coulomb.box((np.pi, 0.2, 0.2), (12, 1, 1), place=ring)
    floor = Contact("bottom", friction=0.3, foundation=Plane((0.0, 0.0, -1.2), (0.0, 0.0, 1.0)))
    problem = ContactProblem(mesh, RUBBER, [Clamp("right")], floor)
    u = np.zeros_like(problem.elasticity.x)
    u[problem.elasticity.x[:, 2] > 1.19, 2] = -2.5
    assert judge(problem.evidence(np.zeros(3 * len(problem.surface.nodes)), u)).penetration == pytest.approx(0.1)


def two_blocks():
    box = coulomb.box((1.0, 0.5, 0.5), (4, 3, 3))
    return coulomb.join(a=box, b=coulomb.moved(coulomb.box((1.0, 0.5, 0.5), (4, 3, 3)), (1.0, 0.0, 0.0)))


def tied(support):
    contact, tie = Contact("b:bottom", friction=0.3), Tied("b:left", "a:right", slave=True)
    load = [Traction("b:top", (0.0, 1e3, -2e3))]
    return ContactProblem(two_blocks(), RUBBER, [Clamp("a:left"), support], contact, load, ties=[tie])


def test_points_that_follow_clamped_nodes_are_no_contact_points():
    """Their rows of B T are zero: the run stagnated."""
    problem = tied(Clamp("a:right"))
    assert problem.unknowns["contact"] == 3 * 16
    answer = problem.solve()
    assert answer.valid and answer.at_nodes.totals()["normal_force"] > 0.0


def test_points_that_follow_pushed_nodes_are_refused():
    error = same_error(lambda: tied(PrescribedDisplacement("a:right", (0.0, 0.0, -1e-3))).solve())
    assert "contact face 'b:bottom'" in error and "hold 4 of its nodes inside" in error and "1 mm deep" in error


def test_points_of_a_rigid_face_whose_height_is_prescribed():
    """They were rows of zeros: an IndexError."""
    still = RigidFace("right", translation=(None, None, 0.0), rotation=(0.0, 0.0, 0.0))
    problem = ContactProblem(cube(), RUBBER, [Clamp("left")], FLOOR, PRESSED, rigid_faces=[still])
    assert problem.unknowns["contact"] == 3 * 8
    assert problem.solve().valid


def stacked(lift=0.0):
    """Two bars on each other, each tied at its left end to a clamped face; that of the upper one is lifted."""
    ends = {"a": (2, 0.0, 0.0), "b": (3, 1.0, 0.0), "c": (2, 0.0, 0.5), "d": (2, 1.0, 0.5)}
    bars = {
        name: coulomb.moved(coulomb.box((1.0, 0.5, 0.5), (2 * n, n, n)), (x, 0.0, z))
        for name, (n, x, z) in ends.items()
    }
    supports = [*map(Clamp, ("a:left", "c:left", "a:right")), PrescribedDisplacement("c:right", (0.0, 0.0, lift))]
    ties = [Tied("b:left", "a:right", slave=True), Tied("d:left", "c:right", slave=True)]
    contact = Contact("b:top", friction=0.3, against="d:bottom", slave=True)
    return ContactProblem(
        coulomb.join(**bars), RUBBER, supports, contact, [Traction("d:top", (0, 0, -50.0))], ties=ties
    )


def test_points_of_a_pair_that_nothing_can_move():
    """Both sides follow clamped nodes: the nodes beside them take their part of the face."""
    problem = stacked()
    assert problem.unknowns["contact"] == 3 * 24
    area = problem.comm.allreduce(float(problem.surface.area.sum()))
    assert area == pytest.approx(0.5)
    assert problem.solve().valid


@pytest.mark.parametrize("lift", [-DEPTH, DEPTH])
def test_faces_of_a_pair_that_are_held_inside_each_other_are_refused(lift):
    problem = stacked(lift)
    if lift > 0.0:
        assert problem.solve().valid
        return
    error = same_error(problem.solve)
    assert "contact face 'b:top'" in error and "hold 4 of its nodes inside 'd:bottom', up to 10 mm deep" in error


@pytest.mark.parametrize("to", [-DEPTH, 0.0])
def test_clamped_nodes_of_both_faces_of_a_pair(to):
    """A block that is held at its side is pushed into one that is held there, too."""
    lower, upper = cube(3), coulomb.moved(cube(2), (0.0, 0.0, 1.0))
    contact = Contact("lower:top", friction=0.3, against="upper:bottom", slave=True)
    supports = [Clamp("lower:left"), PrescribedDisplacement("upper:left", (0.0, 0.0, to))]
    load = [Traction("upper:top", (0.0, 0.0, -500.0))]
    problem = ContactProblem(coulomb.join(lower=lower, upper=upper), RUBBER, supports, contact, load)
    if to == 0.0:
        assert problem.solve().certificate.passed
        return
    error = same_error(problem.solve)
    assert "contact face 'lower:top'" in error and "hold 4 of its nodes inside 'upper:bottom', up to 10 mm" in error
    wrong = np.zeros_like(problem.elasticity.x)
    wrong[problem.elasticity.nodes("upper:left", "test"), 2] = -1e-3
    e = problem.evidence(np.zeros(3 * len(problem.surface.nodes)), wrong)
    assert problem.comm.allreduce(float(np.min(e.held_gap, initial=0.0)), op=MPI.MIN) == pytest.approx(-1e-3)


def test_a_slave_face_whose_height_is_prescribed_presses():
    """All of its nodes follow the motion of a rigid face: their rows of B T are those of the master."""
    lower, upper = cube(2), coulomb.moved(cube(2), (0.0, 0.0, 1.0))
    lifted = RigidFace("lower:top", translation=(None, None, DEPTH), rotation=(0.0, 0.0, 0.0))
    contact = Contact("lower:top", friction=0.3, against="upper:bottom", slave=True)
    supports = [Clamp("lower:bottom"), Clamp("upper:top")]
    mesh = coulomb.join(lower=lower, upper=upper)
    answer = ContactProblem(mesh, RUBBER, supports, contact, rigid_faces=[lifted]).solve()
    assert answer.valid and answer.at_nodes.totals()["normal_force"] == pytest.approx(1e3, rel=0.35)
