"""The error of the stress in the energy norm: differences between meshes by formulas, and estimates by true errors."""

import numpy as np
import pytest
import ufl
from user_forms import Script

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, PrescribedDisplacement, Traction
from coulomb.fem.bodies import StressedCells, stress_difference
from coulomb.fem.meshes import same_cells
from coulomb.io.energy_error import StressOfAnswer, relative_stress_error, stress_of

KINDS = [("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]
SOFT = Material(2.0, 0.3)


def bulge(x):
    y = x.copy()
    y[0] += 0.1 * np.sin(2.0 * x[1]) * x[2]
    y[2] += 0.15 * x[0] ** 2
    return y


def cells(u, n=(3, 3, 3), cell="hexahedron", degree=1, place=None):
    body = Elasticity(coulomb.box((1.0, 1.0, 1.0), n, cell, degree=degree, place=place), SOFT, [Clamp("left")])
    return StressedCells(body, u(body.x), None)


def linear(x):
    return x @ np.array([[0.3, -0.1, 0.4], [0.2, 0.1, -0.3], [0.0, 0.5, -0.2]])


@pytest.mark.parametrize("other", KINDS)
@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_displacements_that_both_meshes_have_do_not_differ(cell, degree, other):
    """On any two meshes; where the boundary is curved points of one are outside the other.  Turned by a rigid motion
    the strain is the same, and a stretch along z of 0.01 has the energy (lambda + 2 mu) 0.01^2 per volume."""
    for n, of in (((2, 2, 1), (3, 3, 3)), ((4, 4, 4), (2, 2, 2))):
        one = cells(linear, n, cell, degree, bulge)
        assert stress_difference(one, cells(linear, of, *other, bulge)).squared < 1e-20
    moved = cells(lambda x: linear(x) + np.cross([0.1, 0.2, 0.3], x) + x * [0.0, 0.0, 0.01], (2, 3, 1), *other)
    mu, lame = 2.0 / 2.6, 2.0 * 0.3 / (1.3 * 0.4)
    found = stress_difference(cells(linear, (4, 4, 4), cell, degree), moved)
    assert found.squared == pytest.approx((lame + 2.0 * mu) * 1e-4)
    assert found.cells == (384 if cell == "tetrahedron" else 64)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_the_difference_of_two_interpolations(cell):
    """u_x = x^2 on n cells along x has the mean slope of each cell: with shear by y and z alone there is none of it, so
    that d^2 = (lambda + 2 mu) h^2/3 beside the exact slope, and on meshes of h and 2 h, (lambda + 2 mu) h^2 since the
    slopes of halves differ by +-h from that of the whole."""
    mu, lame = 2.0 / 2.6, 2.0 * 0.3 / (1.3 * 0.4)

    def stretched(x):
        return x**2 * [1.0, 0.0, 0.0]

    fine, coarse = cells(stretched, (4, 2, 2), cell), cells(stretched, (2, 1, 1), cell)
    found = stress_difference(fine, coarse)
    assert found.squared == pytest.approx((lame + 2.0 * mu) * 0.25**2) and found.across == 0
    exact = cells(stretched, (4, 2, 2), cell, 2)
    assert stress_difference(exact, fine).squared == pytest.approx((lame + 2.0 * mu) * 0.25**2 / 3.0)
    apart = stress_difference(fine, cells(stretched, (3, 1, 1), cell))
    assert apart.across == apart.cells // 2 if cell == "hexahedron" else apart.across > apart.cells // 2


def answer(n, degree=1):
    """An answer on n cells along an edge, of which only the differences from others matter."""
    return StressOfAnswer({"": n}, 1.0 / n, degree, 1.0, 1.0)


@pytest.mark.parametrize("q", [0.4, 0.7, 1.0])
def test_the_error_of_a_power_of_the_cell_size_is_found(monkeypatch, q):
    """Of nested spaces d^2 = e_2^2 - e_1^2, with e = h^q."""

    def difference(fine, coarse):
        return coulomb.fem.bodies.StressDifference(coarse ** (-2.0 * q) - fine ** (-2.0 * q), 1, 0)

    monkeypatch.setattr("coulomb.io.energy_error.stress_difference", difference)
    for sizes in ((8, 4, 2), (12, 6, 3), (12, 6, 4)):
        first, *others = (answer(n) for n in sizes)
        assert relative_stress_error(first, others) == pytest.approx(1.25 * sizes[0] ** -q, rel=1e-3)
        assert relative_stress_error(first, others[::-1]) == relative_stress_error(first, others)


def test_the_error_beside_meshes_that_do_not_contain_each_other_and_beside_second_order(monkeypatch):
    """Both errors are in d of the first ones; of the others one is 0."""
    for across, of, expected in ((1, answer(3, 1), np.sqrt(0.5)), (0, answer(6, 2), 1.0)):
        found = coulomb.fem.bodies.StressDifference(0.04, 1, across)
        monkeypatch.setattr("coulomb.io.energy_error.stress_difference", lambda fine, coarse, found=found: found)
        assert relative_stress_error(answer(6), [of]) == pytest.approx(1.25 * 0.2 * expected)


def block(n, cell, degree, poisson):
    """Held on the left, pressed and dragged on its sole."""
    loads = [Traction("top", (0.0, 1e7, -4e7)), Traction("right", (2e7, 0.0, 0.0))]
    mesh = coulomb.box((2.0, 1.0, 1.0), (2 * n, n, n), cell, degree=degree)
    return ContactProblem(mesh, Material(2e11, poisson), [Clamp("left")], Contact("bottom", 0.3), loads)


@pytest.mark.parametrize(("cell", "degree"), [("tetrahedron", 1), ("hexahedron", 2)])
def test_elements_that_lock_at_singular_edges(cell, degree):
    """For nu = 0.49, where recovery finds half of the error, in both ways; beside second order on smaller cells, whose
    own error is added."""
    posed = block(4 if degree == 1 else 2, cell, degree, 0.49)
    solution, fine = posed.solve(), stress_of(block(6, "hexahedron", 2, 0.49).solve(), 1.0, 2)
    mine = stress_of(solution, 1.0, 1)
    squared = stress_difference(fine.cells[""], mine.cells[""]).squared
    true = np.sqrt(squared + (1.5 * fine.recovered) ** 2) / mine.norm
    assert mine.recovered / mine.norm < 0.75 * true
    others = [posed.on(mesh).solve() for mesh in same_cells(posed.made_of)]
    for bars in (solution.error(), solution.error(*others)):
        assert 0.8 < bars.relative_stress_error / true < 3.0
        assert bars.entry()["relative_stress_error"] == bars.relative_stress_error


def test_two_bodies_with_a_thermal_stress():
    """The norm is without the thermal strain: a uniform temperature of bodies that are free to expand is no stress."""

    def pair(n):
        lower = coulomb.box((1.0, 1.0, 0.5), (2 * n, 2 * n, n))
        upper = coulomb.moved(coulomb.box((0.8, 0.8, 0.5), (n, n, n)), translate=(0.1, 0.1, 0.5))
        expands = Material(2e11, 0.3, expansion=1e-5)
        return ContactProblem(
            coulomb.join(lower=lower, upper=upper),
            {"lower": expands, "upper": expands},
            [Clamp("lower:bottom")],
            Contact("lower:top", 0.3, against="upper:bottom", slave=True),
            [Traction("upper:top", (0.0, 0.0, -1e7))],
            temperature=30.0,
            reference_temperature=20.0,
        )

    fine, coarse = pair(2).solve(), pair(1).solve()
    assert 0.05 < fine.error(coarse).relative_stress_error < 1.0


def test_without_a_known_stress_there_is_none():
    def answer(cells):
        mesh = coulomb.box((1.0, 1.0, 1.0), (cells, cells, cells))
        script = Script(mesh, 1)
        load = ufl.inner(script.constant(np.array([0.0, 0.0, -1e6])), script.v) * script.ds("top")
        body = coulomb.Body(script.elasticity(2e11, 0.3), load, [script.bc(np.zeros(3), "left")], faces=mesh)
        return ContactProblem(body, Contact("bottom", friction=0.2)).solve()

    assert answer(2).error(answer(1)).relative_stress_error is None


def test_a_uniform_stress_has_no_error():
    pressed = [PrescribedDisplacement("top", (0.0, 0.0, -1e-4), "z"), Clamp("left", "x"), Clamp("front", "y")]
    mesh = coulomb.box((1.0, 1.0, 1.0), (4, 4, 4))
    solution = ContactProblem(mesh, Material(2e11, 0.3), pressed, Contact("bottom", friction=0.0)).solve()
    assert solution.error().relative_stress_error < 1e-6
