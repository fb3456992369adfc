"""A rubber belt on a drum that turns under it: the forces of its ends tend to T2 = T1 exp(friction angle)."""

import mpi4py.MPI as MPI  # before dolfinx, as its wheel of PyPI requires
import numpy as np
import ufl
from dolfinx import fem, io, mesh

import coulomb
from coulomb.kinematics import LargeMotions, NonlinearBody, neo_hookean

ANGLE, RADIUS, WIDTH, THICKNESS, FRICTION, PULL = np.pi, 1.0, 0.1, 0.01, 0.3, 20.0  # metres, newtons

size = [np.zeros(3), np.array([ANGLE, WIDTH, THICKNESS])]
domain = mesh.create_box(MPI.COMM_WORLD, size, (24, 1, 1), mesh.CellType.hexahedron)
tight, slack, side, inside = (
    mesh.locate_entities_boundary(domain, 2, lambda x, axis=axis, place=place: np.isclose(x[axis], place))
    for axis, place in ((0, 0.0), (0, ANGLE), (1, 0.0), (2, 0.0))
)
angle, radius = domain.geometry.x[:, 0] - 0.5 * np.pi, RADIUS + domain.geometry.x[:, 2]
domain.geometry.x[:, 0], domain.geometry.x[:, 2] = radius * np.sin(angle), radius * np.cos(angle)  # over the drum
V = (
    fem.functionspace(domain, ("P", 1, (3,)))
    if hasattr(fem, "functionspace")
    else fem.VectorFunctionSpace(domain, ("P", 1))
)
u = fem.Function(V, name="displacement")  # the unknown
still, pull = fem.Function(V), fem.Constant(domain, np.zeros(3))
bcs = [  # the end on the left is held along the belt, and one side across it
    fem.dirichletbc(still.sub(axis), fem.locate_dofs_topological(V.sub(axis), 2, facets))
    for axis, facets in ((2, tight), (1, side))
]
tags = mesh.meshtags(domain, 2, np.sort(slack), np.ones(len(slack), dtype=np.int32))
ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)
soft = 0.5 * 10.0 * ufl.inner(u, u)  # springs that hold the belt until contact does, N/m^3
strain = neo_hookean(u, mu=0.4e6, lame=0.6e6) + soft
energy = strain * ufl.dx(metadata={"quadrature_degree": 3}) - ufl.inner(pull, u) * ds(1)


def update(time):
    """The end on the right is pulled down until 1 s."""
    pull.value[2] = -min(time, 1.0) * PULL / (WIDTH * THICKNESS)


body = NonlinearBody(energy, bcs, {"inside": inside}, displacement=u, update=update)
drum = coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), RADIUS)
turning = coulomb.Rotation((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), lambda time: 0.1 * max(time - 1.0, 0.0))  # radians
problem = LargeMotions(body, coulomb.Contact("inside", friction=FRICTION, foundation=drum, rotation=turning))

film = io.XDMFFile(domain.comm, "belt.xdmf", "w")  # for ParaView: Warp By Vector
film.write_mesh(domain)
for step in coulomb.LoadHistory([1.0, 1.25, 1.5, 1.75, 2.0, 2.5]).steps(problem):
    film.write_function(u, step.state.time)
    *_, upward = step.solution.forces["force"]  # of the drum on the belt
    ratio, count = upward / PULL - 1.0, step.solution.outer_iterations
    if domain.comm.rank == 0:
        print(f"{step.state.time:5.3f} s: {count} linear problems, T2/T1 {ratio:.4f}")
film.close()
if domain.comm.rank == 0:
    print(f"exp(friction angle) {np.exp(FRICTION * ANGLE):.4f}")
    print(step.solution.certificate)  # of the last step, at the deformed place
