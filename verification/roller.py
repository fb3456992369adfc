"""Hertz: a long roller is pressed on a rigid plane, computed by a slice in plane strain.

K. L. Johnson, Contact Mechanics, 4.2(c): with E* = E/(1 - nu^2), the radius R and the force P per length,

    a^2 = 4 P R/(pi E*),   p(x) = p0 sqrt(1 - x^2/a^2),   p0 = 2 P/(pi a)

The slice, one cell of second order thick, is half of the lower half of a ring R/4 < r < R, between two planes of
symmetry at its ends; a third is the plane x = 0.  Its hub moves as a rigid body (`RigidFace`) under the force.  With
a/R = 1/100, the circle is a parabola to (a/R)^2/4, and what the hub changes of the curvature is of order (a/R)^2.

The half width follows from the second moment of the nodal forces, a^2/4 in theory.  The pressure at the centre is that
of the parabola in x^2 that fits the nodal pressures in the inner half best.  Both are averages over loads, since
the edge's position in a cell varies.
"""

from __future__ import annotations

import math

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import PointLoad, RigidFace, SymmetryPlane
from coulomb.fem.geometry import Plane
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .hertz import STEEL
from .table import Curve, Panel, Verified, absolute, order

RADIUS, A, THICK = 0.1, 1e-3, 1e-3
"""Radius, intended half width, and thickness of the slice; metres."""

UNIFORM = 1.5 * A
"""Half width, and depth, of the part with uniform cells."""

LOADS = tuple((0.8 + 0.05 * k) ** 2 for k in range(8))
"""Forces over that of the half width A."""

E_STAR = float(STEEL.young) / (1.0 - float(STEEL.poisson) ** 2)
FORCE = math.pi * E_STAR * A**2 / (4.0 * RADIUS)


def grown(uniform: int, cells: int, width: float) -> FloatArray:
    """Ends of cells, of which the first `uniform` fill `UNIFORM` and the others grow by one factor up to a width."""
    size, count, rest = UNIFORM / uniform, cells - uniform, width - UNIFORM
    low, high = 1.0 + 1e-9, 10.0
    for _ in range(100):
        factor = 0.5 * (low + high)
        low, high = (low, factor) if size * factor * (factor**count - 1.0) / (factor - 1.0) > rest else (factor, high)
    sizes = size * np.append(np.ones(uniform), factor ** np.arange(1, count + 1))
    return np.append(0.0, np.cumsum(sizes))


def problem(uniform: int) -> ContactProblem:
    """The slice with `uniform` cells in 1.5 A; at a time it is under the force of a half width A times that time."""
    cells = 3 * uniform + 6
    along, deep = grown(uniform, cells, 0.5 * math.pi * RADIUS), grown(uniform, cells, 0.75 * RADIUS)
    number = np.arange(cells + 1)

    def place(x: FloatArray) -> FloatArray:
        angle, r = np.interp(x[0], number, along) / RADIUS, RADIUS - np.interp(x[2], number, deep)
        return np.stack([r * np.sin(angle), x[1], RADIUS - r * np.cos(angle)])

    return ContactProblem(
        box((cells, THICK, cells), (cells, 1, cells), place=place, degree=2),
        STEEL,
        [SymmetryPlane(face) for face in ("left", "front", "back")],
        Contact("bottom", 0.0, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
        [PointLoad("top", (0.0, 0.0, -0.5 * FORCE * THICK), amplitude=((0.0, 0.0), (2.0, 2.0)))],
        rigid_faces=[RigidFace("top", translation=(0.0, 0.0, None), rotation=(0.0, 0.0, 0.0))],
    )


def pressed(posed: ContactProblem, times: float) -> tuple[FloatArray, FloatArray, float, float]:
    """Distances of contact nodes from the line over a and their pressures over p0, shapes (m,), and half width and
    pressure at the centre over those of the formula."""
    solution = posed.at(times).solve()
    assert solution.valid
    a = A * math.sqrt(times)
    p0 = 2.0 * times * FORCE / (math.pi * a)
    surface, force = solution.problem.surface, solution.contact_force[0::3]
    x, pressure = np.abs(surface.x[:, 0]), force / surface.area
    half_width = 2.0 * math.sqrt(force @ x**2 / force.sum())
    inner = x < 0.5 * a
    w = np.sqrt(surface.area[inner])
    fit = np.linalg.lstsq(w[:, None] * np.vander(x[inner] ** 2, 2), w * pressure[inner], rcond=None)[0]
    return x / a, pressure / p0, half_width / a, float(fit[1]) / p0


def verify(meshes: tuple[int, ...] = (4, 6, 8)) -> Verified:
    """Results on several meshes, given by their cells in 1.5 a."""
    found = [[pressed(posed, times) for times in LOADS] for posed in map(problem, meshes)]
    h = np.array([UNIFORM / A / uniform for uniform in meshes])
    errors = np.array([[answer[2:] for answer in answers] for answers in found]) - 1.0
    width, centre = np.sqrt(np.mean(errors**2, axis=1)).T
    size = float(h[-1])
    rows = [
        absolute(
            f"{name}, root mean square error over loads, h = {size:.3g} a", 0.0, float(of[-1]), part * size**2, why
        )
        for name, of, part, why in (
            (
                "half width",
                width,
                0.1,
                "(h/a)^2/10: a linear functional, of a pressure with a vertical tangent at the edge",
            ),
            ("pressure at the centre", centre, 0.05, "(h/a)^2/20: the same, far from the edge"),
        )
    ]
    uncertain = "2 for linear functionals; uncertain by the edge's position in a cell"
    rows += [
        absolute(f"order of the {name}", 2.0, order(h, of), 0.5, uncertain)
        for name, of in (("half width", width), ("pressure at the centre", centre))
    ]
    x, pressure, *_ = found[-1][len(LOADS) // 2]
    line, shown = np.linspace(0.0, 1.0, 200), x < 1.3
    curves = (
        Curve("formula", line, np.sqrt(1.0 - line**2), formula=True),
        Curve(f"nodes, h = {size:.3g} a", x[shown], pressure[shown], line=False),
    )
    return Verified(tuple(rows), (Panel("Roller on a plane", "x/a", "p/p0", curves),))
