"""Problems and independent solutions that tests of several folders share."""

from dataclasses import dataclass, field, replace

import clarabel
import numpy as np
import scipy.sparse
from mpi4py import MPI

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    Material,
    NotConverged,
    OrthotropicMaterial,
    Plane,
    PrescribedDisplacement,
    Spring,
    Traction,
)
from coulomb.fem.contact import surface as surfaces
from coulomb.fem.contact.contact_points import contact_matrix
from coulomb.solvers import DirectSolver, FrictionLaw
from coulomb.solvers.contact_equations import ContactEquations

CORK = Material(1e7, 0.0)
RUBBER = Material(1e7, 0.3)
PLATE = Material(7e10, 0.33, expansion=2.3e-5)
WOUND = OrthotropicMaterial(
    (1.3e11, 1.1e10, 9e9),
    (0.28, 0.3, 0.4),
    (5e9, 4.5e9, 3.5e9),
    directions=(lambda x: np.array([-x[1] - 1.0, x[0], 0.2 + 0.0 * x[0]]), (0.0, 0.0, 1.0)),
    expansion=(-1e-6, 3e-5, 2e-5),
)
UP = [(0.0, 0.0), (1.0, 1.0)]
TO_AND_FRO = [(1.0, 0.0), (2.0, 1.0), (4.0, -1.0), (5.0, 0.0)]
NODES = 20
CLOSING = [(0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, -1e-3), (2.0, 2e-3, 0.0, -1e-3)]


def solve(elasticity):
    u = elasticity.K.createVecRight()
    DirectSolver(elasticity.K).solve(elasticity.f(elasticity.at(0.0)), u)
    return u.array.reshape(-1, 3)


def rubbed(cells=4, sway=2e-3, friction=0.4, material=RUBBER, held=()):
    """A block of rubber, its top pressed down by 1 mm until time 1, and moved to and fro along x until time 5."""
    top = [
        PrescribedDisplacement("top", (0.0, 0.0, -1e-3), amplitude=UP),
        PrescribedDisplacement("top", (sway, 0.0, 0.0), "x", amplitude=TO_AND_FRO),
    ]
    mesh = coulomb.box((0.1, 0.1, 0.05), (cells, cells, cells))
    return ContactProblem(mesh, material, [*top, *held], Contact("bottom", friction))


@dataclass(frozen=True)
class FailsAt:
    """Fails when called for one of these."""

    failures: tuple[int, ...]
    tolerance: float = 1e-8
    calls: list = field(default_factory=list)

    def solve(self, problem, start=None, *, gradient=None, progress=None):
        self.calls.append(len(self.calls))
        result = InteriorPoint(self.tolerance).solve(problem, progress=progress)
        if self.calls[-1] in self.failures:
            raise NotConverged("fussy", result)
        return result


def lose(monkeypatch, lost):
    """Contact nodes at which `lost(x)` is true are no longer found."""
    whole = surfaces.contact_surface

    def part(elasticity, face, *arguments):
        found = whole(elasticity, face, *arguments)
        keep = ~lost(found.x)
        points = found.points.only(keep)
        B = contact_matrix(points, found.frames[keep])
        fields = ("part", "x", "frames", "gap", "gap_field", "chord")
        return replace(found, points=points, B=B, free_B=B, **{name: getattr(found, name)[keep] for name in fields})

    monkeypatch.setattr("coulomb.model.contact_faces.contact_surface", part)


def jaws(friction=(0.4, 0.4), motion=CLOSING, **options):
    """A block of cork on soft springs between a floor and a plate that moves down by 1 mm and then sideways by 2 mm."""
    return ContactProblem(
        coulomb.box((0.1, 0.1, 0.05), (4, 4, 4)),
        CORK,
        [],
        [
            Contact("bottom", friction[0]),
            Contact("top", friction[1], foundation=Plane((0, 0, 0.05), (0, 0, -1)), motion=motion),
        ],
        springs=[Spring("left", 1e3), Spring("right", 1e3)],
        **options,
    )


def ring_mesh(inner, outer, cells, angle=0.5 * np.pi, height=0.1, cell="hexahedron", comm=MPI.COMM_WORLD, degree=1):
    """A part of a ring about z: left is its inner face, right the outer one, front and back its ends."""

    def place(x):
        r, phi = inner + (outer - inner) * x[0], angle * x[1]
        return np.stack([r * np.cos(phi), r * np.sin(phi), height * x[2]])

    return coulomb.box((1.0, 1.0, 1.0), cells, cell, comm, place, degree)


def two_bodies(stiffness=1e6, **given):
    """A block of aluminium on one of steel that is clamped; springs alone hold it, beside contact."""
    lower = coulomb.box((1.2, 0.6, 0.4), (12, 6, 4))
    upper = coulomb.moved(coulomb.box((0.8, 0.4, 0.4), (7, 4, 4), "tetrahedron"), translate=(0.2, 0.1, 0.4))
    return ContactProblem(
        coulomb.join(lower=lower, upper=upper),
        {"lower": Material(2.1e11, 0.3), "upper": Material(7e10, 0.33)},
        [Clamp("lower:bottom")],
        Contact("upper:bottom", against="lower:top", friction=0.4),
        [Traction("upper:top", (2e6, 0.0, -1e7))],
        springs=[Spring("upper:left", stiffness)],
        **given,
    )


def equations(rng):
    """At forces of which some are open, some stick and some slip."""
    law = FrictionLaw(np.zeros(NODES), np.full(NODES, 0.4))
    ones = np.ones(NODES)
    of = ContactEquations(law, np.zeros(NODES), ones > 0.0, rng.uniform(1.0, 2.0, NODES), rng.uniform(1.0, 2.0, NODES))
    x, w = rng.uniform(0.0, 2.0, (NODES, 3)), rng.uniform(-1.0, 1.0, (NODES, 3))
    x[:5, 1:], w[:5] = 0.0, 0.0
    w[5:8, 0] = 10.0
    at = of.at(x, w)
    assert set(at.status) == {0, 1, 2}
    return at


def by_clarabel(A, b, slip_bound, lower):
    """The same problem with s = x_n - lower >= 0 and (g, x_t1, x_t2) in the second-order cone, scaled for Clarabel."""
    m, a = len(slip_bound), np.diag(A).mean()
    f = np.abs(b).max() / a
    rows, right, cones = [], [], []
    normal = scipy.sparse.csr_matrix((-np.ones(m), (np.arange(m), 3 * np.arange(m))), shape=(m, 3 * m))
    rows.append(normal)
    right.append(-lower / f)
    cones.append(clarabel.NonnegativeConeT(m))
    for i in range(m):
        rows.append(scipy.sparse.csr_matrix(([-1.0, -1.0], ([1, 2], [3 * i + 1, 3 * i + 2])), shape=(3, 3 * m)))
        right.append([slip_bound[i] / f, 0.0, 0.0])
        cones.append(clarabel.SecondOrderConeT(3))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    P = scipy.sparse.csc_matrix(np.triu(A / a))
    G = scipy.sparse.csc_matrix(scipy.sparse.vstack(rows))
    solution = clarabel.DefaultSolver(P, -b / (a * f), G, np.concatenate(right), cones, settings).solve()
    assert "Solved" in str(solution.status)
    return f * np.array(solution.x)


def left_of(A, b, a, bound, x):
    """x - P(x - (A x - b)/a), written out, shape (m, 3), with compliances a of each row; `bound` of a normal force."""
    v = (x - (A @ x - b) / a).reshape(-1, 3)
    x = x.reshape(-1, 3)
    g = bound(x[:, 0])
    p = v.copy()
    p[:, 0] = np.maximum(v[:, 0], 0.0)
    size = np.hypot(v[:, 1], v[:, 2])
    p[:, 1:] *= np.minimum(1.0, g / np.where(size > 0.0, size, 1.0))[:, None]
    return x - p


def residual_of(A, b, bound, x, elastic=False, d=None):
    """Of one body, compliances alike: the largest left_of over the contact's force, or a hundredth of the largest; and
    that of all contacts by one compliance, over |x|, unless A is that of an `elastic` body; d is its diag(A), shape
    (3 m,), if it is not that of A."""
    d = (np.diag(A) if d is None else d).reshape(-1, 3)
    t = 0.5 * (d[:, 1] + d[:, 2])
    own = left_of(A, b, np.column_stack([d[:, 0], t, t]).ravel(), bound, x)
    off = np.linalg.norm(left_of(A, b, np.mean(d), bound, x))
    if off == 0.0:
        return 0.0
    size = np.linalg.norm(x.reshape(-1, 3), axis=1)
    worst = np.max(np.linalg.norm(own, axis=1) / np.maximum(size, 1e-2 * size.max()))
    return worst if elastic else max(worst, off / np.linalg.norm(x))


def pressed_block(cells, degree=1, **others):
    """Steel that is clamped on the left, pressed and dragged."""
    loads = [Traction("top", (0.0, 1.0e7, -4.0e7)), Traction("right", (2.0e7, 0.0, 0.0))]
    mesh = coulomb.box((3.0, 1.0, 1.0), (3 * cells, cells, cells), degree=degree)
    return ContactProblem(
        mesh, Material(2.1e11, 0.3), [Clamp("left")], Contact("bottom", friction=0.3), loads, **others
    )
