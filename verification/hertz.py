"""Hertz: a rigid sphere presses into a flat elastic block, without friction.

K. L. Johnson, Contact Mechanics, 4.2: with E* = E/(1 - nu^2), the radius R and the force P,

    a^3 = 3 P R/(4 E*),   p(r) = p0 sqrt(1 - r^2/a^2),   p0 = 3 P/(2 pi a^2),   approach a^2/R

The block is a quarter of one of 32 a x 32 a x 16 a: two planes of symmetry, its far face held along the sphere's
motion; a/R = 1/100, so that the sphere is a paraboloid to 1e-4.  The displacement of the sphere is prescribed; P
follows, and the formulas are evaluated for it.  Cells have the size h up to 4 a/3 from the centre and grow beyond.  A
body of finite size L bends the surface under the contact by (a/L)^3 of the sphere's curvature, less than the mesh
error; it changes the approach by a/L.

Mesh resolution.  The pressure vanishes at the edge like a square root, with a vertical tangent.  Nodal pressures cannot
resolve it in the last cell: their mean square error is of order h, and a radius computed from the area of the nodes in
contact is uncertain by a cell.  Integrals of the pressure are better: the displacement error is of order h in the
energy norm, that of linear functionals of order h^2.  One of these is the mean square distance from the centre, 2 a^2/5
in theory, which gives a second radius.  Errors are root mean squares over twelve loads, since the edge's position in a
cell varies.

The constant of h^2.  A node represents its hat function, over which the mean of r^2 exceeds its value at the node by
h^2/3. So the pressure at the centre is smaller by p0 (h/a)^2/6, the gap r^2/2R larger by (h/a)^2/6 of the approach, and
the mean square distance of nodal forces is larger by h^2/3, which is 5/12 (h/a)^2 of the second radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material
from coulomb.fem.geometry import Sphere
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .table import Curve, Panel, Verified, absolute, at_least, order

STEEL = Material(young=2.1e11, poisson=0.3)
RADIUS, A = 0.1, 1e-3
"""Radius of the sphere, and intended contact radius; metres."""

WIDTH = 16.0 * A
UNIFORM = 4.0 / 3.0 * A
"""Half width of the block, and of its part with uniform cells."""

LOADS = tuple((0.84 + 0.03 * k) ** 2 for k in range(12))
"""Displacements of the sphere over a^2/R: the edge of the contact moves by a cell of the coarsest mesh, a/3."""


@dataclass(frozen=True)
class Hertz:
    """The formulas for a force P in newtons; of two spheres 1/R is the sum of their curvatures.

    The other body is rigid by default.
    """

    P: float
    R: float
    material: Material
    other: Material | None = None

    @property
    def materials(self) -> tuple[Material, ...]:
        return (self.material,) if self.other is None else (self.material, self.other)

    @property
    def E_star(self) -> float:
        return 1.0 / sum((1.0 - material.poisson**2) / material.young for material in self.materials)

    @property
    def a(self) -> float:
        return float(np.cbrt(0.75 * self.P * self.R / self.E_star))

    @property
    def p0(self) -> float:
        return 1.5 * self.P / (math.pi * self.a**2)

    @property
    def approach(self) -> float:
        return self.a**2 / self.R

    def pressure(self, r: FloatArray) -> FloatArray:
        """At the distances r (k,) from the centre, shape (k,)."""
        pressure: FloatArray = self.p0 * np.sqrt(np.maximum(1.0 - (r / self.a) ** 2, 0.0))
        return pressure


def half_space(
    material: Material, P: float, sign: float = 1.0, shift: float = 0.0
) -> Callable[[FloatArray], FloatArray]:
    """Displacement of the half space sign z > 0, P along sign z at the origin (Boussinesq), and a shift along z."""
    nu = material.poisson
    unit = P * (1.0 + nu) / (2.0 * math.pi * material.young)

    def value(x: FloatArray) -> FloatArray:
        z = np.abs(x[2])
        s = np.sqrt(x[0] ** 2 + x[1] ** 2 + z**2)
        across = unit * (z / s**3 - (1.0 - 2.0 * nu) / (s * (s + z)))
        down = unit * (z**2 / s**3 + 2.0 * (1.0 - nu) / s)
        return np.stack([across * x[0], across * x[1], sign * down + shift])

    return value


def grading(uniform: int, cells: int, width: float) -> Callable[[FloatArray], FloatArray]:
    """Start of the k-th of `cells` cells from the centre: the first `uniform` fill UNIFORM, the others grow."""
    outer = width - UNIFORM * cells / uniform

    def place(k: FloatArray) -> FloatArray:
        beyond: FloatArray = np.maximum(np.abs(k) - uniform, 0.0) / (cells - uniform)
        side: FloatArray = np.sign(k)
        where: FloatArray = side * (UNIFORM * np.abs(k) / uniform + outer * beyond**3)
        return where

    return place


def problem(uniform: int, width: float = WIDTH) -> ContactProblem:
    """A quarter of the block above the sphere; at time t, the sphere has moved by t a^2/R."""
    cells = 2 * uniform + (uniform // 2 if width > WIDTH else 0)
    place = grading(uniform, cells, width)
    return ContactProblem(
        box((cells, cells, cells), (cells, cells, cells), place=place),
        STEEL,
        [Clamp("left", "x"), Clamp("front", "y"), Clamp("top", "z")],
        Contact(
            "bottom",
            friction=0.0,
            foundation=Sphere((0.0, 0.0, -RADIUS), RADIUS),
            motion=lambda time: (0.0, 0.0, time * A**2 / RADIUS),
        ),
    )


@dataclass(frozen=True)
class Pressed:
    """One answer, and the formulas for the force of the whole sphere.

    Attributes:
        r: Distances of the contact nodes from the centre, shape (m,).
        profile: Error of the pressure in the mean square over the face, over the mean square of the formula.
        centre: Pressure at the centre.
        by_area: Radius of a circle with the area of the nodes in contact.
        by_moment: Radius from the mean square distance, weighted by the nodal forces.
        travel: Displacement of the sphere.
        moment: Moment of the forces on the quarter about the sphere's centre, over P a.
    """

    theory: Hertz
    r: FloatArray
    pressure: FloatArray
    profile: float
    centre: float
    by_area: float
    by_moment: float
    travel: float
    moment: float


def pressed(solution: Solution) -> Pressed:
    """The measures of a solution of the quarter."""
    surface, force = solution.problem.surface, solution.contact_force[0::3]
    theory = Hertz(4.0 * float(force.sum()), RADIUS, STEEL)
    r, pressure = np.hypot(surface.x[:, 0], surface.x[:, 1]), force / surface.area
    known, total = theory.pressure(r), solution.at_nodes.totals()
    centre = solution.problem.motions[0] - [0.0, 0.0, RADIUS]
    moment = np.array(total["moment"]) - np.cross(centre, total["force"])
    return Pressed(
        theory,
        r,
        pressure,
        profile=math.sqrt(surface.area @ (pressure - known) ** 2 / (surface.area @ known**2)),
        centre=float(pressure[np.argmin(r)]),
        by_area=math.sqrt(4.0 * total["contact_area"] / math.pi),
        by_moment=math.sqrt(2.5 * (force @ r**2) / force.sum()),
        travel=float(solution.problem.motions[0, 2]),
        moment=float(np.linalg.norm(moment)) / (theory.P * theory.a),
    )


def verify(meshes: tuple[int, ...] = (4, 6, 8)) -> Verified:
    """Results on several meshes, given by their cells in 4 a/3, and on one of them in a block twice as large."""
    found = {uniform: _series(problem(uniform)) for uniform in meshes}
    h = np.array([UNIFORM / A / uniform for uniform in meshes])
    profile = _rms([[answer.profile for answer in answers] for answers in found.values()])
    by_area = _rms([[answer.by_area / answer.theory.a - 1.0 for answer in answers] for answers in found.values()])
    by_moment = _rms([[answer.by_moment / answer.theory.a - 1.0 for answer in answers] for answers in found.values()])
    centre = _rms([[answer.centre / answer.theory.p0 - 1.0 for answer in answers] for answers in found.values()])
    fine, size = found[meshes[-1]][5], float(h[-1])
    middle = meshes[len(meshes) // 2]
    small = _too_near(found[middle])
    large = _too_near(_series(problem(middle, 2.0 * WIDTH)))
    coarse = UNIFORM / A / middle
    edge = f"h/a = {size:.3g}: the last cell cannot resolve the vertical tangent at the edge"
    node = f"(h/a)^2/6 = {size**2 / 6.0:.2g}: a node represents the mean of the pressure over its hat function"
    second = f"5/12 (h/a)^2 = {size**2 * 5.0 / 12.0:.2g}: a node's force represents the pressure over its hat function"
    orders = "1 from the edge, more from smooth parts; the mean square of twelve loads is uncertain by 0.1 to 0.2"
    rows = (
        absolute("pressure at the centre, error over p0", 0.0, float(centre[-1]), size**2 / 6.0, node),
        absolute("pressure profile, root mean square error", 0.0, float(profile[-1]), size, edge),
        absolute("contact radius by area, error over a", 0.0, float(by_area[-1]), size, edge),
        absolute(
            "contact radius by second moment, error over a", 0.0, float(by_moment[-1]), size**2 * 5.0 / 12.0, second
        ),
        at_least("order of the pressure profile", 1.0, order(h, profile), 0.25, orders),
        at_least("order of the radius by area", 1.0, order(h, by_area), 0.25, orders),
        absolute(
            "order of the radius by second moment",
            2.0,
            order(h, by_moment),
            0.5,
            "2 for a linear functional; uncertain as the others, over meshes that differ by a factor of 2",
        ),
        absolute(
            "moment about the sphere's centre, over P a",
            0.0,
            fine.moment,
            float(np.finfo(float).eps) * RADIUS / A,
            "forces along the normals of a sphere pass through its centre, on any mesh: rounding, 2e-16 R/a",
        ),
        absolute(
            "approach: (displacement of the sphere)/(a^2/R) - 1", 0.0, small, _held_face(WIDTH) + coarse**2 / 6.0, _HELD
        ),
        absolute("the same in a block twice as large", 0.0, large, _held_face(2.0 * WIDTH) + coarse**2 / 6.0, _HELD),
        absolute(
            "the same extrapolated to an infinite block",
            0.0,
            2.0 * large - small,
            coarse**2 / 6.0,
            f"(h/a)^2/6 = {coarse**2 / 6.0:.2g}: the mean gap of a node; the remaining effect of the block is (a/L)^2",
        ),
    )
    return Verified(rows, _panels(fine, h, profile, by_area, by_moment))


_HELD = (
    "the half space continues behind the held face: its displacement there, under a point load; and (h/a)^2/6, the "
    "mean gap of a node"
)


def _held_face(width: float) -> float:
    """Displacement of the half space at the depth of the held face, over the approach; Boussinesq's P at the origin.

    u_z = P (1 + nu)(3 - 2 nu)/(2 pi E L) and P = 4 E* a^3/(3 R).
    """
    nu = STEEL.poisson
    return 4.0 / 3.0 * A / width * (3.0 - 2.0 * nu) / (2.0 * math.pi * (1.0 - nu))


def _series(block: ContactProblem) -> list[Pressed]:
    return [pressed(block.at(time).solve()) for time in LOADS]


def _rms(errors: list[list[float]]) -> FloatArray:
    """Root mean square over the loads, per mesh."""
    mean: FloatArray = np.sqrt(np.mean(np.square(errors), axis=1))
    return mean


def _too_near(answers: list[Pressed]) -> float:
    return float(np.mean([answer.travel / answer.theory.approach - 1.0 for answer in answers]))


def _panels(
    fine: Pressed, h: FloatArray, profile: FloatArray, by_area: FloatArray, by_moment: FloatArray
) -> tuple[Panel, ...]:
    r = np.linspace(0.0, 1.4 * fine.theory.a, 400)
    near = fine.r < r[-1]
    return (
        Panel(
            f"pressure, h = {h[-1]:.2g} a",
            "r, mm",
            "pressure, MPa",
            (
                Curve("Hertz", 1e3 * r, fine.theory.pressure(r) / 1e6, formula=True),
                Curve("coulomb", 1e3 * fine.r[near], fine.pressure[near] / 1e6),
            ),
        ),
        Panel(
            "errors on three meshes",
            "h / a",
            "relative error",
            (
                Curve("order 1", h, profile[0] * h / h[0], formula=True),
                Curve("order 2", h, by_moment[0] * (h / h[0]) ** 2, formula=True),
                Curve("pressure profile", h, profile),
                Curve("radius by area", h, by_area),
                Curve("radius by second moment", h, by_moment),
            ),
            logarithmic=True,
        ),
    )
