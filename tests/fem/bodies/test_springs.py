"""Springs: formulas, equilibrium, wrong input."""

import numpy as np
import pytest
from conftest import STEEL
from mesh_files import BoxFile

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, Spring, Traction
from coulomb.io.summary import summary
from coulomb.solvers import IterativeSolver


def sliding(push, k=1e8, **options):
    return ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (5, 5, 3)),
        STEEL,
        [],
        Contact("bottom", friction=0.3),
        [Traction("top", (push, 0.0, -9e6))],
        (0.0, 0.0, -2e6),
        springs=[Spring("left", k), Spring("right", k)],
        **options,
    )


def test_block_held_by_friction_and_springs_slides():
    """Load -9e6 - 1e6 (weight) down, 4e6 along x: friction is F N, the springs carry the rest and deform."""
    solution = sliding(4e6).solve(tolerance=1e-10)
    assert solution.certificate.passed
    contents = summary(solution)
    force, spring = np.array(contents["force_on_body"]["vector"]), np.array(contents["spring_force_on_body"])
    assert contents["nodes"]["stick"] == 0
    x = solution.contact_force.reshape(-1, 3)
    assert np.allclose(np.hypot(x[:, 1], x[:, 2]), 0.3 * x[:, 0], rtol=1e-6, atol=1e-8 * x.max())
    assert -force[0] == pytest.approx(
        0.3 * force[2], rel=1e-5
    )  # nodes slip sideways a little, since the body expands under load
    assert np.allclose(force + spring + [4e6, 0.0, -10e6], 0.0, atol=1.0)
    slip = (4e6 - 0.3 * force[2]) / 1e8  # of two faces of 0.5 m^2
    assert np.mean(solution.displacement[:, 0]) == pytest.approx(slip, rel=0.01)


def test_multigrid_knows_rigid_motions_of_a_soft_part_that_is_held(tmp_path):
    """Layers of materials 1e3 apart on soft springs: forces K r of a motion r of the whole body along x give r back as
    soon if the edges of both layers are held along y."""
    BoxFile((1.0, 2.0, 2.0), (4, 6, 6), interface=0.5).write(tmp_path / "layers.msh")
    mesh, materials = (
        coulomb.read_mesh(tmp_path / "layers.msh"),
        {"soft": Material(2e8, 0.3), "stiff": Material(2e11, 0.3)},
    )
    iterations = []
    for clamps in ([], [Clamp("front", "y")]):
        elasticity = Elasticity(mesh, materials, clamps, springs=[Spring("right", 1e4)])
        solver, (rhs, u) = IterativeSolver(elasticity.K), elasticity.K.createVecs()
        motion = np.tile([1.0, 0.0, 0.0], len(elasticity.x))
        u.array[:] = motion
        elasticity.K.mult(u, rhs)
        u.set(0.0)
        solver.solve(rhs, u, 1e-3)
        assert u.array == pytest.approx(motion, abs=1e-3)
        iterations.append(solver.iterations)
    assert iterations[1] <= 2 * iterations[0]


BOTTOM, ALONG = (1.0, 2.0), np.array([1e9, 2e9, 3e9])
"""Edges of the face in metres, and the stiffness of its springs along x, y, z."""


def bedded(cell, degree, cells=(1, 1, 1), **given):
    """A block on springs under its lower face, on the coarsest mesh unless others are asked for."""
    mesh = coulomb.box((*BOTTOM, 0.5), cells, cell, degree=degree)
    return Elasticity(mesh, Material(1e15, 0.3), [], springs=[Spring("bottom", ALONG)], **given)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_springs_are_integrated_over_their_face(cell, degree):
    """The work of their forces on another displacement, by Gauss points on the face: exact for linear ones, of second
    order also for quadratic ones, on one cell; lumped at the nodes the inertia of the face is three times too large."""
    body = bedded(cell, degree)

    def field(x, y, seed):
        terms = np.stack([np.ones_like(x), x, y, *((x * x, x * y, y * y) if degree == 2 else ())], axis=-1)
        return terms @ np.random.default_rng(seed).standard_normal((terms.shape[-1], 3))

    u, v = (field(body.x[:, 0], body.x[:, 1], seed) for seed in (1, 2))
    points, weights = np.polynomial.legendre.leggauss(4)
    x, y = np.meshgrid(*(0.5 * length * (1.0 + points) for length in BOTTOM), indexing="ij")
    work = np.einsum("i,j,ijc,c,ijc", weights, weights, field(x, y, 1), ALONG, field(x, y, 2)) * np.prod(BOTTOM) / 4.0
    assert -np.vdot(v, body.spring_force(u)) == pytest.approx(work, rel=1e-12)
    (force,) = body.spring_forces(u)
    assert np.array_equal(force.forces, body.spring_force(u))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_stiffness_and_forces_have_the_same_springs(cell, degree):
    """K u is internal forces less those of the springs; also in the motions that only springs resist."""
    body = bedded(cell, degree, (2, 2, 1))
    u = np.random.default_rng(3).standard_normal(body.x.shape)
    given, product = body.K.createVecs()
    given.array[:] = u.ravel()
    body.K.mult(given, product)
    expected = body.internal_force(u) - body.spring_force(u)
    assert product.array.reshape(-1, 3) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    softest = Elasticity(body.mesh, Material(1e4, 0.3), [], springs=[Spring("bottom", 1e12)])  # the springs dominate
    softest.K.mult(given, product)
    expected = softest.internal_force(u) - softest.spring_force(u)
    assert product.array.reshape(-1, 3) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


def test_springs_at_nodes():
    """A block on a smooth floor, held sideways by springs at four corners alone: as a whole, by F over the sum of k."""
    mesh = coulomb.box((0.1, 0.1, 0.05), (2, 2, 1)).with_nodes(
        "feet", at=[(x, y, 0.0) for x in (0, 0.1) for y in (0, 0.1)]
    )
    springs = [Spring("feet", (100.0, 50.0, 0.0), at_nodes=True)]
    loads = [coulomb.Pressure("top", 10.0), coulomb.TotalForce("top", (0.004, 0.003, 0.0))]
    problem = ContactProblem(mesh, Material(1e9, 0.0), [], Contact("bottom", 0.0), loads, springs=springs)
    solution = problem.solve()
    assert solution.valid
    assert np.allclose(solution.displacement[:, :2], [0.004 / 400.0, 0.003 / 200.0], rtol=1e-2)
    (spring,) = (one for one in problem.elasticity.support_entries() if one["kind"] == "spring")
    assert spring["holds"] == "stiffness (100, 50, 0) N/m"
    forces = problem.elasticity.spring_force(solution.displacement).sum(axis=0)
    assert forces == pytest.approx([-0.004, -0.003, 0.0], abs=1e-9)
    with pytest.raises(ValueError, match="there is no set of nodes 'toes' \\(there are feet\\)"):
        ContactProblem(mesh, Material(1e9, 0.0), [], Contact("bottom", 0.0), loads, springs=[Spring("toes", 1.0, True)])
    with pytest.raises(ValueError, match="springs at nodes are for small motions"):
        ContactProblem(mesh, Material(1e9, 0.0), [], Contact("bottom", 0.0), loads, springs=springs, kinematics="large")


@pytest.mark.parametrize("direct", [True, False])
def test_a_spring_between_two_nodes(direct):
    """Two cubes, the second on a smooth floor, guided along x, and held by the spring alone: it stretches by F / k, as
    along an oblique line; the energies add up, and so does the force on either body."""
    ends = ((1.5, 0.0, 0.0), (1.0, 0.0, 0.0))
    mesh = coulomb.join(
        a=coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)),
        b=coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), translate=(1.5, 0.0, 0.0)),
    )
    pull, k = 5.0, 1e3
    loads = [coulomb.TotalForce("b:right", (pull, 0.0, 0.0), amplitude=[(0.0, 0.0), (1.0, 1.0)])]
    loads += [coulomb.Pressure("b:top", 10.0, amplitude=[(0.0, 0.0), (1.0, 1.0)])]
    way = np.array([1.0, 0.0, 0.0]) if direct else np.array([0.8, 0.6, 0.0])
    signed = zip(ends, (1.0, -1.0), strict=True)
    terms = [(end, "xyz"[axis], sign * way[axis]) for end, sign in signed for axis in range(2) if way[axis]]
    problem = coulomb.ContactProblem(
        mesh,
        coulomb.Material(1e6, 0.0),
        [coulomb.Clamp("a:left"), coulomb.Clamp("b:front", "y")],
        coulomb.Contact("b:bottom", 0.0),
        loads,
        ties=[coulomb.Equation(terms, stiffness=k)],
    )
    (step,) = coulomb.LoadHistory([1.0]).steps(problem)
    x, u = problem.elasticity.x, step.solution.displacement
    one, other = (u[np.argmin(np.linalg.norm(x - end, axis=1))] for end in ends)
    assert step.solution.valid and (one - other) @ way == pytest.approx(pull / way[0] / k, rel=1e-9)
    assert step.row["clamp_a:left_force_x"] == pytest.approx(-pull, rel=1e-9)
    assert step.row["clamp_a:left_force_y"] == pytest.approx(-pull * way[1] / way[0], rel=1e-9, abs=1e-9)
    assert step.state.energy.imbalance == pytest.approx(0.0, abs=1e-3 * step.state.energy.elastic)
    assert step.state.energy.elastic >= 0.5 * (pull / way[0]) ** 2 / k


def test_springs_between_nodes_that_cannot_be():
    for stiffness, constant in ((-1.0, 0.0), (np.nan, 0.0), (1.0, 1e-3)):
        with pytest.raises(ValueError, match="equation: stiffness must be a number of N/m, without a constant"):
            coulomb.Equation([((0.0, 0.0, 0.0), "x", 1.0)], constant, stiffness=stiffness)
    link = coulomb.Equation([((0.0, 0.0, 0.0), "x", 1.0)], stiffness=1.0)
    with pytest.raises(ValueError, match="its stiffness is for small motions"):
        given = coulomb.NeoHookean(1e6, 0.3), [coulomb.Clamp("top")], coulomb.Contact("bottom", 0.1)
        coulomb.ContactProblem(coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), *given, ties=[link], kinematics="large")
