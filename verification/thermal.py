"""Heated bodies against formulas, on hexahedra and tetrahedra of first and second order; a is the thermal expansion.

A block between rigid walls, heated by T, has the stress -E a T/(1 - 2 nu) in all directions.  A bar with a gap g to a
rigid wall reaches it where a T L = g; heated further, it is pressed by E A (a T - g/L).  A strip of two layers, of
which the upper one expands more by da, bends downwards with the curvature (Timoshenko 1925)

    k = 6 da T (1 + m)^2/(h (3 (1 + m)^2 + (1 + m n) (m^2 + 1/(m n)))),   m = t1/t2, n = E1/E2

for layers of thickness t1, t2, h together.  Its end, free at first, then rests on a rigid plate at the distance g: a
thermostat, which closes at k L^2/2 = g, and then presses with 3 S (k L^2/2 - g)/L^3; S is the bending stiffness.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material
from coulomb.fem.geometry import Plane
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import in_layers
from .table import Curve, Panel, Row, Verified, absolute, relative, worst

EXPANSION = {"steel": 1.2e-5, "brass": 1.9e-5}
STEEL = Material(2.1e11, 0.3, expansion=EXPANSION["steel"])
BRASS = Material(1.0e11, 0.3, expansion=EXPANSION["brass"])
CELLS = (("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2))
LENGTH, WIDTH, GAP = 0.2, 0.03, 1e-4
EXACT = 1e-7
STRIP, THICKNESS, BREADTH, PLAY = 0.1, (0.001, 0.0015), 0.002, 5e-4
HEATED = 60.0


def verify() -> Verified:
    """Blocks, bars and strips."""
    rows: list[Row] = []
    heats = np.array([0.5, 0.99, 1.5, 2.0, 3.0]) * GAP / LENGTH / EXPANSION["steel"]
    curves = [_force_of_bar(np.linspace(0.0, heats[-1], 61))]
    for cell, degree in CELLS:
        name = f"{cell}, order {degree}"
        rows += _block(name, cell, degree)
        found, curve = _bar(name, cell, degree, heats)
        rows += found
        curves.append(curve)
    rows += _strip("hexahedron", 0.01) + _strip("tetrahedron", 0.01)
    panel = Panel("bar heated against a wall", "temperature change, K", "contact force, kN", tuple(curves))
    return Verified(tuple(rows), (panel,))


def _block(name: str, cell: str, degree: int) -> list[Row]:
    sides = [
        Clamp(face, components=axis) for face, axis in zip(("left", "right", "front", "back"), "xxyy", strict=True)
    ]
    problem = ContactProblem(
        box((1.0, 1.0, 1.0), (2, 2, 2), cell, degree=degree),
        STEEL,
        [*sides, Clamp("top", components="z")],
        Contact("bottom", 0.3),
        temperature=353.15,
        reference_temperature=293.15,
    )
    solution = problem.solve(1e-10)
    expected = STEEL.young * EXPANSION["steel"] * 60.0 / (1.0 - 2.0 * STEEL.poisson)
    pressure = solution.at_nodes.fields()["pressure"]
    sideways = next(abs(part.force[0]) for part in solution.reactions if part.face == "left")
    body = problem.elasticity.alone
    (stress, *_) = body.cell_fields(body.function(solution.displacement), problem.loading)
    why = "exact: the body does not move"
    return [
        worst(f"block between walls, {name}: pressure, worst node, Pa", expected, pressure, EXACT, why),
        relative(f"block between walls, {name}: force of a side, N", expected, sideways, EXACT, why),
        absolute(
            f"block between walls, {name}: von Mises stress over it", 0, stress.x.array.max() / expected, EXACT, why
        ),
    ]


def _force_of_bar(heats: FloatArray) -> Curve:
    force = STEEL.young * WIDTH**2 * np.maximum(EXPANSION["steel"] * heats - GAP / LENGTH, 0.0)
    return Curve("E A (a T - g/L)", heats, force / 1e3, formula=True)


def _bar(name: str, cell: str, degree: int, heats: FloatArray) -> tuple[list[Row], Curve]:
    """The bar at several temperatures, by an amplitude in time."""
    problem = ContactProblem(
        box((WIDTH, WIDTH, LENGTH), (2, 2, 3), cell, degree=degree),
        STEEL,
        [Clamp("left", components="x"), Clamp("front", components="y"), Clamp("top", components="z")],
        Contact("bottom", 0.0, foundation=Plane((0.0, 0.0, -GAP), (0.0, 0.0, 1.0))),
        temperature=1.0,
        temperature_amplitude=lambda heat: heat,
    )
    forces = [float(problem.at(float(heat)).solve(1e-10).at_nodes.totals()["normal_force"]) for heat in heats]
    expected = 1e3 * _force_of_bar(heats).y
    why = "exact for linear elements, but for the residual reached"
    rows = [
        absolute(
            f"bar at a wall, {name}: force before the gap closes, N", 0.0, max(forces[:2]), 0.0, "nothing touches"
        ),
        *(
            relative(f"bar at a wall, {name}: force at {heat:.4g} K, N", formula, force, EXACT, why)
            for heat, formula, force in list(zip(heats, expected, forces, strict=True))[2:]
        ),
    ]
    return rows, Curve(name, heats, np.array(forces) / 1e3)


def _strip(cell: str, tolerance: float) -> list[Row]:
    """A thermostat of steel below brass, second order."""
    below, above = THICKNESS

    def layers(x: FloatArray) -> FloatArray:
        """Two cells over each layer."""
        z = np.interp(x[2], [0.0, 0.5, 1.0], [0.0, below, below + above])
        return np.array([x[0], x[1], z])

    whole = box((STRIP, BREADTH, 1.0), (25, 1, 4), cell, place=layers, degree=2)
    problem = partial(
        ContactProblem,
        in_layers(whole, below, "steel", "brass"),
        {"steel": STEEL, "brass": BRASS},
        [Clamp("left", components="x"), Clamp("front", components="y"), Clamp("left", direction=(0.0, 0.0, 1.0))],
        temperature=20.0 + HEATED,
        reference_temperature=20.0,
    )
    free = problem(Contact("bottom", 0.0, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))).solve(1e-9)
    touching = problem(Contact("bottom", 0.0, foundation=Plane((0.0, 0.0, -PLAY), (0.0, 0.0, 1.0)))).solve(1e-9)
    sag = 0.5 * _curvature() * STRIP**2
    force = 3.0 * _bending_stiffness() * (sag - PLAY) / STRIP**3
    pressing = float(touching.at_nodes.totals()["normal_force"])
    why, name = f"a beam of {STRIP / (below + above):.2g} times its height", f"strip of two metals, {cell}, order 2"
    return [
        relative(f"{name}: deflection, m", sag, _sag(free), tolerance, why),
        relative(f"{name}: force of the end, N", force, pressing, 3 * tolerance, f"{why}, a small difference"),
    ]


def _sag(solution: Solution) -> float:
    """Downward displacement of the free end."""
    x = solution.problem.elasticity.x
    return -float(solution.displacement[np.isclose(x[:, 0], STRIP), 2].mean())


def _curvature() -> float:
    (t1, t2), h = THICKNESS, sum(THICKNESS)
    m, n = t1 / t2, STEEL.young / BRASS.young
    below = 3.0 * (1.0 + m) ** 2 + (1.0 + m * n) * (m**2 + 1.0 / (m * n))
    return 6.0 * (EXPANSION["brass"] - EXPANSION["steel"]) * HEATED * (1.0 + m) ** 2 / (h * below)


def _bending_stiffness() -> float:
    """Of the strip about its elastic centre, N m^2."""
    stiff, thick = np.array([STEEL.young, BRASS.young]) * BREADTH, np.array(THICKNESS)
    z = np.array([0.5 * thick[0], thick[0] + 0.5 * thick[1]])
    centre = np.sum(stiff * thick * z) / np.sum(stiff * thick)
    return float(np.sum(stiff * (thick**3 / 12.0 + thick * (z - centre) ** 2)))
