"""Contact of 10-node tetrahedra and 27-node hexahedra: contact points, their weights, and multigrid."""

import numpy as np
import pytest
from conftest import STEEL, to_csr

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Plane,
    PrescribedDisplacement,
    Pressure,
    SignedDistance,
    Sphere,
    Traction,
)
from coulomb.fem.contact.contact_points import contact_points

CELLS = ["tetrahedron", "hexahedron"]


def pressed(cell, **given):
    """A block of 2 x 1 x 1 m on a plane; the mesh is curved inside its faces."""

    def bulged(x):
        y = x.copy()
        y[0] += 0.06 * np.sin(np.pi * x[0] / 2.0) * np.cos(2.0 * x[1])
        y[2] += 0.05 * np.sin(np.pi * x[2]) * np.sin(3.0 * x[0])
        return y

    mesh = coulomb.box((2.0, 1.0, 1.0), (2, 2, 1), cell, degree=2, place=bulged)
    loads = [Pressure("top", 1e7), Traction("right", (1e6, 0.0, 0.0))]
    return ContactProblem(mesh, STEEL, [Clamp("left")], Contact("bottom", 0.3), loads, **given)


def of_triangle(area):
    """Integrals of 2 L_j - L_k/2 - L_l/2 times the quadratic functions over a plane triangle with straight edges, from
    int L1^a L2^b L3^c dS = 2 S a! b! c!/(a + b + c + 2)!; edges 12, 02, 01."""
    vertices = area * (np.eye(3) * (1 / 30 + 1 / 60) - 1 / 60)
    edges = area * (2 / 15 - np.eye(3) / 15)
    return (2.5 * np.eye(3) - 0.5) @ np.hstack([vertices, edges])


def test_weights_of_vertices_are_integrals_over_the_triangles():
    mesh = coulomb.box((2.0, 1.0, 1.0), (2, 1, 1), "tetrahedron", degree=2)
    problem = ContactProblem(mesh, STEEL, [Clamp("top")], Contact("bottom", 0.3))
    x, points = problem.elasticity.x, problem.surface.points
    assert not points.nodal

    def node(place):
        return int(np.flatnonzero(np.linalg.norm(x - place, axis=1) < 1e-9)[0])

    integrals = np.zeros((len(x), len(x)))
    bottom = np.abs(x[:, 2]) < 1e-9
    corners = [point for point in x[bottom] if np.allclose(point, np.round(point))]
    for a in corners:
        for b in corners:
            for c in corners:
                numbers = [node(v) for v in (a, b, c)]
                if len({*numbers}) < 3 or numbers != sorted(numbers):
                    continue
                area = 0.5 * np.linalg.norm(np.cross(b - a, c - a))
                middles = [0.5 * (b + c), 0.5 * (a + c), 0.5 * (a + b)]
                if area != pytest.approx(0.5) or not is_facet(problem, (a, b, c)):
                    continue
                integrals[np.ix_(numbers, [*numbers, *map(node, middles)])] += of_triangle(area)
    a_j = integrals.sum(axis=1)[points.nodes]
    assert points.area == pytest.approx(a_j, rel=1e-12) and points.area.sum() == pytest.approx(2.0)
    assert points.weights.toarray() == pytest.approx(integrals[points.nodes] / a_j[:, None], abs=1e-13)


def is_facet(problem, corners):
    """Whether a cell has these corners."""
    domain = problem.mesh.domain
    for cell in domain.geometry.x[coulomb.fem.compat.cell_geometry(domain)[:, :4]]:
        if all(np.any(np.all(np.abs(cell - corner) < 1e-9, axis=1)) for corner in corners):
            return True
    return False


@pytest.mark.parametrize("cell", CELLS)
def test_forces_and_moments_are_those_of_the_contact_points(cell):
    """B^T x has the resultant of the forces x and their moment about any point, on curved cells too."""
    problem = pressed(cell)
    surface = problem.surface
    x = np.random.default_rng(3).normal(size=(len(surface.nodes), 3))
    at_nodes, forces = surface.at_nodes(x), surface.vectors(x)
    assert at_nodes.sum(axis=0) == pytest.approx(forces.sum(axis=0), abs=1e-12)
    moment = np.cross(problem.elasticity.x, at_nodes).sum(axis=0)
    assert moment == pytest.approx(np.cross(surface.x, forces).sum(axis=0), abs=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_constant_tractions_are_the_loads_of_a_pressure(cell):
    """Contact forces p a_j are exactly the nodal forces of the pressure p on the face: the condition of patch tests."""
    problem = pressed(cell)
    body, facets = problem.elasticity, problem.mesh.facets("bottom", "test")
    points = contact_points(body, facets)
    load = body.pressure_load(np.full(len(body.x), 3.0), facets)
    there = np.zeros_like(load)
    there[:, 2] = points.weights.T @ (3.0 * points.area)
    assert there == pytest.approx(load, abs=1e-12 * np.abs(load).max())


@pytest.mark.parametrize("cell", CELLS)
def test_gaps_are_averages(cell):
    """Of a plane that is inclined: the gap at the mean place.  Of a ball: by the gaps of the nodes."""
    inclined, ball = Plane((0.0, 0.0, -0.1), (0.0, 0.1, 1.0)), Sphere((1.0, 0.5, -3.0), 2.9)
    for foundation in (inclined, ball):
        problem = ContactProblem(
            coulomb.box((2.0, 1.0, 1.0), (2, 2, 1), cell, degree=2),
            STEEL,
            [Clamp("top")],
            Contact("bottom", 0.3, foundation=foundation),
        )
        surface = problem.surface
        if foundation is inclined:
            assert surface.gap == pytest.approx(foundation.signed_distance(surface.x), abs=1e-14)
        else:
            on_face = np.where(problem.elasticity.x[:, 2] == 0.0, foundation.signed_distance(problem.elasticity.x), 0.0)
            assert surface.gap == pytest.approx(surface.points.weights @ on_face, abs=1e-14)


@pytest.mark.parametrize("place", [(1.0, 0.5), (1.0, 0.0), (0.9, 0.45), (0.3, 0.1)])
def test_a_ball_that_touches_makes_no_interference(place):
    """At a vertex, at one on the edge of the face, in a facet, on an edge: all gaps are at least 0, that of a vertex
    that touches is 0 to fourth order in h/R."""
    ball = Sphere((*place, -30.0), 30.0)
    mesh = coulomb.box((2.0, 1.0, 1.0), (8, 4, 1), "tetrahedron", degree=2)
    problem = ContactProblem(mesh, STEEL, [Clamp("top", "xy")], Contact("bottom", 0.3, foundation=ball))
    surface = problem.surface
    x = problem.elasticity.x[surface.nodes]
    away = np.hypot(x[:, 0] - place[0], x[:, 1] - place[1])
    assert surface.gap.min() >= 0.0
    if away.min() < 1e-12:
        assert surface.gap[np.argmin(away)] <= 0.25**4 / 30.0**3
    assert not np.any(problem.solve().contact_force)


def test_a_foundation_of_fourth_order_that_touches_makes_no_interference():
    """A gap that grows as r^4 around a vertex has the mean -3/16 h^4 times its factor, but no node is inside."""
    foundation = SignedDistance(lambda x: x[2] + 2.0 * ((x[0] - 0.5) ** 2 + (x[1] - 0.5) ** 2) ** 2)
    mesh = coulomb.box((1.0, 1.0, 0.5), (2, 2, 1), "tetrahedron", degree=2)
    surface = ContactProblem(mesh, STEEL, [Clamp("top")], Contact("bottom", 0.3, foundation=foundation)).surface
    of_nodes = foundation.signed_distance(surface.points.space.x)
    assert surface.points.average(of_nodes).min() < -0.01 and surface.gap.min() == 0.0


@pytest.mark.parametrize("cells", [2, 6])
def test_singular_values_of_B_next_to_clamps(cells):
    """The rows of tetrahedra stay independent on the free nodes when the mesh is refined: the smallest singular value
    is 0.40 to 0.41 with one edge of the face clamped, 1/3 with all four; the largest at most 0.8."""
    all_four = [Clamp(face) for face in ("left", "right", "front", "back")]
    for clamps, least in (([Clamp("left")], 0.4), (all_four, 0.333)):
        mesh = coulomb.box((1.0, 1.0, 1.0), (cells, cells, 1), "tetrahedron", degree=2)
        problem = ContactProblem(mesh, STEEL, clamps, Contact("bottom", 0.3))
        values = np.linalg.svd(to_csr(problem.surface.free_B).toarray(), compute_uv=False)
        assert values[-1] > least and values[0] < 0.8


@pytest.mark.parametrize("cell", CELLS)
def test_the_certificate_names_means(cell):
    solution = pressed(cell).solve()
    assert solution.valid and solution.force_balance.balance < 1e-12
    assert ("means around vertices" in str(solution.certificate)) == (cell == "tetrahedron")
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(solution.force_on_body.sum(axis=0)[2], rel=1e-12)


def test_a_ball_that_no_mean_touches_is_found():
    """The body moves without deformation, past a small ball that is between its contact points."""
    mesh = coulomb.box((1.0, 1.0, 0.5), (4, 4, 2), "tetrahedron", degree=2)
    ball = Contact("bottom", 0.3, foundation=Sphere((0.375, 0.5, -0.1), 0.1))
    press = PrescribedDisplacement("top", (0.0, 0.0, -1e-4))
    solution = ContactProblem(mesh, STEEL, [press], ball).solve()
    assert solution.at_nodes.totals()["normal_force"] == 0.0 and not solution.valid
    assert solution.small_strain.between == 100.0
    lifted = ContactProblem(mesh, STEEL, [PrescribedDisplacement("top", (0.0, 0.0, 1e-4))], ball).solve()
    assert lifted.valid and lifted.small_strain.between == 0.0
