"""NAFEMS CB2: a steel punch with a rounded edge on an aluminium cylinder, with and without friction.

A. W. A. Konter, Advanced Finite Element Contact Benchmarks, NAFEMS 2006, benchmark 2: punch of diameter and height
100 mm with an edge radius of 10 mm, foundation of diameter and height 200 mm, fixed below, E = 210 and 70 GPa,
nu = 0.3, 100 N/mm^2 on top of the punch, F = 0 and 0.1.  A quarter between planes of symmetry; nothing but contact
holds the punch up.

There is no formula.  Known are the displacement of the centre of the foundation, from commercial codes that spread by 2
to 3 %, and the force on the contact face, by equilibrium.  Friction takes 1.6 % off the displacement, which is the
difference of two figures with the same error of the mesh.  For comparison the picture has the pressure of a rigid flat
punch on a half-space, P/(2 pi a^2)/sqrt(1 - r^2/a^2).
"""

from __future__ import annotations

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, SymmetryPlane, TotalForce, join
from coulomb.fem.meshes import NamedMesh
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import growing, quarter_cylinder, quarter_disc
from .table import Curve, Panel, Row, Verified, relative

STEEL, ALUMINIUM = Material(young=2.1e11, poisson=0.3), Material(young=7e10, poisson=0.3)
RADIUS, HEIGHT, EDGE = 0.05, 0.1, 0.01
"""Of the punch, and of its edge; metres.  The foundation is twice as wide and high."""

FORCE = 1e8 * np.pi * RADIUS**2 / 4.0
"""Of 100 N/mm^2 on a quarter of the punch, newtons: polygons have less area than circles."""

KNOWN = {0.0: -0.13073e-3, 0.1: -0.12858e-3}
"""Displacement of the centre of the foundation in metres, by the friction coefficient."""

CELLS = (6, 8)
"""Cells along the core of the punch and of the foundation; twice as many around the quarter."""

_CORE = 0.4
"""Length of the core over the radius of the flat part of the punch."""


def punch(cells: int) -> NamedMesh:
    """The punch, its flat face at z = 0; face bottom with the rounded edge."""
    flat, finest = RADIUS - EDGE, EDGE / cells
    angles = 0.5 * np.pi * np.linspace(0.0, 1.0, cells + 1)[1:] ** 1.5  # finer where it leaves the flat part
    disc = quarter_disc(cells, _CORE * flat, np.concatenate([_flat(finest, cells), flat + EDGE * np.sin(angles)]))
    r = np.hypot(*disc[0].T)
    lowest = EDGE - np.sqrt(EDGE**2 - np.clip(r - flat, 0.0, EDGE) ** 2)
    upwards = np.concatenate([[0.0], growing(2.0 * finest / HEIGHT, 1.0, 2 * cells)])
    return quarter_cylinder(disc, lowest[:, None] + (HEIGHT - lowest)[:, None] * upwards)


def foundation(cells: int) -> NamedMesh:
    """The cylinder below z = 0."""
    flat, finest = RADIUS - EDGE, EDGE / cells
    beyond = flat + growing(finest, 2.0 * RADIUS - flat, 2 * cells)
    disc = quarter_disc(cells, _CORE * flat, np.concatenate([_flat(finest, cells), beyond]))
    downwards = np.concatenate([[0.0], growing(2.0 * finest, 2.0 * HEIGHT, 2 * cells)])
    return quarter_cylinder(disc, np.tile(-downwards[::-1], (len(disc[0]), 1)))


def _flat(finest: float, cells: int) -> FloatArray:
    """Radii of the circles from the core to the end of the flat part, finer towards it."""
    flat = RADIUS - EDGE
    inwards: FloatArray = flat - growing(finest, (1.0 - _CORE) * flat, cells)
    return np.concatenate([inwards[-2::-1], [flat]])


def problem(cells: tuple[int, int], friction: float) -> ContactProblem:
    """A quarter of the punch on a quarter of the foundation."""
    bodies = {"punch": punch(cells[0]), "foundation": foundation(cells[1])}
    return ContactProblem(
        join(bodies),
        {"punch": STEEL, "foundation": ALUMINIUM},
        [SymmetryPlane(f"{name}:{face}") for name in bodies for face in ("left", "front")]
        + [Clamp("foundation:bottom")],
        Contact("punch:bottom", friction, against="foundation:top"),
        [TotalForce("punch:top", (0.0, 0.0, -FORCE))],
        small_strain="warn",
    )


def centre(solution: Solution) -> float:
    """Displacement of the centre of the foundation along z, in metres."""
    *_, member = solution.problem.elasticity.members
    nearest = np.argmin(np.linalg.norm(solution.problem.elasticity.x[member.nodes], axis=1))
    return float(solution.displacement[member.nodes][nearest, 2])


def verify(cells: tuple[int, int] = CELLS) -> Verified:
    """The displacement of the centre with and without friction, and the force."""
    rows: list[Row] = []
    curves: list[Curve] = []
    found: dict[float, float] = {}
    for friction, known in KNOWN.items():
        solution = problem(cells, friction).solve()
        surface = solution.problem.surface
        found[friction] = centre(solution)
        why = "the codes of the benchmark spread by 2 to 3 %"
        rows.append(relative(f"F = {friction:g}: displacement of the centre, m", known, found[friction], 0.03, why))
        force = solution.contact_force[0::3]
        total = abs(float(np.sum(surface.vectors(solution.contact_force.reshape(-1, 3))[:, 2])))
        why = "equilibrium of the punch, which only contact holds: the residual"
        rows.append(relative(f"F = {friction:g}: force on the contact face, N", FORCE, total, 1e-8, why))
        r = np.hypot(surface.x[:, 0], surface.x[:, 1])
        near = r < 1.2 * (RADIUS - EDGE)
        curves.append(
            Curve(f"coulomb, F = {friction:g}", 1e3 * r[near], force[near] / surface.area[near] / 1e6, line=False)
        )
    taken, ours = (1.0 - u[0.1] / u[0.0] for u in (KNOWN, found))
    why = "the meshes of the tests and of the table differ by 10 %"
    rows.append(relative("part of it that friction takes off", taken, ours, 0.1, why))
    flat = RADIUS - EDGE
    r = np.linspace(0.0, 0.99 * flat, 200)
    rigid = 4.0 * FORCE / (2.0 * np.pi * flat**2) / np.sqrt(1.0 - (r / flat) ** 2)
    known_curve = Curve("rigid flat punch on a half-space", 1e3 * r, rigid / 1e6, formula=True)
    return Verified(tuple(rows), (Panel("NAFEMS CB2", "r, mm", "pressure, MPa", (known_curve, *curves)),))
