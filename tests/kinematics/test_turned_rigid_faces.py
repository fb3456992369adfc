"""Rigid faces that turn by finite angles, against supports that move the same nodes, and formulas."""

import numpy as np
import pytest
from check_runs import made
from history_runs import TURNED_FACE
from resumed_rows import rows_of
from scipy.spatial.transform import Rotation

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    HistoryFiles,
    LoadHistory,
    Material,
    Plane,
    PointLoad,
    PrescribedDisplacement,
    RigidFace,
)
from coulomb.io.run_directory import RunDirectory
from coulomb.kinematics import NeoHookean, StVenantKirchhoff
from coulomb.model.equilibrium import undetermined

RUBBER = NeoHookean(young=1e6, poisson=0.3)
RAMP = ((0.0, 0.0), (1.0, 1.0))
POINT, WAY = np.array([0.3, 0.4, 0.6]), np.array([0.1, 0.0, -0.06])
TURN = np.radians(60.0) * np.array([0.1, -0.15, 1.0]) / np.linalg.norm([0.1, -0.15, 1.0])


def block(faces=(), loads=(), supports=()):
    """A block over a floor that rubs."""
    floor = Contact("bottom", friction=0.4, foundation=Plane((0.0, 0.0, -0.02), (0.0, 0.0, 1.0)))
    mesh = coulomb.box((1.0, 1.0, 0.6), (2, 2, 2))
    return ContactProblem(mesh, RUBBER, supports, floor, loads, kinematics="large", rigid_faces=faces)


def moved(x):
    """Displacement of points (3, k) with the whole motion."""
    return (POINT + WAY)[:, None] + Rotation.from_rotvec(TURN).as_matrix() @ (x - POINT[:, None]) - x


def test_a_pressed_and_turned_face_is_the_same_as_its_nodes_prescribed_and_as_its_moment_given():
    *_, before, last = LoadHistory([0.5, 0.75, 1.0]).steps(
        block([RigidFace("top", tuple(POINT), tuple(WAY), tuple(TURN), RAMP)])
    )
    answer, (face,) = last.solution, last.solution.rigid_faces
    assert answer.valid and answer.methods["linear_problems"] <= 5 and last.halvings == 0
    assert np.allclose(face.rotation, TURN, atol=1e-14) and np.allclose(face.point, POINT + WAY, atol=1e-14)

    other = block(supports=[PrescribedDisplacement("top", moved)]).at(1.0, before.state).solve()
    (held,) = other.reactions
    size = np.linalg.norm(face.force)
    assert np.abs(other.displacement - answer.displacement).max() < 1e-12
    assert np.abs(other.contact_force - answer.contact_force).max() < 1e-9 * size
    assert np.abs(held.force - face.force).max() < 1e-9 * size
    assert np.abs(held.moment - np.cross(face.point, held.force) - face.moment).max() < 1e-9 * size

    rotation = (TURN[0], TURN[1], None)
    load = PointLoad("top", moment=tuple(face.moment), point=tuple(POINT))
    found = block([RigidFace("top", tuple(POINT), tuple(WAY), rotation)], [load]).at(1.0, before.state)
    found = found.solve(tolerance=1e-11)
    (free,) = found.rigid_faces
    assert found.valid and np.abs(free.rotation - TURN).max() < 1e-8
    assert np.abs(free.force - face.force).max() < 1e-7 * size


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_a_lifted_body_that_may_spin_about_the_vertical_is_said_to_be_free_there(kinematics, tmp_path):
    """Where it is pressed friction resists; where it hangs its weight resists that it swings in large motions."""
    swings = None if kinematics == "large" else 0.0
    way, turn = (0.0, 0.0, 1.0), (swings, swings, None)
    lifted = RigidFace("top", translation=way, rotation=turn, amplitude=[(0, 0), (1, -0.01), (2, 0.01)])
    floor = Contact("bottom", friction=0.4, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    rubber = NeoHookean(young=1e6, poisson=0.3, density=1e3) if kinematics == "large" else Material(1e6, 0.3, 1e3)
    mesh, given = coulomb.box((1.0, 1.0, 0.6), (2, 2, 2)), {"kinematics": kinematics, "rigid_faces": [lifted]}
    problem = ContactProblem(mesh, rubber, [], floor, gravity=(0.0, 0.0, -9.81), **given)
    answers = []
    LoadHistory([1.0, 2.0]).run(problem, HistoryFiles(tmp_path), on_step=lambda one: answers.append(one.solution))
    named = [undetermined(one.problem, one.contact_force) for one in answers]
    assert all(one.valid for one in answers) and named[0] == () and len(named[1]) == 1
    assert "the body spins about z" in named[1][0]
    said = [text for text in RunDirectory(tmp_path).read_summary()["history"]["remarks"] if "not unique" in text]
    assert len(said) == 1 and said[0].startswith("at 2 s: ") and named[1][0] in said[0]


def test_a_bar_under_a_moment_becomes_an_arc():
    """Of the angle M L / (E I), past half a turn, in a plane; the moment acts where its end turns as a whole."""
    length, h, young, angle = 1.0, 0.05, 1e9, 1.25 * np.pi
    problem = ContactProblem(
        coulomb.box((length, h, h), (10, 1, 1), degree=2),
        StVenantKirchhoff(young, 0.0),
        [Clamp("left")],
        Contact("bottom", friction=0.0, foundation=Plane((0.0, 0.0, -5.0), (0.0, 0.0, 1.0))),
        [PointLoad("right", moment=(0.0, -angle * young * h**4 / 12.0 / length, 0.0), amplitude=RAMP)],
        kinematics="large",
        rigid_faces=[RigidFace("right", translation=(None, 0.0, None), rotation=(0.0, None, 0.0))],
    )
    for step in LoadHistory(np.linspace(0.0, 1.0, 6)[1:]).steps(problem):
        (face,), now = step.solution.rigid_faces, angle * step.state.time
        assert step.solution.valid and step.solution.methods["linear_problems"] <= 11
        assert face.rotation == pytest.approx([0.0, -now, 0.0], rel=0.02)
        tip = length * np.array([np.sin(now) / now - 1.0, 0.0, (1.0 - np.cos(now)) / now])
        assert face.translation == pytest.approx(tip, abs=0.02 * length)


def test_a_spring_pulls_by_the_components_of_the_rotation_vector():
    """Of the energy k theta^2 / 2 the moment in space is -J^-T k theta, with J dtheta the turn of a change dtheta."""
    along, about = np.array([1e5, 2e5, 3e5]), np.array([4e4, 2e4, 3e4])
    faces = [RigidFace("top", tuple(POINT), translation_stiffness=tuple(along), rotation_stiffness=tuple(about))]
    loads = [PointLoad("top", (2e4, -1e4, 1e4), (1e4, -6e3, 2e4), tuple(POINT), RAMP)]
    *_, last = LoadHistory([0.5, 1.0]).steps(block(faces, loads))
    answer, (face,) = last.solution, last.solution.rigid_faces
    (spring,), h, theta = answer.reactions, 1e-6, face.rotation
    R = Rotation.from_rotvec(theta).inv()
    J = np.array([(Rotation.from_rotvec(theta + h * e) * R).as_rotvec() / h for e in np.eye(3)]).T
    moment = -np.linalg.solve(J.T, about * theta)
    assert answer.valid and np.linalg.norm(theta) > 0.6
    assert spring.force == pytest.approx(-along * face.translation, rel=1e-9)
    assert spring.moment - np.cross(face.point, spring.force) == pytest.approx(moment, rel=1e-4)
    assert np.abs(face.force).max() < 1e-3 and answer.force_balance.balance < 1e-8
    stored = last.state.energy.elastic - answer.problem.elasticity.members[0].body.strain_energy(answer.displacement)
    assert stored == pytest.approx(0.5 * (along @ face.translation**2 + about @ theta**2), rel=1e-9)


def test_a_case_of_a_face_turned_past_half_a_turn():
    assert float(rows_of(made(TURNED_FACE))[-1]["rigid_face_top_rotation_z"]) == pytest.approx(4.4, rel=1e-6)


@pytest.mark.parametrize(
    "faces, supports, message",
    [
        ([RigidFace("top", along="free")], (), "moves along its normal and does not turn: prescribe its rotation as 0"),
        ([RigidFace("top")], [Clamp("left", "z")], "along directions in which finite rotations move them"),
    ],
)
def test_what_cannot_turn_is_refused(faces, supports, message):
    with pytest.raises(ValueError, match=message):
        block(faces, supports=supports)
