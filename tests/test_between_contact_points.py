"""Foundations that reach into a face between its contact points are not missed silently, on any element."""

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Cylinder, Material, Pressure, Traction
from coulomb.io.recheck.directory import check
from coulomb.linalg.reductions import Reductions
from coulomb.model.small_strain import deformation_of


@pytest.mark.parametrize(
    ("cell", "degree", "place"),
    [
        ("hexahedron", 1, 0.92),
        ("hexahedron", 2, 0.925),
        ("tetrahedron", 1, 0.92),
        ("tetrahedron", 2, 0.95),
    ],
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
    along = 0.1 * np.arange(41) / 4
    along = np.linspace(0.9, 1.0, 100001)
    if degree == 1:
        down = np.interp(along, x[line, 0][order], u[line, 2][order])
        ahead = np.interp(along, x[line, 0][order], u[line, 0][order])
        moved = np.column_stack([along + ahead, 0.0 * along, down])
        depth = -roller.signed_distance(moved).min()
        deformation = deformation_of(problem.elasticity, u, Reductions(problem.comm))
        assert solution.small_strain.between == pytest.approx(depth / deformation, rel=1e-3)
    solution.write(tmp_path / "out")
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
    assert solution.valid and solution.small_strain.between == 0.0
