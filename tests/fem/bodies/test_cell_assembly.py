"""The stiffness matrix by kernels in C, against DOLFINx's assembly."""

import numpy as np
import pytest
import ufl

from coulomb import Clamp, Elasticity, Material, OrthotropicMaterial, box
from coulomb.fem import compat
from coulomb.fem.bodies import elasticity as cell_assembly
from coulomb.fem.bodies.body import HexahedralForces, strain
from coulomb.fem.compat import fem

STEEL = Material(2.1e11, 0.3)
PLY = OrthotropicMaterial((1.3e11, 1.1e10, 9e9), (0.28, 0.3, 0.4), (5e9, 4.5e9, 3.5e9))


def form_on(mesh, material):
    """A body, and its bilinear form."""
    body = Elasticity(mesh, material, [Clamp("left")])
    return body, fem.form(ufl.inner(body._stress(ufl.TrialFunction(body.V)), strain(body._test)) * body._dx)


def compare(form, V):
    """Rows and columns are the same, values to rounding: cells are added in the same order."""
    rows, columns, values = zip(
        *(K.getValuesCSR() for K in (compat.assemble_matrix(form), cell_assembly.assembled_matrix(form, V))),
        strict=True,
    )
    assert np.array_equal(*rows) and np.array_equal(*columns)
    assert np.abs(values[0] - values[1]).max() <= 1e-13 * np.abs(values[0]).max()
    assert cell_assembly.assembled_matrix(form, V).getBlockSize() == 3  # for multigrid


@pytest.mark.parametrize("moved", [0.0, 1e-9, 0.01])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_as_dolfinx_assembles(cell, degree, moved):
    """Cells that are alike share a matrix; moved nodes make all cells different."""
    mesh = box((1.0, 1.1, 1.3), (3, 2, 2), cell, degree=degree)
    if moved:
        x = mesh.domain.geometry.x
        x[:] += moved * np.random.default_rng(5).standard_normal(x.shape)
    body, form = form_on(mesh, PLY if degree == 1 else STEEL)
    compare(form, body.V)


def test_cells_that_are_alike_but_of_other_materials():
    body, form = form_on(box((1.0, 1.0, 1.0), (4, 4, 4)), STEEL)
    factors = np.random.default_rng(6).integers(1, 4, len(body._mu.x.array))
    body._mu.x.array[:] *= factors
    compare(form, body.V)
    values = cell_assembly.assembled_matrix(form, body.V).getValuesCSR()[2]
    body._mu.x.array[:] = body._mu.x.array[0]
    assert np.abs(values - cell_assembly.assembled_matrix(form, body.V).getValuesCSR()[2]).max() > 0.1 * values.max()


@pytest.mark.parametrize("mirrored", [False, True])
def test_internal_forces_are_those_of_the_form(mirrored):
    """On hexahedra that are all different, of several materials; 45 cells, so that the last vector is not full."""
    mesh = box((1.0, 1.1, 1.3), (5, 3, 3))
    x, rng = mesh.domain.geometry.x, np.random.default_rng(7)
    x[:] += 0.03 * rng.standard_normal(x.shape)
    x[:, 0] *= -1.0 if mirrored else 1.0
    body, _ = form_on(mesh, STEEL)
    for constant in (body._mu, body._lame):
        constant.x.array[:] *= rng.integers(1, 4, len(constant.x.array))
    body._forces = HexahedralForces(body.V, body._mu, body._lame)
    u = 1e-3 * rng.standard_normal(body.x.shape)
    ours = body.internal_force(u)
    theirs = body._assemble(body._internal_form)
    assert np.abs(ours - theirs).max() <= 1e-13 * np.abs(theirs).max()
    spin = np.cross([0.1, -0.2, 0.3], body.x) + 0.5  # a rigid motion strains nothing
    assert np.abs(body.internal_force(spin)).max() <= 1e-13 * STEEL.young


def test_other_cells_take_the_form():
    for cell, degree, material in (("tetrahedron", 1, STEEL), ("hexahedron", 2, STEEL), ("hexahedron", 1, PLY)):
        assert form_on(box((1.0, 1.0, 1.0), (1, 1, 1), cell, degree=degree), material)[0]._forces is None
