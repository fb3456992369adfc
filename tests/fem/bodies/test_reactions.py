"""Loads, reactions and their balance against formulas: run it alone, or on several ranks."""

import numpy as np
import pytest
from conftest import STEEL

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Plane, PrescribedDisplacement, Spring, Traction
from coulomb.io.summary import summary
from coulomb.model.load_step import face_columns
from coulomb.solvers import IterativeSolver

CELLS = ["hexahedron", "tetrahedron"]
FAR = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
LENGTHS = np.array([3.0, 1.0, 1.0])


def bar(cell, cells=(6, 2, 2)):
    return coulomb.box(tuple(LENGTHS), cells, cell)


def left_over(solution):
    """Sums of all forces and of all moments, each relative to the largest of them."""
    parts = [*solution.loads, *solution.reactions]
    totals = solution.at_nodes.totals()
    found = []
    for name in ("force", "moment"):
        vectors = np.array([*(getattr(part, name) for part in parts), totals[name]])
        found.append(np.linalg.norm(vectors.sum(axis=0)) / np.max(np.linalg.norm(vectors, axis=1)))
    return max(found)


@pytest.mark.parametrize(("cell", "solver"), [("hexahedron", None), ("tetrahedron", IterativeSolver)])
def test_a_clamp_carries_the_loads(cell, solver):
    """A cantilever that touches nothing: traction at its end, and weight."""
    traction, weight = np.array([2e5, 1e5, -3e6]), np.array([0.0, 0.0, -7.7e4])
    load = [Traction("right", tuple(traction))]
    clamp = [Clamp("left")]
    solution = ContactProblem(bar(cell), STEEL, clamp, FAR, load, tuple(weight), linear_solver=solver).solve()
    body_force, pulled = solution.loads
    (reaction,) = solution.reactions
    volume, face = np.prod(LENGTHS), LENGTHS[1] * LENGTHS[2]
    assert (body_force.name, pulled.name, reaction.name) == ("body_force", "traction_right", "clamp_left")
    assert np.allclose(body_force.force, weight * volume, rtol=1e-12)
    assert np.allclose(body_force.moment, np.cross(0.5 * LENGTHS, weight * volume), rtol=1e-12, atol=1e-6)
    end = np.array([3.0, 0.5, 0.5])
    assert np.allclose(pulled.force, traction * face, rtol=1e-12)
    assert np.allclose(pulled.moment, np.cross(end, traction * face), rtol=1e-12)
    force = -(weight * volume + traction * face)
    moment = -(np.cross(0.5 * LENGTHS, weight * volume) + np.cross(end, traction * face))
    assert np.linalg.norm(reaction.force - force) <= 1e-10 * np.linalg.norm(force)
    assert np.linalg.norm(reaction.moment - moment) <= 1e-10 * np.linalg.norm(moment)
    assert solution.force_balance.balance <= 1e-10


@pytest.mark.parametrize("cell", CELLS)
def test_each_spring_has_its_force(cell):
    """A bar under stress s, held by two springs on one face, in the ratio of their stiffnesses; y and z are free."""
    s, k = 1e6, 3e9
    clamps = [Clamp("front", "y"), Clamp("bottom", "z")]
    springs = [Spring("left", (k, 0.0, 0.0)), Spring("left", (2.0 * k, 0.0, 0.0))]
    contact = Contact("top", 0.3, foundation=Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)))
    problem = ContactProblem(bar(cell), STEEL, clamps, contact, [Traction("right", (s, 0, 0))], springs=springs)
    reactions = {part.name: part for part in problem.solve().reactions}
    assert list(reactions) == ["clamp_front", "clamp_bottom", "spring_left", "spring_left_2"]
    for name, part in (("spring_left", 1.0 / 3.0), ("spring_left_2", 2.0 / 3.0)):
        force = np.array([-s * part, 0.0, 0.0])
        assert np.allclose(reactions[name].force, force, rtol=1e-10, atol=1e-8 * s)
        assert np.allclose(reactions[name].moment, np.cross([0.0, 0.5, 0.5], force), rtol=1e-9, atol=1e-8 * s)
    for name in ("clamp_front", "clamp_bottom"):  # the bar contracts freely
        assert np.linalg.norm(reactions[name].force) <= 1e-8 * s


def test_where_supports_meet_each_direction_is_counted_once():
    """A block pulled off its corner: three clamps that share edges carry the traction, each along its own axis."""
    clamps = [Clamp("left", "x"), Clamp("front", "y"), Clamp("bottom", "z")]
    contact = Contact("top", 0.3, foundation=Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)))
    pull = [Traction("right", (1e6, 0, 0)), Traction("back", (0, 2e6, 0)), Traction("top", (0, 0, 3e6))]
    solution = ContactProblem(bar("hexahedron"), STEEL, clamps, contact, pull).solve()
    forces = np.array([part.force for part in solution.reactions])
    assert np.allclose(forces, -np.diag([1e6, 6e6, 9e6]), rtol=1e-10, atol=1e-3)


CASES = {
    "clamp": lambda cell, **options: ContactProblem(
        bar(cell),
        STEEL,
        [Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (0, 1e7, -4e7)), Traction("right", (2e7, 0, 0))],
        (0.0, 0.0, -7e4),
        **options,
    ),
    "pulled along": lambda cell, **options: ContactProblem(
        bar(cell),
        STEEL,
        [PrescribedDisplacement("top", (0.1, 0.05, -1e-5))],
        Contact("bottom", 0.3),
        [Traction("right", (1e5, 0, 0))],
        small_strain="warn",
        **options,
    ),
    "springs": lambda cell, **options: ContactProblem(
        bar(cell),
        STEEL,
        [],
        Contact("bottom", 0.3),
        [Traction("top", (0, 1e7, -4e7)), Traction("right", (2e7, 0, 0))],
        springs=[Spring("left", 1e11), Spring("back", (1e9, 0.0, 2e9))],
        **options,
    ),
}


@pytest.mark.parametrize(
    ("name", "cell", "solver"),
    [("clamp", "tetrahedron", None), ("pulled along", "hexahedron", IterativeSolver), ("springs", "hexahedron", None)],
)
def test_loads_reactions_and_contact_balance(name, cell, solver):
    solution = CASES[name](cell, linear_solver=solver).solve()
    assert solution.certificate.passed
    assert solution.at_nodes.totals()["normal_force"] > 0.0
    assert left_over(solution) <= 1e-10
    assert solution.force_balance.balance <= 1e-10
    assert summary(solution)["balance"] == solution.force_balance.balance
    (foundation,) = solution.forces_on_foundations
    assert np.allclose(foundation.force, np.negative(solution.at_nodes.totals()["force"]), rtol=1e-12)


@pytest.mark.parametrize(("cell", "slope"), [("hexahedron", 4e-6), ("hexahedron", 0.0), ("tetrahedron", 0.0)])
def test_centre_of_pressure_of_a_linear_pressure(cell, slope):
    """u_z = -(a + b x) z/h, without Poisson's effect: pressure E (a + b x)/h at z = 0, which hexahedra have exactly."""
    E, a, b, (length, width, h) = 2e11, 1e-5, slope, LENGTHS
    shear = 0.5 * E * b / h  # of z; its divergence is a body force along x
    sides = [
        Traction(face, lambda x, n=n: np.stack([0 * x[0], 0 * x[0], -n * shear * x[2]]))
        for face, n in (("left", -1.0), ("right", 1.0))
    ]
    supports = [PrescribedDisplacement("top", lambda x: np.stack([0 * x[0], 0 * x[0], -(a + b * x[0])]))]
    supports += [Clamp("left", "x"), Clamp("right", "x"), Clamp("front", "y"), Clamp("back", "y")]
    contact = Contact("bottom", 0.0, foundation=Plane((0, 0, 0), (0, 0, 1)))
    material = coulomb.Material(E, 0.0)
    solution = ContactProblem(bar(cell), material, supports, contact, sides, (shear, 0.0, 0.0)).solve(1e-10)
    totals = solution.at_nodes.totals()
    force = E / h * width * (a * length + 0.5 * b * length**2)
    centre = (0.5 * a * length**2 + b * length**3 / 3.0) / (a * length + 0.5 * b * length**2)
    assert totals["normal_force"] == pytest.approx(force, rel=1e-8)
    assert np.allclose(totals["centre_of_pressure"], [centre, 0.5 * width, 0.0], rtol=1e-8, atol=1e-12)
    assert totals["contact_area"] == pytest.approx(length * width, rel=1e-12)
    assert totals["moment"][1] == pytest.approx(-centre * force, rel=1e-8)
    columns = face_columns("bottom", totals)
    assert columns["bottom_centre_of_pressure_x"] == totals["centre_of_pressure"][0]
    assert columns["bottom_moment_y"] == totals["moment"][1]
    assert columns["bottom_contact_area"] == totals["contact_area"]
