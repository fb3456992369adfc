"""Hertz for two elastic bodies: spheres of different materials, a sphere on a half space, crossed cylinders.

K. L. Johnson, Contact Mechanics, 4.1 and 4.2.  The gap is x^2/(2 Rx) + y^2/(2 Ry) with the curvatures of both bodies
summed, and 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2.  For Rx = Ry = R the contact is a circle of radius a,

    a^3 = 3 P R/(4 E*),   p = p0 sqrt(1 - r^2/a^2),   p0 = 3 P/(2 pi a^2),   approach a^2/R;

otherwise an ellipse with the half axes a > b, its eccentricity e^2 = 1 - b^2/a^2, and with the complete elliptic
integrals K(e), E(e)

    R'/R'' = (a^2/b^2 E - K)/(K - E),   p = p0 sqrt(1 - x^2/a^2 - y^2/b^2),   p0 = 3 P/(2 pi a b),
    1/(2 R') = p0 b/(E* e^2 a^2) (K - E),   approach p0 b K/E*;     R' along a, R'' along b.

A quarter of both bodies, graded and not matching, the upper one finer.  The far sides of both have the displacement of
a half space under the point force P of the formula (Boussinesq), the upper ones also the approach: at 5 a, where an
ellipse or circle of pressure differs from a point force by 1/5 (a/5a)^2 = 0.8 %, of displacements that are at most 8 %
of the approach.

Tolerances are those of `hertz`: a node represents the pressure over its hat function, which lowers that of the inner
half by (h/a)^2/6 of p0, and makes a half axis from the second moment larger by 5/12 (h/a)^2.  Chords of the coarser
mesh, with cells of the size H, add (H/a)^2/6 of the approach to the gap, and pressure moves towards its corners, which
stand out: the pressure of a single node is uncertain by more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, PrescribedDisplacement, Support, join
from coulomb.fem.geometry import Sphere
from coulomb.fem.meshes import NamedMesh, box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .array_mesh import between, graded, growing
from .hertz import half_space
from .table import Curve, Panel, Row, Verified, absolute

STEEL, ALUMINIUM = Material(young=2.1e11, poisson=0.3), Material(young=7e10, poisson=0.33)
BRONZE = Material(young=1.1e11, poisson=0.34)

A = 1e-3
"""Intended larger half axis of the contact, metres."""

WIDTH, UNIFORM = 5.0, 1.2
"""Edges of the quarters over the larger half axis, and of their uniform parts over the half axis along the edge."""

LOADS = (0.92, 1.0, 1.06)
"""Half axes over the intended ones: errors are root mean squares over them, since the edge's place in a cell varies."""


@dataclass(frozen=True)
class Pair:
    """Two bodies: radii along x and y (inf where flat), upper and lower, and their materials, upper and lower."""

    name: str
    upper: tuple[float, float]
    lower: tuple[float, float]
    materials: tuple[Material, Material]

    @property
    def radii(self) -> tuple[float, float]:
        """Rx, Ry of the gap."""
        x, y = (1.0 / (1.0 / one + 1.0 / other) for one, other in zip(self.upper, self.lower, strict=True))
        return x, y

    @property
    def E_star(self) -> float:
        return 1.0 / sum((1.0 - material.poisson**2) / material.young for material in self.materials)


@dataclass(frozen=True)
class Ellipse:
    """The formulas for a pair and the half axis along x in metres."""

    pair: Pair
    half_x: float

    @property
    def aspect(self) -> float:
        """Half axis along y over that along x; of the gap x^2/(2 Rx) + y^2/(2 Ry) alone."""
        Rx, Ry = self.pair.radii
        return _aspect(Rx / Ry) if Rx > Ry else 1.0 / _aspect(Ry / Rx)

    @property
    def half_y(self) -> float:
        return self.half_x * self.aspect

    @property
    def p0(self) -> float:
        """Pressure at the centre."""
        a, b = max(self.half_x, self.half_y), min(self.half_x, self.half_y)
        e2, R = 1.0 - (b / a) ** 2, max(self.pair.radii)
        shape = 0.25 * math.pi if e2 < _ROUND else float(ellipk(e2) - ellipe(e2)) / e2  # limit for a circle
        return 0.5 / R * self.pair.E_star * a**2 / (b * shape)

    @property
    def P(self) -> float:
        return 2.0 / 3.0 * math.pi * self.half_x * self.half_y * self.p0

    @property
    def approach(self) -> float:
        a, b = max(self.half_x, self.half_y), min(self.half_x, self.half_y)
        return self.p0 * b * float(ellipk(1.0 - (b / a) ** 2)) / self.pair.E_star

    def pressure(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """At the points x, y (k,), shape (k,)."""
        inside = np.maximum(1.0 - (x / self.half_x) ** 2 - (y / self.half_y) ** 2, 0.0)
        pressure: FloatArray = self.p0 * np.sqrt(inside)
        return pressure


_ROUND = 1e-6
"""Square of the eccentricity below which an ellipse is a circle to rounding errors of K - E."""


def _aspect(ratio: float) -> float:
    """b/a for R'/R'' >= 1."""
    if ratio - 1.0 < _ROUND:
        return 1.0

    def off(b: float) -> float:
        K, E = float(ellipk(1.0 - b**2)), float(ellipe(1.0 - b**2))
        return (E / b**2 - K) / (K - E) - ratio

    return float(brentq(off, 1e-3, 1.0 - 1e-7, xtol=1e-14))


SPHERES = Pair("spheres", (0.25, 0.25), (1.0 / 6.0, 1.0 / 6.0), (STEEL, ALUMINIUM))
HALF_SPACE = Pair("sphere on half space", (0.08, 0.08), (math.inf, math.inf), (BRONZE, STEEL))
CYLINDERS = Pair("crossed cylinders", (math.inf, 0.05), (0.1, math.inf), (ALUMINIUM, STEEL))


def quarter(ellipse: Ellipse, n: int, upper: bool, cell: str = "hexahedron", degree: int = 1) -> NamedMesh:
    """The quarter x, y > 0 of a body, with n cells in 1.2 half axes; z > 0 or z < 0 and its contact face at 0."""
    n //= degree
    far = WIDTH * A * max(1.0, ellipse.aspect)  # of the intended ellipse, for all loads
    lines = [graded(UNIFORM * half / n, n, far, n // 2 + 2, 1.4) for half in (A, A * ellipse.aspect)]
    first = UNIFORM * A * min(1.0, ellipse.aspect) / n
    down = np.concatenate([[0.0], growing(first, far, n + 2)])
    count, deep = len(lines[0]) - 1, len(down) - 1
    Rx, Ry = ellipse.pair.upper if upper else ellipse.pair.lower

    def place(k: FloatArray) -> FloatArray:
        x, y, depth = between(lines[0], k[0]), between(lines[1], k[1]), between(down, k[2] if upper else deep - k[2])
        height = depth + (1.0 - depth / far) * _rise(x, y, Rx, Ry)
        return np.stack([x, y, height if upper else -height])

    return box((count, count, deep), (count, count, deep), cell, place=place, degree=degree)


def _rise(x: FloatArray, y: FloatArray, Rx: float, Ry: float) -> FloatArray:
    """Distance of a sphere, a cylinder or a plane from its tangent plane at the centre."""
    inside = (x / Rx) ** 2 + (y / Ry) ** 2  # radii are equal, or one of them is infinite
    R = min(Rx, Ry)
    rise: FloatArray = np.zeros_like(x) if math.isinf(R) else R * (1.0 - np.sqrt(1.0 - inside))
    return rise


def problem(
    ellipse: Ellipse,
    cells: tuple[int, int],
    lower_kind: tuple[str, int],
    upper_kind: tuple[str, int] = ("hexahedron", 1),
    approached: float = 1.0,
    named: bool = False,
) -> ContactProblem:
    """Quarters of both bodies that approach each other by so much of the approach of the ellipse.

    `cells` in 1.2 half axes, of the upper and the lower body; `named` if the spheres for which facets stand are.
    """
    (upper, lower), P = ellipse.pair.materials, approached * ellipse.P
    bodies = {
        "upper": quarter(ellipse, cells[0], True, *upper_kind),
        "lower": quarter(ellipse, cells[1], False, *lower_kind),
    }
    far = {
        "upper": half_space(upper, P, 1.0, -approached * ellipse.approach),
        "lower": half_space(lower, P, -1.0, 0.0),
    }
    supports: list[Support] = []
    for name, end in (("upper", "top"), ("lower", "bottom")):
        supports += [Clamp(f"{name}:left", "x"), Clamp(f"{name}:front", "y")]
        supports += [PrescribedDisplacement(f"{name}:{face}", far[name]) for face in ("right", "back", end)]
    return ContactProblem(
        join(**bodies),
        {"upper": upper, "lower": lower},
        supports,
        Contact(
            "upper:bottom",
            against="lower:top",
            friction=0.0,
            surface=Sphere((0.0, 0.0, ellipse.pair.upper[0]), abs(ellipse.pair.upper[0])) if named else None,
            against_surface=Sphere((0.0, 0.0, -ellipse.pair.lower[0]), abs(ellipse.pair.lower[0])) if named else None,
        ),
    )


@dataclass(frozen=True)
class Found:
    """One answer; errors relative to the formula: force, pressure in the inner half, profile, half axes by moments."""

    x: FloatArray
    y: FloatArray
    pressure: FloatArray
    errors: FloatArray


_ERRORS = (
    "force",
    "pressure in the inner half",
    "pressure profile, mean square",
    "half axis along x",
    "half axis along y",
)


def found(
    ellipse: Ellipse,
    cells: tuple[int, int],
    lower_kind: tuple[str, int] = ("hexahedron", 1),
    upper_kind: tuple[str, int] = ("hexahedron", 1),
) -> Found:
    """Solve for the approach of the ellipse."""
    solution = problem(ellipse, cells, lower_kind, upper_kind).solve()
    surface, force = solution.problem.surface, solution.contact_force[0::3]
    x, y = surface.x[:, 0], surface.x[:, 1]
    pressure, known = force / surface.area, ellipse.pressure(x, y)
    inner = (x / ellipse.half_x) ** 2 + (y / ellipse.half_y) ** 2 < 0.25
    P = 4.0 * float(force.sum())
    ours = (
        P / ellipse.P - 1.0,
        float(force[inner].sum() / (surface.area @ np.where(inner, known, 0.0))) - 1.0,
        math.sqrt(surface.area @ (pressure - known) ** 2 / (surface.area @ known**2)),
        math.sqrt(5.0 * (force @ x**2) / force.sum()) / ellipse.half_x - 1.0,
        math.sqrt(5.0 * (force @ y**2) / force.sum()) / ellipse.half_y - 1.0,
    )
    return Found(x, y, pressure, np.array(ours))


def verify(cells: tuple[int, int] = (8, 6), loads: tuple[float, ...] = LOADS) -> Verified:
    """All three pairs, on hexahedra; the spheres also with a lower one of second-order tetrahedra."""
    rows: list[Row] = []
    panels = []
    for pair in (SPHERES, HALF_SPACE, CYLINDERS):
        answers = [found(Ellipse(pair, load * A), cells) for load in loads]
        rows += _rows(pair.name, cells, answers)
        panels.append(_panel(pair, Ellipse(pair, loads[-1] * A), answers[-1]))
    mixed = [found(Ellipse(SPHERES, load * A), cells, ("tetrahedron", 2)) for load in loads]
    rows += _rows("spheres, the lower of 10-node tetrahedra", cells, mixed)
    return Verified(tuple(rows), tuple(panels))


def _rows(name: str, cells: tuple[int, int], answers: list[Found]) -> list[Row]:
    h, H = (UNIFORM / n for n in cells)
    chords = f"(h/a)^2/6 = {h**2 / 6.0:.2g} and (H/a)^2/6 = {H**2 / 6.0:.2g}, h and H the cells of both bodies"
    moment = f"5/12 (H/a)^2 = {5.0 / 12.0 * H**2:.2g}: a node's force represents the pressure over its hat function"
    tolerances = (
        ((h**2 + H**2) / 4.0, f"{chords}, of the approach: hat functions and chords; the force grows with its 3/2"),
        ((h**2 + H**2) / 6.0, f"{chords}: hat functions, and chords of the master, to whose corners pressure moves"),
        (H, f"H/a = {H:.2g}: the last cell cannot resolve the vertical tangent at the edge"),
        (5.0 / 12.0 * H**2, moment),
        (5.0 / 12.0 * H**2, moment),
    )
    errors = np.sqrt(np.mean([answer.errors**2 for answer in answers], axis=0))
    return [
        absolute(f"{name}: {what}, error", 0.0, float(error), *allowed)
        for what, error, allowed in zip(_ERRORS, errors, tolerances, strict=True)
    ]


def _panel(pair: Pair, ellipse: Ellipse, answer: Found) -> Panel:
    curves = []
    line = np.linspace(0.0, 1.3, 300)
    for axis, half, place, across in (
        ("x", ellipse.half_x, answer.x, answer.y),
        ("y", ellipse.half_y, answer.y, answer.x),
    ):
        if axis == "y" and ellipse.aspect == 1.0:
            continue
        s = line * half
        there = (s, 0.0 * s) if axis == "x" else (0.0 * s, s)
        on = (across < 1e-9) & (place < s[-1])
        curves.append(Curve(f"Hertz, along {axis}", 1e3 * s, ellipse.pressure(*there) / 1e6, formula=True))
        curves.append(Curve(f"coulomb, along {axis}", 1e3 * place[on], answer.pressure[on] / 1e6))
    return Panel(pair.name, "distance from the centre, mm", "pressure, MPa", tuple(curves))
