"""Faces that move as rigid bodies, and loads at a reference point."""

from dataclasses import replace

import numpy as np
import pytest

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    PointLoad,
    PrescribedDisplacement,
    PrescribedRotation,
    Pressure,
    RigidFace,
    SymmetryPlane,
    Tied,
    Traction,
    box,
    join,
    moved,
)
from coulomb.case.ties import RigidFaceTable
from coulomb.fem.geometry import evaluate_amplitude

E, NU = 2e11, 0.3
STEEL = Material(E, NU)
FAR = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
FREE = (None, None, None)


def bar(cell="hexahedron", degree=1, cells=(4, 2, 2), **given):
    mesh = box((1.0, 0.5, 0.3), cells, cell, degree=degree)
    return ContactProblem(mesh, STEEL, given.pop("clamps", [Clamp("left")]), FAR, given.pop("loads", []), **given)


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_a_motion_in_part_prescribed(cell, degree):
    """Twisted about its axis, free along and across it: the answer of the whole motion prescribed; a moment alone."""
    face = RigidFace("right", rotation=(1e-3, None, None), point=(1.0, 0.25, 0.15))
    solution = bar(cell, degree, rigid_faces=[face]).solve()
    (found,) = solution.rigid_faces
    assert solution.valid and found.rotation[0] == pytest.approx(1e-3, rel=1e-12)
    assert (
        np.abs(found.force).max() <= 1e-8 * found.moment[0] and np.abs(found.moment[1:]).max() <= 1e-8 * found.moment[0]
    )

    def whole(x):
        return found.translation[:, None] + np.cross(found.rotation, x.T - found.point).T

    same = bar(cell, degree, clamps=[Clamp("left"), PrescribedDisplacement("right", whole)]).solve()
    assert np.abs(same.displacement - solution.displacement).max() <= 1e-11 * np.abs(solution.displacement).max()
    assert same.reactions[1].moment[0] == pytest.approx(found.moment[0], rel=1e-9)


def test_a_motion_prescribed_as_a_whole():
    """Nothing of it is free, and each component follows its own amplitude: as displacements of its nodes."""
    point, t, turn = np.array([1.0, 0.25, 0.15]), np.array([1e-5, 2e-5, -3e-5]), np.array([1e-3, -5e-4, 0.0])
    amplitudes = [lambda time: 0.5 * time, None, 2.0, None, lambda time: time**2, None]
    face = RigidFace("right", tuple(point), t, turn, lambda time: time, amplitudes)
    solution = bar(rigid_faces=[face], time=3.0).solve()
    (found,) = solution.rigid_faces
    now = np.array([1.5, 3.0, 2.0]) * t, np.array([3.0, 9.0, 3.0]) * turn
    assert solution.valid
    assert np.allclose(found.translation, now[0], rtol=1e-12) and np.allclose(found.rotation, now[1], rtol=1e-12)

    def whole(x):
        return now[0][:, None] + np.cross(now[1], x.T - point).T

    same = bar(clamps=[Clamp("left"), PrescribedDisplacement("right", whole)]).solve()
    assert np.abs(same.displacement - solution.displacement).max() <= 1e-11 * np.abs(solution.displacement).max()
    assert np.allclose(found.force, same.reactions[1].force, rtol=1e-9, atol=1e-9 * np.linalg.norm(found.force))
    with pytest.raises(ValueError, match="amplitudes must be six"):
        RigidFace("right", amplitudes=[1.0])


def test_each_component_of_a_case_has_its_amplitude():
    names = [f"{of}_{axis}_amplitude" for of in ("translation", "rotation") for axis in "xyz"]
    own = {name: [(0.0, 0.0), (1.0, k)] for k, name in enumerate(names, 1)}
    face = RigidFaceTable(face="right", amplitude=[(0.0, 0.0), (1.0, 9.0)], **own).rigid_face()
    assert [evaluate_amplitude(one, 0.5, "face") for one in face.amplitudes] == pytest.approx(
        [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    )
    del own[names[4]]
    face = RigidFaceTable(face="right", amplitude=[(0.0, 0.0), (1.0, 9.0)], **own).rigid_face()
    assert face.amplitudes[4] is None and evaluate_amplitude(face.amplitude, 0.5, "face") == pytest.approx(4.5)


def test_a_beam_with_a_rigid_end():
    """Euler and Bernoulli, and shear: a free end, and one that must not tilt, by a load at the reference point."""
    length, height, width, force = 2.0, 0.1, 0.05, -1e3
    inertia, area = width * height**3 / 12.0, width * height
    shear = force * length / (5.0 / 6.0 * area * E / 2.0)
    mesh = box((length, width, height), (16, 1, 2), degree=2)
    for rotation, bending in ((FREE, 3.0), ((0.0, 0.0, 0.0), 12.0)):
        problem = ContactProblem(
            mesh,
            Material(E, 0.0),
            [Clamp("left")],
            FAR,
            [PointLoad("right", (0.0, 0.0, force))],
            rigid_faces=[RigidFace("right", rotation=rotation)],
            small_strain="warn",
        )
        solution = problem.solve()
        (found,) = solution.rigid_faces
        assert found.translation[2] == pytest.approx(force * length**3 / (bending * E * inertia) + shear, rel=0.01)
        if rotation is FREE:
            assert found.rotation[1] == pytest.approx(-force * length**2 / (2.0 * E * inertia), rel=0.01)
            assert np.abs(found.moment).max() <= 1e-6 * abs(force)
        else:
            assert found.moment[1] == pytest.approx(force * length / 2.0, rel=0.01)


def test_a_load_at_a_point_is_its_force_and_moment():
    """Spread without stiffening: resultants, about any point, on faces of first and second order."""
    for cell, degree in (("hexahedron", 1), ("tetrahedron", 2)):
        load = PointLoad("right", (1.0, 2.0, 3.0), (4.0, -5.0, 6.0), point=(1.2, 0.1, 0.0))
        (found,) = bar(cell, degree, loads=[load]).solve().loads
        assert found.force == pytest.approx([1.0, 2.0, 3.0], abs=1e-12)
        moment = np.array([4.0, -5.0, 6.0]) + np.cross([1.2, 0.1, 0.0], [1.0, 2.0, 3.0])
        assert found.moment == pytest.approx(moment, abs=1e-12)


def test_planes_of_symmetry_through_a_rigid_face():
    """Half of a bar bends as the whole: the motions that the plane prevents are not free."""
    loads = [Traction("right", (0.0, 0.0, -1e6))]
    whole = bar(cells=(4, 4, 2), loads=loads, rigid_faces=[RigidFace("right", point=(1.0, 0.25, 0.15))]).solve()
    mesh = box((1.0, 0.25, 0.3), (4, 2, 2))
    supports, face = [Clamp("left"), SymmetryPlane("back")], RigidFace("right", point=(1.0, 0.25, 0.15))
    half = ContactProblem(mesh, STEEL, supports, FAR, loads, rigid_faces=[face]).solve()
    one, other = whole.rigid_faces[0], half.rigid_faces[0]
    assert half.valid and other.translation == pytest.approx(one.translation, abs=1e-9 * abs(one.translation[2]))
    assert other.rotation == pytest.approx(one.rotation, abs=1e-9 * abs(one.rotation[1]))


def test_a_torque_that_slides():
    """A thin block between a rough plane and a plate that turns and does not tilt: its torque is that of sliding,
    F p int r dA; the work of the plate is the heat of friction, and the load history shows torque and angle."""
    a, friction, force = 0.1, 0.3, 5e3
    mesh = box((a, a, 0.005), (10, 10, 1))
    plate = RigidFace("top", translation=(0.0, 0.0, None), rotation=(0.0, 0.0, 4e-3), amplitude=lambda t: t)
    problem = ContactProblem(
        mesh,
        Material(1e9, 0.0),
        [],
        Contact("bottom", friction),
        [PointLoad("top", (0.0, 0.0, -force))],
        rigid_faces=[plate],
    )
    steps = list(LoadHistory([0.25, 0.5, 0.75, 1.0]).steps(problem))
    assert all(step.solution.valid for step in steps)
    mean = a / 6.0 * (np.sqrt(2.0) + np.log(1.0 + np.sqrt(2.0)))  # of the distance from the middle of a square
    (found,) = steps[-1].solution.rigid_faces
    assert found.moment[2] == pytest.approx(friction * force * mean, rel=0.01)
    assert steps[-1].row["rigid_face_top_rotation_z"] == pytest.approx(4e-3)
    assert steps[-1].row["rigid_face_top_moment_z"] == pytest.approx(found.moment[2])
    last, before = steps[-1].state.energy, steps[-2].state.energy
    turned = found.moment[2] * 1e-3
    assert last.prescribed - before.prescribed == pytest.approx(turned, rel=1e-3)
    assert last.dissipated - before.dissipated == pytest.approx(turned, rel=1e-3)


def test_a_rigid_face_with_a_tie():
    """The other face of a tie follows the rigid one."""
    a, b = box((1.0, 1.0, 0.5), (3, 3, 2)), moved(box((1.0, 1.0, 0.5), (2, 2, 1)), (0.0, 0.0, 0.5))
    contact = Contact("b:back", 0.3, foundation=Plane((0.0, 5.0, 0.0), (0.0, -1.0, 0.0)))
    problem = ContactProblem(
        join(a=a, b=b),
        STEEL,
        [Clamp("a:bottom")],
        contact,
        [Traction("b:top", (1e5, 0.0, 0.0))],
        rigid_faces=[RigidFace("a:top")],
        ties=[Tied("a:top", "b:bottom")],
    )
    solution = problem.solve()
    x, u = problem.elasticity.x, solution.displacement
    (found,), at = solution.rigid_faces, np.abs(x[:, 2] - 0.5) < 1e-9
    expected = found.translation + np.cross(found.rotation, x[at] - found.point)
    assert solution.valid and np.abs(u[at] - expected).max() <= 1e-13 * np.abs(u).max()
    assert solution.ties[0].face == "b:bottom" and solution.ties[0].force[0] == pytest.approx(-1e5, rel=1e-9)


@pytest.mark.parametrize(
    ("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]
)
@pytest.mark.parametrize("turned", [0.0, 0.4])
def test_a_bar_between_plane_faces_contracts_freely(cell, degree, turned):
    """Stretched by one of two plane faces, with planes of symmetry through both: uniform stress, exactly."""
    c, s, strain = np.cos(turned), np.sin(turned), 1e-4
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    mesh = box((1.0, 0.5, 0.3), (3, 2, 2), cell, degree=degree, place=lambda x: turn @ x)
    moved_by = strain * c if turned else strain  # the component along x of a translation along the normal
    faces = [
        RigidFace("left", translation=(0.0, None, None), along="free"),
        RigidFace("right", translation=(moved_by, None, None), along="free"),
    ]
    supports = [SymmetryPlane("front"), SymmetryPlane("top")]
    solution = ContactProblem(mesh, STEEL, supports, FAR, rigid_faces=faces).solve()
    x = solution.problem.elasticity.x @ turn
    u = strain * np.stack([x[:, 0], -NU * x[:, 1], -NU * (x[:, 2] - 0.3)], axis=1) @ turn.T
    assert solution.valid and np.abs(solution.displacement - u).max() <= 1e-10 * strain
    left, right = solution.rigid_faces
    assert right.translation == pytest.approx(strain * turn[:, 0], abs=1e-13)
    assert np.abs([left.rotation, right.rotation]).max() <= 1e-9 * strain
    for one, way in ((left, -1.0), (right, 1.0)):
        assert one.force == pytest.approx(way * E * strain * 0.15 * turn[:, 0], abs=1e-9 * E * strain)
        assert np.abs(one.moment).max() <= 1e-9 * E * strain


SLICE = (0.4, 0.1, 0.3)
"""Width, thickness and height; its back stays plane."""


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("tilts", [False, True])
def test_a_heated_slice(cell, tilts):
    """Warmer above than below, held across: the axial force is zero, and the moment too if the plane face may tilt."""
    (b, t, h), a, low, high = SLICE, 1e-5, 20.0, 60.0
    slope = a * (1.0 + NU) * (high - low) / h if tilts else 0.0
    supports = [SymmetryPlane(face) for face in ("left", "right", "front")]
    supports += [
        PrescribedDisplacement("bottom", lambda x: -0.5 * slope * np.stack([0 * x[0], 0 * x[0], x[1] ** 2]), "z")
    ]
    face = RigidFace("back", rotation=FREE if tilts else (0.0, None, None), along="free")
    far = Contact("top", 0.3, foundation=Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)))
    problem = ContactProblem(
        box(SLICE, (2, 1, 3), cell, degree=2),
        Material(E, NU, expansion=a),
        supports,
        far,
        rigid_faces=[face],
        temperature=lambda x: low + (high - low) * x[2] / h,
    )
    solution = problem.solve()
    (found,), moment = solution.rigid_faces, E / (1.0 - NU**2) * a * (1.0 + NU) * (high - low) * b * h**2 / 12.0
    assert solution.valid and found.translation[1] == pytest.approx(a * (1.0 + NU) * 0.5 * (low + high) * t, rel=1e-9)
    assert np.abs(found.force).max() <= 1e-8 * moment / h
    assert found.rotation[0] == pytest.approx(-slope * t, rel=1e-9)
    assert found.moment[0] == pytest.approx(0.0 if tilts else moment, abs=1e-8 * moment)


@pytest.mark.parametrize(
    ("cell", "degree", "cells", "off"),
    [("hexahedron", 2, (2, 1, 2), 1e-8), ("tetrahedron", 2, (2, 1, 2), 1e-8), ("hexahedron", 1, (8, 2, 12), 0.03)],
)
@pytest.mark.parametrize("by_moment", [False, True])
def test_a_bent_slice(cell, degree, cells, off, by_moment):
    """Pure bending, with the curvature across of a free section: M = E I over the radius."""
    (b, t, h), curvature = SLICE, 1e-3
    moment = E * b * h**3 / 12.0 * curvature

    def exact(x):
        z = x[2] - 0.5 * h
        bent = [-NU * x[0] * z, x[1] * z, 0.5 * (NU * (x[0] ** 2 - z**2) - x[1] ** 2)]
        return curvature * np.stack(bent)

    supports = [SymmetryPlane("left"), SymmetryPlane("front"), PrescribedDisplacement("right", exact, "z")]
    turned = FREE if by_moment else (-curvature * t, None, None)
    loads = [PointLoad("back", moment=(-moment, 0.0, 0.0))] if by_moment else []
    far = Contact("top", 0.3, foundation=Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)))
    problem = ContactProblem(
        box(SLICE, cells, cell, degree=degree),
        STEEL,
        supports,
        far,
        loads,
        rigid_faces=[RigidFace("back", (0.1, 0.7, 0.5 * h), rotation=turned, along="free")],
    )
    solution = problem.solve()
    (found,), u = solution.rigid_faces, exact(solution.problem.elasticity.x.T).T
    assert solution.valid and found.rotation[0] == pytest.approx(-curvature * t, rel=off)
    assert found.moment[0] == pytest.approx(0.0 if by_moment else -moment, abs=off * moment)
    assert np.abs(solution.displacement - u).max() <= off * np.abs(u).max()


K_U, K_R = (2e8, 3e8, 5e8), (4e7, 6e7, 9e7)
"""Stiffness of a spring, N/m and N m per radian."""


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
@pytest.mark.parametrize("soft", [1.0, 1e-6])
def test_a_body_held_by_the_spring_of_a_rigid_face(cell, degree, soft):
    """A load at the other end, by force and moment: the point moves by F/k and turns by M/k."""
    point, force, moment = (
        np.array([1.2, 0.1, 0.2]),
        soft * np.array([1e3, -2e3, 3e3]),
        soft * np.array([50.0, 70.0, -20.0]),
    )
    spring = {"translation_stiffness": soft * np.array(K_U), "rotation_stiffness": soft * np.array(K_R)}
    loads = [PointLoad("left", force, moment, point=(0.0, 0.0, 0.0))]
    face = RigidFace("right", tuple(point), **spring)
    solution = bar(cell, degree, clamps=[], loads=loads, rigid_faces=[face]).solve()
    (found,), (held,) = solution.rigid_faces, solution.reactions
    about = moment - np.cross(point, force)
    assert solution.valid and solution.force_balance.balance <= 1e-9
    assert found.translation == pytest.approx(force / spring["translation_stiffness"], rel=1e-7)
    assert found.rotation == pytest.approx(about / spring["rotation_stiffness"], rel=1e-7)
    assert (held.kind, held.name) == ("spring", "spring_right")
    understood = solution.problem.elasticity.support_entries()[-1]
    words = "stiffness (2e+08, 3e+08, 5e+08) N/m and (4e+07, 6e+07, 9e+07) N m/rad at its reference point"
    assert soft < 1.0 or understood == {"kind": "spring", "face": "right", "holds": words}
    assert held.force == pytest.approx(-force, rel=1e-7) and held.moment == pytest.approx(-moment, rel=1e-7)
    assert np.abs([*found.force, *found.moment]).max() <= 1e-7 * 3e3 * soft


def test_a_block_on_a_spring_is_pressed():
    """By a plate that moves up: F = d/(1/k + h/(E A)), between smooth faces; the work of the plate is stored."""
    a, h, k, d = 0.1, 0.05, 3e8, 1e-5
    face = RigidFace("top", translation_stiffness=(1e7, 1e7, k), rotation_stiffness=(1e4, 1e4, 1e4))
    contact = Contact("bottom", 0.0, gap=-d, gap_amplitude=lambda t: t)
    mesh = box((a, a, h), (3, 3, 2))
    problem = ContactProblem(mesh, Material(1e10, 0.0), [], contact, rigid_faces=[face])
    *_, step = LoadHistory([0.5, 1.0]).steps(problem)
    force = d / (1.0 / k + h / (1e10 * a * a))
    (found,), (held,), energy = step.solution.rigid_faces, step.solution.reactions, step.state.energy
    assert step.solution.valid and found.translation == pytest.approx((0.0, 0.0, force / k), abs=1e-9 * d)
    assert held.force == pytest.approx((0.0, 0.0, -force), abs=1e-7 * force)
    assert energy.elastic == pytest.approx(0.5 * force * d, rel=1e-8)
    assert abs(energy.imbalance) <= 1e-8 * energy.elastic


def test_a_torque_spring_at_a_face_that_is_turned():
    """What turns the face turns the spring too; the bar does not notice."""
    point, turned = (1.0, 0.25, 0.15), (2e-3, None, None)
    plain, sprung = (
        bar(rigid_faces=[RigidFace("right", point, rotation=turned, rotation_stiffness=(k, 0.0, 0.0))]).solve()
        for k in (0.0, 5e6)
    )
    assert np.abs(sprung.displacement - plain.displacement).max() <= 1e-9 * np.abs(plain.displacement).max()
    one, other = plain.rigid_faces[0], sprung.rigid_faces[0]
    assert other.moment[0] - one.moment[0] == pytest.approx(5e6 * 2e-3, rel=1e-9)
    moments = [reaction.moment - np.cross(point, reaction.force) for reaction in sprung.reactions]
    assert sprung.force_balance.balance <= 1e-9 and moments[1][0] == pytest.approx(-5e6 * 2e-3, rel=1e-9)


def test_the_spring_of_a_plane_face_that_is_free_along_itself():
    """A bar that contracts freely, between a spring and a plane of symmetry: one spring, E A/L, behind the other."""
    k, pull = 1e10, 1e6
    face = RigidFace("right", translation_stiffness=(k, 0.0, 0.0), along="free")
    supports = [SymmetryPlane("back"), SymmetryPlane("top")]
    loads = [Traction("left", (-pull / 0.15, 0.0, 0.0))]
    solution = bar(clamps=supports, loads=loads, rigid_faces=[face]).solve()
    x = solution.problem.elasticity.x
    strain = pull / (E * 0.15)
    u = np.stack(
        [-pull / k + strain * (x[:, 0] - 1.0), -NU * strain * (x[:, 1] - 0.5), -NU * strain * (x[:, 2] - 0.3)], 1
    )
    assert solution.valid and np.abs(solution.displacement - u).max() <= 1e-9 * np.abs(u).max()


def test_a_prescribed_rotation_is_a_rigid_face_without_freedom():
    given = RigidFace("right", (1.0, 0.25, 0.15), (0.0, 0.0, 0.0), (2e-3, 0.0, None))
    one = bar(rigid_faces=[given]).solve()
    turn = PrescribedRotation("right", (1.0, 0.25, 0.15), (1.0, 0.0, 0.0), 2e-3)
    other = bar(clamps=[Clamp("left"), turn]).solve()
    assert np.abs(one.displacement - other.displacement).max() <= 1e-9 * np.abs(one.displacement).max()


@pytest.mark.parametrize(
    ("faces", "words"),
    [
        ([RigidFace("rihgt")], "rigid face: there is no face|has no face|unknown face"),
        ([RigidFace("right"), RigidFace("right")], "tied already"),
        ([RigidFace("right", rotation=(1e-3, None, None), along="free")], "no motion of it has the components"),
    ],
)
def test_wrong_rigid_faces_are_refused(faces, words):
    with pytest.raises(ValueError, match=words):
        bar(rigid_faces=faces)


def test_faces_that_do_not_suit_to_be_free_along_themselves_are_refused():
    def curved(x):
        return x + np.stack([0.03 * x[0] * (x[1] - 0.25) ** 2, 0 * x[0], 0 * x[0]])

    mesh, face = box((1.0, 0.5, 0.3), (2, 2, 2), place=curved), RigidFace("right", along="free")
    with pytest.raises(ValueError, match=r"nodes are up to 938 um off the plane of its mean normal \(1, 0, 0\)"):
        ContactProblem(mesh, STEEL, [Clamp("left")], FAR, rigid_faces=[face])
    held = PrescribedDisplacement("top", (0.0, 0.0, 0.0), direction=(1.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="neither along its normal nor along the face"):
        bar(clamps=[Clamp("left"), held], rigid_faces=[face])


@pytest.mark.parametrize("degree", [1, 2])
def test_a_slice_that_two_plane_faces_and_contact_alone_hold(degree):
    """With cells of first order all nodes are on these faces: unknowns of their own hold its motions."""
    faces, load = [RigidFace(name, along="free") for name in ("front", "back")], Pressure("top", 1e4)
    problem = ContactProblem(
        box(SLICE, (4, 1, 3), degree=degree), STEEL, [], Contact("bottom", 0.3), [load], rigid_faces=faces
    )
    solution = problem.solve()
    front, back = solution.rigid_faces
    apart = back.translation[1] - front.translation[1]
    assert solution.valid and 0.9 < apart / (NU * 1e4 / E * SLICE[1]) < 1.0 + NU  # friction holds x in part


def test_supports_that_contradict_a_rigid_face_are_refused():
    clamps = [Clamp("left"), SymmetryPlane("top")]
    with pytest.raises(ValueError, match="supports prescribe other displacements"):
        bar(clamps=clamps, rigid_faces=[RigidFace("right", translation=(None, None, 1e-4))])


def test_entries_of_rigid_faces():
    with pytest.raises(ValueError, match="three numbers, or None"):
        RigidFace("right", rotation=(0.0, "free", 0.0))
    with pytest.raises(ValueError, match=r"rotation_stiffness must be three numbers >= 0, but is \(0.0, -1.0, 0.0\)"):
        RigidFace("right", rotation_stiffness=(0.0, -1.0, 0.0))
    with pytest.raises(ValueError, match="along must be 'rigid' or 'free', but is 'plane'"):
        RigidFace("right", along="plane")


def test_a_tie_follows_a_rigid_face_whose_motion_is_prescribed():
    """A block without loads, tied to the face: it moves with it."""
    bodies = join(a=box((1.0, 1.0, 0.5), (3, 3, 2)), b=moved(box((0.5, 0.5, 0.4), (2, 3, 2)), (0.2, 0.2, 0.5)))
    face = RigidFace("a:top", translation=(None, 2e-4, -1e-3), rotation=(1e-4, None, None), point=(0.5, 0.5, 0.5))
    contact = Contact("a:left", 0.3, foundation=Plane((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    ties = [Tied("b:bottom", "a:top")]
    solution = ContactProblem(bodies, STEEL, [Clamp("a:bottom")], contact, ties=ties, rigid_faces=[face]).solve()
    (found,), member = solution.rigid_faces, solution.problem.elasticity.members[1]
    expected = found.translation + np.cross(found.rotation, member.body.x - found.point)
    assert solution.valid and found.translation[2] == pytest.approx(-1e-3, rel=1e-12)
    assert np.abs(solution.displacement[member.nodes] - expected).max() <= 1e-11 * 1e-3


def test_a_rigid_body():
    """All of its boundary as a rigid face: nothing of it is deformed, and contact alone holds it on an elastic one."""
    block = moved(box((0.6, 0.6, 0.4), (3, 3, 2)), (0.2, 0.2, 0.5))
    block = replace(block, faces={**block.faces, "all": np.unique(np.concatenate(list(block.faces.values())))})
    bodies = join(a=box((1.0, 1.0, 0.5), (3, 3, 2)), b=block)
    pressed = PointLoad("b:all", (1e5, 0.0, -1e6), point=(0.5, 0.5, 0.9))
    pair = Contact("b:bottom", 0.3, against="a:top")
    problem = ContactProblem(bodies, STEEL, [Clamp("a:bottom")], pair, [pressed], rigid_faces=[RigidFace("b:all")])
    solution = problem.solve()
    (found,), member = solution.rigid_faces, problem.elasticity.members[1]
    rigid = found.translation + np.cross(found.rotation, member.body.x - found.point)
    assert solution.valid
    assert np.abs(solution.displacement[member.nodes] - rigid).max() <= 1e-11 * np.abs(rigid).max()
    assert solution.at_nodes.totals(0)["force"] == pytest.approx([-1e5, 0.0, 1e6], abs=1e-2)
