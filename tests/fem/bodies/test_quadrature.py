"""The integration points of products of stress and strain on hexahedra of first order, against many more points."""

import numpy as np
import pytest
from conftest import STEEL

import coulomb
from coulomb.fem import compat
from coulomb.fem.bodies.body import ElasticBody, strain
from coulomb.fem.bodies.materials import CellMaterials
from coulomb.fem.compat import fem, ufl


def body(place, cells=(2, 2, 2)):
    mesh = coulomb.box((1.0, 1.0, 1.0), cells, place=place)
    count = mesh.domain.topology.index_map(3).size_local
    return ElasticBody(mesh.domain, CellMaterials(*(np.full(count, value) for value in (STEEL.young, STEEL.poisson))))


def stiffness(elastic, measure):
    """Its matrix, dense."""
    u, v = ufl.TrialFunction(elastic.V), ufl.TestFunction(elastic.V)
    K = compat.assemble_matrix(fem.form(ufl.inner(elastic._stress(u), strain(v)) * measure))
    return K.convert("dense").getDenseArray().copy()


def sheared(x):
    return np.array([[1.0, 0.4, -0.3], [0.1, 0.7, 0.2], [0.0, 0.3, 1.2]]) @ x


def distorted(x):
    return x + 0.12 * np.sin([5.0 * x[1] + 3.0 * x[2], 4.0 * x[2] * x[0] + x[1], 6.0 * x[0] + 2.0 * x[1]])


def many_points(elastic):
    return ufl.dx(domain=elastic.domain, metadata={"quadrature_degree": 11})


def test_the_stiffness_of_parallelepipeds_is_exact():
    elastic = body(sheared)
    K, exact = stiffness(elastic, elastic._dx), stiffness(elastic, many_points(elastic))
    assert np.abs(K - exact).max() <= 1e-14 * np.abs(exact).max()


def test_the_forces_of_a_constant_stress_are_exact_on_cells_of_any_shape():
    elastic = body(distorted)
    gradient = np.array([[1e-3, 2e-3, 0.0], [-1e-3, 4e-3, 1e-3], [5e-4, 0.0, -2e-3]])
    forces = elastic.internal_force(elastic.x @ gradient.T)
    exact = (stiffness(elastic, many_points(elastic)) @ (elastic.x @ gradient.T).ravel()).reshape(-1, 3)
    assert np.abs(forces - exact).max() <= 1e-12 * np.abs(exact).max()
    inside = np.argmin(np.linalg.norm(elastic.x - distorted(np.full((3, 1), 0.5)).T, axis=1))
    assert np.abs(forces[inside]).max() <= 1e-12 * np.abs(forces).max()  # in equilibrium with nothing


@pytest.mark.parametrize("place", [sheared, distorted])
def test_only_rigid_motions_have_no_energy(place):
    elastic = body(place, (1, 1, 1))
    sizes = np.linalg.eigvalsh(stiffness(elastic, elastic._dx))
    assert np.sum(sizes <= 1e-12 * sizes[-1]) == 6 and sizes[6] >= 1e-3 * sizes[-1]
