"""Surfaces that run through each other outside of every contact, on any number of ranks: alone, or with mpirun."""

from itertools import permutations, product

import numpy as np
import pytest
from mpi4py import MPI

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Tied,
    Traction,
    auto_pairs,
    box,
    join,
    moved,
)
from coulomb.fem.contact.body_boundary import BodyBoundary
from coulomb.fem.meshes import NamedMesh, boundary_facets, corners_of, distributed, second_order
from coulomb.kinematics import NeoHookean
from coulomb.units import amount

comm = MPI.COMM_WORLD
STEEL = Material(2e11, 0.3)
HEXAHEDRON = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
GAP = 0.02


def clip(cell="hexahedron", degree=1, gap=GAP, names=("jaw_up", "jaw_low")):
    """A block of 6 x 1 x 2 m with a slot from x = 1 on in the middle of its height: three layers of cells, without
    those of the slot."""
    x, y, z = np.arange(7.0), np.linspace(0.0, 1.0, 3), np.array([0.0, 1.0, 1.0 + gap, 2.0 + gap])
    points, shape = np.array(list(product(x, y, z))), (7, 3, 4)
    cells = []
    for origin in product(range(6), range(2), range(3)):
        if origin[0] == 0 or origin[2] != 1:
            ways = [HEXAHEDRON]
            if cell == "tetrahedron":
                ways = [np.cumsum([(0, 0, 0), *path], axis=0) for path in permutations(np.eye(3, dtype=int).tolist())]
            cells += [[np.ravel_multi_index(tuple(np.add(origin, c)), shape) for c in way] for way in ways]
    mine = np.array(cells) if comm.rank == 0 else np.empty((0, len(cells[0])), dtype=np.int64)
    domain = distributed(comm, points if comm.rank == 0 else np.empty((0, 3)), mine)
    facets = boundary_facets(domain)
    at = domain.geometry.x[corners_of(domain, facets)].mean(axis=1)
    slot = at[:, 0] > 1.0
    faces = {"back": at[:, 0] < 1e-9, "bottom": at[:, 2] < 1e-9, "top": at[:, 2] > 2.0 + gap - 1e-9}
    faces |= dict(zip(names, (slot & (np.abs(at[:, 2] - 1.0 - k * gap) < 1e-9) for k in (1, 0)), strict=False))
    mesh = NamedMesh(domain, {name: facets[on] for name, on in faces.items()})
    return second_order(mesh) if degree == 2 else mesh


def pressed(mesh, contacts=(), pressure=1e7, **others):
    """Its upper half is bent towards the lower one, which lies on a floor: by more than the slot."""
    floor = Contact("bottom", 0.2)
    load = Traction("top", (0.0, 0.0, -pressure), amplitude=[(0.0, 0.0), (1.0, 1.0)])
    return ContactProblem(mesh, STEEL, [Clamp("back")], [floor, *contacts], [load], time=1.0, **others)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_slot_that_closes_by_more_than_its_width(cell, degree):
    mesh = clip(cell, degree)
    pressure = 2e7 if (cell, degree) == ("tetrahedron", 1) else 1e7  # the stiffest
    answer = pressed(mesh, pressure=pressure).solve()
    strain = answer.small_strain
    assert answer.certificate.passed and not answer.valid and strain.inside.place[0] == 6.0
    assert sorted(strain.inside.faces) == ["'jaw_low'", "'jaw_up'"]
    assert strain.overlap == pytest.approx(1.0 - GAP / strain.inside.approach, rel=0.05) and strain.overlap > 0.3
    (text,) = answer.outside
    assert f"is {amount(strain.inside.depth)} inside, through 'jaw_" in text and "x = (6, " in text
    half = pressed(mesh, pressure=0.25 * pressure).solve()
    assert half.valid and half.small_strain.inside is None


def test_a_slot_with_contact_of_the_body_with_itself():
    mesh, jaws = clip(), Contact("jaw_up", 0.2, against="jaw_low")
    answer = pressed(mesh, [jaws]).solve()
    assert answer.valid and answer.small_strain.inside is None and answer.at_nodes.totals(1)["normal_force"] > 1e5


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_both_sides_of_a_slot_are_a_pair_whatever_their_names(cell):
    """With names, without, with one name for both, and with a name of one side alone."""
    whole = clip(cell)
    jaws = np.concatenate([whole.faces[name] for name in ("jaw_up", "jaw_low")])
    one = NamedMesh(whole.domain, {**clip(cell, names=()).faces, "jaws": np.sort(jaws)})
    forces = []
    for mesh, names in (
        (whole, {"jaw_up", "jaw_low"}),
        (clip(cell, names=()), {"facing_itself_1", "facing_itself_2"}),
        (one, {"jaws_facing_itself_1", "jaws_facing_itself_2"}),
        (clip(cell, names=("jaw_up",)), {"jaw_up", "facing_jaw_up"}),
    ):
        found = auto_pairs(mesh, 1.5 * GAP)
        (pair,) = found.pairs
        assert {pair.face, pair.against} == names and pair.gap == pytest.approx((GAP, GAP))
        assert pair.area == pytest.approx(5.0) and set(found.made) == names - {"jaw_up", "jaw_low"}
        answer = pressed(found.mesh, [Contact(pair.face, 0.2, against=pair.against)], 2e7).solve()
        assert answer.valid
        forces.append(answer.at_nodes.totals(1)["normal_force"])
    assert forces == pytest.approx(4 * forces[:1], rel=1e-6) and forces[0] > 1e5
    with pytest.raises(ValueError, match="no faces"):
        auto_pairs(clip(cell, names=()), 0.5 * GAP)


def test_faces_without_names_and_answers_that_are_accepted():
    answer = pressed(clip(names=()), small_strain="warn").solve()
    assert answer.valid and answer.small_strain.inside.faces == ("the unnamed boundary",) * 2
    assert "the unnamed boundary is" in answer.small_strain.violations[0]


def test_the_step_of_a_history_is_named():
    steps = list(LoadHistory([0.2, 1.0]).steps(pressed(clip())))
    assert [step.solution.valid for step in steps] == [True, False]


def test_large_motions():
    problem = ContactProblem(
        clip(),
        NeoHookean(2e11, 0.3),
        [Clamp("back")],
        Contact("bottom", 0.2, foundation=Plane((0, 0, 0), (0, 0, 1))),
        [Traction("top", (0.0, 0.0, -1e7), amplitude=[(0.0, 0.0), (1.0, 1.0)])],
        kinematics="large",
    )
    steps = list(LoadHistory([0.2, 1.0]).steps(problem))
    assert [step.solution.valid for step in steps] == [True, False]
    assert sorted(steps[1].solution.small_strain.inside.faces) == ["'jaw_low'", "'jaw_up'"]


def two(way, gap=0.01, contacts=(), cells=(2, 2, 2)):
    """A block on a floor, and one above it that is moved."""
    lower = box((1.0, 1.0, 0.5), (2, 2, 2))
    upper = moved(box((0.6, 1.0, 0.5), cells), (0.2, 0.0, 0.5 + gap))
    held = [Clamp("lower:left"), PrescribedDisplacement("upper:top", way)]
    return ContactProblem(join(lower=lower, upper=upper), STEEL, held, [Contact("lower:bottom", 0.2), *contacts])


@pytest.mark.parametrize("cells", [(2, 2, 2), (1, 1, 1)])
def test_two_bodies_without_a_contact(cells):
    """Flush at two sides; of one cell, the nodes are at edges alone."""
    inside = two((0.0, 0.0, -0.02), cells=cells).solve()
    assert not inside.valid and inside.small_strain.inside.depth == pytest.approx(0.01, rel=1e-6)
    assert set(inside.small_strain.inside.faces) == {"'upper:bottom'", "'lower:top'"}
    assert two((0.0, 0.0, -0.01), cells=cells).solve().valid
    pair = Contact("upper:bottom", 0.2, against="lower:top")
    assert two((0.0, 0.0, -0.02), contacts=[pair], cells=cells).solve().small_strain.inside is None


def test_touching_faces_may_slide_and_part_but_not_press():
    assert two((0.02, 0.01, 0.0), gap=0.0).solve().valid
    assert two((0.02, 0.0, 0.01), gap=0.0).solve().valid
    assert not two((0.0, 0.0, -1e-6), gap=0.0).solve().valid


def test_an_overlap_before_deformation_counts_only_as_it_grows():
    assert two((0.0, 0.0, -1e-5), gap=-0.02).solve().small_strain.inside.depth == pytest.approx(1e-5, rel=1e-6)
    assert two((1e-5, 0.0, 0.0), gap=-0.02).solve().valid and two((0.0, 0.0, 1e-5), gap=-0.02).solve().valid


def test_what_passes_through_beside_the_contact_points():
    """The contact is of the upper block with the left half of the lower one, which ends there."""
    lower = join(a=box((1.0, 1.0, 0.5), (2, 2, 2)), b=moved(box((1.0, 1.0, 0.5), (2, 2, 2)), (1.01, 0.0, 0.0)))
    bodies = join(**lower.bodies, top=moved(box((2.01, 1.0, 0.5), (4, 2, 2)), (0.0, 0.0, 0.5)))
    held = [Clamp("a:bottom"), Clamp("b:bottom"), PrescribedDisplacement("top:top", (0.0, 0.0, -1e-3))]
    pairs = [Contact("top:bottom", 0.2, against="a:top"), Contact("top:bottom", 0.2, against="b:top")]
    half = ContactProblem(bodies, STEEL, held, pairs[:1]).solve()
    assert half.certificate.passed and not half.valid
    assert set(half.small_strain.inside.faces) == {"'top:bottom'", "'b:top'"}
    assert ContactProblem(bodies, STEEL, held, pairs).solve().small_strain.inside is None


def test_tied_faces_are_no_overlap():
    bodies = join(a=box((1.0, 1.0, 1.0), (2, 2, 2)), b=moved(box((0.6, 0.7, 0.5), (2, 3, 1)), (0.2, 0.1, 0.999)))
    tied = [Tied("b:bottom", "a:top")]
    load = [Traction("b:top", (1e7, 0.0, -1e7))]
    answer = ContactProblem(bodies, STEEL, [Clamp("a:left")], Contact("a:bottom", 0.2), load, ties=tied).solve()
    assert answer.valid and answer.small_strain.inside is None


def test_a_corner_that_runs_into_the_floor():
    """A cantilever above a floor that only the part next to the clamp is declared to touch."""
    mesh = box((6.0, 1.0, 1.0), (6, 1, 1))
    facets = mesh.faces["bottom"]
    near = mesh.domain.geometry.x[corners_of(mesh.domain, facets)].mean(axis=1)[:, 0] < 2.0
    beam = NamedMesh(mesh.domain, {**mesh.faces, "foot": facets[near]})

    def bent(face, force, floor=-0.01):
        plane = Plane((0.0, 0.0, floor), (0.0, 0.0, 1.0))
        load = [Traction("right", (0.0, 0.0, -force))]
        return ContactProblem(beam, STEEL, [Clamp("left")], Contact(face, 0.2, foundation=plane), load).solve()

    answer = bent("foot", 2e7)
    assert answer.certificate.passed and not answer.valid and answer.small_strain.inside.place[::2] == (6.0, 0.0)
    assert answer.small_strain.inside.faces[1] == "the foundation of contact face 'foot'"
    tip = float(comm.allreduce(np.min(answer.displacement[:, 2], initial=0.0), op=MPI.MIN))
    inside = answer.small_strain.inside
    assert (inside.depth, inside.approach) == pytest.approx((-tip - 0.01, -tip))
    assert bent("foot", 2e6).valid and bent("bottom", 2e7).small_strain.inside is None


def test_what_is_behind_a_foundation_from_the_beginning_is_no_overlap():
    """The plane on which the upper jaw comes down goes through the lower one."""
    mesh = clip()
    stop = Contact("jaw_up", 0.2, foundation=Plane((0.0, 0.0, 1.0 + 0.9 * GAP), (0.0, 0.0, 1.0)))
    answer = pressed(mesh, [stop]).solve()
    assert answer.valid and answer.small_strain.inside is None


@pytest.mark.parametrize("joined", [False, True])
def test_a_foundation_stops_what_is_joined_with_its_body(joined):
    """A second cantilever, without a foundation, bends through the plane of the floor under a block: beside it no
    answer is the worse for that, glued to its side it is."""
    cube = box((1.0, 1.0, 1.0), (2, 2, 2))
    beam = moved(box((6.0, 1.0, 1.0), (6, 2, 2)), translate=(1.0 if joined else 9.0, 0.0, 0.0))
    floor = Contact("cube:bottom", 0.2, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    supports = [Clamp("cube:left")] if joined else [Clamp("cube:left"), Clamp("beam:left")]
    answer = ContactProblem(
        join(cube=cube, beam=beam),
        STEEL,
        supports,
        floor,
        [Traction("beam:right", (0.0, 0.0, -2e6))],
        ties=[Tied("beam:left", "cube:right")] if joined else [],
        small_strain="warn",
    ).solve()
    assert answer.certificate.passed and (answer.small_strain.inside is not None) == joined


def test_a_gap_that_is_given_lets_surfaces_pass():
    """A thin plate comes down by a gap beside the distance, which is larger than the plate is thick."""
    plate = box((1.0, 1.0, 0.01), (2, 2, 2))
    down = [PrescribedDisplacement("top", (0.0, 0.0, -0.04))]
    assert ContactProblem(plate, STEEL, down, Contact("bottom", 0.2, gap=0.05)).solve().valid
    bodies = join(plate=plate, base=moved(box((1.0, 1.0, 0.5), (2, 2, 2)), (0.0, 0.0, -0.5)))
    held = [Clamp("base:bottom"), PrescribedDisplacement("plate:top", (0.0, 0.0, -0.04))]
    assert ContactProblem(bodies, STEEL, held, Contact("plate:bottom", 0.2, against="base:top", gap=0.05)).solve().valid


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize(("degree", "cells"), [(1, (1, 1, 1)), (2, (1, 1, 1)), (1, (2, 2, 2))])
def test_a_blade_that_cuts_between_the_nodes(cell, degree, cells):
    """It is one cell long, much longer than the block is wide, and as thin as 1 % of that."""
    block = box((1.0, 1.0, 0.5), cells, cell, degree=degree)

    def cut(way, *pair, long=1):
        blade = moved(box((0.01, 9.0, 1.0), (1, long, 1), cell, degree=degree), (0.3, -0.7, 0.51))
        held = [Clamp("block:bottom"), PrescribedDisplacement("blade:top", (0.0, 0.0, -way))]
        bodies, floor = join(block=block, blade=blade), Contact("block:left", 0.2)
        return ContactProblem(bodies, STEEL, held, [floor, *pair], small_strain="warn").solve().small_strain.inside

    inside = cut(0.03)
    assert inside.faces == ("'blade:bottom'", "'block:top'") and inside.place[2] == pytest.approx(0.51)
    assert -1e-9 <= inside.place[1] <= 1.0 + 1e-9 and inside.depth == pytest.approx(0.02, rel=1e-6)
    assert cut(0.01) is None
    assert cut(0.03, Contact("blade:bottom", 0.2, against="block:top"), long=20) is None


@pytest.mark.parametrize("wide", [0.02, 2.0])
def test_a_knife_whose_sides_are_steep(wide):
    """Its edge has facets along which the block's face is not opposed to any: two, of a wedge."""
    points = [(x, y, z) for y in (-0.7, 8.3) for x, z in ((0.3, 0.51), (0.3 - wide / 2, 1.5), (0.3 + wide / 2, 1.5))]
    tetrahedra = np.array([(0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)])
    first = comm.rank == 0
    domain = distributed(comm, np.array(points)[: None if first else 0], tetrahedra[: None if first else 0])
    facets = boundary_facets(domain)
    at = domain.geometry.x[corners_of(domain, facets)].mean(axis=1)
    knife = NamedMesh(domain, {"back": facets[at[:, 2] > 1.5 - 1e-9]})
    bodies = join(block=box((1.0, 1.0, 0.5), (1, 1, 1)), knife=knife)

    def cut(way):
        held = [Clamp("block:bottom"), PrescribedDisplacement("knife:back", (0.0, 0.0, -way))]
        return ContactProblem(bodies, STEEL, held, Contact("block:left", 0.2)).solve()

    answer = cut(0.03)
    inside = answer.small_strain.inside
    assert not answer.valid and inside.depth == pytest.approx(0.02, rel=1e-6) and inside.faces[1] == "'block:top'"
    assert cut(0.01).small_strain.inside is None and cut(0.0099).valid


def test_cells_under_a_face_alone():
    """Of 5 x 4 x 3 cells: not those at the edges of the face, which something can enter from the side."""
    mesh = box((1.0, 1.0, 1.0), (5, 4, 3))
    problem = ContactProblem(mesh, STEEL, [Clamp("top")], Contact("bottom", 0.2))
    (member,) = problem.elasticity.members
    under = BodyBoundary.of(member).under
    every = np.unique(np.concatenate(list(mesh.faces.values())))
    assert comm.allreduce(int(np.count_nonzero(under(mesh.faces["bottom"])))) == 3 * 2
    assert comm.allreduce(int(np.count_nonzero(under(every)))) == 5 * 4 * 3 - 3 * 2 * 1
