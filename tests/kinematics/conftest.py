"""Rubber blocks of large displacements."""

import numpy as np
import pytest
from mpi4py import MPI

from coulomb.fem.compat import fem, functionspace, mesh, ufl
from coulomb.kinematics import NonlinearBody, neo_hookean

MU, LAME = 1e6 / 2.6, 0.3e6 / (1.3 * 0.4)
"""Of E = 1 MPa, nu = 0.3."""


class Block:
    """A neo-Hookean box with the faces "bottom" and "top"; the top follows `way(t, x)`, its displacement (3, k)."""

    def __init__(self, way, cells=(2, 2, 2), size=(1.0, 1.0, 1.0), at=(0.0, 0.0, 0.0), degree=1, held=(0, 1, 2), cell="hexahedron", held_face="top", more=()):
        low, high = np.array(at), np.array(at) + np.array(size)
        self.domain = mesh.create_box(MPI.COMM_WORLD, [low, high], cells, getattr(mesh.CellType, cell))
        self.V = functionspace(self.domain, degree, (3,))
        self.u, self.g = fem.Function(self.V), fem.Function(self.V)
        on = {name: mesh.locate_entities_boundary(self.domain, 2, lambda x, z=z: np.isclose(x[2], z)) for name, z in (("bottom", low[2]), ("top", high[2]))}
        self.conditions = [
            self.condition(on[held_face], component) for component in held
        ] + [self.condition(mesh.locate_entities_boundary(self.domain, 2, where), component) for where, component in more]
        energy = neo_hookean(self.u, MU, LAME) * ufl.dx(metadata={"quadrature_degree": 3 if degree == 1 else 5})

        def update(time):
            self.g.interpolate(lambda x: way(time, x))

        self.body = NonlinearBody(energy, self.conditions, on, displacement=self.u, update=update)

    def condition(self, facets, component):
        dofs = fem.locate_dofs_topological(self.V.sub(component), 2, facets)
        return fem.dirichletbc(self.g.sub(component), dofs)


@pytest.fixture
def block():
    return Block
