"""The estimated error of the stress against the true one: exact solutions, finer meshes, and what has no error."""

import functools

import numpy as np
import pytest
from petsc4py import PETSc

import coulomb
from coulomb import Clamp, Elasticity, Material, NamedMesh, OrthotropicMaterial, PrescribedDisplacement, Traction
from coulomb.fem import compat
from coulomb.fem.bodies.loads import ThermalLoad
from coulomb.fem.bodies.materials import PAIRS, midpoints
from coulomb.fem.bodies.recovery import relative_error, stress_error, stress_errors
from coulomb.fem.compat import basix, ufl
from coulomb.fem.meshes import lagrange_slopes, lagrange_values

KINDS = [("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]
FACES = ("left", "right", "front", "back", "bottom", "top")
SOFT = Material(2.0, 0.3, expansion=0.02)
DIRECTIONS = ((1.0, 0.3, 0.0), (0.0, 1.0, 0.5))
WOOD = OrthotropicMaterial((9.0, 1.0, 0.6), (0.4, 0.4, 0.5), (0.7, 0.6, 0.2), DIRECTIONS)


def curved(x):
    y = x.copy()
    y[0] += 0.15 * np.sin(np.pi * x[1]) * x[2] + 0.1 * x[1] ** 2
    y[2] += 0.2 * np.sin(2.0 * x[0]) * (1.0 - 0.5 * x[1])
    return y


def body(cell, degree, material=SOFT, cells=(3, 3, 3), lengths=(1.0, 1.0, 1.0), place=None, **options):
    return Elasticity(
        coulomb.box(lengths, cells, cell, degree=degree, place=place), material, [Clamp("left")], **options
    )


def split(mesh):
    """The mesh with the groups "low" and "high", below and above z = 1/2, and "even" and "odd" cells."""
    count = mesh.domain.topology.index_map(3).size_local
    high = midpoints(mesh.domain)[:count, 2] > 0.5
    groups = {"low": ~high, "high": high, "even": np.arange(count) % 2 == 0, "odd": np.arange(count) % 2 == 1}
    return NamedMesh(
        mesh.domain, mesh.faces, {name: np.flatnonzero(of).astype(np.int32) for name, of in groups.items()}
    )


# --- what has an error ------------------------------------------------------------------------------------------------


def compliance(material):
    """The stiffness of a material, shape (6, 6), by the inverse of the compliance along its directions."""
    isotropic = isinstance(material, Material)
    E = np.full(3, material.young) if isotropic else np.array(material.young)
    nu = np.full(3, material.poisson) if isotropic else np.array(material.poisson)
    G = E / 2.0 / (1.0 + nu) if isotropic else np.array(material.shear)
    first, second = np.eye(3)[:2] if isotropic else np.array(material.directions)
    d = np.linalg.qr(np.transpose([first, second, np.cross(first, second)]))[0]
    along = np.einsum("ia,jb->ijab", d, d)  # e_ab = d_ia d_jb e_ij
    S = np.zeros((3, 3, 3, 3))
    for i in range(3):
        S[i, i, i, i] = 1.0 / E[i]
    for n, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        S[i, i, j, j] = S[j, j, i, i] = -nu[n] / E[i]
        for a, b in ((i, j), (j, i)):
            S[a, b, i, j] = S[a, b, j, i] = 0.25 / G[n]
    S = np.einsum("ijab,abcd,klcd->ijkl", along, S, along)
    factor = np.repeat([1.0, 2.0], 3)
    return np.array([[S[(*p, *q)] for q in PAIRS] for p in PAIRS]) * factor[:, None] * factor


class Waves:
    """The displacement sum of p sin(k . x + phase), its stress, and the force per volume that it needs."""

    waves = (([0.8, -0.3, 0.5], [1.6, 0.9, -0.7], 0.3), ([-0.4, 0.6, 0.2], [-0.5, 1.3, 1.9], 1.1))

    def __init__(self, material):
        C = np.linalg.inv(compliance(material))
        self._parts = []
        for p, k, phase in self.waves:
            grad = np.outer(p, k)
            s = C @ [grad[i, i] if i == j else grad[i, j] + grad[j, i] for i, j in PAIRS]
            tensor = s[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]
            self._parts.append((np.array(p), np.array(k), phase, s, tensor @ k))

    def _sum(self, x, amplitude, function):
        parts = ((part[amplitude], function(part[1] @ x + part[2])) for part in self._parts)
        return sum(vector[:, None] * values for vector, values in parts)

    def displacement(self, x):
        return self._sum(x, 0, np.sin)

    def stress(self, x):
        return self._sum(x, 3, np.cos)

    def force(self, x):
        return self._sum(x, 4, np.sin)


def solved(given):
    f = given.f(given.at(1.0))
    solver, u = PETSc.KSP().create(given.comm), f.duplicate()
    solver.setOperators(given.K)
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    solver.solve(f, u)
    found = u.array.reshape(-1, 3).copy()
    for done in (solver, f, u):
        done.destroy()
    return found


def true_squares(given, u, material, stress):
    """Twice the energy of the stress's error in every cell, by 125 points or so, from stress(x)."""
    domain, S = given.domain, compliance(material)
    cell = domain.topology.cell_type
    X, weights = basix.make_quadrature(getattr(basix.CellType, cell.name), 8)
    x, values = domain.geometry.x[compat.cell_geometry(domain)], u[compat.cell_dofs(given.V)]
    slopes, N = lagrange_slopes(cell, given.degree, X), lagrange_values(cell, given.degree, X)
    assert lagrange_values(cell, given.degree, X[:0]).shape == N[:0].shape
    jacobian = np.einsum("dqa,cai->cqdi", slopes, x)
    gradient = np.linalg.solve(jacobian, np.einsum("dqa,caj->cqdj", slopes, values))
    strain = np.array([gradient[..., i, j] + (i != j) * gradient[..., j, i] for i, j in PAIRS])
    if given.has_mean_dilatation:
        volume = np.abs(np.linalg.det(jacobian)) * weights
        change = strain[:3].sum(axis=0)
        strain[:3] += ((change * volume).sum(axis=1) / volume.sum(axis=1) - change.T).T / 3.0
    exact = stress((N @ x).reshape(-1, 3).T).reshape(6, *np.shape(strain)[1:])
    error = exact - np.einsum("ij,jcq->icq", np.linalg.inv(S), strain)
    density = np.einsum("icq,ij,jcq->cq", error, S, error)
    return np.sum(density * np.abs(np.linalg.det(jacobian)) * weights, axis=1)


@pytest.mark.parametrize(
    ("material", "place"), [(SOFT, None), (Material(2.0, 0.49), curved), (WOOD, curved)], ids=["cube", "0.49", "wood"]
)
@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_estimated_over_true_error(cell, degree, material, place):
    """Near 1, in all and in nearly every cell, and nearer on the finest mesh."""
    exact, indices = Waves(material), []
    for n in (3, 7) if degree == 1 else (2, 4):
        mesh = coulomb.box((1.0, 1.0, 1.0), (n, n, n), cell, degree=degree, place=place)
        held = [PrescribedDisplacement(face, exact.displacement) for face in FACES]
        given = Elasticity(mesh, material, held, body_force=exact.force)
        u = solved(given)
        found, true = stress_error(given, u), true_squares(given, u, material, exact.stress)
        assert found.total**2 == pytest.approx(found.squared.sum())
        indices.append(found.total / np.sqrt(true.sum()))
        in_cells = np.sqrt(np.median(found.squared / true))
    assert all(0.8 < index < 3.0 for index in indices)
    assert abs(indices[-1] - 1.0) <= (0.4 if (cell, degree) == ("hexahedron", 2) else 0.04) and 0.9 < in_cells < 1.4
    assert abs(indices[-1] - 1.0) <= max(abs(indices[0] - 1.0), 0.01)


@functools.cache
def bent(cells, cell, degree):
    """The error of a clamped block with loads on two faces."""
    loads = [Traction("right", (0.0, 0.0, -1e-3)), Traction("top", (0.0, 0.0, -1e-4))]
    given = Elasticity(coulomb.box((2.0, 1.0, 1.0), cells, cell, degree=degree), SOFT, [Clamp("left")], loads)
    return stress_error(given, solved(given))


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_singular_edges(cell, degree):
    """At the edges of a clamped face the stress is not finite, and eta a little too small; the true error by the energy
    that a much finer mesh of second order has more, with its own error added."""
    n = 4 // degree
    found, fine = bent((2 * n, n, n), cell, degree), bent((8, 4, 4), "hexahedron", 2)
    true = np.sqrt(fine.norm**2 + fine.total**2 - found.norm**2)
    assert 0.7 < found.total / true < 1.3


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_the_direction_in_which_more_planes_are_needed(cell, degree, moved):
    """u_x = x^2, or x^3 in second order: the error of the strain is 2 x or 3 x^2 less its mean, or its line, in every
    cell, across the planes of x alone, here also those of the box's y."""
    n, lengths = 6, (2.0, 1.0, 1.0)
    mesh = coulomb.box(lengths, (n, n, n), cell, degree=degree)
    if moved:
        lengths = (1.0, 2.0, 1.0)
        mesh = coulomb.box(lengths, (n, n, n), cell, degree=degree, place=lambda x: x[[1, 2, 0]])
    given, power = Elasticity(mesh, SOFT, [Clamp("left")]), degree + 1
    h, modulus = 2.0 / n, SOFT.young * 0.7 / (1.3 * 0.4)
    found = stress_error(given, given.x**power * [1.0, 0.0, 0.0])
    inside = np.all(np.abs(midpoints(mesh.domain)[: len(found.squared)] - [1.0, 0.5, 0.5]) < [0.6, 0.3, 0.3], axis=1)
    slope = {1: 4.0 * h**2 / 12.0, 2: 9.0 * h**4 / 180.0}[degree]
    along, axis = found.along[:, inside], int(moved)
    np.testing.assert_allclose(along[axis], modulus * slope * found.volume[inside], rtol=0.1)
    others = np.delete(along, axis, axis=0)
    assert others.max() < 1e-3 * along[axis].max()


# --- what has none ----------------------------------------------------------------------------------------------------


def linear(x):
    """A displacement with six strains, and its stress in `SOFT`."""
    gradient = np.array([[0.3, -0.1, 0.4], [0.2, 0.1, -0.3], [0.0, 0.5, -0.2]])
    return x @ gradient.T


@pytest.mark.parametrize("material", [SOFT, Material(2.0, 0.49), WOOD], ids=["0.3", "0.49", "wood"])
@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_constant_stress_and_rigid_motion(cell, degree, material):
    for cells in ((3, 3, 3), (3, 2, 1), (1, 1, 1)):
        given = body(cell, degree, material, cells, place=curved)
        strained = stress_error(given, linear(given.x))
        moved = stress_error(given, np.cross([0.1, 0.2, -0.3], given.x) + 0.2)
        assert strained.norm > 0.1 and strained.relative < 1e-10
        assert max(moved.total, moved.norm) < 1e-10 * strained.norm


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_norm_volume_and_energy_of_a_constant_stress(cell, degree):
    for material in (SOFT, WOOD):
        given = body(cell, degree, material, lengths=(1.0, 2.0, 0.5))
        found, e = stress_error(given, linear(given.x)), (lambda g: 0.5 * (g + g.T))(linear(np.eye(3)).T)
        e = np.array([e[i, j] * (1.0 if i == j else 2.0) for i, j in PAIRS])
        assert found.norm**2 == pytest.approx(e @ np.linalg.solve(compliance(material), e), rel=1e-10)
        assert found.volume.sum() == pytest.approx(1.0) and found.squared.shape == found.volume.shape


def quadratic(x):
    return np.stack([x[:, 0] * x[:, 2], x[:, 1] ** 2 - x[:, 0] ** 2, x[:, 0] ** 2 - x[:, 1] * x[:, 2]], axis=1)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_linear_stress_of_second_order(cell):
    """Also in corners with one tetrahedron, in a single layer and in a single cell."""
    for cells in ((3, 3, 3), (3, 2, 1), (1, 1, 1)):
        for lengths in ((1.0, 1.0, 1.0), (1.0, 0.5, 0.01)):
            given = body(cell, 2, WOOD, cells, lengths)
            assert stress_error(given, quadratic(given.x)).relative < 1e-8


def test_flat_cells_askew_of_second_order():
    """Ten thousand times as long as thick, far from the origin."""
    turn = np.linalg.qr(np.array([[1.0, 0.4, -0.3], [0.1, 0.7, 0.2], [0.5, 0.3, 1.2]]))[0]
    for cell in ("hexahedron", "tetrahedron"):
        given = body(cell, 2, place=lambda x: turn @ (x * [[1.0], [1.0], [1e-4]]) + 10.0)
        assert stress_error(given, linear(given.x)).relative < 1e-7


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_two_materials(cell, degree):
    """Bonded at z = 1/2 and drawn along z, with no lateral strain, the stress s_zz is the same in both and the others
    jump: no error.  Of one material the same displacement has one at the kink."""
    mesh, stiff = split(coulomb.box((1.0, 1.0, 1.0), (4, 4, 4), cell, degree=degree)), Material(20.0, 0.4)

    def oedometric(material):
        return material.young * (1.0 - material.poisson) / (1.0 + material.poisson) / (1.0 - 2.0 * material.poisson)

    both = {"low": SOFT, "high": stiff}
    given = Elasticity(mesh, both, [Clamp("left")])
    z = given.x[:, 2]
    u = np.zeros_like(given.x)
    u[:, 2] = np.minimum(z, 0.5) / oedometric(SOFT) + np.maximum(z - 0.5, 0.0) / oedometric(stiff)
    found = stress_error(given, u)
    assert found.norm**2 == pytest.approx(0.5 / oedometric(SOFT) + 0.5 / oedometric(stiff))
    assert found.relative < 1e-11
    same = {"low": SOFT, "high": Material(2.0, 0.3, density=3.0, conductivity=2.0)}
    one, two = (stress_error(Elasticity(mesh, of, [Clamp("left")]), u) for of in (SOFT, same))
    assert one.relative > 0.1 and two.squared == pytest.approx(one.squared, rel=1e-9, abs=1e-20)


def test_materials_in_turns():
    """Every second cell is a group of its own: groups with equal materials are one."""
    mesh = split(coulomb.box((1.0, 1.0, 1.0), (4, 4, 4)))
    again = Material(2.0, 0.3)  # equal, not the same; without a temperature its expansion does not matter
    two = Elasticity(mesh, {"even": SOFT, "odd": again}, [Clamp("left")])
    one = Elasticity(mesh, SOFT, [Clamp("left")])
    u = np.sin(one.x @ [[1.0, 0.5, 0.2], [0.0, 1.0, 1.0], [0.3, 0.0, 1.0]])
    assert stress_error(two, u).squared == pytest.approx(stress_error(one, u).squared, rel=1e-9)


def test_directions_of_place_are_one_material():
    """Isotropic constants along directions that turn: as of the isotropic material."""
    G = SOFT.young / 2.0 / (1.0 + SOFT.poisson)
    around = (lambda x: np.array([-x[1] - 1.0, x[0], 0.0 * x[0]]), (0.0, 0.0, 1.0))
    wound = OrthotropicMaterial((SOFT.young,) * 3, (SOFT.poisson,) * 3, (G,) * 3, around)
    given = body("tetrahedron", 1)
    u = np.sin(given.x @ [[1.0, 0.5, 0.2], [0.0, 1.0, 1.0], [0.3, 0.0, 1.0]])
    found, expected = stress_error(body("tetrahedron", 1, wound), u), stress_error(given, u)
    assert found.squared == pytest.approx(expected.squared, rel=1e-9) and found.norm == pytest.approx(expected.norm)
    assert found.stress == pytest.approx(expected.stress)


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_thermal_stress(cell, degree):
    """A body that cannot move with a temperature linear in place: a linear stress -E alpha T/(1 - 2 nu) in all
    directions; one that follows its thermal strain: none."""
    heat = ThermalLoad(lambda x: 5.0 + 40.0 * x[0] - 25.0 * x[2], 5.0)
    wood = OrthotropicMaterial(WOOD.young, WOOD.poisson, WOOD.shear, DIRECTIONS, expansion=0.01)
    for material in (SOFT, wood):
        given = body(cell, degree, material, thermal=heat)
        change = given.at(1.0).temperature.change
        found = stress_error(given, np.zeros_like(given.x), change)
        strain = material.expansion * np.repeat([1.0, 0.0], 3)
        mean = (40.0**2 + 25.0**2) / 3.0 - 40.0 * 25.0 / 2.0
        assert found.norm**2 == pytest.approx(mean * strain @ np.linalg.solve(compliance(material), strain))
        assert found.relative < 1e-10
        free = stress_error(given, 7.0 * material.expansion * given.x, np.full(len(given.x), 7.0))
        assert free.norm < 1e-10 * found.norm


# --- scales and several bodies ----------------------------------------------------------------------------------------


def test_scales():
    """In mm and N/mm^2 the same; the error as a stress is sqrt(E eta_K^2/volume)."""
    one, other = (body("hexahedron", 2, Material(2e11 / s**2, 0.3), lengths=(s, s, s)) for s in (1.0, 1000.0))
    u = 1e-3 * np.sin(one.x @ [[1.0, 0.5, 0.2], [0.0, 1.0, 1.0], [0.3, 0.0, 1.0]])
    metres, millimetres = stress_error(one, u), stress_error(other, 1000.0 * u)
    assert millimetres.relative == pytest.approx(metres.relative)
    assert 1e6 * millimetres.stress == pytest.approx(metres.stress)
    assert metres.stress == pytest.approx(np.sqrt(2e11 * metres.squared / metres.volume))
    wood = stress_error(body("tetrahedron", 1, WOOD, (1, 1, 1)), np.zeros((8, 3)))
    assert wood.modulus == pytest.approx(1.0 / np.mean([1.0 / young for young in WOOD.young]))


def test_several_bodies_and_those_without_a_stress():
    lower, upper = body("hexahedron", 1), body("tetrahedron", 2, WOOD)
    both = coulomb.join(lower=lower, upper=upper)
    u = np.sin(both.x @ [[1.0, 0.5, 0.2], [0.0, 1.0, 1.0], [0.3, 0.0, 1.0]])
    found = stress_errors(both, u)
    assert list(found) == ["lower", "upper"]
    one, two = stress_error(lower, u[: len(lower.x)]), stress_error(upper, u[len(lower.x) :])
    assert np.array_equal(found["lower"].squared, one.squared) and np.array_equal(found["upper"].squared, two.squared)
    together = np.hypot(one.total, two.total) / np.hypot(one.norm, two.norm)
    assert relative_error(found.values()) == pytest.approx(together)
    v, w = ufl.TrialFunction(lower.V), ufl.TestFunction(lower.V)
    own = coulomb.Body(ufl.inner(ufl.grad(v), ufl.grad(w)) * ufl.dx + ufl.inner(v, w) * ufl.dx)
    with pytest.raises(ValueError, match="it is not known which stress belongs to a strain"):
        stress_errors(own, u[: len(lower.x)])
