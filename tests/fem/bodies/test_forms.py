"""A body from the user's forms: the same answers as from materials and loads of the package, and formulas."""

import re

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from user_forms import Script, strain

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory, Material, PrescribedDisplacement, Traction
from coulomb.fem import compat
from coulomb.fem.bodies import rows_of

YOUNG, POISSON = 2.1e11, 0.3
FORCE = np.array([2e6, 1e6, -8e6])
PRESS = [(0, 0), (1, 1), (3, 1)]
RUB = [(0, 0), (1, 0), (2, 1), (3, -1)]


def both(cell, degree, compiled=False, comm=MPI.COMM_WORLD):
    """A block pressed and rubbed by its top, with traction and weight, from materials and from forms."""
    mesh = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), cell, comm=comm)
    ours = None
    if degree == 1:
        press = PrescribedDisplacement("top", (0.0, 0.0, -1e-4), "z", amplitude=PRESS)
        rub = PrescribedDisplacement("top", (1e-4, 0.0, 0.0), "xy", amplitude=RUB)
        loads = [Traction("left", tuple(FORCE), amplitude=PRESS)]
        weight = {"body_force": (0.0, 0.0, -5e6), "body_force_amplitude": RUB}
        ours = ContactProblem(mesh, Material(YOUNG, POISSON), [press, rub], Contact("bottom", 0.4), loads, **weight)
    script = Script(mesh, degree)
    t, g = script.constant(np.zeros(3)), script.constant(np.zeros(3))
    top, ds = script.function(), script.ds("left")
    a = script.elasticity(YOUNG, POISSON)
    L = ufl.inner(t, script.v) * ds + ufl.inner(g, script.v) * ufl.dx
    if compiled:
        a, L = script.compile(a), script.compile(L)

    def update(time):
        press, rub = (np.interp(time, *np.transpose(table)) for table in (PRESS, RUB))
        t.value[:], g.value[:] = press * FORCE, rub * np.array([0.0, 0.0, -5e6])
        top.x.array.reshape(-1, 3)[:] = [rub * 1e-4, 0.0, -press * 1e-4]

    body = coulomb.Body(a, L, [script.bc(top, "top")], faces=mesh, update=update)
    return ours, ContactProblem(body, Contact("bottom", 0.4)), script


def close(one, other, limit=1e-10):
    return np.abs(one - other).max() <= limit * np.abs(other).max()


@pytest.mark.parametrize(("cell", "compiled"), [("hexahedron", True), ("tetrahedron", False)])
def test_the_same_history_from_forms(cell, compiled):
    """Displacements, forces, reactions, energies and accumulated friction of three steps are the same to 1e-10."""
    ours, theirs, script = both(cell, 1, compiled)
    history = LoadHistory([1.0, 2.0, 3.0], tolerance=1e-12)
    steps = list(history.steps(theirs))
    for one, other in zip(history.steps(ours), steps, strict=True):
        earlier = other.solution  # of which an answer keeps its load
        assert coulomb.certify(earlier.problem, earlier.contact_force, earlier.displacement).passed
        assert other.solution.certificate.passed and other.solution.force_balance.balance < 1e-10
        assert close(other.solution.displacement, one.solution.displacement)
        assert close(other.solution.contact_force, one.solution.contact_force)
        clamps = np.sum([part.force for part in one.solution.reactions], axis=0)
        assert close(other.solution.reactions[0].force, clamps)
        for name in ("loads", "prescribed", "elastic", "dissipated"):
            scale = one.state.energy.elastic
            assert abs(getattr(other.state.energy, name) - getattr(one.state.energy, name)) < 1e-10 * scale
    assert one.state.energy.dissipated > 0.01 * one.state.energy.elastic
    function = other.solution.function
    assert np.array_equal(function.x.array[: other.solution.displacement.size], other.solution.displacement.ravel())
    assert compiled or function.function_space == script.V


def distorted(comm=MPI.COMM_WORLD):
    """A block of hexahedra that are no parallelepipeds."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (3, 3, 3), comm=comm)
    x = mesh.domain.geometry.x
    x += 0.06 * np.sin(np.pi * x[:, [1, 2, 0]]) * np.sin(np.pi * x) * np.sin(2.0 * np.pi * x[:, [2, 0, 1]])
    return mesh


def test_selective_reduced_integration():
    """Volume changes by one point per cell, the rest by 8, and springs: the matrix and the residual are the sums of
    those of each integral by itself (FFCx compiles the whole wrongly), and the answer is certified."""
    script = Script(distorted(), 1)
    young, poisson = 1e6, 0.4999
    mu, lame = script.constant(young / (2.0 * (1.0 + poisson))), young * poisson / (1.0 + poisson) / (1 - 2 * poisson)
    along = script.on_cells(lambda x: 1.0 + x[0])
    parts = [
        2.0 * mu * ufl.inner(strain(script.u), strain(script.v)) * ufl.dx,
        lame * along * ufl.div(script.u) * ufl.div(script.v) * ufl.dx(metadata={"quadrature_degree": 1}),
        1e5 * ufl.inner(script.u, script.v) * script.ds("left"),
    ]
    body = coulomb.Body(sum(parts[1:], parts[0]), None, [script.bc((0.0, 0.0, -0.02), "top")], script.mesh)
    u = np.random.default_rng(5).standard_normal(body.x.shape)
    expected = sum(rows_of(compat.assemble_matrix(script.compile(part)), u) for part in parts)
    assert close(rows_of(body.assembled(), u), expected, 1e-13)
    assert close(body.internal_force(u), expected, 1e-13)
    solution = ContactProblem(body, Contact("bottom", 0.3)).solve()
    assert solution.valid and solution.certificate.passed


def test_near_incompressibility_as_from_materials():
    """Changes of volume by one point per cell are the mean dilatation of bricks, whose answer our materials have; by
    all points its mean square in bending, h^2/12, makes n cells across 1 + bulk/(4 mu n^2) times as stiff."""
    mesh, young, poisson = coulomb.box((2.0, 1.0, 0.5), (4, 2, 2)), 1e6, 0.4999
    mu, bulk = young / (2.0 * (1.0 + poisson)), young / (3.0 * (1.0 - 2.0 * poisson))
    press, contact = (0.0, 0.0, -0.01), Contact("bottom", 0.5)
    ours = ContactProblem(mesh, Material(young, poisson), [PrescribedDisplacement("top", press)], contact).solve(1e-11)
    script = Script(mesh, 1)
    e, d = strain(script.u), strain(script.v)
    shape, volume = 2.0 * mu * ufl.inner(ufl.dev(e), ufl.dev(d)), bulk * ufl.tr(e) * ufl.tr(d)

    a = shape * ufl.dx + volume * ufl.dx(metadata={"quadrature_degree": 1})
    theirs = ContactProblem(coulomb.Body(a, None, [script.bc(press, "top")], mesh), contact).solve(1e-11)
    assert theirs.valid and close(theirs.displacement, ours.displacement, 1e-8)
    assert close(theirs.contact_force, ours.contact_force, 1e-6)
    assert not theirs.problem.body.remarks
    locked = ContactProblem(coulomb.Body((shape + volume) * ufl.dx, None, [script.bc(press, "top")], mesh), contact)
    (said,) = locked.body.remarks
    bulks, times = (float(one) for one in re.findall(r"(\S+) times", said))
    assert said.startswith("forms: bulk modulus") and bulks == pytest.approx(bulk / mu, rel=5e-3)
    assert times == pytest.approx(1.0 + bulk / (16.0 * mu), rel=3e-2)


def test_a_block_held_by_robin_terms_alone():
    """A push along x moves it by p/k; along z its top gets what the floor does not carry: forces k A u in balance."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2))
    young, k, push, press, gap = 1e12, (2e8, 3e8, 5e8), 3e4, 1e5, 5e-5
    script = Script(mesh, 1)
    springs = sum(stiffness * script.u[i] * script.v[i] for i, stiffness in enumerate(k)) * script.ds("top")
    L = ufl.inner(script.constant((push, 0.0, -press)), script.v) * script.ds("top")
    body = coulomb.Body(script.elasticity(young, 0.0) + springs, L, faces=mesh)
    below = coulomb.Plane((0.0, 0.0, -gap), (0.0, 0.0, 1.0))
    solution = ContactProblem(body, Contact("bottom", 0.0, foundation=below)).solve(1e-12)
    (robin,) = solution.reactions
    assert robin.name == "form" and solution.certificate.passed and solution.force_balance.balance < 1e-10
    u = np.array([push / k[0], 0.0, -(press + young * gap) / (k[2] + young)])
    top = script.nodes("top")
    assert np.abs(solution.displacement[top] - u).max() <= 1e-8 * np.abs(u).max()
    assert np.abs(robin.force + k * u).max() <= 1e-9 * press
    assert solution.forces_on_foundations[0].force[2] == pytest.approx(-press - k[2] * u[2], rel=1e-9)
    assert solution.function.x.array.size >= 3 * len(top)


def test_a_modulus_that_changes_by_hand():
    """N = E A d/h of a bar pressed by d; solve() takes the present value, and an earlier answer keeps its own.

    Then by a history, in which the change of the modulus does work: the energies add up."""
    mesh, d = coulomb.box((1.0, 1.0, 2.0), (1, 1, 2)), 1e-4
    script = Script(mesh, 1)
    young = script.on_cells(lambda x: np.full(len(x[0]), 1e9))
    top = script.function()
    body = coulomb.Body(script.elasticity(young, 0.0), None, [script.bc(top, "top")], mesh)
    problem = ContactProblem(body, Contact("bottom", 0.0))
    top.x.array.reshape(-1, 3)[:, 2] = -d
    first = problem.solve()
    young.x.array[:] = 3e9
    body.update()
    second = problem.solve()
    for answer, modulus in ((first, 1e9), (second, 3e9), (first, 1e9)):
        assert -answer.forces_on_foundations[0].force[2] == pytest.approx(modulus * d / 2.0, rel=1e-6)
        assert answer.certificate.passed
        assert coulomb.certify(answer.problem, answer.contact_force, answer.displacement).passed
        assert answer.reactions[0].force[2] == pytest.approx(-modulus * d / 2.0, rel=1e-6)
        assert answer.problem.elasticity.K.norm() == pytest.approx(modulus / 1e9 * first.problem.elasticity.K.norm())

    def update(time):
        young.x.array[:] = 1e9 * (1.0 + time)
        top.x.array.reshape(-1, 3)[:, 2] = -d * min(time, 1.0)

    body = coulomb.Body(script.elasticity(young, 0.0), None, [script.bc(top, "top")], mesh, update=update)
    *_, last = LoadHistory([1.0, 2.0, 4.0]).steps(ContactProblem(body, Contact("bottom", 0.0)))
    energy = last.state.energy
    assert energy.elastic == pytest.approx(0.5 * 5e9 * d**2 / 2.0, rel=1e-6)
    assert energy.prescribed == pytest.approx(0.5 * 2e9 * d**2 / 2.0, rel=1e-6)
    assert abs(energy.imbalance) < 1e-6 * energy.elastic
