import numpy as np
import pytest
from conftest import STEEL
from petsc4py import PETSc

import coulomb
from coulomb import Clamp, Elasticity


def cube(clamps=(Clamp("left"),), **options):
    return Elasticity(
        coulomb.box((2.0, 1.0, 1.5), (4, 2, 3), options.pop("cell", "hexahedron")), STEEL, clamps, **options
    )


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_stresses_of_a_uniform_strain(cell):
    """s = 2 mu e + lambda tr(e) I of a strain e with given principal values in given directions."""
    body = cube(cell=cell)
    turned = np.linalg.qr(np.array([[3.0, 1.0, 0.5], [-1.0, 2.0, 0.3], [0.2, -0.7, 2.5]]))[0]
    extension = np.array([2e-4, 1e-4, -5e-4])
    mu = STEEL.young / (2.0 * (1.0 + STEEL.poisson))
    lame = STEEL.young * STEEL.poisson / ((1.0 + STEEL.poisson) * (1.0 - 2.0 * STEEL.poisson))
    principal = 2.0 * mu * extension + lame * extension.sum()
    s = turned @ np.diag(principal) @ turned.T
    one, two, three = principal
    expected = {
        "von_mises_stress": np.sqrt(0.5 * ((one - two) ** 2 + (two - three) ** 2 + (three - one) ** 2)),
        **{f"stress_{'xyz'[i]}{'xyz'[j]}": s[i, j] for i in range(3) for j in range(i, 3)},
        **{f"principal_stress_{k + 1}": value for k, value in enumerate(principal)},
    }
    spin = np.array([[0.0, 1e-4, 0.0], [-1e-4, 0.0, 2e-4], [0.0, -2e-4, 0.0]])  # a rotation has no stress
    found = body.stresses(body.function(body.x @ (turned @ np.diag(extension) @ turned.T + spin).T))
    assert {stress.name for stress in found} == set(expected)
    for stress in found:
        assert np.allclose(stress.x.array, expected[stress.name], rtol=0.0, atol=1e-9 * abs(three)), stress.name


def test_held_components_have_the_mean_diagonal_of_their_node():
    elasticity = cube()
    d = elasticity.K.getDiagonal().array.reshape(-1, 3)
    free = Elasticity(elasticity.mesh, STEEL, [])
    d_free = free.K.getDiagonal().array.reshape(-1, 3) - free.anchoring
    mean = np.repeat(d_free.mean(axis=1, keepdims=True), 3, axis=1)
    assert np.allclose(d[elasticity.held.components], mean[elasticity.held.components])
    assert elasticity.K.isSymmetric(1e-6 * d.max())
    assert elasticity.K.getBlockSize() == 3


def test_displacement_of_loaded_nodes_alone():
    """f_i/K_ii of a force on one component; of many, of different sizes, the mean, to the accuracy of the estimate."""
    body = cube(clamps=())
    K = body.K.getDiagonal().array.reshape(-1, 3) - body.anchoring
    load = np.zeros_like(body.x)
    load[7, 1] = -3e4
    assert body.nodal_displacement(load) == pytest.approx(3e4 / K[7, 1], rel=1e-12)
    load = 1e4 * np.random.default_rng(0).normal(size=load.shape)
    mean = np.sum(load**2 / K) / np.sum(np.linalg.norm(load, axis=1))
    assert 0.5 * mean < body.nodal_displacement(load) < 2.0 * mean
    assert body.nodal_displacement(0.0 * load) == 0.0


def test_near_nullspace_is_six_rigid_motions():
    elasticity = cube()
    modes = elasticity.K.getNearNullSpace().getVecs()
    assert len(modes) == 6
    rigid = [np.tile(np.eye(3)[k], (len(elasticity.x), 1)) for k in range(3)]
    rigid += [np.cross(np.eye(3)[k], elasticity.x) for k in range(3)]
    span = np.array([v.array_r for v in modes])
    for motion in rigid:
        v = motion.ravel() / np.linalg.norm(motion)
        assert np.linalg.norm(v - span.T @ (span @ v)) <= 1e-10


def test_no_option_is_left_behind():
    from coulomb.solvers import DirectSolver, IterativeSolver

    before = dict(PETSc.Options().getAll())
    elasticity = cube()
    DirectSolver(elasticity.K)
    IterativeSolver(elasticity.K)
    assert PETSc.Options().getAll() == before
