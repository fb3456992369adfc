"""SSNP121 of code_aster (V6.03.121): two like blocks with different meshes, one pressed on the other, without friction.

E = 2e6 Pa, nu = 0, plane strain as one layer of cells.  The lower block is held below; the top of the upper one goes
down by 0.1 m, and each is compressed by half of it:

    p = E 0.05/1 = 1e5 Pa,   u = -0.05 m on the contact face

The same with the pressure 1e5 Pa on the top (the original's model P), where only contact holds the upper block up.

It is a patch test, exact for all elements; the original asks for 1 %.  Strains are not small, 5 %: the problem of this
theory has an answer all the same, and `small_strain` is "warn".
"""

from __future__ import annotations

import numpy as np

from coulomb.fem.bodies import Clamp, Load, Material, PrescribedDisplacement, Support, Traction, join
from coulomb.fem.meshes import box, moved
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .table import Curve, Panel, Row, Verified, worst

MATERIAL = Material(young=2e6, poisson=0.0)
HEIGHT, WIDTH, THICKNESS = 1.0, 1.0, 0.25
PRESSURE, DISPLACEMENT = 1e5, -0.05
CELLS = {"lower": (4, 1, 4), "upper": (7, 1, 5)}

Kind = tuple[str, int]
"""Cells and order."""

MODELS: dict[str, tuple[Kind, Kind]] = {
    "hexahedra": (("hexahedron", 1), ("hexahedron", 1)),
    "hexahedra, second order on first": (("hexahedron", 1), ("hexahedron", 2)),
    "hexahedra of second order": (("hexahedron", 2), ("hexahedron", 2)),
    "tetrahedra of second order": (("tetrahedron", 2), ("tetrahedron", 2)),
    "tetrahedra on hexahedra of second order": (("hexahedron", 2), ("tetrahedron", 2)),
}
"""Kinds of the lower and the upper block, as in the original's models A, H, Q, R and F."""

PRESSED = ("hexahedra", "tetrahedra on hexahedra of second order")
"""The models that are also loaded by the pressure."""


def problem(kinds: tuple[Kind, Kind], by_pressure: bool = False) -> ContactProblem:
    """Both blocks, the upper one pressed down by a displacement or by a pressure on its top."""
    lower, upper = (
        box((WIDTH, THICKNESS, HEIGHT), CELLS[name], cell, degree=degree)
        for name, (cell, degree) in zip(CELLS, kinds, strict=True)
    )
    supports: list[Support] = [Clamp("lower:bottom")]
    supports += [Clamp(f"{name}:{face}", "y") for name in CELLS for face in ("front", "back")]
    loads: list[Load] = []
    if by_pressure:
        supports.append(Clamp("upper:top", "x"))
        loads.append(Traction("upper:top", (0.0, 0.0, -PRESSURE)))
    else:
        supports.append(PrescribedDisplacement("upper:top", (0.0, 0.0, 2.0 * DISPLACEMENT)))
    return ContactProblem(
        join(lower=lower, upper=moved(upper, translate=(0.0, 0.0, HEIGHT))),
        MATERIAL,
        supports,
        Contact("upper:bottom", 0.0, against="lower:top"),
        loads,
        small_strain="warn",
    )


def verify() -> Verified:
    """Pressure and displacement of every model at the worst node."""
    rows: list[Row] = []
    curves: list[Curve] = []
    why = "exact: the residual 1e-10, amplified by the condition of A"
    for name, kinds in MODELS.items():
        for by_pressure in (False, True) if name in PRESSED else (False,):
            solution = problem(kinds, by_pressure).solve(1e-10)
            surface, bodies = solution.problem.surface, solution.problem.elasticity
            pressure = solution.contact_force[0::3] / surface.area
            down = solution.displacement[bodies.nodes("lower:top", "contact"), 2]
            how = f"{name}, by {'pressure' if by_pressure else 'displacement'}"
            for what, known, ours in (("p, Pa", PRESSURE, pressure), ("u_z, m", DISPLACEMENT, down)):
                rows.append(worst(f"{how}: {what}, worst node", known, ours, 1e-8, why))
        curves.append(Curve(name, surface.x[:, 0], pressure / PRESSURE, line=False))
    exact = Curve("exact", np.array([0.0, WIDTH]), np.ones(2), formula=True)
    return Verified(tuple(rows), (Panel("SSNP121", "x, m", "pressure over 1e5 Pa", (exact, *curves)),))
