"""A rubber block is pressed onto a wavy rigid foundation and drawn over it: large displacements with friction."""

import mpi4py.MPI as MPI  # before dolfinx, as its wheel of PyPI requires
import numpy as np
import ufl
from dolfinx import fem, io, mesh

import coulomb
from coulomb.kinematics import LargeMotions, NonlinearBody, neo_hookean

domain = mesh.create_box(MPI.COMM_WORLD, [np.zeros(3), np.array([1.0, 0.5, 0.6])], (8, 2, 4), mesh.CellType.hexahedron)
V = (
    fem.functionspace(domain, ("P", 1, (3,)))
    if hasattr(fem, "functionspace")
    else fem.VectorFunctionSpace(domain, ("P", 1))
)
u = fem.Function(V, name="displacement")  # the unknown
energy = neo_hookean(u, mu=0.4e6, lame=0.6e6) * ufl.dx(
    metadata={"quadrature_degree": 3}
)  # any of your own in its place
bottom, top = (
    mesh.locate_entities_boundary(domain, 2, lambda x, place=place: np.isclose(x[2], place)) for place in (0.0, 0.6)
)
moved = fem.Function(V)
bc = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 2, top))


def update(time):
    """The top goes down by 0.15 m until 1 s, then at 1 m/s along x."""
    way = np.array([max(time - 1.0, 0.0), 0.0, -0.15 * min(time, 1.0)])
    moved.interpolate(lambda x: np.tile(way[:, None], (1, x.shape[1])))


body = NonlinearBody(energy, [bc], {"sole": bottom}, displacement=u, update=update)
waves = coulomb.SignedDistance(lambda x: x[2] + 0.05 - 0.05 * np.cos(2.0 * np.pi * x[0]))
problem = LargeMotions(body, coulomb.Contact("sole", friction=0.3, foundation=waves))
history = coulomb.LoadHistory([0.5, 1.0, *np.linspace(1.05, 1.4, 8)])

film = io.XDMFFile(domain.comm, "rubber_block.xdmf", "w")  # for ParaView: Warp By Vector
film.write_mesh(domain)
for step in history.steps(problem):
    solution, totals = step.solution, step.solution.forces
    film.write_function(u, step.state.time)
    along, _, across = totals["force"]
    if domain.comm.rank == 0:
        print(
            f"{step.state.time:5.3f} s: {solution.outer_iterations} linear problems, T {along:.0f} N, N {across:.0f} N"
        )
film.close()
if domain.comm.rank == 0:
    print(solution.certificate)  # of the last step, at the deformed place
