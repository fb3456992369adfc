"""Patch tests: a cube on a rigid plane in a uniform state of stress, which all elements represent exactly.

The unit cube carries the traction (tau, 0, -p) on its top; on its sides the displacements of the exact solution are
prescribed.  Sticking throughout (|tau| < F p):

    u = ((tau/G) z, 0, -p z/M),   M = E (1 - nu)/((1 + nu)(1 - 2 nu)),   contact traction (-tau, 0, p)

Sliding throughout, by s0 > 0 along x (sigma_xx = 0, sigma_yy = -nu p, sigma_zz = -p, sigma_xz = F p):

    u = (s0 + (nu (1 + nu) p/E) x + (F p/G) z, 0, -((1 - nu^2) p/E) z),   contact traction (-F p, 0, p)

Each on hexahedra and on tetrahedra, upright and rotated in space with its plane, so that no axis is a coordinate axis;
of first and of second order, these also with distorted cells and curved edges, inside the cube and on its plane sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Material, PrescribedDisplacement, Traction
from coulomb.fem.geometry import Plane
from coulomb.fem.meshes import box
from coulomb.io import summary
from coulomb.linalg.compliance import SchurCompliance
from coulomb.model.contact import Contact
from coulomb.model.discrete_problem import DiscreteProblem
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .table import Curve, Panel, Row, Verified, absolute, relative

STEEL = Material(young=2.119e11, poisson=0.277)
PRESSURE, SHEAR, FRICTION, SLIP = 4e7, 1e7, 0.3, 1e-4
CELLS = {1: (4, 5, 3), 2: (2, 3, 2)}
"""Along the edges of the cube, by the order of the elements."""

RESIDUAL = 1e-10  # of the worst node by its own force; products leave 1.4e-11 of one of them

TURN = np.linalg.qr(np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.1], [0.48, 0.64, 0.7]]))[0]
TURN *= np.linalg.det(TURN)
"""A rotation that changes every axis."""


@dataclass(frozen=True)
class Patch:
    """A patch test: sliding or sticking throughout, everything rotated by `turn` (3, 3).

    `curved` if nodes are moved, so that edges of second-order cells are curved.
    """

    sliding: bool
    cell: str
    turn: FloatArray
    degree: int = 1
    curved: bool = False

    @property
    def name(self) -> str:
        where = "upright" if np.array_equal(self.turn, np.eye(3)) else "turned"
        order = "" if self.degree == 1 else ", second order"
        state = "sliding" if self.sliding else "sticking"
        return f"{state}, {self.cell}{order}, {where}{', curved' if self.curved else ''}"

    @property
    def shear(self) -> float:
        return shear_of(self.sliding)

    def exact(self, x: FloatArray) -> FloatArray:
        """Displacement at the points x (3, k), shape (3, k)."""
        return uniform_state(x, self.turn, STEEL, SLIP if self.sliding else None)

    def _place(self, x: FloatArray) -> FloatArray:
        """Positions of the nodes x (3, k) of the regular cube, shape (3, k)."""
        return self.turn @ (x + curving(x) if self.curved else x)

    def problem(self) -> ContactProblem:
        normal = self.turn[:, 2]
        return ContactProblem(
            box((1.0, 1.0, 1.0), CELLS[self.degree], self.cell, place=self._place, degree=self.degree),
            STEEL,
            [PrescribedDisplacement(face, self.exact) for face in ("left", "right", "front", "back")],
            Contact("bottom", FRICTION, foundation=Plane((0.0, 0.0, 0.0), tuple(normal))),
            [Traction("top", tuple(self.turn @ (self.shear, 0.0, -PRESSURE)))],
        )


def shear_of(sliding: bool) -> float:
    """Shear traction on the top, pascals."""
    return FRICTION * PRESSURE if sliding else SHEAR


def uniform_state(x: FloatArray, turn: FloatArray, material: Material, slip: float | None) -> FloatArray:
    """Displacement at the points x (3, k) of a cube with the axes `turn` that slides by `slip`, or sticks if None."""
    E, nu, sliding = material.young, material.poisson, slip is not None
    G, M = E / (2.0 * (1.0 + nu)), E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))
    x, y, z = turn.T @ x
    across = 0.0 * x if slip is None else slip + nu * (1.0 + nu) * PRESSURE / E * x
    down = -(1.0 - nu**2) * PRESSURE / E * z if sliding else -PRESSURE / M * z
    u: FloatArray = turn @ np.stack([across + shear_of(sliding) / G * z, 0.0 * y, down])
    return u


def state_rows(
    name: str,
    solution: Solution,
    sliding: bool,
    traction: FloatArray,
    expected: FloatArray,
    off: float,
    allowed: tuple[float, str],
    of_a_point: tuple[float, str],
    at: str = "node",
) -> list[Row]:
    """Tractions (m, 3) beside the expected one, the error `off` of displacements, the share of nodes in the state."""
    worst = traction[np.argmax(np.linalg.norm(traction - expected, axis=1))]
    counts = summary.summary(solution)["nodes"]
    alike = counts["slip" if sliding else "stick"] / counts["contact"]
    single, why = of_a_point
    of_shear = single * PRESSURE / shear_of(sliding)
    return [
        relative(f"{name}: pressure, worst {at}, Pa", expected[2], worst[2], single, why),
        relative(f"{name}: shear, worst {at}, Pa", expected[0], worst[0], of_shear, why),
        absolute(f"{name}: displacement, worst node, over the largest", 0.0, off, *allowed),
        absolute(f"{name}: share of {at}s in this state", 1.0, alike, 0.0, "a count: all of them"),
    ]


def curving(x: FloatArray) -> FloatArray:
    """Displacement of the nodes x (3, k) of the unit cube that leaves its sides plane, shape (3, k).

    A smooth part, and one that varies from node to node; along a side both are tangential.
    """
    inside = np.sin(np.pi * x)  # of each component: 0 on the two sides across it
    smooth = 0.05 * np.stack([np.cos(2.0 * x[1] + x[2]), np.sin(2.0 * x[2] + x[0]), np.cos(x[0] - 2.0 * x[1])])
    rough = 0.02 * np.sin(1e3 * np.array([[1.0, 2.0, 3.0], [5.0, 4.0, 7.0], [9.0, 8.0, 6.0]]) @ np.round(x, 9))
    moved: FloatArray = inside * (smooth + rough)
    return moved


def patches() -> list[Patch]:
    """All sixteen."""
    found = []
    for sliding in (False, True):
        for cell in ("hexahedron", "tetrahedron"):
            found += [Patch(sliding, cell, turn) for turn in (np.eye(3), TURN)]
            found += [Patch(sliding, cell, np.eye(3), 2), Patch(sliding, cell, TURN, 2, curved=True)]
    return found


def verify() -> Verified:
    """All patch tests."""
    rows: list[Row] = []
    shears = []
    for patch in patches():
        solution = patch.problem().solve(RESIDUAL)
        rows += _rows(patch.name, patch, solution)
        shears.append((patch, _traction(patch, solution)))
    return Verified(tuple(rows), _panels(shears))


def _traction(patch: Patch, solution: Solution) -> FloatArray:
    """Contact traction on the body in the axes of the cube, shape (m, 3), pascals."""
    surface = solution.problem.surface
    force = -surface.vectors(solution.contact_force.reshape(-1, 3))
    traction: FloatArray = force @ patch.turn / surface.area[:, None]
    return traction


_INTEGRALS = 1e-9
"""Error of integrals over the curved tetrahedra: the pressure stays off by 7.8e-10 at residuals from 1e-11 to 1e-15."""


_ROUNDING = 1e-13
"""Rounding errors of a residual: semismooth Newton steps end at residuals of this size, and below."""


def _rows(name: str, patch: Patch, solution: Solution) -> list[Row]:
    problem = solution.problem
    allowed = (solution.result.residual + _ROUNDING) * amplification(problem)
    why = "exact for all elements: the residual reached times (1 + L)/m, m and L the extreme eigenvalues of A over a"
    if patch.curved and patch.cell == "tetrahedron":
        allowed += _INTEGRALS
        why += f", and {_INTEGRALS:g} for integrals over curved tetrahedra"
    force = solution.contact_force.reshape(-1, 3)
    of_a_node = np.linalg.norm(force) / np.linalg.norm(force, axis=1).min()
    single = f"{why}, times the norm of all forces over the smallest nodal force"
    exact = patch.exact(problem.elasticity.x.T).T
    off = float(np.abs(solution.displacement - exact).max() / np.abs(exact).max())
    expected, of_a_point = np.array([-patch.shear, 0.0, PRESSURE]), (float(allowed * of_a_node), single)
    traction = _traction(patch, solution)
    return state_rows(name, solution, patch.sliding, traction, expected, off, (allowed, why), of_a_point)


def amplification(problem: DiscreteProblem) -> float:
    """Bound of the error over the natural residual: (1 + L)/m for a strongly monotone problem."""
    assert isinstance(problem.A, SchurCompliance)
    eigenvalues = np.linalg.eigvalsh(problem.A.dense()) / problem.mean_compliance
    return float((1.0 + eigenvalues[-1]) / eigenvalues[0])


def _panels(shears: list[tuple[Patch, FloatArray]]) -> tuple[Panel, ...]:
    panels = []
    for sliding in (False, True):
        chosen = [(patch, traction) for patch, traction in shears if patch.sliding is sliding]
        ends = np.array([0.0, max(len(traction) for _, traction in chosen) - 1.0])
        curves = [
            Curve("p", ends, np.full(2, PRESSURE / 1e6), formula=True),
            Curve("F p" if sliding else "tau", ends, np.full(2, chosen[0][0].shear / 1e6), formula=True),
        ]
        for number, (patch, traction) in enumerate(chosen):
            nodes, label = np.arange(len(traction), dtype=float), patch.name.partition(", ")[2]
            both = np.concatenate([traction[:, 2], -traction[:, 0]]) / 1e6
            curves.append(Curve(label, np.tile(nodes + 0.1 * number, 2), both))
        title = "sliding throughout" if sliding else "sticking throughout"
        panels.append(Panel(title, "contact node", "pressure and shear, MPa", tuple(curves)))
    return tuple(panels)
