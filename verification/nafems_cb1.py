"""NAFEMS CB1: a steel roller pressed on an aluminium block, plane strain.

A. W. A. Konter, Advanced Finite Element Contact Benchmarks, NAFEMS 2006, benchmark 1: radius 50 mm, block 200 x 200 mm,
fixed below, E = 210 and 70 GPa, nu = 0.3, 35 kN per mm of thickness.  The reference is Hertz's line contact,

    half width a = sqrt(4 P R/(pi E*)) = 6.21 mm,   p = p0 sqrt(1 - x^2/a^2),   p0 = sqrt(P E*/(pi R)) = 3585 N/mm^2,

1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2.  Half of it, right of the plane of symmetry, one layer of cells with plane
strain.  The lower half of the roller, with a small hole at its centre so that cells are quadrilaterals; its load is a
uniform force on the plane through the axis.  Friction is 0, as the formula needs it.

Strains are not small, p0/E* = 6 %: displacement gradients exceed the limits of the theory, and `small_strain` is
"warn".  The problem of this theory has an answer all the same, which is compared.

Tolerances.  The roller is a circle, the formula has a parabola: (a/R)^2 = 1.5 % of the curvature at the edge, a third
of it in the mean.  Nodes represent the pressure over their hat functions: (h/a)^2/6 for the pressure at the centre.
"""

from __future__ import annotations

import math

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, Support, SymmetryPlane, TotalForce, join
from coulomb.fem.meshes import NamedMesh, box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .array_mesh import between, graded
from .press_fit import along_x
from .table import Curve, Panel, Verified, relative

STEEL, ALUMINIUM = Material(young=2.1e11, poisson=0.3), Material(young=7e10, poisson=0.3)
RADIUS, HOLE, WIDTH, HEIGHT, THICKNESS = 0.05, 0.005, 0.1, 0.2, 1e-3
"""Of the roller, its hole, half of the block, and the layer; metres."""

FORCE = 35e6
"""Newtons per metre of thickness."""

UNIFORM = 0.009
"""Part of the contact faces with uniform cells, metres."""

CELLS = (18, 15)
"""Cells in it, of the roller and the block."""

E_STAR = 1.0 / sum((1.0 - material.poisson**2) / material.young for material in (STEEL, ALUMINIUM))
HALF_WIDTH = math.sqrt(4.0 * FORCE * RADIUS / (math.pi * E_STAR))
LARGEST = math.sqrt(FORCE * E_STAR / (math.pi * RADIUS))


def roller(cells: int) -> NamedMesh:
    """The right lower quarter, its lowest point at the origin: faces left (x = 0), right (z = R), bottom (the rim)."""
    h = UNIFORM / cells
    around, deep = graded(h / RADIUS, cells, 0.5 * math.pi, cells), graded(h, 4, RADIUS - HOLE, cells)

    def place(k: FloatArray) -> FloatArray:
        angle, r = between(around, k[0]), RADIUS - between(deep, k[2])
        return np.stack([r * np.sin(angle), THICKNESS * k[1], RADIUS - r * np.cos(angle)])

    size = (len(around) - 1, 1, len(deep) - 1)
    return box(size, size, place=place)


def block(cells: int) -> NamedMesh:
    """The right half of the block below z = 0."""
    h = UNIFORM / cells
    across, deep = graded(h, cells, WIDTH, cells), graded(h, 4, HEIGHT, cells + 2)

    def place(k: FloatArray) -> FloatArray:
        return np.stack([between(across, k[0]), THICKNESS * k[1], -between(deep, len(deep) - 1.0 - k[2])])

    size = (len(across) - 1, 1, len(deep) - 1)
    return box(size, size, place=place)


def problem(cells: tuple[int, int]) -> ContactProblem:
    """Half of the roller on half of the block; nothing but contact holds the roller up."""
    supports: list[Support] = [SymmetryPlane("roller:left"), SymmetryPlane("block:left"), Clamp("block:bottom")]
    supports += [Clamp(f"{body}:{face}", "y") for body in ("roller", "block") for face in ("front", "back")]
    return ContactProblem(
        join(roller=roller(cells[0]), block=block(cells[1])),
        {"roller": STEEL, "block": ALUMINIUM},
        supports,
        Contact("roller:bottom", against="block:top", friction=0.0),
        [TotalForce("roller:right", (0.0, 0.0, -0.5 * FORCE * THICKNESS))],
        small_strain="warn",
    )


def verify(cells: tuple[int, int] = CELLS) -> Verified:
    """Half width and largest pressure."""
    solution = problem(cells).solve()
    surface, force = solution.problem.surface, solution.contact_force[0::3]
    x, pressure = along_x(solution)
    half = 2.0 * math.sqrt(force @ surface.x[:, 0] ** 2 / force.sum())
    h, circle = UNIFORM / min(cells) / HALF_WIDTH, (HALF_WIDTH / RADIUS) ** 2
    round_ = f"(a/R)^2 = {circle:.1%}: the roller is a circle; "
    rows = (
        relative(
            "half width from the second moment of the pressure, m",
            HALF_WIDTH,
            half,
            circle + h**2 / 3.0,
            round_ + f"(h/a)^2/3 = {h**2 / 3.0:.1g}: hat functions",
        ),
        relative(
            "largest pressure, Pa",
            LARGEST,
            float(pressure.max()),
            circle + h**2 / 6.0,
            round_ + f"(h/a)^2/6 = {h**2 / 6.0:.1g}: hat functions",
        ),
        relative(
            "force per thickness, N/m",
            FORCE,
            2.0 * abs(float(force @ surface.frames[:, 0, 2])) / THICKNESS,
            1e-8,
            "equilibrium of the roller, which only contact holds: the residual",
        ),
    )
    line_x = np.linspace(0.0, 1.3 * HALF_WIDTH, 300)
    known = LARGEST * np.sqrt(np.maximum(1.0 - (line_x / HALF_WIDTH) ** 2, 0.0))
    near = x < line_x[-1]
    panel = Panel(
        "NAFEMS CB1",
        "x, mm",
        "pressure, N/mm^2",
        (
            Curve("Hertz", 1e3 * line_x, known / 1e6, formula=True),
            Curve("coulomb", 1e3 * x[near], pressure[near] / 1e6),
        ),
    )
    return Verified(rows, (panel,))
