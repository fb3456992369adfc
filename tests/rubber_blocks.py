"""Rubber blocks of large displacements, for the tests of large motions."""

import numpy as np
from case_texts import one_body
from mpi4py import MPI
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import coulomb
from coulomb.fem.compat import fem, functionspace, mesh, ufl
from coulomb.kinematics import NeoHookean, NonlinearBody, neo_hookean

MU, LAME = 1e6 / 2.6, 0.3e6 / (1.3 * 0.4)
"""Of E = 1 MPa, nu = 0.3."""

FACES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
"""The axis of each face of a box, and its end there."""


MOVED = """\
[[prescribed_displacement]]
face = "TOP"
value = [0.0, 0.0, DOWN]
components = "yz"
amplitude = [[0.0, 0.0], [1.0, 1.0]]
[[prescribed_displacement]]
face = "TOP"
value = [ALONG, 0.0, 0.0]
components = "x"
amplitude = [[1.0, 0.0], [2.0, 1.0]]
[solver]
kinematics = "large"
[output]
picture = false
"""
"""A face is moved down until time 1, then along x until time 2."""

DRAWN = one_body((1.0, 0.5, 0.5), (4, 1, 2), 1e6, law='"neo-hookean"')
DRAWN += MOVED.replace("TOP", "top").replace("DOWN", "-0.1").replace("ALONG", "0.4")
DRAWN += """\
[contact]
face = "bottom"
friction = 0.3
foundation = { shape = "cylinder", point = [0.5, 0.0, -2.0], axis = [0.0, 1.0, 0.0], radius = 2.0 }
[history]
times = [0.5, 1.0, 1.5, 2.0]
"""
"""A case: a block pressed onto a drum, and drawn over it."""


def side(stretch):
    """Stretch of the free sides of a neo-Hookean bar."""
    return brentq(lambda a: MU * (a - 1.0 / a) + LAME * np.log(a * a * stretch) / a, 0.5, 2.0)


def stress(stretch):
    """First Piola stress of a neo-Hookean bar whose sides are free."""
    return MU * (stretch - 1.0 / stretch) + LAME * np.log(side(stretch) ** 2 * stretch) / stretch


class RubberBlock:
    """A neo-Hookean box whose face `held` follows `way(time, x)`, a displacement (3, k), along `components`; so do the
    faces `also`, each with the component that is held.

    `rollers` hold the component of the planes x = 0 and y = 0 that is normal to them.  `shape` maps the points (k, 3)
    of the box to those of the body, whose faces keep their names.  `loads` are dead ones: of a face the force in
    newtons (3,) at a time, uniform over the face.  `energy` is that per volume of the displacement, `skin` one per area
    of the bottom, of the displacement and the normals.
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
        also=(),
        rollers=False,
        shape=lambda x: x,
        loads=None,
        energy=lambda u: neo_hookean(u, MU, LAME),
        skin=None,
        given="energy",
        comm=MPI.COMM_WORLD,
    ):
        self.low, self.high = np.array(at), np.array(at) + np.array(size)
        self.domain = mesh.create_box(comm, [self.low, self.high], cells, getattr(mesh.CellType, cell))
        self.V = functionspace(self.domain, degree, (3,))
        self.u, self.g = fem.Function(self.V), fem.Function(self.V)
        faces = {name: self.on(axis, (self.low, self.high)[end][axis]) for name, (axis, end) in FACES.items()}
        self.conditions = [self.condition(faces[held], component) for component in components]
        self.conditions += [self.condition(faces[face], component) for face, component in also]
        if rollers:
            self.conditions += [self.condition(self.on(axis, self.low[axis]), axis) for axis in (0, 1)]
        self.domain.geometry.x[:] = shape(self.domain.geometry.x)
        form = energy(self.u) * ufl.dx(metadata={"quadrature_degree": 3 if degree == 1 else 5})
        ds, self.loads = self.measure(faces), []
        for face, force in (loads or {}).items():
            traction = fem.Constant(self.domain, np.zeros(3))
            self.loads.append((traction, force, self.area(ds(list(FACES).index(face)))))
            form -= ufl.dot(traction, self.u) * ds(list(FACES).index(face))
        if skin is not None:
            form += skin(self.u, ufl.FacetNormal(self.domain)) * ds(
                list(FACES).index("bottom"), {"quadrature_degree": 3}
            )
        self.form = form
        if given == "residual":
            form = ufl.derivative(form, self.u, ufl.TestFunction(self.V))
        self.body = NonlinearBody(
            bcs=self.conditions,
            faces=faces,
            displacement=self.u,
            update=lambda time: self.update(way, time),
            **{given: form},
        )

    def update(self, way, time):
        self.g.interpolate(lambda x: way(time, x))
        for traction, force, area in self.loads:
            traction.value[:] = np.asarray(force(time)) / area

    def free_forces(self):
        """Internal forces at the nodes that no condition holds, and the places of these nodes, both (k, 3)."""
        inside = fem.form(ufl.derivative(self.form, self.u, ufl.TestFunction(self.V)))
        force = fem.petsc.assemble_vector(inside).array.reshape(-1, 3)
        held = [one.dof_indices()[0] // 3 for one in self.conditions]
        free = np.setdiff1d(np.arange(len(force)), np.concatenate(held))
        return force[free], (self.body.reference + self.u.x.array.reshape(-1, 3)[: len(force)])[free]

    def on(self, axis, place):
        return mesh.locate_entities_boundary(self.domain, 2, lambda x: np.isclose(x[axis], place))

    def condition(self, facets, component):
        return fem.dirichletbc(self.g.sub(component), fem.locate_dofs_topological(self.V.sub(component), 2, facets))

    def measure(self, faces):
        facets = np.concatenate(list(faces.values()))
        number = np.repeat(np.arange(len(faces), dtype=np.int32), [len(one) for one in faces.values()])
        order = np.argsort(facets)
        tags = mesh.meshtags(self.domain, 2, facets[order], number[order])
        return ufl.Measure("ds", domain=self.domain, subdomain_data=tags)

    def area(self, ds):
        here = fem.assemble_scalar(fem.form(fem.Constant(self.domain, 1.0) * ds))
        return self.domain.comm.allreduce(here)


def bolted_bar(comm=MPI.COMM_WORLD):
    """A bar of two halves, tightened to 500 N until time 1, then locked; its upper end is drawn aside until time 2, and
    everything is turned by 30 degrees until time 3: the problem, and the rotation at a time."""
    axis, foot, head = np.array([1.0, 2.0, -0.5]), np.array([0.05, 0.05, 0.0]), np.array([0.05, 0.05, 1.0])
    whole = np.radians(30.0) * axis / np.linalg.norm(axis)

    def turned(time):
        return Rotation.from_rotvec(max(time - 2.0, 0.0) * whole).as_matrix()

    def way(time):
        aside = np.array([0.0, 0.02, 0.0]) * min(max(time - 1.0, 0.0), 1.0)
        return foot + turned(time) @ (head + aside - foot) - head

    ramp = ((0.0, 0.0), (2.0, 0.0), (3.0, 1.0))
    along = [lambda time, axis=axis: float(way(time)[axis]) for axis in range(3)]
    ends = [
        coulomb.RigidFace("low:bottom", tuple(foot), (0.0, 0.0, 0.0), tuple(whole), ramp),
        coulomb.RigidFace("up:top", tuple(head), (1.0, 1.0, 1.0), tuple(whole), 1.0, [*along, ramp, ramp, ramp]),
    ]
    bolt = coulomb.Pretension("up:bottom", "low:top", force=500.0, amplitude=((0.0, 0.0), (1.0, 1.0)), lock=1.0)
    low = coulomb.box((0.1, 0.1, 0.4), (1, 1, 2), comm=comm)
    up = coulomb.moved(coulomb.box((0.1, 0.1, 0.6), (1, 2, 2), comm=comm), (0.0, 0.0, 0.4))
    far = coulomb.Contact("low:left", 0.3, foundation=coulomb.Plane((-9.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    given = {"ties": [bolt], "rigid_faces": ends, "kinematics": "large"}
    problem = coulomb.ContactProblem(coulomb.join(low=low, up=up), NeoHookean(1e6, 0.3), [], far, **given)
    return problem, turned


RISING = [(0.0, 0.0), (1.0, 1.0), (2.0, 1.2)]


def in_a_jaw(friction=1.0, moved=1.0, young=1.0, pushed=1.0, sprung=1.0, bent=1.0, cells=(2, 2, 1)):
    """A rubber block on a ball, turned by a jaw that is partly free, on springs and under a moment."""
    jaw = coulomb.RigidFace(
        "top",
        (0.4, 0.5, 0.5),
        (0.03 * moved, None, -0.06 * moved),
        (None, None, 0.2 * moved),
        RISING,
        translation_stiffness=(0.0, 1e5 * sprung, 0.0),
        rotation_stiffness=(2e3 * sprung, 1e3 * sprung, 0.0),
    )
    moment = tuple(bent * np.array([2e3, -3e3, 1e3]))
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), cells),
        NeoHookean(1e6 * young, 0.3),
        [],
        coulomb.Contact("bottom", 0.4 * friction, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 2.99)),
        [
            coulomb.Pressure("right", 1e4 * pushed, amplitude=RISING),
            coulomb.PointLoad("top", (1e3 * bent, 1e3 * bent, 0.0), moment, (0.45, 0.5, 0.5), RISING),
        ],
        kinematics="large",
        rigid_faces=[jaw],
    )


def strut(lock=None, friction=1.0, pressed=1.0, lower=1.0, upper=1.0, pushed=1.0, bent=1.0, turned=1.0, sprung=1.0):
    """A rubber bar of two halves, which a jack between them presses against an oblique wall; it is bent, and turned by
    its foot."""
    if lock is None:
        jack = coulomb.Pretension("upper:bottom", "lower:top", shortening=-0.1 * turned, amplitude=RISING)
    else:
        jack = coulomb.Pretension("upper:bottom", "lower:top", force=-3e4 * pressed, amplitude=RISING, lock=lock)
    foot = coulomb.RigidFace(
        "lower:bottom",
        (0.2, 0.3, 0.0),
        (0.0, 0.0, 0.0),
        (None, None, 0.1 * turned),
        RISING,
        rotation_stiffness=(1e5 * sprung, 2e5 * sprung, 0.0),
    )
    above = coulomb.moved(coulomb.box((0.5, 0.5, 0.6), (2, 1, 1)), (0.0, 0.0, 0.4))
    moment = 200.0 * bent, 0.0, 300.0 * bent
    return coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box((0.5, 0.5, 0.4), (1, 1, 1)), upper=above),
        {"lower": NeoHookean(1e6 * lower, 0.3), "upper": NeoHookean(2e6 * upper, 0.3)},
        [],
        coulomb.Contact("upper:top", 0.2 * friction, foundation=coulomb.Plane((0.0, 0.0, 1.005), (0.2, 0.1, -1.0))),
        [
            coulomb.TotalForce("upper:left", (2e3 * pushed, 1e3 * pushed, 0.0), amplitude=RISING),
            coulomb.PointLoad("upper:right", (0.0, 0.0, 0.0), moment, (0.5, 0.2, 0.7), RISING),
        ],
        ties=[jack],
        rigid_faces=[foot],
        kinematics="large",
    )
