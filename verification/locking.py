"""Bending, and rubber: where linear tetrahedra are too stiff and second order is right.

A cantilever of length L, clamped at x = 0, bends under a pressure on its top until its end rests on a plane at the
distance g.  By Timoshenko's beam theory (shear coefficient 5/6, nu = 0) the force R of the plane at x = c is

    R = (w(c) - g) / (c^3/(3 E I) + c/(5/6 G A)),
    w(c) = q (c^4 - 4 c^3 L + 6 c^2 L^2)/(24 E I) + q (L c - c^2/2)/(5/6 G A)

The gap is half of w(L): a beam that is twice too stiff does not even touch.  The force is a line load near the end;
c is the computed centre of pressure, which is in the last element.

A strip of rubber (nu = 0.499) of thickness t and half width b is bonded to a plate, which presses it by d onto a smooth
plane: half of a strip of thickness 2 t between two plates.  For b much larger than t the force per length on half of it
is, with the bulk modulus K and the shear modulus G (Kelly 1997, compressible pad, plane strain),

    F = b K (d/t) (1 - tanh(a b)/(a b)),    a = sqrt(12 G/K)/(2 t)

It leaves out the free edge, where the pressure goes to zero over a thickness: here 2.4 % (second order, 9000 unknowns).
"""

from __future__ import annotations

import math

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, PrescribedDisplacement, Pressure, Support, SymmetryPlane
from coulomb.fem.geometry import Plane
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .array_mesh import between
from .table import Curve, Panel, Row, Verified, absolute, relative

LENGTH, HEIGHT, YOUNG, PRESSURE = 1.0, 0.1, 2e11, 1e5
SECTION = HEIGHT**4 / 12.0
SHEAR = 5.0 / 6.0 * 0.5 * YOUNG * HEIGHT**2
BEAM = {1: (20, 2, 2), 2: (10, 1, 1)}
"""Cells by order: both have 540 unknowns."""

WIDTH, THICKNESS, DEPTH, RUBBER = 0.1, 0.01, 1e-5, Material(1e6, 0.499)
PAD = {1: (28, 1, 5), 2: (10, 1, 2)}
"""Cells by order: about 570 unknowns."""

FINE = (40, 1, 8)


def _deflection(x: float) -> float:
    q, L = PRESSURE * HEIGHT, LENGTH
    bending = q * (x**4 - 4.0 * x**3 * L + 6.0 * x**2 * L**2) / (24.0 * YOUNG * SECTION)
    return bending + q * (L * x - 0.5 * x**2) / SHEAR


GAP = 0.5 * _deflection(LENGTH)


def _reaction(c: float) -> float:
    return (_deflection(c) - GAP) / (c**3 / (3.0 * YOUNG * SECTION) + c / SHEAR)


def cantilever(cell: str, degree: int) -> tuple[float, float, int]:
    """Force of the plane in newtons, its centre of pressure in metres, and the number of unknowns."""
    problem = ContactProblem(
        box((LENGTH, HEIGHT, HEIGHT), BEAM[degree], cell, degree=degree),
        Material(YOUNG, 0.0),
        [Clamp("left")],
        Contact("bottom", 0.0, foundation=Plane((0.0, 0.0, -GAP), (0.0, 0.0, 1.0))),
        [Pressure("top", PRESSURE)],
    )
    totals = problem.solve().at_nodes.totals()
    return totals["normal_force"], totals["centre_of_pressure"][0], problem.unknowns["displacement"]


def pad(cell: str, degree: int, cells: tuple[int, int, int]) -> tuple[float, int, FloatArray, FloatArray]:
    """Force on half of the strip in N/m, number of unknowns, places in metres and pressures in pascals."""
    lines = WIDTH * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, cells[0] + 1))  # finer towards the free edge

    def place(x: FloatArray) -> FloatArray:
        return np.stack([between(lines, x[0]), x[1], x[2]])

    walls: list[Support] = [SymmetryPlane("left"), Clamp("front", "y"), Clamp("back", "y")]
    problem = ContactProblem(
        box((cells[0], THICKNESS, THICKNESS), cells, cell, degree=degree, place=place),
        RUBBER,
        [*walls, PrescribedDisplacement("top", (0.0, 0.0, -DEPTH))],
        Contact("bottom", 0.0),
    )
    solution = problem.solve()
    pressure = solution.contact_force[0::3] / problem.surface.area
    force = solution.at_nodes.totals()["normal_force"] / THICKNESS
    return force, problem.unknowns["displacement"], problem.surface.x[:, 0], pressure


def _strip() -> float:
    bulk = RUBBER.young / (3.0 * (1.0 - 2.0 * RUBBER.poisson))
    shear = RUBBER.young / (2.0 * (1.0 + RUBBER.poisson))
    ab = math.sqrt(12.0 * shear / bulk) / (2.0 * THICKNESS) * WIDTH
    return WIDTH * bulk * DEPTH / THICKNESS * (1.0 - math.tanh(ab) / ab)


def verify() -> Verified:
    """Forces of the cantilever's support and of the strip, by linear tetrahedra and by second order."""
    rows: list[Row] = []
    theory = "1 %: the clamped end and the line load are three-dimensional"
    for cell in ("tetrahedron", "hexahedron"):
        force, centre, unknowns = cantilever(cell, 2)
        what = f"cantilever, second-order {cell}, {unknowns} unknowns: force of the support, N"
        rows.append(relative(what, _reaction(centre), force, 0.01, theory))
        rows.append(
            absolute("its centre of pressure, m", LENGTH, centre, LENGTH / BEAM[2][0] / 2.0, "inside the last element")
        )
    force, centre, unknowns = cantilever("tetrahedron", 1)
    rows.append(_too_stiff(f"cantilever, linear tetrahedra, {unknowns} unknowns", _reaction(centre), force, -0.7))

    known, (fine, _, x, pressure) = _strip(), pad("hexahedron", 2, FINE)
    rows.append(relative("rubber strip, second order, fine: force, N/m", known, fine, 0.03, "3 %: the free edge"))
    found = {}
    for cell in ("tetrahedron", "hexahedron"):
        force, unknowns, *found[cell] = pad(cell, 2, PAD[2])
        what = f"rubber strip, second-order {cell}, {unknowns} unknowns: force, N/m"
        rows.append(relative(what, fine, force, 0.02, "2 %: coarse mesh, against the fine one"))
    force, unknowns, *linear = pad("tetrahedron", 1, PAD[1])
    rows.append(_too_stiff(f"rubber strip, linear tetrahedra, {unknowns} unknowns", fine, force, 0.1))
    force, unknowns, *bricks = pad("hexahedron", 1, PAD[1])
    what = f"rubber strip, linear hexahedra with mean dilatations, {unknowns} unknowns: force, N/m"
    rows.append(relative(what, fine, force, 0.02, "2 %: coarse mesh, against the fine one"))
    panel = Panel(
        "rubber strip, nu = 0.499",
        "x, mm",
        "contact pressure, Pa",
        (
            Curve("second order, 9000 unknowns", 1e3 * x, pressure, formula=True, line=False),
            Curve("linear tetrahedra", 1e3 * linear[0], linear[1]),
            Curve("linear hexahedra", 1e3 * bricks[0], bricks[1]),
            *(Curve(f"second-order {cell}", 1e3 * at, p) for cell, (at, p) in found.items()),
        ),
    )
    return Verified(tuple(rows), (panel,))


def _too_stiff(what: str, known: float, force: float, least: float) -> Row:
    """A row that passes where the relative error is beyond `least`, with its sign."""
    error = force / known - 1.0
    missing = max(0.0, (least - error) * math.copysign(1.0, least))
    return Row(
        f"{what}: relative error of the force, at least", least, error, missing, 0.0, "locking of these elements"
    )
