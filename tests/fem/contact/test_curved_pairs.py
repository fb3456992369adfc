"""Pairs of curved faces: nothing moves against the load, nothing presses without one, and named surfaces count."""

import json

import numpy as np
import pytest
from mpi4py import MPI
from shared_problems import ring_mesh

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Cylinder,
    Material,
    Plane,
    PrescribedDisplacement,
    Pressure,
    SignedDistance,
    Sphere,
    SymmetryPlane,
    Traction,
    box,
    join,
    moved,
)
from coulomb.io import output
from coulomb.recheck import check
from verification.array_mesh import quarter_ring
from verification.ring_pair import FIT, INTERFERENCE, rings

STEEL = Material(2.1e11, 0.3)
RADIUS = 0.01


def roller(cells, cell, degree, shift=0.0, half=60.0, comm=MPI.COMM_WORLD):
    """The lower part of a roller of 2 mm, its face "bottom" along the circle by so many degrees to both sides, its face
    "top" plane; a shift moves the nodes along the circle."""

    def place(k):
        angle = np.radians(half) * (2.0 * (k[0] + 0.2 * shift * k[0] * (1.0 - k[0])) - 1.0)
        rim = RADIUS * np.stack([np.sin(angle), -np.cos(angle)])
        top = np.stack(
            [
                0.5 * RADIUS * angle / np.radians(half),
                np.full_like(angle, -0.3 * RADIUS if half < 90.0 else 0.7 * RADIUS),
            ]
        )
        x, z = k[2] * top + (1.0 - k[2]) * rim
        return np.stack([x, 0.002 * k[1], z])

    return box((1.0, 1.0, 1.0), (cells, 1, max(cells // 3, 2)), cell, comm, place, degree)


def rolled(cells, cell, degree, load, shift=0.0, comm=MPI.COMM_WORLD, **contact):
    """The roller on a plate, pressed by a load in newtons per metre and guided, without friction."""
    plate = box((0.02, 0.002, 0.004), (cells // 2, 1, 2), cell, comm, degree=degree)
    plate = moved(plate, translate=(-0.01, 0.0, -RADIUS - 0.004))
    sides = [Clamp(f"{name}:{face}", "y") for name in ("upper", "lower") for face in ("front", "back")]
    return ContactProblem(
        join(upper=roller(cells, cell, degree, shift, comm=comm), lower=plate),
        STEEL,
        [Clamp("lower:bottom"), Clamp("upper:top", "x"), *sides],
        Contact("upper:bottom", against="lower:top", friction=0.0, **contact),
        [Traction("upper:top", (0.0, 0.0, -load / RADIUS))],
    )


@pytest.mark.parametrize(
    ("cell", "degree", "cells", "shift"),
    [("hexahedron", 1, 6, 0.3), ("tetrahedron", 1, 9, 0.0), ("hexahedron", 2, 9, 0.0), ("tetrahedron", 2, 6, 0.3)],
)
def test_a_roller_moves_down_under_a_load_and_not_without(cell, degree, cells, shift):
    """With a vertex or an edge at the lowest place; by half the load less.  The error of the approach is at most the
    chord of the facets, and where that is large the answer is invalid."""
    problem = rolled(cells, cell, degree, 3e5, shift)
    chord = (np.pi / 1.5 / cells) ** 4 * RADIUS / 384.0 if degree == 2 else 0.0  # of facets outside the circle
    assert problem.surface.gap.min() >= -chord
    solution, half = problem.solve(), rolled(cells, cell, degree, 1.5e5, shift).solve()
    top = problem.elasticity.members[0].body.nodes("top", "contact")
    down, less = (one.displacement[top, 2].mean() for one in (solution, half))
    assert down < less < 0.0
    if degree == 2:
        assert not solution.valid or solution.small_strain.chord < 0.5
    low = (np.pi / 9.0) ** 4 * RADIUS / 384.0 if degree == 2 else 0.0
    still = ContactProblem(
        join(
            upper=roller(6, cell, degree, shift),
            lower=moved(box((0.02, 0.002, 0.004), (3, 1, 2)), translate=(-0.01, 0, -0.014 - low)),
        ),
        STEEL,
        [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", (0.0, 0.0, 0.0))],
        Contact("upper:bottom", against="lower:top", friction=0.3),
    ).solve()
    assert not np.any(still.contact_force)


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_a_contact_smaller_than_a_facet_does_not_count(cell, degree):
    """The approach is the work of the line load over it; the chord is that of the distance of contact points."""
    for load, valid in ((3e5, False), (3e7, True)):
        solution = rolled(18, cell, degree, load).solve()
        forces = solution.problem.elasticity.internal_force(solution.displacement)
        approach = np.vdot(forces, solution.displacement) / (2e-3 * load)
        sagitta = RADIUS * (1.0 - np.cos(np.pi / 54))
        if degree == 1:
            assert 0.7 < solution.small_strain.chord * approach / sagitta < 1.02  # in the middles of triangles less
        assert any("coarse" in text for text in solution.small_strain.violations) is not valid


def test_contact_points_of_fitting_faces_are_on_them():
    """With dual functions they would be up to 2 % of the radius before the face, and so would be arms of friction; of a
    face on a plane they are, where a contact is small."""
    bore, shaft = (
        quarter_ring(inner, 0.5 + inner, 0.6, (1, n, 1), "tetrahedron", 2) for inner, n in ((1.0, 4), (0.5, 3))
    )
    fit = Contact("bore:left", against="shaft:right", friction=0.3)
    problem = ContactProblem(join(bore=bore, shaft=shaft), STEEL, [Clamp("bore:right"), Clamp("shaft:left")], fit)
    surface = problem.surface
    off = np.abs(np.linalg.norm(surface.x[:, :2], axis=1) - 1.0)
    assert (
        off.max() < 3e-3 and off.mean() < 1.5e-3
    )  # at ends of the face points are beside their vertices, along tangents
    turn = np.cross([0.0, 0.0, 1.0], problem.elasticity.x)
    turn[problem.elasticity.members[1].nodes] = 0.0
    slip = surface.rows(turn)
    assert np.abs(np.linalg.norm(slip[:, 1:], axis=1) - 1.0).max() < 3e-3


def test_named_surfaces_of_first_order_facets_count():
    """A plate pressed on a roller that is the master: between its vertices the polygon is lower than the circle."""
    cylinder = Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), RADIUS)
    gaps = []
    for given in ({}, {"smooth": True}, {"against_surface": cylinder}):
        mesh = join(
            upper=roller(9, "hexahedron", 1),
            lower=moved(box((0.02, 0.002, 0.004), (60, 1, 2)), translate=(-0.01, 0, -0.014)),
        )
        problem = ContactProblem(
            mesh,
            STEEL,
            [Clamp("lower:bottom"), Clamp("upper:top")],
            Contact("lower:top", against="upper:bottom", friction=0.0, **given),
        )
        assert problem.surface.faces == ("lower:top",)
        x, gap = problem.surface.x, problem.surface.gap
        near = np.abs(x[:, 0]) < 0.002
        gaps.append((gap - (RADIUS - np.sqrt(RADIUS**2 - x[:, 0] ** 2)))[near])
    sagitta = RADIUS * (1.0 - np.cos(np.pi / 27))
    assert np.abs(gaps[0]).max() == pytest.approx(sagitta, rel=0.02)
    assert np.abs(gaps[1:]).max() < (np.pi / 13.5) ** 2 * sagitta  # the square of a facet's angle


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_gaps_of_a_shaft_in_a_bore_count_the_chords_of_both(cell):
    """Their mean is the distance between the areas of both polygons, in place of that between vertices and chords."""
    problem = rings(4, (cell, cell), (1, 1), by_geometry=True, facets="as they are")
    surface, radii = problem.surface, np.array([FIT, FIT + INTERFERENCE])
    angles = 0.5 * np.pi / np.array([12, 16])
    outer, inner = 0.5 * radii**2 * np.sin(angles) / angles  # areas over angles of both polygons
    assert surface.gap @ surface.area / surface.area.sum() == pytest.approx((outer - inner) / FIT, rel=0.02)


def test_the_surface_follows_its_face_when_slave_and_master_are_exchanged():
    ball, plate = Sphere((0.0, 0.0, 0.0), 1.0), Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    contact = Contact("a:x", against="b:y", friction=0.1, surface=ball, against_surface=plate)
    other = contact.exchanged()
    assert (other.face, other.against, other.surface, other.against_surface) == ("b:y", "a:x", plate, ball)


def test_the_wrong_surface_is_refused():
    wrong = Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 2.0 * RADIUS)
    with pytest.raises(ValueError, match="'upper:bottom': has a node off the surface given for it"):
        rolled(6, "hexahedron", 1, 1e5, surface=wrong)
    with pytest.raises(ValueError, match="smooth and surface are for faces against a deformable face"):
        Contact("bottom", friction=0.1, smooth=True)


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_what_faces_away_from_a_foundation_is_left_out(cell, degree, caplog, tmp_path):
    """A face that goes up to 110 degrees around a roller: with the forces of one that ends at 90 degrees."""
    problem = ContactProblem(
        roller(12, cell, degree, half=110.0),
        STEEL,
        [PrescribedDisplacement("top", (0.0, 0.0, -3e-4))],
        Contact("bottom", friction=0.3, foundation=Plane((0.0, 0.0, -RADIUS), (0.0, 0.0, 1.0))),
    )
    angle = np.degrees(np.arctan2(problem.surface.x[:, 0], -problem.surface.x[:, 2]))
    assert 70.0 < np.abs(angle).max() < 95.0
    assert "nodes face away from the foundation" in caplog.text
    solution = problem.solve()
    assert solution.certificate.passed and solution.contact_force[0::3].sum() > 1e3
    output.write(solution, tmp_path / "run")
    assert check(tmp_path / "run").passed
    with pytest.raises(ValueError, match="is turned away from the foundation"):
        foundation = Plane((0.0, 0.0, -RADIUS), (0.0, 0.0, -1.0))
        ContactProblem(roller(11, cell, degree), STEEL, [Clamp("top")], Contact("bottom", 0.3, foundation=foundation))


SURFACES = {
    "smooth": {"smooth": True},
    "cylinder": {"surface": Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), RADIUS)},
    "function": {"surface": SignedDistance(lambda x: np.hypot(x[0], x[2]) - RADIUS)},
}


@pytest.mark.parametrize("given", SURFACES.values(), ids=SURFACES)
def test_check_knows_the_surfaces_of_a_run_from_python(given, tmp_path):
    problem = rolled(6, "hexahedron", 1, 3e5, 0.3, **given)
    output.write(problem.solve(), tmp_path / "run")
    assert not check(tmp_path / "run").faults and not check(tmp_path / "run", problem).faults
    summary = json.loads((tmp_path / "run/summary.json").read_text())
    summary["understood"]["contacts"][0]["shape"] = {"smooth": False, "surface": None, "against_surface": None}
    (tmp_path / "run/summary.json").write_text(json.dumps(summary))
    assert any("contacts[0].shape" in fault for fault in check(tmp_path / "run", problem).faults)
    flat = rolled(6, "hexahedron", 1, 3e5, 0.3)
    assert any(fault.startswith("contact.xdmf: initial_gap") for fault in check(tmp_path / "run", flat).faults)


@pytest.mark.parametrize("interference", [1e-5, 0.0, -1e-5])
@pytest.mark.parametrize(("cells", "alike"), [(12, True), (18, False)])
def test_polygons_of_the_same_and_of_another_division(cells, alike, interference):
    """A ring in another one under inner pressure, pressed in or with clearance (Lame): chords of both faces cancel
    where the facets have the same edges, and matter where they have not."""
    E, nu, pressure = 2.1e11, 0.3, 1e7
    bodies = join(shaft=ring_mesh(0.5, 1.0 + interference, (6, 12, 1)), hub=ring_mesh(1.0, 2.0, (6, cells, 1)))
    planes = [SymmetryPlane(f"{one}:{face}") for one in bodies.bodies for face in ("front", "back", "bottom", "top")]
    contact = Contact("shaft:right", 0.0, against="hub:left")
    solution = ContactProblem(bodies, STEEL, planes, contact, [Pressure("shaft:left", pressure)]).solve()
    assert solution.valid is alike
    fit = interference * E / (1.0 - nu**2) / ((4.0 + 1.0) / (4.0 - 1.0) + (1.0 + 0.25) / (1.0 - 0.25))
    expected = fit + pressure * 0.25 / (4.0 - 0.25) * (4.0 - 1.0)
    if alike:
        assert solution.at_nodes.pressure == pytest.approx(expected, rel=5e-3)
    else:
        assert any("coarse" in text for text in solution.small_strain.violations)


def test_a_signed_distance_has_a_normal_at_the_origin_alone():
    """As on a rank with one node: the step of its differences is no part of the coordinates then."""
    found = SignedDistance(lambda x: x[2] + 1e-3).normal(np.zeros((1, 3)))
    assert found == pytest.approx(np.array([[0.0, 0.0, 1.0]]), abs=1e-9)
