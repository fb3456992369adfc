"""Orthotropic and layered bodies against formulas, on hexahedra and tetrahedra of first and second order.

A bar of unidirectional composite stands on a rigid plane without friction, and a rigid plate presses it together by d.
Its fibres, direction 1, are inclined by an angle t to its axis z, in the plane x z.  The stress is uniaxial,
-E(t) d/L, and the bar shears by a d/L (Jones, Mechanics of Composite Materials, section 2.6; c = cos t, s = sin t):

    1/E(t) = c^4/E1 + (1/G13 - 2 nu13/E1) c^2 s^2 + s^4/E3
    a/E(t) = (2/E1 + 2 nu13/E1 - 1/G13) c^3 s - (2/E3 + 2 nu13/E1 - 1/G13) c s^3

A wound tube, with the fibres around it, is pressed on a rigid pin that is too thick by d.  In plane strain the
stiffness along r and around has constants Crr, Ctt, Crt, and (Lekhnitskii, Theory of Elasticity of an Anisotropic Body)

    u = A r^k + B r^-k,   k^2 = Ctt/Crr,   s_rr = (Crr k + Crt) A r^(k - 1) + (Crt - Crr k) B r^(-k - 1)

with u(a) = d, s_rr(b) = 0.  Layers of two materials between rigid walls are pressed together by p = d/(h1/M1 + h2/M2),
M = E (1 - nu)/((1 + nu)(1 - 2 nu)).
"""

from __future__ import annotations

import math

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, OrthotropicMaterial, PrescribedDisplacement
from coulomb.fem.geometry import Cylinder
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import in_layers, quarter_ring
from .table import Curve, Panel, Row, Verified, absolute, relative, worst

YOUNG, POISSON, SHEAR = (1.3e11, 1.1e10, 9e9), (0.28, 0.3, 0.4), (5e9, 4.5e9, 3.5e9)
LENGTH, WIDTH, SHORTENED = 0.1, 0.03, 1e-4
ANGLES = (0.0, 20.0, 45.0, 90.0)
CELLS = (("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2))
EXACT = 1e-7
INNER, OUTER, TOO_THICK = 0.05, 0.08, 2e-5


def verify() -> Verified:
    """All bars, tubes and layers."""
    rows: list[Row] = []
    computed: dict[str, list[float]] = {}
    for cell, degree in CELLS:
        name = f"{cell}, order {degree}"
        for angle in ANGLES:
            solution = _bar(cell, degree, angle)
            rows += _bar_rows(f"bar, fibres at {angle:g} degrees, {name}", solution, angle)
            computed.setdefault(name, []).append(-_total(solution) / WIDTH**2 / (SHORTENED / LENGTH))
        rows.append(_layers(name, cell, degree))
    tubes = (("hexahedron", 1, 8, 0.01), ("tetrahedron", 1, 8, 0.03), ("hexahedron", 2, 10, 0.02))
    rows += [_tube(*tube) for tube in (*tubes, ("tetrahedron", 2, 6, 0.02))]
    return Verified(tuple(rows), (_panel(computed),))


def modulus(degrees: float) -> float:
    """E(t) in pascals."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    E1, _, E3 = YOUNG
    return 1.0 / (c**4 / E1 + (1.0 / SHEAR[1] - 2.0 * POISSON[1] / E1) * (c * s) ** 2 + s**4 / E3)


def _shearing(degrees: float) -> float:
    """a/E(t) in 1/Pa: shear strain x z over the stress along z."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    E1, _, E3 = YOUNG
    coupling = 2.0 * POISSON[1] / E1 - 1.0 / SHEAR[1]
    return (2.0 / E1 + coupling) * c**3 * s - (2.0 / E3 + coupling) * c * s**3


def _bar(cell: str, degree: int, degrees: float) -> Solution:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    material = OrthotropicMaterial(YOUNG, POISSON, SHEAR, ((s, 0.0, c), (0.0, 1.0, 0.0)))
    slope = -modulus(degrees) * SHORTENED / LENGTH * _shearing(degrees)
    problem = ContactProblem(
        box((WIDTH, WIDTH, LENGTH), (2, 2, 3), cell, degree=degree),
        material,
        [
            PrescribedDisplacement("top", (0.0, 0.0, -SHORTENED), components="z"),
            PrescribedDisplacement("left", lambda x: np.array([slope * x[2], 0.0 * x[0], 0.0 * x[0]]), components="x"),
            Clamp("front", components="y"),
        ],
        Contact("bottom", 0.0),
    )
    return problem.solve(1e-10)


def _total(solution: Solution) -> float:
    return -float(solution.at_nodes.totals()["normal_force"])


def _bar_rows(name: str, solution: Solution, angle: float) -> list[Row]:
    body, u = solution.problem.elasticity.alone, solution.displacement
    expected = modulus(angle) * SHORTENED / LENGTH
    pressure = solution.at_nodes.fields()["pressure"]
    (stress, *_) = body.cell_fields(body.function(u), solution.problem.loading)
    why = "exact for linear elements, but for the residual reached"
    right = np.isclose(body.x[:, 0], WIDTH)
    over = (u[right & np.isclose(body.x[:, 2], z), 0].mean() for z in (LENGTH, 0.0))
    sideways, formula = next(over) - next(over), -expected * _shearing(angle) * LENGTH
    found = [
        worst(f"{name}: pressure, worst node, Pa", expected, pressure, EXACT, why),
        worst(f"{name}: von Mises stress, worst cell, Pa", expected, stress.x.array, EXACT, why),
    ]
    held = next(part for part in solution.reactions if part.face == "left").nodal / abs(_total(solution))
    found.append(
        absolute(f"{name}: force of the side that follows the shear, over that of the plate", 0, held, EXACT, why)
    )
    if 0.0 < angle < 90.0:
        found.append(relative(f"{name}: sideways displacement of the top, m", formula, float(sideways), EXACT, why))
    return found


def _layers(name: str, cell: str, degree: int) -> Row:
    """Two layers of different thickness between rigid walls."""
    materials = {"soft": Material(2e9, 0.4), "stiff": Material(7e10, 0.3)}
    sides = [Clamp(face, components="x") for face in ("left", "right")]
    sides += [Clamp(face, components="y") for face in ("front", "back")]
    solution = ContactProblem(
        in_layers(box((1.0, 1.0, 1.0), (2, 2, 4), cell, degree=degree), 0.25, "soft", "stiff"),
        materials,
        [*sides, PrescribedDisplacement("top", (0.0, 0.0, -1e-4), components="z")],
        Contact("bottom", 0.3),
    ).solve(1e-10)
    soft, stiff = (
        m.young * (1.0 - m.poisson) / ((1.0 + m.poisson) * (1.0 - 2.0 * m.poisson)) for m in materials.values()
    )
    formula = 1e-4 / (0.25 / soft + 0.75 / stiff)
    why = "exact for linear elements, but for the residual reached"
    pressure = solution.at_nodes.fields()["pressure"]
    return worst(f"two layers, {name}: pressure, worst node, Pa", formula, pressure, EXACT, why)


def _around(x: FloatArray) -> FloatArray:
    return np.array([-x[1], x[0], 0.0 * x[0]])


def _outwards(x: FloatArray) -> FloatArray:
    return np.array([x[0], x[1], 0.0 * x[0]])


def _tube(cell: str, degree: int, cells: int, tolerance: float) -> Row:
    """A quarter of the tube on the pin."""
    solution = ContactProblem(
        quarter_ring(INNER, OUTER, 0.01, (cells, 2 * cells, 1), cell, degree),
        OrthotropicMaterial(YOUNG, POISSON, SHEAR, (_around, _outwards)),
        [Clamp("front", components="y"), Clamp("back", components="x"), Clamp("bottom", components="z")]
        + [Clamp("top", components="z")],
        Contact("left", 0.0, foundation=Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), INNER + TOO_THICK)),
    ).solve(1e-9)
    mean = -_total(solution) / float(solution.problem.surface.area.sum())
    why = f"cells of {90 / (2 * cells):.2g} degrees, in each of which the directions are constant"
    return relative(f"wound tube, {cell}, order {degree}: mean pressure, Pa", _pin_pressure(), mean, tolerance, why)


def _pin_pressure() -> float:
    """-s_rr(a) in pascals."""
    (E1, E2, E3), (nu12, nu13, nu23) = YOUNG, POISSON
    S = np.array([[1 / E1, -nu12 / E1, -nu13 / E1], [0, 1 / E2, -nu23 / E2], [0, 0, 1 / E3]])
    C = np.linalg.inv(S + S.T - np.diag(np.diag(S)))
    around, along, both = C[0, 0], C[1, 1], C[0, 1]
    k = math.sqrt(around / along)
    row = np.array([along * k + both, both - along * k])
    conditions = np.array([[INNER**k, INNER**-k], row * [OUTER ** (k - 1), OUTER ** (-k - 1)]])
    A, B = np.linalg.solve(conditions, [TOO_THICK, 0.0])
    return -float(row @ [A * INNER ** (k - 1), B * INNER ** (-k - 1)])


def _panel(computed: dict[str, list[float]]) -> Panel:
    angles = np.linspace(0.0, 90.0, 91)
    curves = [Curve("E(t)", angles, np.array([modulus(angle) for angle in angles]) / 1e9, formula=True)]
    curves += [Curve(name, np.array(ANGLES), np.array(values) / 1e9) for name, values in computed.items()]
    title = "composite bar between rigid plates"
    return Panel(title, "angle of the fibres, degrees", "modulus, GPa", tuple(curves), logarithmic=False)
