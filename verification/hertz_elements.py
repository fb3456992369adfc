"""Hertz by elements of first and second order: errors of the force and of the pressure at the centre.

The problem is that of `hertz`, a rigid sphere on a quarter of an elastic block without friction, but in a half space:
the sides of the block that are far from the contact, at 5 a, have the displacement of the half space z > 0 under a
point force P along z (Boussinesq; Johnson, Contact Mechanics, 3.4), with the force P of Hertz's theory,

    u_z = P/(4 pi G) (z^2/s^3 + 2 (1 - nu)/s),    u_r = P/(4 pi G) (r z/s^3 - (1 - 2 nu) r/(s (s + z))),

s^2 = r^2 + z^2.  Hertz's pressure has the mean square distance 2 a^2/5 from the centre: at 5 a the displacement of the
point force is wrong by a part of about 1/5 (a/5a)^2 = 0.8 %, and it is 8 % of the approach.  So Hertz's force and
displacement of the sphere hold to 1e-3.

Elements of both orders have the same nodes, so the same unknowns: n second-order cells on 1.2 a, or 2 n of first order;
beyond, and with the depth, cells grow geometrically.  Errors are root mean squares over four loads, since the edge's
position in a cell varies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, PrescribedDisplacement, Support
from coulomb.fem.geometry import Sphere
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .array_mesh import between, graded, growing
from .hertz import RADIUS, STEEL, A, Hertz, half_space
from .table import Curve, Panel, Row, Verified, absolute

WIDTH, UNIFORM = 5.0 * A, 1.2 * A
"""Edge of the quarter of the block, and of its part with uniform cells, metres."""

LOADS = tuple(radius**2 for radius in (0.9, 0.95, 1.0, 1.05))
"""Displacements of the sphere over a^2/R."""

ELEMENTS = {
    "P1": ("tetrahedron", 1),
    "P2": ("tetrahedron", 2),
    "Q1": ("hexahedron", 1),
    "Q2": ("hexahedron", 2),
}
"""Cell and order by name."""

COARSE, FINE, LINEAR = 4, 8, 7
"""Numbers n of meshes: two of quadratic tetrahedra, and one of linear ones with four times the unknowns of COARSE."""


def _force(displacement: float) -> float:
    """Hertz's force in newtons for a displacement of the sphere over a^2/R."""
    E_star = STEEL.young / (1.0 - STEEL.poisson**2)
    return float(4.0 / 3.0 * E_star * math.sqrt(RADIUS) * (displacement * A**2 / RADIUS) ** 1.5)


def _growth(time: float) -> float:
    """Of the force with the displacement of the sphere."""
    return float(time**1.5)


def problem(element: str, n: int) -> ContactProblem:
    """The quarter of the block above the sphere, n second-order cells or 2 n of first order on 1.2 a; at time t the
    sphere has moved by t a^2/R."""
    cell, degree = ELEMENTS[element]
    times = 3 - degree
    inner, outer, deep = times * n, times * (n // 2 + 1), times * (n + 1)
    h = UNIFORM / inner
    along = graded(h, inner, WIDTH, outer, 1.5)
    down = np.concatenate([[0.0], growing(h, WIDTH, deep)])

    def place(k: FloatArray) -> FloatArray:
        return np.stack([between(along, k[0]), between(along, k[1]), between(down, k[2])])

    cells = (inner + outer, inner + outer, deep)
    far = [
        PrescribedDisplacement(face, half_space(STEEL, _force(1.0)), amplitude=_growth)
        for face in ("right", "back", "top")
    ]
    planes: list[Support] = [Clamp("left", "x"), Clamp("front", "y")]
    return ContactProblem(
        box(cells, cells, cell, place=place, degree=degree),
        STEEL,
        [*planes, *far],
        Contact(
            "bottom",
            friction=0.0,
            foundation=Sphere((0.0, 0.0, -RADIUS), RADIUS),
            motion=lambda time: (0.0, 0.0, time * A**2 / RADIUS),
        ),
        time=1.0,
    )


@dataclass(frozen=True)
class Errors:
    """Root mean squares over the loads of the force and the pressure at the centre over Hertz's, and the worst.

    `r` and `pressure` (m,) are those of the contact points at the last load.
    """

    unknowns: int
    force: float
    centre: float
    worst_centre: float
    r: FloatArray
    pressure: FloatArray


def errors(block: ContactProblem) -> Errors:
    """Solve for all loads."""
    forces, centres = [], []
    for time in LOADS:
        solution = block.at(time).solve()
        surface, known = solution.problem.surface, Hertz(_force(time), RADIUS, STEEL)
        force = solution.contact_force[0::3]
        r, pressure = np.linalg.norm(block.elasticity.x[surface.nodes], axis=1), force / surface.area
        forces.append(4.0 * float(force.sum()) / known.P - 1.0)
        centres.append(float(pressure[np.argmin(r)]) / known.p0 - 1.0)
    force_error, centre_error = (math.sqrt(float(np.mean(np.square(values)))) for values in (forces, centres))
    worst = float(np.max(np.abs(centres)))
    return Errors(block.unknowns["displacement"], force_error, centre_error, worst, r, pressure)


def verify(sizes: tuple[int, int, int] = (FINE, COARSE, LINEAR)) -> Verified:
    """Quadratic tetrahedra on two meshes, and linear ones with four times the unknowns of the coarser."""
    fine, coarse, linear = (errors(problem(*of)) for of in zip(("P2", "P2", "P1"), sizes, strict=True))
    needed = "wanted of quadratic tetrahedra; the far sides are right to 1e-3"
    rows = (
        absolute(f"P2, {fine.unknowns} unknowns: force, error", 0.0, fine.force, 0.005, needed),
        absolute("P2: pressure at the centre, error over p0", 0.0, fine.worst_centre, 0.01, needed),
        _fewer_unknowns(coarse, linear),
    )
    return Verified(rows, (_panel(fine),))


def _panel(fine: Errors) -> Panel:
    known = Hertz(_force(LOADS[-1]), RADIUS, STEEL)
    r, near = np.linspace(0.0, UNIFORM, 400), fine.r < UNIFORM
    return Panel(
        f"quadratic tetrahedra, {fine.unknowns} unknowns",
        "r, mm",
        "pressure at the vertices, MPa",
        (
            Curve("Hertz", 1e3 * r, known.pressure(r) / 1e6, formula=True),
            Curve("coulomb", 1e3 * fine.r[near], fine.pressure[near] / 1e6),
        ),
    )


def _fewer_unknowns(coarse: Errors, linear: Errors) -> Row:
    """A row that passes where linear tetrahedra with four times the unknowns have the larger error of the force."""
    assert linear.unknowns >= 4 * coarse.unknowns
    what = f"force: error of P2, {coarse.unknowns} unknowns, over that of P1, {linear.unknowns}, at most"
    ratio = coarse.force / linear.force
    why = "at most a quarter of the unknowns of linear tetrahedra for the same error"
    return Row(what, 1.0, ratio, max(0.0, ratio - 1.0), 0.0, why)
