"""Plasticity, viscoelasticity, heat, a tool under a force: loops around a contact problem, each beside its formula."""

import basix
import mpi4py.MPI as MPI  # before dolfinx, as its wheel of PyPI requires
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc
from petsc4py import PETSc
from scipy.optimize import root

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory

domain = mesh.create_box(MPI.COMM_WORLD, [[0.0] * 3, [1.0] * 3], (2, 2, 2), mesh.CellType.hexahedron)
domain.topology.create_connectivity(2, 3)
QUADRATURE = {"quadrature_degree": 2, "quadrature_scheme": "default"}
dx = ufl.dx(domain=domain, metadata=QUADRATURE)


def space(family, degree, shape=()):
    """Lagrange or DG functions, or values at the points of the quadrature."""
    if not hasattr(fem, "functionspace"):  # DOLFINx 0.5
        cell, of = domain.ufl_cell(), {0: ufl.FiniteElement, 1: ufl.VectorElement, 2: ufl.TensorElement}[len(shape)]
        scheme = {"quad_scheme": "default"} if family == "Quadrature" else {}
        return fem.FunctionSpace(domain, of(family, cell, degree, **scheme))
    if family == "Quadrature":
        element = basix.ufl.quadrature_element("hexahedron", value_shape=shape, degree=degree)
        return fem.functionspace(domain, element)
    return fem.functionspace(domain, (family, degree, shape) if shape else (family, degree))


V, points, tensors = space("Lagrange", 1, (3,)), space("Quadrature", 2), space("Quadrature", 2, (3, 3))
u, v, unit = ufl.TrialFunction(V), ufl.TestFunction(V), ufl.Identity(3)


def strain(w):
    return ufl.sym(ufl.grad(w))


def hooke(e, young, poisson):
    return young / (1 + poisson) * (e + poisson / (1 - 2 * poisson) * ufl.tr(e) * unit)


cells = np.arange(domain.topology.index_map(3).size_local + domain.topology.index_map(3).num_ghosts, dtype=np.int32)
X, _ = basix.make_quadrature(basix.CellType.hexahedron, 2)  # the points of dx


def evaluated(expression, function):
    """What sets a function of values at the points to an expression of UFL."""
    W, value = function.function_space, fem.Expression(expression, X)
    nodes, width = W.dofmap.list, W.dofmap.bs
    nodes = (nodes if isinstance(nodes, np.ndarray) else nodes.array).reshape(len(cells), -1)  # the second until 0.6

    def evaluate():
        found = value.eval(domain, cells) if hasattr(fem, "functionspace") else value.eval(cells)
        function.x.array.reshape(-1, width)[nodes] = found.reshape(*nodes.shape, width)

    return evaluate


def held(axis, value, component, to=0.0):
    """One component on a plane of the boundary, as a Constant and its condition."""
    facets = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[axis], value))
    constant = fem.Constant(domain, to)
    W = V.sub(component)
    return constant, fem.dirichletbc(constant, fem.locate_dofs_topological(W, 2, facets), W)


down, top = held(2, 1.0, 2)
sides = [held(0, 0.0, 0)[1], held(1, 0.0, 1)[1]]  # planes of symmetry
faces = {"sole": lambda x: np.isclose(x[2], 0.0)}
smooth = Contact("sole", friction=0.0)


def pressing(solution):
    return solution.forces["normal_force"]


# J2 plasticity: von Mises' yield stress S0, linear isotropic hardening H.  The trial stress of the last answer is
# returned to the yield surface (Simo and Hughes, Computational Inelasticity, box 3.2); its difference from the elastic
# stress goes into L, until the displacement does not change.
E, NU, S0, H = 1000.0, 0.3, 2.0, 500.0
MU = E / (2 * (1 + NU))
last, plastic, size = fem.Function(V), fem.Function(tensors), fem.Function(points)  # size: equivalent plastic strain
new_plastic, new_size = fem.Function(tensors), fem.Function(points)

trial = 2 * MU * ufl.dev(strain(last) - plastic)
norm = ufl.sqrt(ufl.inner(trial, trial) + 1e-30)
beyond = norm - np.sqrt(2 / 3) * (S0 + H * size)
flow = ufl.conditional(ufl.gt(beyond, 0.0), beyond, 0.0) / (2 * MU + 2 * H / 3)
return_mapping = (
    evaluated(plastic + flow * trial / norm, new_plastic),
    evaluated(size + np.sqrt(2 / 3) * flow, new_size),
)

a = ufl.inner(hooke(strain(u), E, NU), strain(v)) * dx
L = ufl.inner(hooke(new_plastic, E, NU), strain(v)) * dx
problem = ContactProblem(coulomb.Body(a, L, [top, *sides], faces=faces), smooth)

state, start = LoadHistory([1.0, 2.0, 3.0]).beginning(problem), None
for time, depth in ((1.0, 0.001), (2.0, 0.006), (3.0, 0.004)):
    down.value = -depth
    posed = problem.at(time, state)
    for iteration in range(60):
        solves = iteration + 1
        solution = posed.solve(tolerance=1e-10, start=start)
        change = np.abs(solution.function.x.array - last.x.array).max(initial=0.0)
        last.x.array[:], start = solution.function.x.array, solution.contact_force
        for evaluate in return_mapping:
            evaluate()
        if domain.comm.allreduce(change, op=MPI.MAX) < 1e-9 * depth:
            break
    plastic.x.array[:], size.x.array[:] = new_plastic.x.array, new_size.x.array  # accepted
    state = problem.after(state, solution)
    yielded = S0 + E * H / (E + H) * (0.006 - S0 / E)  # the stress at 0.006
    exact = {0.001: E * 0.001, 0.006: yielded, 0.004: yielded - E * 0.002}[depth]
    print(f"plasticity: {pressing(solution) / exact:.7f} of the formula, {solves} solves")

# Viscoelasticity: a spring E0 beside a Maxwell branch E1 with relaxation time TAU, implicit Euler steps.  A step that
# fails would be halved: `update` takes the length of the step from the last one that was accepted.
E0, E1, TAU = 20e3, 80e3, 1.0
viscous, step, accepted = fem.Function(tensors), fem.Constant(domain, 0.1), [0.0]
factor = 1 / (1 + step / TAU)
a = ufl.inner(hooke(strain(u), E0, 0.0) + factor * hooke(strain(u), E1, 0.0), strain(v)) * dx
L = factor * ufl.inner(hooke(viscous, E1, 0.0), strain(v)) * dx


def update(time):
    step.value = time - accepted[0] if time > accepted[0] else 0.1
    down.value = -0.01 * min(time / 0.1, 1.0)


body, known = coulomb.Body(a, L, [top, *sides], faces=faces, update=update), 0.0
for one in LoadHistory([0.1, 0.2, 0.4, 0.8]).steps(ContactProblem(body, smooth)):
    dt = one.state.time - accepted[0]
    evaluated(factor * (viscous + step / TAU * strain(one.solution.function)), viscous)()
    accepted[0] = one.state.time
    known = (known + 0.01 * dt / TAU) / (1 + dt / TAU)
    exact = E0 * 0.01 + E1 * (0.01 - known)
    print(f"viscoelasticity: {pressing(one.solution) / exact:.7f} of the formula")

# Heat and contact in turns: heat passes into a cold floor through a conductance proportional to the contact pressure,
# and the block expands (along z alone, for the formula), which presses it.
CONDUCTIVITY, PER_PASCAL, EXPANSION, HOT, YOUNG = 10.0, 0.5, 1e-4, 100.0, 1e4
W = space("Lagrange", 1)
T, p, q = fem.Function(W), ufl.TrialFunction(W), ufl.TestFunction(W)
pressure = fem.Function(W)
sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
roof = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1.0))
facets, values = np.concatenate([sole, roof]), np.repeat([1, 2], [len(sole), len(roof)])
order = np.argsort(facets)
tags = mesh.meshtags(domain, 2, facets[order].astype(np.int32), values[order].astype(np.int32))
ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)
conduction = CONDUCTIVITY * ufl.inner(ufl.grad(p), ufl.grad(q)) * ufl.dx
conduction = fem.form(conduction + PER_PASCAL * pressure * p * q * ds(1) + 1e8 * p * q * ds(2))
heating = fem.form(1e8 * HOT * q * ds(2))


def heated():
    A, b = petsc.assemble_matrix(conduction), petsc.assemble_vector(heating)
    A.assemble()
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    solver, x = PETSc.KSP().create(domain.comm), A.createVecRight()
    solver.setOperators(A)
    solver.setTolerances(rtol=1e-13)
    solver.solve(b, x)
    T.x.array[: x.array.size] = x.array
    T.x.scatter_forward()


a = ufl.inner(hooke(strain(u), YOUNG, 0.0), strain(v)) * ufl.dx
L = YOUNG * EXPANSION * T * strain(v)[2, 2] * ufl.dx
down.value = -1e-3
problem, start, before = ContactProblem(coulomb.Body(a, L, [top, *sides], faces=faces), smooth), None, 0.0
for turn in range(40):
    turns = turn + 1
    solution = problem.solve(tolerance=1e-10, start=start)
    pressure.x.array[:], start = solution.function("pressure").x.array, solution.contact_force
    heated()
    if abs(pressing(solution) - before) < 1e-9 * pressing(solution):
        break
    before = pressing(solution)
low, high = 0.0, 1e3  # bisection: the pressure of the mean of the temperatures at both ends
for _ in range(60):
    middle = 0.5 * (low + high)
    cold = HOT / (1 + PER_PASCAL * middle / CONDUCTIVITY)
    low, high = (middle, high) if YOUNG * (1e-3 + EXPANSION * 0.5 * (HOT + cold)) > middle else (low, middle)
print(f"heat: {pressing(solution) / middle:.7f} of the formula, {turns} turns")

# A tool whose force depends on where it is: translation and tilt of the foundation are unknowns, the normal force and
# the centre of pressure equations.
FORCE, PLACE, YOUNG, pose, answers = 500.0, 0.51, 1e6, np.zeros(2), []
tool = Contact(
    "roof",
    friction=0.0,
    foundation=coulomb.Plane((0.5, 0.5, 1.0), (0.0, 0.0, -1.0)),
    motion=lambda time: (0.0, 0.0, -pose[0]),
    rotation=coulomb.Rotation((0.5, 0.5, 1.0), (0.0, 1.0, 0.0), lambda time: pose[1]),
)
a = ufl.inner(hooke(strain(u), YOUNG, 0.0), strain(v)) * dx
body = coulomb.Body(a, None, [held(2, 0.0, 2)[1], *sides], faces={"roof": lambda x: np.isclose(x[2], 1.0)})
problem = ContactProblem(body, tool)


def out_of_balance(unknowns):
    pose[:] = 1e-3 * unknowns
    start = answers[-1].contact_force if answers else None
    answers.append(problem.at(0.0).solve(tolerance=1e-11, start=start))
    forces = answers[-1].forces
    return [forces["normal_force"] / FORCE - 1.0, (forces["centre_of_pressure"][0] - PLACE) / 0.5]


found = root(out_of_balance, [1.0, 0.0], tol=1e-9)
force, place = out_of_balance(found.x)
print(f"tool: {1e-3 * found.x[0] / (FORCE / YOUNG):.7f} of the formula, {len(answers)} solves")  # F = E A d/L
print(f"out of balance: {abs(force):.1e} of the force, {abs(place):.1e} of the lever")
print(answers[-1].certificate)
