"""Gradients of functionals of UFL, and along coefficients of forms: against differences of answers and formulas."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from user_forms import Script

import coulomb

H = 2e-4
"""Changes of inputs."""

EXACT = {"quadrature_degree": 4}


def pressed(friction=0.3, young=1.0, pushed=1.0):
    """A block that is clamped on the left, pressed and drawn: points that are open, stick and slip."""
    return coulomb.ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (5, 2, 2)),
        coulomb.Material(2e11 * young, 0.3),
        [coulomb.Clamp("left")],
        coulomb.Contact("bottom", friction=friction, gap=2e-6),
        [coulomb.Traction("top", (0.0, 1e7 * pushed, -4e7 * pushed)), coulomb.Traction("right", (2e7, 0.0, 0.0))],
    )


def value(form):
    return fem.assemble_scalar(fem.form(form))


def mixed(answer):
    """Squares of the displacement in the volume, and of pressure and traction where the body is on the ground."""
    u, p, t = answer.function, answer.function("pressure"), answer.function("traction")
    x = ufl.SpatialCoordinate(u.function_space.mesh)
    of_contact = 1e-12 * (p**2 * x[0] + 3.0 * t[0] * t[1] + 1e6 * t[1])
    return 1e12 * ufl.inner(u, u) * ufl.dx(metadata=EXACT) + of_contact * ufl.ds(metadata=EXACT)


def test_of_displacement_pressure_and_traction():
    """Along each input the remainder is of second order, and central differences agree."""
    answer = pressed().solve(tolerance=1e-12)
    found = answer.gradient(functional=mixed(answer))
    forward = {
        one.name: one.others["functionals"]["mixed"]["value"]
        for one in answer.sensitivities(functionals={"mixed": mixed(answer)})
    }
    (load, _), body = [one.forces for one in answer.problem.elasticity.loads_in(answer.problem.loading)], found.young
    along = {
        "friction": 0.3 * found.friction.sum(),
        "young": body[""].sum(),
        "pushed": np.sum(found.load * load),
    }
    present = value(mixed(answer))
    for name, called in zip(along, ("friction of 'bottom'", "young", "traction on 'top'"), strict=True):
        assert forward[called] == pytest.approx(along[name], rel=1e-8), name
    for name, slope in along.items():
        start = 0.3 if name == "friction" else 1.0

        def after(h, name=name, start=start):
            answer = pressed(**{name: start * (1.0 + h)}).solve(tolerance=1e-12)
            return value(mixed(answer))

        more, less, half = after(H), after(-H), after(0.5 * H)
        assert slope == pytest.approx((more - less) / (2.0 * H), rel=1e-5), name
        left = [abs(of - present - h * slope) for of, h in ((more, H), (half, 0.5 * H))]
        assert 3.5 < left[0] / left[1] < 4.5, (name, left)
        assert abs(slope) > 1e-3 * present


def test_the_strain_energy_of_a_body_under_given_forces():
    """U, as a functional of u, is in proportion to the square of the forces, and of 1/E."""
    problem = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
        coulomb.Material(1e9, 0.3),
        [coulomb.SymmetryPlane("left")],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.TotalForce("top", (1e5, 0.0, -1e6))],
    )
    answer = problem.solve(tolerance=1e-12)
    e = ufl.sym(ufl.grad(answer.function))
    energy = 0.5 * (1e9 / 1.3 * ufl.inner(e, e) + 3e8 / (1.3 * 0.4) * ufl.tr(e) ** 2) * ufl.dx
    found, present = answer.gradient(functional=energy), value(energy)
    (load,) = [one.forces for one in problem.elasticity.loads_in(problem.loading)]
    assert np.sum(found.load * load) == pytest.approx(2.0 * present, rel=1e-9)
    assert found.young[""].sum() == pytest.approx(-2.0 * present, rel=1e-9)


def test_what_functionals_are_refused():
    answer = pressed().solve()
    other = pressed().solve().function
    with pytest.raises(ValueError, match="a form of UFL without arguments"):
        answer.gradient(functional=1.0)
    with pytest.raises(ValueError, match="no function of this answer"):
        answer.gradient(functional=ufl.inner(other, other) * ufl.dx)
    with pytest.raises(ValueError, match="the field 'slip' are not known"):
        answer.gradient(functional=answer.function("slip")[0] * ufl.ds)
    upper = coulomb.moved(coulomb.box((0.8, 0.8, 0.4), (1, 1, 1)), translate=(0.1, 0.1, 0.5))
    pair = coulomb.ContactProblem(
        coulomb.join(low=coulomb.box((1.0, 1.0, 0.5), (1, 1, 1)), up=upper),
        {"low": coulomb.Material(3e6, 0.3), "up": coulomb.Material(1e6, 0.3)},
        [coulomb.Clamp("low:bottom"), coulomb.PrescribedDisplacement("up:top", (0.001, 0.0, -0.002))],
        coulomb.Contact("up:bottom", friction=0.2, against="low:top"),
    )
    answer = pair.solve(tolerance=1e-12)
    p, (member, facets) = answer.functions["up"]("pressure"), answer.problem.elasticity.face("up:bottom", "contact")
    whole = answer.gradient(functional=p * member.body.measure(facets))  # the normal force
    forces = answer.gradient(np.tile([1.0, 0.0, 0.0], len(answer.contact_force) // 3))
    assert whole.young["low"] == pytest.approx(forces.young["low"], rel=1e-9)
    with pytest.raises(ValueError, match="no contact point of the body's own faces"):
        answer.gradient(functional=answer.functions["low"]("pressure") * ufl.ds)


class OfForms:
    """A block of the user's forms, with a modulus, a function on the cells, and a load that are coefficients."""

    def __init__(self, large=False):
        script = self.script = Script(coulomb.box((1.0, 1.0, 0.5), (2, 1, 1)), 1)
        self.young, self.force = script.constant(1e7), script.constant((1e5, 2e4, -2e6))
        self.softer = script.on_cells(lambda x: 1.0 + 0.5 * x[0])
        bcs = [script.bc(0.0, "left", 0)]
        if large:
            u = script.function()
            G, mu = ufl.grad(u), self.young * self.softer / 2.6
            E = 0.5 * (G + G.T + G.T * G)
            energy = (mu * ufl.inner(E, E) + 0.75 * mu * ufl.tr(E) ** 2) * ufl.dx(metadata=EXACT)
            energy -= ufl.inner(self.force, u) * script.ds("top")
            self.body = coulomb.Body(energy=energy, displacement=u, bcs=bcs, faces=script.mesh)
        else:
            a = script.elasticity(self.young * self.softer, 0.3)
            self.body = coulomb.Body(a, ufl.inner(self.force, script.v) * script.ds("top"), bcs, script.mesh)
        self.large = large

    def solve(self):
        contact = coulomb.Contact("bottom", friction=0.3)
        if not self.large:
            return coulomb.ContactProblem(self.body, contact=contact, small_strain="warn").solve(tolerance=1e-12)
        problem = coulomb.ContactProblem(self.body, contact=contact, kinematics="large")
        return problem.solve(tolerance=1e-12)


@pytest.mark.parametrize("large", [False, True])
def test_along_coefficients_of_own_forms(large):
    """A constant of numbers and of vectors, and a function; of the energy of a body, a load is one as well."""
    made = OfForms(large)
    answer = made.solve()
    of_u = np.zeros_like(answer.displacement)
    of_u[:, 2] = answer.problem.elasticity.reference[:, 0]

    def value():
        return np.sum(of_u * made.solve().displacement)

    found, present = answer.gradient(displacement=of_u), value()
    slopes = {one: found.along(one) for one in (made.young, made.force, made.softer)}
    assert [slopes[one].shape for one in slopes] == [(), (3,), made.softer.x.array.shape]
    if not large:  # u is in proportion to the force over the modulus
        assert slopes[made.young] == pytest.approx(-present / 1e7, rel=1e-8)
        assert slopes[made.force] @ made.force.value == pytest.approx(present, rel=1e-8)
        assert slopes[made.softer] @ made.softer.x.array == pytest.approx(-present, rel=1e-8)
    arrays = [made.young.value, made.force.value, made.softer.x.array]
    of_cells = np.random.default_rng(5).uniform(-1.0, 1.0, made.softer.x.array.shape)
    ways = [1e7, 1e5 * np.array([0.3, -0.2, 5.0]), of_cells]
    slope = sum(np.sum(of * way) for of, way in zip(slopes.values(), ways, strict=True))
    start = list(map(np.array, arrays))

    def after(h):
        for array, before, way in zip(arrays, start, ways, strict=True):
            array[...] = before + h * way
        return value()

    more, less, half = after(H), after(-H), after(0.5 * H)
    assert slope == pytest.approx((more - less) / (2.0 * H), rel=1e-6)
    assert 3.8 < (more - present - H * slope) / (half - present - 0.5 * H * slope) < 4.2
    assert after(0.0) == pytest.approx(present, rel=1e-9)
    with pytest.raises(ValueError, match="none of the forms"):
        found.along(made.script.constant(1.0))
    made.young.value *= 1.1
    with pytest.raises(ValueError, match="they have changed"):
        found.along(made.young)
