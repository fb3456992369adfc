"""SSNV128 of code_aster: a square plate, pressed onto a rigid line and pushed along it from the side.

Validation manual V6.04.128, plane strain (here one layer of cells with u_y = 0): 40 x 40 mm, E = 1.3e11 Pa, nu = 0.2,
F = 1; 5e7 Pa on top, 15e7 Pa on the left, symmetry u_x = 0 on the right, the corner (40 mm, 0) held.  There is no
closed solution: the manual gives tangential displacements of the contact line and the pressure at 38.75 mm.

Supports act on faces, not edges: the corner is the end of the line, a strip of 0.01 mm whose bottom is held.

The manual prints three digits.  Second order is also compared with four digits of an independent augmented Lagrangian
solver on 32 x 32 trilinear cells.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem import compat
from coulomb.fem.bodies import Clamp, Material, Traction
from coulomb.fem.meshes import NamedMesh, box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import between
from .table import Curve, Panel, Row, Verified, relative

EDGE, SLIVER = 0.04, 1e-5
PLACES = (0.0, 1.25e-3, 5e-3, 7.5e-3, 11.25e-3)
DISPLACEMENTS = (2.86e-5, 2.72e-5, 2.28e-5, 1.98e-5, 1.50e-5)
PRESSURE_AT, PRESSURE = 38.75e-3, 8.389e7
REFERENCE = (2.859e-5, 2.722e-5, 2.285e-5, 1.980e-5, 1.541e-5)
"""Displacements of the independent solver."""

CELLS = 32
SECOND_ORDER = {"hexahedron": 16, "tetrahedron": 32}
"""Cells along an edge; pressures of tetrahedra are linear between vertices."""

REFINED = 1e-3
"""Largest relative change of our values from 32 x 32 to 64 x 64 cells: 7e-4."""

_SECOND = "0.2 %: the elements differ from the reference's by 0.1 % here, and its last digit is 0.03 %"
_PRINTED = "half a unit of the last printed digit, and the change of our values when the cells are halved, below 0.1 %"
_OTHERS = (
    "5 %, the tolerance given with the (numerical) reference values; our value changes by less than 0.1 % "
    "when the cells are halved"
)


def plate(cells: int = CELLS, cell: str = "hexahedron", degree: int = 1) -> NamedMesh:
    """So many squares along each edge, and the strip, whose bottom is the face "corner"."""
    columns = np.append(np.arange(cells) * EDGE / cells, [EDGE - SLIVER, EDGE])

    def place(x: FloatArray) -> FloatArray:
        return np.stack([between(columns, x[0]), x[1], x[2]])

    mesh = box((cells + 1.0, EDGE / cells, EDGE), (cells + 1, 1, cells), cell, place=place, degree=degree)
    corner = compat.mesh.locate_entities_boundary(
        mesh.domain, 2, lambda x: (x[0] > EDGE - 1.5 * SLIVER) & (x[2] < 1e-6 * EDGE)
    )
    return replace(mesh, faces={**mesh.faces, "corner": corner})


def problem(mesh: NamedMesh | None = None) -> ContactProblem:
    """The plate with its loads; by default of trilinear hexahedra."""
    return ContactProblem(
        mesh or plate(),
        Material(young=1.3e11, poisson=0.2),
        [Clamp("front", "y"), Clamp("back", "y"), Clamp("right", "x"), Clamp("corner", "xz")],
        Contact("bottom", friction=1.0),
        [Traction("top", (0.0, 0.0, -5e7)), Traction("left", (15e7, 0.0, 0.0))],
    )


def _tolerance(known: float, place: float) -> tuple[float, str]:
    """Tolerance of a displacement and its reason; the manual's last value is less accurate than its digits."""
    return (0.05, _OTHERS) if place == PLACES[-1] else (0.5e-7 / known + REFINED, _PRINTED)


def _line(solution: Solution) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places x of the nodes of the contact line, u_x and contact pressure there."""
    problem, surface = solution.problem, solution.problem.surface
    nodes = problem.elasticity.nodes("bottom", "contact")
    place = problem.elasticity.x[nodes]
    nodes = nodes[place[:, 1] < 1e-6 * EDGE]  # one of the lines of nodes: all have the same
    nodes = nodes[np.argsort(problem.elasticity.x[nodes, 0])]
    pressure = surface.points.spread(solution.contact_force[0::3] / surface.area)
    return problem.elasticity.x[nodes, 0], solution.displacement[nodes, 0], pressure[nodes]


def _second_order(cell: str) -> list[Row]:
    x, u, pressure = _line(problem(plate(SECOND_ORDER[cell], cell, 2)).solve())
    rows = [
        relative(
            f"second order, {cell}: u_x at x = {1e3 * place:g} mm, m",
            known,
            float(u[np.argmin(np.abs(x - place))]),
            2e-3,
            _SECOND,
        )
        for place, known in zip(PLACES, REFERENCE, strict=True)
    ]
    near = float(pressure[np.argmin(np.abs(x - PRESSURE_AT))])
    return [*rows, relative(f"second order, {cell}: pressure at x = 38.75 mm, Pa", PRESSURE, near, 2e-3, _SECOND)]


def verify() -> Verified:
    """Displacements at the five places, and the pressure near the corner."""
    x, u, pressure = _line(problem().solve())
    rows = [
        relative(
            f"u_x at x = {1e3 * place:g} mm, m",
            known,
            float(u[np.argmin(np.abs(x - place))]),
            *_tolerance(known, place),
        )
        for place, known in zip(PLACES, DISPLACEMENTS, strict=True)
    ]
    near = float(pressure[np.argmin(np.abs(x - PRESSURE_AT))])
    printed = 0.5e4 / PRESSURE
    rows.append(relative("pressure at x = 38.75 mm, Pa", PRESSURE, near, printed + REFINED, _PRINTED))
    rows += [row for cell in SECOND_ORDER for row in _second_order(cell)]
    panels = (
        Panel(
            "displacement of the contact line",
            "x, mm",
            "u_x, micrometres",
            (
                Curve(
                    "code_aster's manual",
                    1e3 * np.array(PLACES),
                    1e6 * np.array(DISPLACEMENTS),
                    formula=True,
                    line=False,
                ),
                Curve("coulomb, 32 x 32", 1e3 * x, 1e6 * u),
            ),
        ),
        Panel(
            "contact pressure",
            "x, mm",
            "pressure, MPa",
            (
                Curve(
                    "code_aster's manual",
                    np.array([1e3 * PRESSURE_AT]),
                    np.array([PRESSURE / 1e6]),
                    formula=True,
                    line=False,
                ),
                Curve("coulomb, 32 x 32", 1e3 * x, pressure / 1e6),
            ),
        ),
    )
    return Verified(tuple(rows), panels)
