"""Derivatives of answers against formulas: Lame's press fit and Hertz's contact radius."""

import numpy as np
import pytest

import coulomb


def test_a_press_fit_has_the_derivatives_of_the_formula_of_lame():
    """p = E d (b^2 - a^2)/((1 + nu) a ((1 - 2 nu) a^2 + b^2)) and T = F p A: of friction, interference, modulus."""
    young, nu, a, b, long, d, friction = 2.1e11, 0.3, 0.1, 0.2, 0.1, 5e-5, 0.15

    def place(x):
        r, angle = a + (b - a) * x[0], 0.5 * np.pi * x[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), long * x[2]])

    problem = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (4, 6, 1), place=place),
        coulomb.Material(young, nu),
        [coulomb.SymmetryPlane(face) for face in ("front", "back", "bottom", "top")],
        coulomb.Contact(
            "left",
            friction,
            foundation=coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), a),
            gap=-d,
            gap_amplitude=[(0.0, 0.0), (1.0, 1.0)],
            motion=[(1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 1e-4)],
        ),
    )
    p = young * d * (b**2 - a**2) / ((1 + nu) * a * ((1 - 2 * nu) * a**2 + b**2))
    normal, found = p * 0.5 * np.pi * a * long, []
    for step in coulomb.LoadHistory([1.0, 2.0], tolerance=1e-10).steps(problem):
        found = step.solution.sensitivities(found)
    by = {one.name: one.totals["left"] for one in found}
    for name, owed in (("friction", 0.0), ("gap", normal), ("young", normal)):
        name = "young" if name == "young" else f"{name} of 'left'"
        assert by[name]["normal_force"] == pytest.approx(owed, rel=0.02, abs=1e-6 * normal)
        assert by[name]["friction_force"] == pytest.approx(friction * (owed or normal), rel=0.02)


def test_the_contact_radius_of_hertz_is_as_the_third_root_of_force_over_modulus():
    """a^3 = 3 P R/(4 E*), by the mean square distance of the force, 2 a^2/5; cells of a sixth of it."""
    young, nu, R, a, fine, cells = 2.1e11, 0.3, 0.1, 1e-3, 8, 13

    def place(k):
        uniform = 4 / 3 * a * k / fine
        return uniform + (16 - 4 / 3 * cells / fine) * a * (np.maximum(k - fine, 0) / (cells - fine)) ** 3

    quarter = young / (1 - nu**2) * a**3 / (3 * R)
    answer = coulomb.ContactProblem(
        coulomb.box((cells, cells, cells), (cells, cells, cells), place=place),
        coulomb.Material(young, nu),
        [coulomb.Clamp("left", "x"), coulomb.Clamp("front", "y")],
        coulomb.Contact("bottom", friction=0.0, foundation=coulomb.Sphere((0.0, 0.0, -R), R)),
        [coulomb.TotalForce("top", (0.0, 0.0, -quarter))],
    ).solve(tolerance=1e-10)
    force, square = answer.contact_force[0::3], np.sum(answer.at_nodes.x[:, :2] ** 2, axis=1)
    spread, rates = force @ square / quarter, {}
    assert np.sqrt(2.5 * spread) == pytest.approx(a, rel=0.01)
    for one in answer.sensitivities():
        change = one.contact_force[0::3]
        rates[one.name] = 0.5 * (change @ square / spread - change.sum()) / quarter  # of log a
    assert rates["young"] == pytest.approx(-1 / 3, rel=0.06)
    assert rates["total force on 'top'"] == pytest.approx(-rates["young"], rel=1e-3)  # normals are not along z
