"""The user's own forms beside the same built-in material; and the remedy for tangents that are not definite."""

import numpy as np
import pytest
import ufl
from rubber_blocks import LAME, MU, RubberBlock

import coulomb
from coulomb.fem import compat
from coulomb.fem.bodies import rows_of
from coulomb.fem.compat import fem
from coulomb.kinematics import LargeMotions, neo_hookean

BODY_FORCE, PRESS, SPRING = (3e4, 0.0, 0.0), (0.0, 0.0, -8e4), (0.0, 2e4, 0.0)
CONTACT = coulomb.Contact("bottom", friction=0.4)


def own(given):
    """Held on the left, with a body force in the integral of the strain energy, a load beside it and springs."""
    return RubberBlock(
        held="left",
        loads={"top": lambda time: np.array(PRESS) * time},
        energy=lambda u: neo_hookean(u, MU, LAME) - (2.0 * BODY_FORCE[0] * u[0]) / 2.0,
        skin=lambda u, n: 0.5 * SPRING[1] * u[1] ** 2,
        given=given,
    )


def built_in():
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)),
        coulomb.NeoHookean(1e6, 0.3),
        [coulomb.Clamp("left")],
        CONTACT,
        [coulomb.TotalForce("top", PRESS, amplitude=[(0.0, 0.0), (1.0, 1.0)])],
        body_force=BODY_FORCE,
        springs=[coulomb.Spring("bottom", SPRING)],
        kinematics="large",
    )


@pytest.mark.parametrize("given", ["energy", "residual"])
def test_energies_and_loads_are_those_of_the_built_in_material(given):
    """Dead loads are found in the forms.  Of a residual the strain energy is the work of its internal forces, with the
    error of the trapezoidal rule, and springs are inside."""
    history = coulomb.LoadHistory([0.5, 1.0], tolerance=1e-11)
    steps = [list(history.steps(problem)) for problem in (built_in(), LargeMotions(own(given).body, CONTACT))]
    for one, other in zip(*steps, strict=True):
        assert one.solution.valid and other.solution.valid
        energies = [step.state.energy for step in (one, other)]
        size = abs(energies[0].loads)
        for name in ("loads", "prescribed", "foundation", "elastic", "dissipated"):
            values = [getattr(energy, name) for energy in energies]
            within = 5e-3 if (given, name) == ("residual", "elastic") else 1e-9
            assert values[1] == pytest.approx(values[0], abs=within * size), name
        loads = [sum(load.force for load in step.solution.loads) for step in (one, other)]
        assert loads[1] == pytest.approx(loads[0], rel=1e-12, abs=1e-9)
        ratio = [np.linalg.norm(step.solution.evidence.load) for step in (one, other)]
        assert ratio[1] == pytest.approx(ratio[0], rel=1e-12)


@pytest.mark.parametrize(
    ("energy", "skin", "warned"),
    [
        (
            lambda u: LAME / 2.0 * ufl.div(u) ** 2 + MU * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(u))),
            None,
            True,
        ),
        (lambda u: neo_hookean(u, MU, LAME) - BODY_FORCE[0] * u[0], None, False),
        (lambda u: neo_hookean(u, MU, LAME), lambda u, n: 0.5 * SPRING[1] * u[1] ** 2, False),
    ],
    ids=["small strains", "with a load", "with springs"],
)
def test_an_energy_that_changes_as_the_body_turns_is_named(energy, skin, warned, caplog):
    """One of small strains was valid without a word; loads and springs to the ground are none of strains."""
    LargeMotions(RubberBlock(held="left", energy=energy, skin=skin).body, CONTACT)
    said = [one.getMessage() for one in caplog.records if "not objective" in one.getMessage()]
    assert len(said) == warned
    if warned:  # e = cos a - 1 across the axis, twice: (LAME 2 + 2 MU) e^2 = 2 (LAME + MU) e^2 of a volume of 1
        e = 1.0 - np.cos(np.linalg.norm([0.05, 0.1, 0.15]))
        assert f" {2.0 * (LAME + MU) * e**2:.2g} J" in said[0]


def test_small_motions_are_about_no_displacement():
    """Whatever the function of the displacement has been set to before, as by an answer of large motions; the force is
    that of the linear material."""

    def pressed(set_to):
        block = RubberBlock(way=lambda time, x: np.array([[0.0], [0.0], [-1e-3]]) + 0.0 * x)
        block.u.x.array[:] = set_to * np.sin(np.arange(len(block.u.x.array)))
        body = coulomb.Body(energy=block.form, displacement=block.u, bcs=block.conditions, faces=block.body.mesh)
        for one in (block.body, body):
            block.update(lambda time, x: np.array([[0.0], [0.0], [-1e-3]]) + 0.0 * x, 0.0)
            yield coulomb.ContactProblem(one, CONTACT).solve().forces["normal_force"]
        assert block.u.x.array == pytest.approx(set_to * np.sin(np.arange(len(block.u.x.array))))

    top = coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3))
    linear = coulomb.ContactProblem(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), coulomb.Material(1e6, 0.3), [top], CONTACT)
    expected = linear.solve().forces["normal_force"]
    assert [*pressed(0.0), *pressed(0.05)] == pytest.approx([expected] * 4, rel=1e-6)


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_constants_of_an_energy_change_between_answers(kinematics):
    def energy(u):
        factors.append(fem.Constant(u.function_space.mesh, 1.0))
        return factors[0] * neo_hookean(u, MU, LAME)

    factors = []
    block = RubberBlock(way=lambda time, x: np.array([[0.0], [0.0], [-1e-3]]) + 0.0 * x, energy=energy)
    problem = coulomb.ContactProblem(block.body, CONTACT, kinematics=kinematics)
    before = problem.solve().forces["normal_force"]
    factors[0].value = 3.0
    assert problem.solve().forces["normal_force"] == pytest.approx(3.0 * before, rel=1e-9)


def test_an_energy_of_two_quadrature_rules():
    """Volume changes by one point per cell, which FFCx compiles wrongly beside others: energy, residual and tangent,
    also the one that is positive in every cell, are sums of those of each integral by itself."""
    block = RubberBlock(shape=lambda x: x + 0.05 * np.sin(3.0 * x[:, [1, 2, 0]] + 2.0 * x))
    u, v, w = block.u, ufl.TestFunction(block.V), ufl.TrialFunction(block.V)
    J = ufl.det(ufl.Identity(3) + ufl.grad(u))
    volume = 25.0 * MU * (J - 1.0) ** 2 * ufl.dx(metadata={"quadrature_degree": 1})
    body = coulomb.Body(energy=block.form + volume, displacement=u, bcs=block.conditions)
    there = body.linearised(1e-3 * np.random.default_rng(7).standard_normal(body.reference.shape), 1.0)
    forms = [[one, ufl.derivative(one, u, v)] for one in (block.form, volume)]
    energy = sum(fem.assemble_scalar(fem.form(one)) for one, _ in forms)
    force = sum(fem.petsc.assemble_vector(fem.form(one)).array.reshape(-1, 3) for _, one in forms)
    K = sum(rows_of(compat.assemble_matrix(fem.form(ufl.derivative(one, u, w))), there.x) for _, one in forms)
    assert there.strain_energy(there.place.u) == pytest.approx(energy, rel=1e-12)
    assert np.abs(there.place.loading.load + force).max() < 1e-12 * np.abs(force).max()
    assert np.abs(there.internal_force(there.x) - K).max() < 1e-12 * np.abs(K).max()
    for one, within in ((there, 1e-12), (there.made_positive(), 1e-6)):  # rotations of stressed cells change it
        assert np.abs(rows_of(one.assembled(), there.x) - K).max() < within * np.abs(K).max()


def test_where_cells_are_stable_the_last_remedy_changes_nothing():
    """In every cell, and on facets with springs: coefficients are those of the integrals over each."""
    body = own("energy").body
    there = body.linearised(np.zeros_like(body.reference), 1.0)
    positive = there.made_positive()
    tangents = [one.assembled() for one in (there, positive)]
    size = tangents[0].norm()
    tangents[1].axpy(-1.0, tangents[0])
    assert tangents[1].norm() < 1e-12 * size
    squeezed = body.reference * (0.0, 0.0, -0.6)
    there = body.linearised(squeezed, 1.0)
    dense = [one.assembled().convert("dense") for one in (there, there.made_positive())]
    least = [np.linalg.eigvalsh(one.getDenseArray())[0] for one in dense]  # a view of the matrix, which has to live
    assert least[0] < -1.0 and least[1] > -1e-9 * size


def test_faults_of_the_program_are_no_failed_steps(monkeypatch):
    problem = LargeMotions(own("energy").body, CONTACT)

    def fault(*_):
        raise ValueError("zip() argument 2 is longer than argument 1")

    monkeypatch.setattr("coulomb.model.large_motions.Linearised.turning", fault)
    with pytest.raises(ValueError, match=r"^zip\(\)"):
        list(coulomb.LoadHistory([0.5, 1.0]).steps(problem))
