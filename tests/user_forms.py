"""A user's script of DOLFINx, for bodies from forms."""

import numpy as np
import ufl

from coulomb.fem import compat
from coulomb.fem.compat import fem


def strain(u):
    return ufl.sym(ufl.grad(u))


class Script:
    """Space, trial and test function on a mesh with named faces."""

    def __init__(self, mesh, degree):
        self.mesh, self.domain = mesh, mesh.domain
        self.V = compat.functionspace(self.domain, degree, (3,))
        self.u, self.v = ufl.TrialFunction(self.V), ufl.TestFunction(self.V)

    def elasticity(self, young, poisson, u=None):
        """The form of isotropic elasticity; young and poisson may be functions."""
        u = self.u if u is None else u
        mu, lame = young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        stress = 2.0 * mu * strain(u) + lame * ufl.tr(strain(u)) * ufl.Identity(3)
        return ufl.inner(stress, strain(self.v)) * ufl.dx

    def constant(self, value):
        return fem.Constant(self.domain, np.asarray(value, dtype=float))

    def function(self):
        return fem.Function(self.V)

    def on_cells(self, value):
        """A function that is constant on every cell, as value(midpoint)."""
        W = compat.functionspace(self.domain, 0, family="DG")
        function = fem.Function(W)
        middle = W.tabulate_dof_coordinates()
        function.x.array[:] = value(middle.T)[: len(function.x.array)]
        return function

    def compile(self, form):
        return fem.form(form)

    def ds(self, face):
        facets = self.mesh.faces[face]
        tags = compat.meshtags(self.domain, 2, facets, np.ones(len(facets), dtype=np.int32))
        return ufl.Measure("ds", domain=self.domain, subdomain_data=tags)(1)

    def bc(self, value, face, component=None):
        """A Dirichlet condition: a Function, three numbers, or a number for a component."""
        self.domain.topology.create_connectivity(2, 3)
        space = self.V if component is None else self.V.sub(component)
        dofs = fem.locate_dofs_topological(space, 2, self.mesh.faces[face])
        if hasattr(value, "x"):
            return fem.dirichletbc(value, dofs)
        return fem.dirichletbc(np.asarray(value, dtype=float) if component is None else float(value), dofs, space)

    def nodes(self, face):
        """This rank's nodes on a face."""
        dofs = fem.locate_dofs_topological(self.V, 2, self.mesh.faces[face])
        return dofs[dofs < self.V.dofmap.index_map.size_local]
