"""Foundations that reach into a face between its contact points are not missed silently, on any element."""

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Cylinder, Material, Plane, Pressure, Traction
from coulomb.fem.contact.facet_patch import FacetKind
from coulomb.fem.contact.near_facets import FaceSamples
from coulomb.io.output import write
from coulomb.linalg.reductions import Reductions
from coulomb.model.certificate_scales import deformations
from coulomb.model.facets import _depths
from coulomb.recheck import check


@pytest.mark.parametrize(
    ("cell", "degree", "place"),
    [("hexahedron", 1, 0.92), ("hexahedron", 2, 0.925), ("tetrahedron", 1, 0.92), ("tetrahedron", 2, 0.95)],
)
def test_a_roller_between_nodes(cell, degree, place, tmp_path):
    """A cantilever bends over a narrow roller.  The depth is that of the face by its nodes' displacements."""
    gap, radius = 1e-4, 0.02
    roller = Cylinder((place, 0.0, -gap - radius), (0.0, 1.0, 0.0), radius)
    mesh = coulomb.box((1.0, 0.1, 0.1), (10, 1, 1), cell, degree=degree)
    contact = Contact("bottom", 0.0, foundation=roller)
    problem = ContactProblem(mesh, Material(2e11, 0.0), [Clamp("left")], contact, [Pressure("top", 1e5)])
    solution = problem.solve()
    assert solution.at_nodes.totals()["normal_force"] == 0.0
    assert solution.certificate.passed and not solution.valid
    x, u = problem.elasticity.x, solution.displacement
    line = (x[:, 2] == 0.0) & (x[:, 1] == 0.0)
    order = np.argsort(x[line, 0])
    along = np.linspace(0.9, 1.0, 100001)
    if degree == 1:
        down = np.interp(along, x[line, 0][order], u[line, 2][order])
        ahead = np.interp(along, x[line, 0][order], u[line, 0][order])
        moved = np.column_stack([along + ahead, 0.0 * along, down])
        depth = -roller.signed_distance(moved).min()
        deformation = deformations(solution.evidence, Reductions(problem.comm))[1][0]
        assert solution.small_strain.between == pytest.approx(depth / deformation, rel=1e-3)
    write(solution, tmp_path / "out")
    findings = check(tmp_path / "out")
    assert not findings.passed and "between" in str(findings)


def test_the_chord_of_a_curved_face_is_no_penetration():
    """A half ring of first order around a pin of its own radius: the middles of its facets are inside the pin."""

    def place(k):
        angle, r = np.pi * k[0], 1.0 + k[2]
        return np.stack([r * np.cos(angle), k[1], r * np.sin(angle)])

    pin = Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0)
    mesh = coulomb.box((1.0, 1.0, 1.0), (8, 1, 2), place=place)
    problem = ContactProblem(
        mesh,
        Material(2e11, 0.3),
        [Clamp("front", "y"), Clamp("left", "z"), Clamp("right", "z"), Clamp("left", "x")],
        Contact("bottom", 0.0, foundation=pin),
        [Traction("top", (0.0, 0.0, -1e5))],
    )
    solution = problem.solve()
    assert solution.valid and solution.small_strain.between == solution.small_strain.chord == 0.0


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_contact_smaller_than_a_facet_is_invalid(cell, degree, tmp_path):
    """Of a curved face on a plane: the chord is compared with the approach, which grows with the load."""
    radius = 1.0
    mesh = coulomb.box(
        (1.0, 0.25, 0.5), (8 // degree, 2 // degree, 4 // degree), cell, degree=degree,
        place=lambda k: np.stack([k[0] - 0.5, k[1], k[2] + (0.5 - k[2]) * (k[0] - 0.5) ** 2 / radius]),
    )  # fmt: skip
    plane = coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    holds = [Clamp("top", "xy"), Clamp("front", "y"), Clamp("back", "y")]
    contact = Contact("bottom", 0.0, foundation=plane)
    light, heavy = (
        ContactProblem(mesh, Material(2e11, 0.3), holds, contact, [Traction("top", (0.0, 0.0, -load))]).solve()
        for load in (1e7, 1e11)
    )
    assert light.certificate.passed and heavy.certificate.passed
    assert not light.valid and heavy.small_strain.chord < 0.1
    h, work = 0.125 * degree, 1e7 * 0.25 * -light.displacement[light.problem.elasticity.x[:, 2] == 0.5, 2].mean()
    chord = light.small_strain.chord * work / light.at_nodes.totals()["normal_force"]
    assert 0.7 * h**2 / (8 * radius) < chord < 1.5 * h**2 / (8 * radius)
    write(light, tmp_path / "out")
    findings = check(tmp_path / "out")
    assert not findings.passed and "coarse" in str(findings)


def test_depths_are_rounded_by_the_size_of_the_whole_face():
    """A rank whose facets are near the origin has the same depths as one that has all."""
    corners = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]])
    zero = np.zeros(1)
    for depth, found in ((5e-13, 0.0), (5e-12, 5e-12)):
        moved = np.full_like(corners, 0.0) - [0.0, 0.0, depth]
        face = FaceSamples(FacetKind(3, 1), corners, moved, zero, corners.mean(axis=1), True)
        points = np.vstack([corners[0], [[1.0, 0.0, 0.0]]])
        depths = _depths(face, Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), points, np.zeros(4))
        assert depths == pytest.approx([found], abs=1e-20)


@pytest.mark.parametrize("inner", [False, True])
@pytest.mark.parametrize(("half", "cells", "noise"), [(1.0, 1, 0.0), (45.0, 6, 0.0), (5.0, 2, 1e-9)])
def test_a_ring_on_a_foundation_of_its_curvature(half, cells, noise, inner):
    """A sector of a thick ring in a rigid bore or on a rigid shaft, in plane strain (Lame): its chords are those of the
    foundation, of one facet alone and with rounding errors of coordinates, and the pressure is that of the ring."""
    young, nu, pressure, radii = 2e11, 0.3, 1e7, (1.0, 2.0)
    random = np.random.default_rng(1)

    def place(k):
        angle, radius = (
            np.radians(half) * (2.0 * k[1] - 1.0),
            1.0 + k[0] + noise * random.uniform(-1.0, 1.0, k[0].shape),
        )
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.2 * k[2]])

    mesh = coulomb.box((1.0, 1.0, 1.0), (16, cells, 1), place=place)
    touching, loaded = ("left", "right") if inner else ("right", "left")
    at, other = radii if inner else radii[::-1]
    foundation = coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), at, not inner)
    planes = [coulomb.SymmetryPlane(face) for face in ("front", "back", "bottom", "top")]
    contact = Contact(touching, 0.0, foundation=foundation)
    solution = ContactProblem(mesh, Material(young, nu), planes, contact, [coulomb.Pressure(loaded, pressure)]).solve()
    bulk, shear = young / (1.0 + nu) / (1.0 - 2.0 * nu), young / (1.0 + nu)  # sigma_r = bulk A - shear B / r^2
    A, B = np.linalg.solve([[at, 1.0 / at], [bulk, -shear / other**2]], [0.0, -pressure])
    assert solution.valid and solution.small_strain.chord == solution.small_strain.between == 0.0
    assert solution.at_nodes.pressure == pytest.approx(shear * B / at**2 - bulk * A, rel=0.02 if cells == 6 else 4e-3)
    assert bool(solution.small_strain.warnings) is False


def test_flat_faces_whose_coordinates_have_rounding_errors(tmp_path):
    """A plane that touches its foundation: the pressure is uniform under a load whose approach is a quarter of these
    errors; of one that is apart they count, with a warning; a pair is under a load of which they are no part."""
    random, steel = np.random.default_rng(2), Material(2e11, 0.0)
    lower, upper = (
        coulomb.box((1.0, 1.0, 1.0), (4, 4, 2), place=lambda x: x + 1e-9 * random.uniform(-1.0, 1.0, x.shape))
        for _ in range(2)
    )

    def on_plane(z, load):
        floor = Contact("bottom", 0.3, foundation=coulomb.Plane((0.0, 0.0, z), (0.0, 0.0, 1.0)))
        return ContactProblem(lower, steel, [], floor, [Traction("top", (0.0, 0.0, -load))]).solve()

    touching, apart = on_plane(0.0, 50.0), on_plane(-1e-3, 50.0)
    assert touching.valid and not touching.small_strain.warnings
    assert touching.at_nodes.pressure == pytest.approx(50.0, rel=1e-6)
    write(touching, tmp_path / "out")
    findings = check(tmp_path / "out")
    assert findings.passed, str(findings)
    assert apart.valid and apart.small_strain.chord == 0.0
    assert any("have rounding errors of" in text for text in apart.small_strain.warnings)
    bodies = coulomb.join(a=lower, b=coulomb.moved(upper, (0.0, 0.0, 1.0)))
    pair, load = Contact("b:bottom", 0.3, against="a:top"), Traction("b:top", (0.0, 0.0, -1e7))
    together = ContactProblem(bodies, steel, [Clamp("a:bottom")], pair, [load]).solve()
    assert together.valid and not together.small_strain.warnings
    assert together.at_nodes.pressure == pytest.approx(1e7, rel=1e-3)


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 1), ("tetrahedron", 2)])
def test_a_given_gap_of_a_slope(cell, degree):
    """A block turned by a thousandth onto a wedge, pressed by 10 MPa as if on a plane; between the corners of its
    facets the gap was that of the nearest one, 1.7 of the deformation off, and the right answer did not count."""
    slope, offset, strain = 1e-3, 5e-4, 1e7 * (1.0 - 0.3**2 / (1.0 - 0.3) * 2.0) / 2e11

    def exact(x):
        return np.stack([slope * x[2], 0.0 * x[0], offset - slope * x[0] - strain * x[2]])

    answer = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (3, 2, 2), cell, degree=degree),
        coulomb.Material(2e11, 0.3),
        [coulomb.PrescribedDisplacement(side, exact, "xy") for side in ("left", "right", "front", "back")],
        coulomb.Contact("bottom", 0.3, gap=lambda x: slope * x[0] - offset),
        [coulomb.Traction("top", (0.0, 0.0, -1e7))],
    ).solve()
    assert answer.valid and answer.small_strain.between < 1e-6
    u = answer.displacement - exact(answer.problem.elasticity.x.T).T
    assert np.abs(u).max() < 1e-9 * offset


def domed(left, right, apex, bend, cells, degree):
    """A block above z = 0.5 from one x to another, whose lower side is bend (x - apex)^2 above that."""

    def place(x):
        at = left + (right - left) * x[0]
        return np.stack([at, x[1], 0.5 + x[2] + bend * (1.0 - x[2] / 0.3) * (at - apex) ** 2])

    return coulomb.box((1.0, 0.2, 0.3), (cells, 1, 1), place=place, degree=degree)


@pytest.mark.parametrize("kinematics", ["small", "large"])
@pytest.mark.parametrize("cells", [5, 40])
def test_a_body_between_the_nodes_of_a_pair(cells, kinematics):
    """A ridge of second order, 0.1 mm deep in the other body at its apex, has its nodes 0.125 mm above it; its contact
    is 40 mm wide."""
    bodies = coulomb.join(upper=domed(0.0, 1.0, 0.55, 0.05, cells, 2), lower=coulomb.box((1.0, 0.2, 0.5), (4, 1, 2)))
    held = [Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-4))]
    pair = Contact("upper:bottom", 0.2, against="lower:top", slave=True)
    solution = ContactProblem(bodies, Material(2.1e11, 0.3), held, pair, kinematics=kinematics).solve()
    assert solution.certificate.passed
    if cells == 5:
        assert solution.forces["normal_force"] == 0.0 and not solution.valid
        assert "the face opposite" in " ".join(solution.outside)
    else:
        assert solution.forces["normal_force"] > 0.0 and solution.small_strain.between < 0.25


@pytest.mark.parametrize("degree", [1, 2])
def test_a_node_far_beyond_the_end_of_a_curved_master_does_not_press_unnoticed(degree):
    """Slave facets of half a metre before a ridge from 0.6 to 0.9: of first order, the averages of the node at 0.5
    continue the distance from where it is known, and it presses, a place where the other body is not."""
    bodies = coulomb.join(
        upper=domed(0.6, 0.9, 0.7, 2.0, 4, degree), lower=coulomb.box((1.0, 0.2, 0.5), (2, 1, 2), degree=degree)
    )
    held = [Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-4))]
    pair = Contact("lower:top", 0.2, against="upper:bottom", slave=True)
    solution = ContactProblem(bodies, Material(2.1e11, 0.3), held, pair).solve()
    assert solution.certificate.passed and not solution.valid
    if degree == 1:
        assert solution.forces["centre_of_pressure"][0] < 0.6 and solution.small_strain.chord > 1.0


@pytest.mark.parametrize(("cell", "cells"), [("tetrahedron", 2), ("tetrahedron", 8), ("hexahedron", 8)])
def test_an_edge_within_a_facet_of_the_other_body_counts_or_is_told(cell, cells):
    """A block, tilted by 0.6 degrees, stands on its edge at x = 0.3: with the slave's nodes beside it, they do not
    touch, or press by averages that continue the distance beyond the edge, where the block is not."""

    def place(x):
        return np.stack([0.3 + 0.6 * x[0], x[1], 0.5 + x[2] + (1.0 - x[2] / 0.3) * 0.006 * x[0]])

    upper, lower = (
        coulomb.box((1.0, 0.2, 0.3), (4, 1, 1), cell, place=place),
        coulomb.box((1.0, 0.2, 0.5), (cells, 1, 2), cell),
    )
    held = [Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-4))]

    def solve(slave, master):
        pair = Contact(slave, 0.2, against=master, slave=True)
        return ContactProblem(coulomb.join(upper=upper, lower=lower), Material(2.1e11, 0.3), held, pair).solve()

    beside, on_edge = solve("lower:top", "upper:bottom"), solve("upper:bottom", "lower:top")
    assert beside.certificate.passed and not beside.valid and "apart from it" in " ".join(beside.outside)
    assert on_edge.valid and on_edge.forces["centre_of_pressure"][0] == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_an_interference_is_no_depth(kinematics):
    """Blocks that are given to overlap by 0.1 mm press each other, and their faces are apart by as much afterwards."""
    boxes = coulomb.box((1.0, 1.0, 0.5), (3, 3, 1)), coulomb.box((1.0, 1.0, 0.5), (2, 2, 1))
    bodies = coulomb.join(lower=boxes[0], upper=coulomb.moved(boxes[1], translate=(0.0, 0.0, 0.5)))
    pair = Contact("lower:top", 0.2, against="upper:bottom", gap=-1e-4)
    held = [Clamp("lower:bottom"), Clamp("upper:top")]
    answer = ContactProblem(bodies, Material(2.1e11, 0.0), held, pair, kinematics=kinematics).solve()
    assert answer.valid and answer.small_strain.between < 1e-3
    assert answer.forces["normal_force"] == pytest.approx(2.1e11 * 1e-4, rel=1e-3)


def test_slivers_of_a_curved_master_on_few_facets_do_not_count():
    """A dome, pressed into a block wholly, covers slivers of some facets, where hardly any force acts: half of 1.2 mm
    of approach would be far from linear there, but the force is within 1 % of that with the dome's nodes."""

    def place(x):
        x, y, z = -0.08 + 0.43 * x[0], -0.11 + 0.722 * x[1], x[2]
        return np.stack([x, y, 0.5 + 0.4 * z + (1.0 - z) * 0.005 * ((x + 0.04) ** 2 + (y - 0.21) ** 2)])

    bodies = coulomb.join(
        lower=coulomb.box((1.0, 1.0, 0.5), (5, 5, 2), degree=2),
        upper=coulomb.box((1.0, 1.0, 1.0), (2, 5, 2), place=place, degree=2),
    )
    held = [Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", (0.0, 0.0, -1.2e-3))]
    ends = ("lower:top", "upper:bottom"), ("upper:bottom", "lower:top")
    pairs = (Contact(face, 0.0, against=against, slave=True) for face, against in ends)
    one, other = (ContactProblem(bodies, Material(2.1e11, 0.3), held, pair).solve() for pair in pairs)
    assert one.valid and other.valid
    assert one.forces["normal_force"] == pytest.approx(other.forces["normal_force"], rel=0.01)
    pressing = one.at_nodes.force[:, 0] > 0.0
    assert np.max(one.at_nodes.chord[pressing, 1]) > 0.6e-3


def pressed_dome(cells, way, pair, degree=1):
    """A block whose lower face is a paraboloid of radius 1 m, its lowest point at the origin, moved down by `way`
    metres towards the plane z = 0, rigid or of a block that is held below."""

    def place(x):
        x, y, z = x[0] - 0.5, x[1] - 0.5, x[2]
        return np.stack([x, y, 0.6 * z + (1.0 - z) * 0.5 * (x**2 + y**2)])

    upper = coulomb.box((1.0, 1.0, 1.0), (cells, cells, 2), place=place, degree=degree)
    held = [coulomb.PrescribedDisplacement("upper:top" if pair else "top", (0.0, 0.0, -way))]
    contact, body = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))), upper
    if pair:
        lower = coulomb.box(
            (1.2, 1.2, 0.5),
            (3 + (pair == "as master"),) * 2 + (2,),
            place=lambda x: x - np.array([[0.6], [0.6], [0.5]]),
            degree=degree,
        )
        contact, body = (
            Contact("upper:bottom", 0.3, against="lower:top", slave=True),
            coulomb.join(lower=lower, upper=upper),
        )
        held += [Clamp("lower:bottom")]
    if pair == "as master":
        contact = Contact("lower:top", 0.3, against="upper:bottom", slave=True)
    return ContactProblem(body, Material(2.1e11, 0.3), held, contact).solve()


@pytest.mark.parametrize("pair", [None, "as slave", "as master"])
def test_a_face_that_its_facets_keep_from_touching(pair):
    """The facet around the lowest point of the dome is 10 mm above it: by 2 mm the dome touches, the facet does not."""
    answer = pressed_dome(5, 2e-3, pair)
    assert answer.forces["normal_force"] == 0.0 and not answer.valid
    assert "or beyond the gap of a face that presses nowhere" in answer.small_strain.violations[0]
    assert pressed_dome(5, -1e-3, pair).valid  # the facet is 11 mm above
    apart = 6e-3 if pair == "as master" else 1e-3  # nodes opposite are seen through means of facets
    assert pressed_dome(4, -apart, pair).valid  # a node is so far above, the chord 8 mm


def test_a_dome_pressed_by_the_middle_node_of_a_facet():
    """Of second order, with a contact of a radius of 45 mm within a facet of 200 mm: its force is 1.6 times that of
    facets of 91 mm."""
    answer, finer = (pressed_dome(cells, 2e-3, None, degree=2) for cells in (5, 11))
    assert np.count_nonzero(answer.at_nodes.force[:, 0]) == 1
    assert answer.forces["normal_force"] > 1.5 * finer.forces["normal_force"]
    assert answer.small_strain.chord > 4.0 and not answer.valid
