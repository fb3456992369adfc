"""Large motions from meshes and case files: materials, loads, run directory, resumed runs, `coulomb check`."""

import numpy as np
import pytest
from conftest import run_coulomb
from rubber_blocks import DRAWN, LAME, MU, side, stress
from scipy.optimize import brentq

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory, PrescribedDisplacement, SymmetryPlane
from coulomb.case.case import read_case
from coulomb.kinematics import MooneyRivlin, NeoHookean, Ogden, StVenantKirchhoff

UP = [(0.0, 0.0), (1.0, 1.0)]
RUBBER = NeoHookean(1e6, 0.3)
SMOOTH = Contact("bottom", friction=0.0)
ROLLERS = [SymmetryPlane("left"), SymmetryPlane("front")]


def block(material, supports, loads=(), cells=(1, 1, 1), contact=SMOOTH, **others):
    mesh = coulomb.box((1.0, 1.0, 1.0), cells)
    return ContactProblem(mesh, material, supports, contact, loads, kinematics="large", **others)


def pressed(depth):
    return [*ROLLERS, PrescribedDisplacement("top", (0.0, 0.0, -depth), "z", amplitude=UP)]


def last(problem, times=(0.5, 1.0)):
    *_, step = LoadHistory(times).steps(problem)
    assert step.solution.certificate.passed
    return step


def test_materials_have_the_stresses_of_their_formulas():
    """Nominal stress from the contact force, and Cauchy stress in the cells."""
    step = last(block(RUBBER, pressed(0.4)))
    assert step.row["force_z"] == pytest.approx(-stress(0.6), rel=1e-7)
    body = step.solution.problem.elasticity.alone
    fields = {one.name: one.x.array for one in body.cell_fields(step.solution.function, step.solution.problem.loading)}
    assert fields["stress_zz"] == pytest.approx(stress(0.6) / side(0.6) ** 2, rel=1e-7)
    hooke, expected = coulomb.Material(1e6, 0.3), 0.5e6 * 0.8 * (0.8**2 - 1.0)
    for material in (hooke, StVenantKirchhoff(1e6, 0.3)):
        assert last(block(material, pressed(0.2))).row["force_z"] == pytest.approx(-expected, rel=1e-7)
    soft = MooneyRivlin(3e5, 1e5, 3e9)
    incompressible = 2.0 * (0.8 - 0.8**-2) * (3e5 + 1e5 / 0.8)
    assert last(block(soft, pressed(0.2))).row["force_z"] == pytest.approx(-incompressible, rel=1e-3)
    assert soft.young == pytest.approx(3.0 * 2.0 * 4e5, rel=1e-3) and soft.poisson == pytest.approx(0.5, abs=1e-3)


def test_an_interference_compresses_as_the_formula_says():
    """On a foundation, and half of it in each of two bodies, with the gap's amplitude."""
    rubber, gap = NeoHookean(1e6, 0.0), {"gap": -0.2, "gap_amplitude": UP}
    step = last(block(rubber, pressed(0.0), contact=Contact("bottom", friction=0.0, **gap)))
    assert step.row["force_z"] == pytest.approx(-0.5e6 * (0.8 - 1.0 / 0.8), rel=1e-7)
    upper = coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), (0.0, 0.0, 1.0))
    both = coulomb.join(lower=coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), upper=upper)
    held = [SymmetryPlane(f"{name}:{face}") for name in ("lower", "upper") for face in ("left", "front")]
    held += [PrescribedDisplacement(face, (0.0, 0.0, 0.0), "z") for face in ("lower:bottom", "upper:top")]
    pair = Contact("upper:bottom", friction=0.0, against="lower:top", **gap)
    answer = last(ContactProblem(both, rubber, held, pair, kinematics="large")).solution
    assert answer.at_nodes.pressure == pytest.approx(-0.5e6 * (0.9 - 1.0 / 0.9), rel=1e-6)


def test_friction_by_place_moves_with_the_body():
    """F is that of the material, wherever it slides to."""
    drawn = PrescribedDisplacement("top", (0.8, 0.0, 0.0), "xy", amplitude=[(1, 0), (2, 1)])
    contact = Contact("bottom", friction=lambda x: 0.1 + 0.2 * x[0])
    step = last(block(RUBBER, [*pressed(0.05)[2:], drawn], cells=(3, 1, 1), contact=contact), (1.0, 1.5, 2.0))
    nodes, surface = step.solution.at_nodes, step.solution.problem.surface
    F = 0.1 + 0.2 * step.solution.problem.elasticity.reference[surface.nodes, 0]
    assert nodes.x[:, 0].min() > 0.5 and np.hypot(*nodes.force[:, 1:].T) == pytest.approx(
        F * nodes.force[:, 0], rel=1e-9
    )


HOT = [
    NeoHookean(1e6, 0.3, None, 1e-3),
    coulomb.Material(1e6, 0.3, expansion=1e-3),
    MooneyRivlin(2e5, 1e5, 1e7, expansion=1e-3),
]


@pytest.mark.parametrize("material", HOT)
def test_a_temperature_stretches_a_free_body(material):
    """By 1 + expansion dT, with no stress but that of a plate which stops its top a micrometre before."""
    stopped = PrescribedDisplacement("top", (0.0, 0.0, 0.1 - 1e-6), "z")
    problem = block(material, [*ROLLERS, stopped], temperature=120.0, reference_temperature=20.0)
    answer = last(problem, (1.0,)).solution
    assert answer.displacement == pytest.approx(0.1 * answer.problem.elasticity.reference, abs=2e-6)


def test_a_heated_block_between_plates_has_the_stress_of_the_formula():
    """The energy of l/j times j^3, derived by l at l = 1, with free sides; half of the temperature at time 0.5."""
    problem = block(HOT[0], pressed(0.0), temperature=lambda x: 100.0 + 0.0 * x[0], temperature_amplitude=UP)
    for step in LoadHistory([0.5, 1.0]).steps(problem):
        j = 1.0 + 0.1 * step.state.time
        assert step.solution.certificate.passed
        assert step.row["force_z"] == pytest.approx(-stress(1.0 / j) * j**2, rel=1e-7)


def test_an_ogden_material_has_the_stress_of_its_energy():
    """By differences of the energy in principal stretches, with the sides free; and its modulus of small strains."""
    mu, alpha, bulk, stretch = (6e5, -1e4), (1.3, -2.0), 1e8, 0.6

    def energy(along, across):
        J = along * across**2
        stretches = np.array([across, across, along]) * J ** (-1.0 / 3.0)
        parts = (m / a * (np.sum(stretches**a) - 3.0) for m, a in zip(mu, alpha, strict=True))
        return sum(parts) + 0.5 * bulk * (J - 1.0) ** 2

    def slope(f, x, h=1e-5):
        return (8.0 * (f(x + h) - f(x - h)) - f(x + 2.0 * h) + f(x - 2.0 * h)) / (12.0 * h)

    across = brentq(lambda a: slope(lambda q: energy(stretch, q), a), 1.0, 1.5, xtol=1e-14)
    material = Ogden(mu, alpha, bulk)
    assert last(block(material, pressed(0.4))).row["force_z"] == pytest.approx(
        -slope(lambda q: energy(q, across), stretch), rel=1e-7
    )
    assert material.young == pytest.approx(3.0 * 0.5 * (1.3 * 6e5 + 2e4), rel=5e-3)


def test_a_pressure_follows_the_surface_beside_a_dead_load_and_a_spring():
    """Stress times undeformed area is traction, plus pressure times the area as it has become, plus the spring's."""
    loads = [coulomb.Pressure("top", 6e4, UP), coulomb.Traction("top", (0.0, 0.0, -3e4), UP)]
    step = last(block(RUBBER, ROLLERS, loads, springs=[coulomb.Spring("top", (0.0, 0.0, 1e5))]))
    stretch = brentq(lambda s: stress(s) + 6e4 * side(s) ** 2 + 3e4 - 1e5 * (1.0 - s), 0.5, 1.0)
    assert step.row["force_z"] == pytest.approx(-stress(stretch), rel=1e-7)
    balance = step.solution.force_balance
    pressure, traction = (next(one for one in balance.loads if one.kind == kind) for kind in ("pressure", "traction"))
    (spring,) = (one for one in balance.reactions if one.kind == "spring")
    assert pressure.force[2] == pytest.approx(-6e4 * side(stretch) ** 2, rel=1e-7)
    assert traction.force[2] == pytest.approx(-3e4) and spring.force[2] == pytest.approx(
        1e5 * (1.0 - stretch), rel=1e-6
    )
    assert balance.balance < 1e-7
    energy = step.state.energy
    assert energy.elastic == pytest.approx(energy.loads, rel=0.05)  # by the trapezoidal rule in two steps


def test_a_prescribed_rotation_is_a_rotation():
    turn = coulomb.PrescribedRotation("top", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.5 * np.pi, UP)
    far = Contact("bottom", 0.3, foundation=coulomb.Plane((0.0, 0.0, -9.0), (0.0, 0.0, 1.0)))
    step = last(block(RUBBER, [turn], contact=far, cells=(2, 1, 1)), [0.5, 1.0])
    x = step.solution.problem.elasticity.alone.reference
    assert step.solution.displacement == pytest.approx(np.column_stack([x[:, 2], x[:, 1], -x[:, 0]]) - x, abs=1e-9)
    assert step.state.energy.elastic < 1e-9


@pytest.mark.parametrize("angle", [0.0, 1.0])
@pytest.mark.parametrize("guided", ["surface", "direction"])
def test_a_shaft_that_turns_in_a_guide_of_supports_leaves_it(angle, guided):
    """Supports keep their directions: nodes of a shaft in a guide that turn go along its tangents, not around; the
    angle is that of their radii before and after.  A shaft that slides along its guide stays in it."""

    def place(x):
        a, b = 2.0 * x[0] - 1.0, 2.0 * x[1] - 1.0
        return np.array([a * np.sqrt(1.0 - 0.5 * b * b), b * np.sqrt(1.0 - 0.5 * a * a), 2.0 * x[2]])

    way = {"surface": coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0), "components": "normal"}
    way = way if guided == "surface" else {"direction": lambda x: x * [[1.0], [1.0], [0.0]]}
    moved = PrescribedDisplacement("top", (0.0, 0.0, 0.5), amplitude=UP)
    if angle:
        moved = coulomb.PrescribedRotation("top", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), angle, UP)
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), place=place)
    supports = [*(coulomb.Clamp(face, **way) for face in ("left", "right", "front", "back")), moved]
    far = Contact("bottom", 0.3, foundation=coulomb.Plane((0.0, 0.0, -9.0), (0.0, 0.0, 1.0)))
    answer = last(ContactProblem(mesh, RUBBER, supports, far, kinematics="large")).solution
    then = answer.problem.elasticity.alone.reference[:, :2]
    on, now = np.linalg.norm(then, axis=1) > 0.99, then + answer.displacement[:, :2]
    cosines = np.einsum("ki,ki->k", then, now)[on] / np.linalg.norm(now[on], axis=1)
    turned = np.degrees(np.arccos(np.clip(cosines / np.linalg.norm(then[on], axis=1), -1.0, 1.0)).max())
    assert answer.small_strain.turn == pytest.approx(turned, abs=1e-5)
    assert answer.valid == (turned < 15.0) == (angle < 1.0)


def test_groups_of_cells_have_their_own_laws():
    """A soft and a stiff half in a row carry the same force."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 2))
    halves = (
        mesh.domain.geometry.x[mesh.domain.geometry.dofmap.links(0)]
        if hasattr(mesh.domain.geometry.dofmap, "links")
        else None
    )
    if halves is None:
        halves = mesh.domain.geometry.x[mesh.domain.geometry.dofmap[0]]
    low = 0 if halves[:, 2].mean() < 0.5 else 1
    mesh = coulomb.NamedMesh(
        mesh.domain, mesh.faces, {"low": np.array([low], np.int32), "high": np.array([1 - low], np.int32)}
    )
    problem = ContactProblem(
        mesh, {"low": RUBBER, "high": StVenantKirchhoff(1e6, 0.3)}, pressed(0.2), SMOOTH, kinematics="large"
    )
    step = last(problem)
    (force,) = -np.array([step.row["force_z"]])
    low_stretch = brentq(lambda s: stress(s) - force, 0.5, 1.0)
    high_stretch = brentq(lambda s: 0.5e6 * s * (s * s - 1.0) - force, 0.7, 1.0)
    assert 0.5 * (low_stretch + high_stretch) == pytest.approx(0.8, abs=1e-2)  # the sides are not free of each other


def test_energies_add_up_to_almost_second_order_in_the_step(tmp_path):
    (tmp_path / "case.toml").write_text(DRAWN)
    case = read_case(tmp_path / "case.toml")
    left = []
    for count in (10, 20):
        states = [step.state.energy for step in LoadHistory(np.linspace(0.0, 2.0, count + 1)[1:]).steps(case.problem())]
        assert np.all(np.diff([0.0, *(one.dissipated for one in states)]) >= -1e-6 * states[-1].dissipated)
        left.append(states[-1].imbalance / states[-1].dissipated)
    assert abs(left[0]) < 0.02 and 0.0 < left[1] / left[0] < 0.4


def test_a_body_of_an_energy_and_problem_and_history_by_their_usual_names():
    from coulomb.fem.compat import fem, ufl
    from coulomb.kinematics import NonlinearBody, neo_hookean

    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1))
    V = coulomb.Elasticity(mesh, coulomb.Material(1e6, 0.3), []).V
    u, g = fem.Function(V, name="displacement"), fem.Function(V)
    g.interpolate(lambda x: np.array([0.0 * x[0], 0.0 * x[0], -0.1 + 0.0 * x[0]]))
    bc = fem.dirichletbc(g, fem.locate_dofs_topological(V, 2, mesh.facets("top", "test")))
    body = coulomb.Body(energy=neo_hookean(u, MU, LAME) * ufl.dx, displacement=u, bcs=[bc], faces=mesh)
    problem = ContactProblem(body, Contact("bottom", 0.3), kinematics="large")
    assert isinstance(body, NonlinearBody) and problem.large is not None
    assert problem.solve().valid and np.abs(u.x.array).max() == pytest.approx(0.1)


@pytest.mark.parametrize(
    "change, message",
    [
        ("history.times=[]", "history"),
        ("material.poisson=[0.3, 0.3, 0.3]", "one number each"),
        ("material.law='mooney-rivlin'", "c1 is missing"),
        ("material.c1=1e5", "c1 does not belong to"),
        ("material.law='ogden'", "mu is missing"),
        ("material={law='ogden', mu=[1e5], alpha=[-2.0], bulk=1e8}", "mu * alpha must be positive"),
    ],
)
def test_wrong_cases(change, message, tmp_path):
    (tmp_path / "case.toml").write_text(DRAWN)
    done = run_coulomb("check-case", "case.toml", "--set", change, cwd=tmp_path, code=2)
    assert message in " ".join(done.stderr.split()), done.stderr


def test_wrong_input():
    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1))
    with pytest.raises(ValueError, match="is for large motions"):
        ContactProblem(mesh, RUBBER, ROLLERS, SMOOTH)
    with pytest.raises(ValueError, match='kinematics must be "small" or "large"'):
        ContactProblem(mesh, RUBBER, ROLLERS, SMOOTH, kinematics="finite")
    with pytest.raises(ValueError, match="shear modulus of small strains must be positive"):
        MooneyRivlin(0.0, 0.0, 1e9)
    with pytest.raises(ValueError, match="bulk must be a number of pascals, not negative"):
        MooneyRivlin(1e5, 0.0, -1e9)
    with pytest.raises(ValueError, match="material of large motions must be"):
        block(coulomb.OrthotropicMaterial((1e6,) * 3, (0.3,) * 3, (4e5,) * 3), ROLLERS)


def test_without_a_history_all_that_is_applied_grows_with_time(tmp_path):
    text = """\
gravity = [0.0, 0.0, -9.81]
[mesh]
box = [1.0, 1.0, 1.0]
cells = [2, 2, 2]
[material]
law = "neo-hookean"
young = 1e6
poisson = 0.3
density = 1e3
[[prescribed_displacement]]
face = "top"
value = [0.0, 0.0, -0.1]
[contact]
face = "bottom"
friction = 0.3
gap = -0.01
[solver]
kinematics = "large"
"""
    (tmp_path / "case.toml").write_text(text)
    case = read_case(tmp_path / "case.toml")
    ramp = ((0.0, 0.0), (1.0, 1.0))
    assert case.history.ends == (1.0,)
    assert case.gravity_amplitude == case.prescribed_displacement[0].amplitude == case.contact.gap_amplitude == ramp
    given = text.replace("gravity =", "gravity_amplitude = [[0, 1], [1, 1]]\ngravity =")
    (tmp_path / "case.toml").write_text(given)
    assert read_case(tmp_path / "case.toml").gravity_amplitude == ((0.0, 1.0), (1.0, 1.0))
