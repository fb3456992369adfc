"""Rubber blocks of large displacements, for the tests of large motions."""

import numpy as np
from mpi4py import MPI

from coulomb.fem.compat import fem, functionspace, mesh, ufl
from coulomb.kinematics import NonlinearBody, neo_hookean

MU, LAME = 1e6 / 2.6, 0.3e6 / (1.3 * 0.4)
"""Of E = 1 MPa, nu = 0.3."""


class RubberBlock:
    """A neo-Hookean box whose face `held` follows `way(time, x)`, a displacement (3, k), along `components`.

    `rollers` hold the component of the planes x = 0 and y = 0 that is normal to them.
    """

    def __init__(
        self,
        way=lambda time, x: 0.0 * x,
        cells=(2, 2, 2),
        size=(1.0, 1.0, 1.0),
        at=(0.0, 0.0, 0.0),
        cell="hexahedron",
        degree=1,
        held="top",
        components=(0, 1, 2),
        rollers=False,
        energy=lambda u: neo_hookean(u, MU, LAME),
        given="energy",
        comm=MPI.COMM_WORLD,
    ):
        low, high = np.array(at), np.array(at) + np.array(size)
        self.domain = mesh.create_box(comm, [low, high], cells, getattr(mesh.CellType, cell))
        self.V = functionspace(self.domain, degree, (3,))
        self.u, self.g = fem.Function(self.V), fem.Function(self.V)
        faces = {"bottom": self.on(2, low[2]), "top": self.on(2, high[2])}
        self.conditions = [self.condition(faces[held], component) for component in components]
        if rollers:
            self.conditions += [self.condition(self.on(axis, low[axis]), axis) for axis in (0, 1)]
        form = energy(self.u) * ufl.dx(metadata={"quadrature_degree": 3 if degree == 1 else 5})
        if given == "residual":
            form = ufl.derivative(form, self.u, ufl.TestFunction(self.V))
        self.body = NonlinearBody(
            bcs=self.conditions,
            faces=faces,
            displacement=self.u,
            update=lambda time: self.g.interpolate(lambda x: way(time, x)),
            **{given: form},
        )

    def on(self, axis, place):
        return mesh.locate_entities_boundary(self.domain, 2, lambda x: np.isclose(x[axis], place))

    def condition(self, facets, component):
        return fem.dirichletbc(self.g.sub(component), fem.locate_dofs_topological(self.V.sub(component), 2, facets))
