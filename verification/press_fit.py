"""Press fit of an elastic ring on a rigid pin, its pull-out force, and a wedge-shaped gap that closes.

Lame, for a ring a < r < b that an interference d widens at a, plane strain (u_z = 0), no traction at b:

    u_r = (1 + nu)/E p a^2/(b^2 - a^2) ((1 - 2 nu) r + b^2/r),   u_r(a) = d
    p = E d (b^2 - a^2)/((1 + nu) a ((1 - 2 nu) a^2 + b^2))

A quarter of the ring with planes of symmetry; nodes of the bore are on the circle r = a, so that the given gap -d is
all of the gap.  The chords of linear elements are off the circle by a part h^2 of the radius, h the size of a cell over
it.

Second-order elements have curved edges; forces of 27-node hexahedra are of the order 3 of displacements at least, up to
the 4 of energies.  With 10-node tetrahedra gap and displacement of a contact point are means around a vertex, along one
normal: a radial displacement d has the mean normal part d (1 - s/2), s the mean square angle to that normal, at most
h^2/6 for cells of the angle h.

Pull-out: the pin is pulled along its axis until the bore slips everywhere, with the friction F p.  The ends of the ring
are held along the axis.  Friction bends the normals of the ring's cross-sections by an antiplane displacement, odd in z
about the middle: it does not change the normal force to first order in F, and the pull-out force is F p A.

Wedge: a block with the sides held on the exact displacement, a rotation by s and a compression by p/M, closes the gap
s x - d, an interference on one side and a clearance on the other: uniform pressure, exact for every element.

Closing wedge: a layer of thickness t with nu = 0, which its upper side presses by D against a rigid plane with the gap
s x, without friction.  Where the layer is thin against the length D/s of the contact, it is an elastic foundation,
p(x) = E (D - s x)/t, with the force E w D^2/(2 s t) over the width w, and D/s the length of the contact.
"""

from __future__ import annotations

import math

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, PrescribedDisplacement, SymmetryPlane, Traction
from coulomb.fem.geometry import Cylinder, Plane
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.load_history import LoadHistory
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import quarter_ring
from .table import Curve, Panel, Row, Verified, absolute, at_least, order, relative, worst

STEEL = Material(young=2.1e11, poisson=0.3)
INNER, OUTER, LENGTH = 0.1, 0.2, 0.1
INTERFERENCE, FRICTION, PULL = 5e-5, 0.15, 2e-4
CELLS, CELLS_OF_SECOND_ORDER = (2, 4, 8), (1, 2, 4)
"""Cells along the radius; twice as many around the quarter."""

WEDGE, OFFSET, PRESSURE = 1e-3, 3e-4, 4e7
LAYER, SPAN, SLOPE, PRESSED = 0.05, 2.0, 1e-4, 1e-4

_CHORDS = "(h/a)^2, h = (b - a)/n: linear elements are of second order, with chords in place of the circle"


def lame() -> float:
    """Pressure of the press fit in pascals."""
    E, nu, a, b = STEEL.young, STEEL.poisson, INNER, OUTER
    return E * INTERFERENCE * (b**2 - a**2) / ((1.0 + nu) * a * ((1.0 - 2.0 * nu) * a**2 + b**2))


def ring(cells: int, cell: str, along: int = 1, pulled: bool = False, degree: int = 1) -> ContactProblem:
    """A quarter of the ring: cells along the radius, twice as many around it, and some along the axis.

    At the time 0 there is no interference, from 1 on the whole; `pulled`, the pin moves along z from then on.
    """

    return ContactProblem(
        quarter_ring(INNER, OUTER, LENGTH, (cells, 2 * cells, along), cell, degree),
        STEEL,
        [SymmetryPlane(face) for face in ("front", "back", "bottom", "top")],
        Contact(
            "left",
            FRICTION,
            foundation=Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), INNER),
            gap=-INTERFERENCE,
            gap_amplitude=[(0.0, 0.0), (1.0, 1.0)],
            motion=[(1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, PULL)] if pulled else None,
        ),
        time=1.0,
    )


def wedge(cell: str) -> ContactProblem:
    """The block on the wedge; `_wedge_exact` is its displacement."""
    sides = ("left", "right", "front", "back")
    return ContactProblem(
        box((1.0, 1.0, 1.0), (3, 2, 2), cell),
        STEEL,
        [PrescribedDisplacement(face, _wedge_exact, "xy") for face in sides],  # all of the bottom is in contact
        Contact("bottom", FRICTION, gap=lambda x: WEDGE * x[0] - OFFSET),
        [Traction("top", (0.0, 0.0, -PRESSURE))],
    )


def _wedge_exact(x: FloatArray) -> FloatArray:
    """Displacement at the points x (3, k), shape (3, k)."""
    E, nu = STEEL.young, STEEL.poisson
    M = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return np.stack([WEDGE * x[2], 0.0 * x[0], OFFSET - WEDGE * x[0] - PRESSURE / M * x[2]])


def layer(cell: str) -> ContactProblem:
    """The layer, pressed."""
    return ContactProblem(
        box((SPAN, LAYER, LAYER), (80, 1, 2), cell),
        Material(young=1e9, poisson=0.0),
        [PrescribedDisplacement("top", (0.0, 0.0, -PRESSED)), Clamp("front", "y"), Clamp("back", "y")],
        Contact(
            "bottom",
            0.0,
            foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
            gap=lambda x: SLOPE * x[0],
        ),
    )


def verify() -> Verified:
    """Press fits on three meshes, the pull-out force, and both wedges, on hexahedra and tetrahedra."""
    rows: list[Row] = []
    profiles: list[Curve] = []
    h = np.array([(OUTER - INNER) / INNER / n for n in CELLS])
    for cell in ("hexahedron", "tetrahedron"):
        errors = np.array([normal_force(ring(n, cell).solve()) / expected_force() - 1.0 for n in CELLS])
        rows += [
            relative(
                f"{cell}: mean pressure of the press fit, Pa", lame(), lame() * (1 + errors[-1]), h[-1] ** 2, _CHORDS
            ),
            absolute(f"{cell}: order of its error", 2.0, order(h, np.abs(errors)), 0.25, "second order; three meshes"),
            *_second_order(cell),
            _pull_out(cell, h[-2]),
            *_wedge_rows(cell),
        ]
        solution = layer(cell).solve()
        rows += _layer_rows(cell, solution)
        x, pressure = along_x(solution)
        profiles.append(Curve(f"coulomb, {cell}", x, pressure / 1e6))
    return Verified(tuple(rows), _panels(profiles))


def _second_order(cell: str) -> list[Row]:
    errors = [
        abs(normal_force(ring(n, cell, degree=2).solve()) / expected_force() - 1.0) for n in CELLS_OF_SECOND_ORDER
    ]
    angles = [0.25 * math.pi / n for n in CELLS_OF_SECOND_ORDER]
    name = f"second order, {cell}"
    found = order(angles, errors)
    if cell == "tetrahedron":
        tolerance, why = angles[-1] ** 2 / 6.0, "mean normals around vertices: h^2/6"
        rate = absolute(f"{name}: order of its error", 2.0, found, 0.25, "three coarse meshes")
    else:
        tolerance, why = angles[-1] ** 4, "h^4, h the angle of a cell: the order of energies"
        rate = at_least(f"{name}: order of its error", 3.0, found, 0.25, "that of displacements")
    return [absolute(f"{name}: mean pressure of the press fit, error", 0.0, errors[-1], tolerance, why), rate]


def normal_force(solution: Solution) -> float:
    """On the bore of the quarter in newtons."""
    return float(solution.at_nodes.totals()["normal_force"])


def expected_force() -> float:
    """Normal force on the bore of the quarter in newtons."""
    return lame() * 0.5 * math.pi * INNER * LENGTH


def _pull_out(cell: str, h: float) -> Row:
    problem = ring(CELLS[1], cell, 4, pulled=True)
    *_, last = LoadHistory(times=[1.0, 2.0]).steps(problem)
    pulled = last.solution.at_nodes.totals()["force"][2]
    why = "as the pressure; to first order in F friction leaves the normal force as it is"
    return relative(f"{cell}: pull-out force F p A, N", FRICTION * expected_force(), pulled, h**2, why)


def _wedge_rows(cell: str) -> list[Row]:
    solution = wedge(cell).solve(1e-10)
    body = solution.problem.elasticity
    exact = _wedge_exact(body.x.T).T
    pressure = solution.at_nodes.fields()["pressure"]
    off = float(np.abs(solution.displacement - exact).max() / np.abs(exact).max())
    why = "exact for linear elements: the residual 1e-10, amplified by the condition of A"
    return [
        worst(f"{cell}: pressure on the wedge, worst node, Pa", PRESSURE, pressure, 1e-8, why),
        absolute(f"{cell}: displacement there, over the largest", 0.0, off, 1e-8, why),
    ]


def _layer_rows(cell: str, solution: Solution) -> list[Row]:
    length, thin = PRESSED / SLOPE, LAYER * SLOPE / PRESSED
    force = 1e9 * LAYER * PRESSED**2 / (2.0 * SLOPE * LAYER)
    x, pressure = along_x(solution)
    reached = float(x[pressure > 0.0].max())
    why = f"t/c = {thin:.2g}: the layer as an elastic foundation, to (t/c)^2"
    return [
        relative(f"{cell}: force that closes the wedge, N", force, normal_force(solution), thin**2, why),
        relative(
            f"{cell}: length of the contact, m",
            length,
            reached,
            thin,
            f"t/c = {thin:.2g}: its edge, and a cell, half of t",
        ),
    ]


def along_x(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Places x and pressures of lines of contact nodes across x, means over their width, metres and pascals."""
    surface, force = solution.problem.surface, solution.contact_force[0::3]
    x, line = np.unique(np.round(surface.x[:, 0], 9), return_inverse=True)
    total, area = np.bincount(line.ravel(), force), np.bincount(line.ravel(), surface.area)
    return x, total / area


def _panels(profiles: list[Curve]) -> tuple[Panel, ...]:
    x = np.linspace(0.0, SPAN, 200)
    r = np.linspace(INNER, OUTER, 50)
    known = 1e9 * np.maximum(PRESSED - SLOPE * x, 0.0) / LAYER / 1e6
    solution = ring(CELLS[-1], "hexahedron").solve()
    nodes = solution.problem.elasticity.x
    place = np.hypot(nodes[:, 0], nodes[:, 1])
    u = np.einsum("ki,ki->k", solution.displacement[:, :2], nodes[:, :2]) / place
    nu, a, b = STEEL.poisson, INNER, OUTER
    shape = ((1.0 - 2.0 * nu) * r + b**2 / r) / ((1.0 - 2.0 * nu) * a + b**2 / a)
    return (
        Panel(
            "press fit: radial displacement",
            "r, mm",
            "u_r, micrometres",
            (
                Curve("Lame", 1e3 * r, 1e6 * INTERFERENCE * shape, formula=True),
                Curve("coulomb, hexahedra", 1e3 * place, 1e6 * u),
            ),
        ),
        Panel(
            "closing wedge",
            "x, m",
            "pressure, MPa",
            (Curve("elastic foundation", x, known, formula=True), *profiles),
        ),
    )
