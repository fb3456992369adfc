"""The classic elasticity script of DOLFINx, and six lines that add certified contact with friction."""

import mpi4py.MPI as MPI  # before dolfinx, as its wheel of PyPI requires
import numpy as np
import ufl
from dolfinx import fem, mesh

import coulomb

domain = mesh.create_box(
    MPI.COMM_WORLD, [np.zeros(3), np.array([3.0, 1.0, 1.0])], (12, 4, 4), mesh.CellType.tetrahedron
)
V = (
    fem.functionspace(domain, ("P", 2, (3,)))
    if hasattr(fem, "functionspace")
    else fem.VectorFunctionSpace(domain, ("P", 2))
)
u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
mu, lame = 8.3e10, 1.03e11  # steel, pascals


def strain(w):
    return ufl.sym(ufl.grad(w))


stress = 2 * mu * strain(u) + lame * ufl.tr(strain(u)) * ufl.Identity(3)
a = ufl.inner(stress, strain(v)) * ufl.dx
L = ufl.inner(fem.Constant(domain, np.array([2e5, 1e5, -4e6])), v) * ufl.dx
domain.topology.create_connectivity(2, 3)
left = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[0], 0.0))
bc = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, left), V)

bottom = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
body = coulomb.Body(a, L, [bc], faces={"sole": bottom})
solution = coulomb.ContactProblem(body, coulomb.Contact("sole", friction=0.3)).solve()
uh = solution.function  # a dolfinx.fem.Function in V
solution.write("results/forms")
force, balance = solution.forces_on_foundations[0].force, solution.force_balance.balance  # sums over all ranks
if domain.comm.rank == 0:
    print(f"{solution.certificate}\nforce on the floor: {force.round(1).tolist()} N, balance {balance:.0e}")
