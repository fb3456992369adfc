"""Bolts: sections tightened to a force or by a length, locked after tightening."""

import numpy as np
import pytest
from user_forms import Script

from coulomb import (
    Body,
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    NoEquilibrium,
    NotConverged,
    Plane,
    PrescribedDisplacement,
    Pretension,
    RigidFace,
    SymmetryPlane,
    Tied,
    TotalForce,
    box,
    join,
    moved,
)
from coulomb.io.summary import remarks

E, WIDE, LONG = 2e11, 0.01, 0.1
AREA = WIDE**2


def far(face):
    return Contact(face, 0.3, foundation=Plane((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("cell", "degree", "given"),
    [("hexahedron", 1, {"force": 1e4}), ("tetrahedron", 2, {"force": -1e4}), ("hexahedron", 2, {"shortening": 5e-5})],
)
def test_a_bar_between_two_clamps(cell, degree, given):
    """s = F L / (E A); meshes that do not match, one of them with a plane of symmetry through the section."""
    low = box((WIDE, WIDE, 0.04), (2, 2, 3), cell, degree=degree)
    up = moved(box((WIDE, WIDE, 0.06), (3, 3, 4), cell, degree=degree), (0.0, 0.0, 0.04))
    clamps = [Clamp("low:bottom"), Clamp("up:top"), SymmetryPlane("low:front"), SymmetryPlane("up:front")]
    bolt = Pretension("up:bottom", "low:top", **given)
    problem = ContactProblem(join(low=low, up=up), Material(E, 0.0), clamps, far("low:left"), ties=[bolt])
    solution = problem.solve()
    (found,) = solution.bolts
    force = given.get("force", 1e4)
    assert solution.valid and found.locked == ("force" not in given)
    assert found.force == pytest.approx(force, rel=1e-10)
    assert found.shortening == pytest.approx(force * LONG / (E * AREA), rel=1e-10)
    assert max(found.shear, found.bending / WIDE, abs(found.torsion) / WIDE) <= 1e-9 * abs(force)
    assert solution.reactions[0].force[2] == pytest.approx(
        -force, rel=1e-9
    )  # on what holds the lower end: it is pulled up
    stress = solution.forces_at_nodes["peel_stress"]
    assert np.max(np.abs(stress[stress != 0.0] - force / AREA)) <= 1e-6 * abs(force) / AREA


def joint(held=(), contacts=2, **given):
    """A shank in two parts between two stiff plates, and two sleeves beside it, which the upper plate presses."""

    def part(size, cells, at):
        return moved(box(size, cells), at)

    plate = ((3 * WIDE, WIDE, WIDE), (3, 1, 1))
    bodies = join(
        foot=part(*plate, (0.0, 0.0, -WIDE)),
        low=part((WIDE, WIDE, 0.04), (1, 1, 2), (WIDE, 0.0, 0.0)),
        up=part((WIDE, WIDE, 0.06), (2, 2, 3), (WIDE, 0.0, 0.04)),
        head=part(*plate, (0.0, 0.0, LONG)),
        one=part((WIDE, WIDE, LONG), (1, 1, 4), (0.0, 0.0, 0.0)),
        two=part((WIDE, WIDE, LONG), (1, 1, 4), (2 * WIDE, 0.0, 0.0)),
    )
    stiff = {"foot": Material(1e5 * E, 0.0), "head": Material(1e5 * E, 0.0)}
    material = {name: stiff.get(name, Material(E, 0.0)) for name in bodies.bodies}
    touching = [Contact(f"{name}:top", 0.1, against="head:bottom") for name in ("one", "two")]
    ties = [Tied("low:bottom", "foot:top"), Tied("up:top", "head:bottom")]
    if contacts == 2:
        ties += [Tied("one:bottom", "foot:top"), Tied("two:bottom", "foot:top")]
    else:
        touching += [Contact(f"{name}:bottom", 0.1, against="foot:top") for name in ("one", "two")]
    bolt = Pretension("up:bottom", "low:top", amplitude=lambda t: min(t, 1.0), lock=1.0, **given)
    loads = [TotalForce("head:top", (0.0, 0.0, 3e3), amplitude=lambda t: max(t - 1.0, 0.0) if contacts == 2 else 0.0)]
    return ContactProblem(bodies, material, [Clamp("foot:bottom"), *held], touching, loads, ties=[*ties, bolt])


def test_the_joint_diagram():
    """Tightened, locked and pulled: the bolt takes k_bolt / (k_bolt + k_sleeves) of the load until the joint opens, all
    of it afterwards (VDI 2230); the work of tightening is F^2 / 2 (1 / k_bolt + 1 / k_sleeves)."""
    problem, force, stiffness = joint(force=1e4), 1e4, E * AREA / LONG
    assert len(problem.elasticity.free.motions) == 1  # the head moves along the bolt until this is tightened
    assert "the bolt at 'up:bottom'" in problem.elasticity.free.bodies
    for step in LoadHistory([0.5, 1.0, 2.0, 9.0]).steps(problem):
        (found,), time = step.solution.bolts, step.state.time
        load = 3e3 * max(time - 1.0, 0.0)
        expected = force * min(time, 1.0) + load / 3.0
        assert step.solution.certificate.passed and found.locked == (time > 1.0)
        assert step.solution.problem.body is problem.body  # pairs, faces and surface are not found again
        assert found.force == pytest.approx(load if load > 1.5 * force else expected, rel=1e-8)
        assert step.row["bolt_up:bottom_force"] == found.force
        if time == 1.0:
            shortened = found.shortening
            assert shortened == pytest.approx(force / stiffness * 1.5, rel=1e-5)
            assert step.state.energy.prescribed == pytest.approx(0.5 * force * shortened, rel=1e-9)
            assert abs(step.state.energy.imbalance) <= 1e-9 * force * shortened
        assert found.shortening == pytest.approx(shortened if time >= 1.0 else 0.75 * force / stiffness, rel=1e-4)


def test_unknowns_and_displacements_with_a_tie_a_bolt_and_a_rigid_face():
    """u = T v: rigid motions have unknowns of their own, v = 0 at a locked bolt; T^T of forces does the same work."""
    given = {"ties": [Pretension("up:bottom", "low:top", force=1.0, lock=1.0)], "rigid_faces": [RigidFace("up:top")]}
    low, up = box((1.0, 1.0, 1.0), (2, 2, 1)), moved(box((1.0, 1.0, 1.0), (3, 3, 1)), (0.0, 0.0, 1.0))
    body = ContactProblem(join(low=low, up=up), Material(E, 0.3), [], Contact("low:bottom", 0.3), **given).elasticity
    rigid = np.array([1.0, 2.0, -3.0]) + np.cross([0.3, -0.2, 0.5], body.x)
    stretched = rigid + 0.2 * (body.x[:, 2:] > 0.5) * (np.arange(len(body.x)) >= 18)[:, None] * [0.0, 0.0, 1.0]
    for time, u in ((0.5, rigid), (0.5, stretched), (1.5, rigid)):
        there = body.at_time(time)
        v = there.reduction.reduced(u)
        assert there.reduction.points.shape == v.shape == (len(body.x) + 3, 3)
        assert np.abs(there.reduction.displacement(v) - u).max() <= 1e-12
        forces = np.sin(np.arange(u.size)).reshape(u.shape)
        assert np.sum(there.reduction.along(forces) * v) == pytest.approx(np.sum(forces * u), rel=1e-11)
        (bolt,) = there.constraints.bolts_at(u)
        assert abs(bolt.shortening) == pytest.approx(0.0 if u is rigid else 0.2, abs=1e-12)
        assert bolt.locked == (time > 1.0)


def test_a_length_in_place_of_a_force():
    """The length that belongs to 10 kN in the joint diagram."""
    *_, last = LoadHistory([1.0, 2.0]).steps(joint(shortening=1.5 * 1e4 * LONG / (E * AREA)))
    assert last.solution.bolts[0].force == pytest.approx(1e4 + 3e3 / 3.0, rel=1e-5)


def test_the_joint_slips():
    """The sleeves are drawn from between the plates: F n F_bolt of two faces each, whatever the drawing."""
    sides = (("one", "left"), ("two", "right"))
    held = [PrescribedDisplacement("head:top", (0.0, 0.0, 0.0), "xy")]
    held += [SymmetryPlane(f"{name}:{side}") for name, side in sides]
    held += [
        PrescribedDisplacement(f"{name}:back", (0.0, 2e-5, 0.0), "y", amplitude=lambda t: max(t - 1.0, 0.0))
        for name, _ in sides
    ]
    problem = joint(held, contacts=4, force=1e4)
    *_, before, last = LoadHistory([1.0, 2.0, 3.0]).steps(problem)
    pulls = sum(part.force[1] for part in last.solution.reactions if part.face in ("one:back", "two:back"))
    assert before.solution.certificate.passed and last.solution.certificate.passed
    assert last.solution.at_nodes.numbers()["nodes"]["stick"] == 0
    assert pulls == pytest.approx(2 * 0.1 * last.solution.bolts[0].force, rel=1e-6)
    assert last.solution.bolts[0].force == pytest.approx(1e4, rel=1e-2)


def test_two_sections_in_one_bolt():
    """The part between them is pushed to both sides by the same force: it can move, and is named."""
    parts = {
        name: moved(box((WIDE, WIDE, 0.03), (k + 1, 1, 2)), (0.0, 0.0, 0.03 * k))
        for k, name in enumerate(("low", "mid", "up"))
    }
    wall = Contact("up:top", 0.3, foundation=Plane((0.0, 0.0, 0.09 + 1e-6), (0.0, 0.0, -1.0)))
    bolts = [Pretension("mid:bottom", "low:top", force=-1e4), Pretension("up:bottom", "mid:top", force=-1e4)]
    solution = ContactProblem(join(**parts), Material(E, 0.0), [Clamp("low:bottom")], wall, ties=bolts).solve()
    (said,) = remarks(solution)
    assert 'nothing resists that body "mid" moves along' in said and "while" not in said and "bolt" not in said


def test_loose_bolts_of_a_free_body():
    """A bolt of which nothing but contact holds any part, and a gap that it closes first: s = gap + F / k."""
    low = box((WIDE, WIDE, 0.04), (2, 2, 3))
    up = moved(box((WIDE, WIDE, 0.06), (2, 2, 4)), (0.0, 0.0, 0.04))
    walls = [
        Contact("low:bottom", 0.3, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
        Contact("up:top", 0.3, foundation=Plane((0.0, 0.0, LONG + 1e-5), (0.0, 0.0, -1.0))),
    ]
    bolt = Pretension("up:bottom", "low:top", force=-1e4)  # a strut between two walls
    problem = ContactProblem(join(low=low, up=up), Material(E, 0.0), [], walls, ties=[bolt])
    assert len(problem.elasticity.free.motions) == 7
    solution = problem.solve()
    assert solution.valid and solution.bolts[0].force == pytest.approx(-1e4, rel=1e-9)
    assert solution.bolts[0].shortening == pytest.approx(-1e-5 - 1e4 * LONG / (E * AREA), rel=1e-6)
    pulled = ContactProblem(
        join(low=low, up=up), Material(E, 0.0), [], walls, ties=[Pretension("up:bottom", "low:top", force=1e4)]
    )
    with pytest.raises(NoEquilibrium, match=r"nothing holds the bolt at 'up:bottom' against loads of 10 kN"):
        pulled.solve()


def test_a_bolt_that_pulls_on_nothing():
    """A stud without a head: where contact is on the side that is clamped, the free one had contact by rounding errors
    and was moved by 5e25 m; where friction holds a part of the force, no proof was wanted, but a word."""
    low = box((WIDE, WIDE, 0.02), (2, 2, 4))
    up = moved(box((WIDE, WIDE, 0.02), (3, 2, 4)), (0.0, 0.0, 0.02))

    def stud(contact, *loads):
        bolt = Pretension("up:bottom", "low:top", force=1e4)
        return ContactProblem(
            join(low=low, up=up), Material(E, 0.3), [Clamp("low:bottom")], Contact(contact, 0.2), loads, ties=[bolt]
        )

    with pytest.raises(NoEquilibrium, match=r"nothing holds the bolt at 'up:bottom' against loads of 10 kN along -z"):
        stud("low:left").solve()
    with pytest.raises(NotConverged, match=r"^no answer found: loads push the bolt at 'up:bottom' along -z with 10 kN"):
        stud("up:left", TotalForce("up:right", (-2e3, 0.0, 0.0))).solve()


def test_the_users_own_forms():
    """A bar of forms, tightened: the force and the length of a bar of materials."""
    meshes = [box((WIDE, WIDE, 0.04), (2, 2, 3)), moved(box((WIDE, WIDE, 0.06), (2, 2, 4)), (0.0, 0.0, 0.04))]
    scripts, ends = [Script(mesh, 1) for mesh in meshes], ("bottom", "top")
    bodies = [
        Body(one.elasticity(E, 0.0), bcs=[one.bc((0.0, 0.0, 0.0), end)], faces=one.mesh)
        for one, end in zip(scripts, ends, strict=True)
    ]
    bolt = Pretension("up:bottom", "low:top", force=1e4)
    solution = ContactProblem(join(low=bodies[0], up=bodies[1]), far("low:left"), ties=[bolt]).solve()
    assert solution.valid
    assert solution.bolts[0].shortening == pytest.approx(1e4 * LONG / (E * AREA), rel=1e-9)


def two_boxes(*ties, clamps=("low:bottom", "up:top"), **given):
    low, up = box((1.0, 1.0, 1.0), (2, 2, 2)), moved(box((1.0, 1.0, 1.0), (2, 2, 2)), (0.0, 0.0, 1.0))
    return ContactProblem(
        join(low=low, up=up), Material(E, 0.3), [Clamp(face) for face in clamps], far("low:left"), ties=ties, **given
    )


def test_bolts_that_cannot_be():
    for given in ({}, {"force": 1.0, "shortening": 1.0}, {"force": np.inf}, {"shortening": "1"}):
        with pytest.raises(ValueError, match="give either force in newtons or shortening in metres"):
            Pretension("a", "b", **given)
    with pytest.raises(ValueError, match="direction"):
        Pretension("a", "b", force=1.0, direction=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="lock must be a time"):
        Pretension("a", "b", force=1.0, lock=np.nan)
    with pytest.raises(ValueError, match=r"supports hold nodes of the section along the bolt"):
        two_boxes(Pretension("up:bottom", "low:top", force=1.0, slave=True), clamps=("low:bottom", "up:left"))
    with pytest.raises(ValueError, match=r"some nodes of 'up:bottom' are tied already: give the pretension before"):
        two_boxes(Pretension("up:bottom", "low:top", force=1.0, slave=True), rigid_faces=[RigidFace("up:left")])
    with pytest.raises(ValueError, match=r"at time 2 it is locked \(lock = 1\).*begin at the time of lock"):
        two_boxes(Pretension("up:bottom", "low:top", force=1.0, lock=1.0), time=2.0)
    problem = two_boxes(Pretension("up:bottom", "low:top", force=1.0, lock=1.0))
    with pytest.raises(ValueError, match=r"at time 2 it is locked"):
        problem.at(2.0)
    with pytest.raises(ValueError, match=r"at time 1 .* no load step ends there \(they end at 0.5, 2\)"):
        next(LoadHistory([0.5, 2.0]).steps(problem))


def test_bolts_in_series_with_unlike_forces():
    """On the column between a wall and a plane both bolts carry one force."""
    part = box((WIDE, WIDE, 0.02), (1, 1, 1))
    mesh = join(low=part, mid=moved(part, (0.0, 0.0, 0.02)), up=moved(part, (0.0, 0.0, 0.04)))

    def column(force):
        bolts = [Pretension("mid:bottom", "low:top", force=-1e3), Pretension("up:bottom", "mid:top", force=force)]
        return ContactProblem(mesh, Material(E, 0.3), [Clamp("up:top")], Contact("low:bottom", 0.3), ties=bolts)

    assert column(-1e3).solve().valid
    unlike = "'mid:bottom' against loads of 1 kN along z; nor .* 2 kN along z; in series they carry the same force"
    with pytest.raises(NoEquilibrium, match=unlike):
        column(-2e3).solve()
