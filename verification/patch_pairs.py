"""Patch tests of pairs: a cube on a cube, with meshes that do not match, in uniform states of stress.

The lower cube is z < 0, the upper one z > 0, of two materials; the upper one's top carries the traction (tau, 0, -p),
on the sides of both and at the bottom the displacements of the exact solution are prescribed.  Sticking throughout
(|tau| < F p), in each cube with its own moduli:

    u = ((tau/G) z, 0, -p z/M),   M = E (1 - nu)/((1 + nu)(1 - 2 nu)),   contact traction on the upper cube (-tau, 0, p)

Sliding throughout, the upper cube by s0 > 0 along x (sigma_xx = 0, sigma_yy = -nu p, sigma_zz = -p, sigma_xz = F p):

    u = (s0 + (nu (1 + nu) p/E) x + (F p/G) z, 0, -((1 - nu^2) p/E) z),   s0 = 0 in the lower cube,   (-F p, 0, p)

Hexahedra on tetrahedra and so on, of first and of second order, each as slave and as master; cells of first order are
also twisted inside the contact face, so that the two meshes are rotated against each other.

Matching meshes that stick are one body: the same problem on one mesh without contact is solved beside them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Elasticity, Material, PrescribedDisplacement, Traction, join
from coulomb.fem.meshes import box, moved
from coulomb.linalg.compliance import DirectSolver
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .patch import FRICTION, PRESSURE, RESIDUAL, SLIP, TURN, amplification, shear_of, state_rows, uniform_state
from .table import Row, Verified, absolute

MATERIALS = {"lower": Material(young=2.119e11, poisson=0.277), "upper": Material(young=7e10, poisson=0.33)}
_ROUGH = 5.0
"""Friction with which everything sticks."""

SIDES = ("left", "right", "front", "back")

Kind = tuple[str, int]
"""Cells and order."""

CELLS = {1: ((3, 4, 2), (6, 5, 2)), 2: ((2, 2, 1), (3, 3, 1))}
"""Along the edges of the coarser and of the finer cube, by the order of the elements; the finer one is the slave."""


@dataclass(frozen=True)
class PairPatch:
    """A patch test: sliding or sticking throughout, kinds of both cubes, everything rotated by `turn` (3, 3).

    The slave is the finer cube, which has the contact points.
    """

    sliding: bool
    lower: Kind
    upper: Kind
    slave: str
    turn: FloatArray

    @property
    def name(self) -> str:
        below, above = (f"{cell}{' of second order' if order == 2 else ''}" for cell, order in (self.lower, self.upper))
        where = "upright" if np.array_equal(self.turn, np.eye(3)) else "turned"
        return f"{'sliding' if self.sliding else 'sticking'}, {above} on {below}, slave is the {self.slave}, {where}"

    @property
    def shear(self) -> float:
        return shear_of(self.sliding)

    def exact(self, body: str, x: FloatArray) -> FloatArray:
        """Displacement at the points x (3, k) of the lower or the upper cube, shape (3, k)."""
        slip = SLIP if body == "upper" else 0.0
        return uniform_state(x, self.turn, MATERIALS[body], slip if self.sliding else None)

    def problem(self) -> ContactProblem:
        meshes, held = {}, []
        for body, (cell, degree) in (("lower", self.lower), ("upper", self.upper)):
            place = partial(self._place, lowered=body == "lower", twisted=degree == 1)
            meshes[body] = box((1.0, 1.0, 1.0), CELLS[degree][body == self.slave], cell, place=place, degree=degree)
            faces = (*SIDES, "bottom") if body == "lower" else SIDES
            held += [PrescribedDisplacement(f"{body}:{face}", partial(self.exact, body)) for face in faces]
        return ContactProblem(
            join(meshes),
            MATERIALS,
            held,
            Contact("upper:bottom", FRICTION, against="lower:top"),
            [Traction("upper:top", tuple(self.turn @ (self.shear, 0.0, -PRESSURE)))],
        )

    def _place(self, x: FloatArray, lowered: bool, twisted: bool) -> FloatArray:
        """Positions of the nodes x (3, k) of the regular unit cube, shape (3, k)."""
        if twisted:
            x = twisting(x, -0.5 if lowered else 0.5)
        return self.turn @ (x - np.array([[0.0], [0.0], [1.0]]) if lowered else x)


def twisting(x: FloatArray, angle: float) -> FloatArray:
    """The nodes x (3, k) of the unit cube rotated about its vertical axis by an angle that is zero on its sides."""
    away = x[:2] - 0.5
    turned = angle * 16.0 * np.prod(x[:2] * (1.0 - x[:2]), axis=0)
    c, s = np.cos(turned), np.sin(turned)
    return np.stack([0.5 + c * away[0] - s * away[1], 0.5 + s * away[0] + c * away[1], x[2]])


def patches() -> list[PairPatch]:
    """All ten."""
    hexahedra, tetrahedra = ("hexahedron", 1), ("tetrahedron", 1)
    second, quadratic = ("hexahedron", 2), ("tetrahedron", 2)
    found = []
    for sliding in (False, True):
        found += [
            PairPatch(sliding, hexahedra, hexahedra, "upper", np.eye(3)),
            PairPatch(sliding, tetrahedra, hexahedra, "upper", TURN),
            PairPatch(sliding, quadratic, tetrahedra, "lower", np.eye(3)),
            PairPatch(sliding, tetrahedra, quadratic, "lower", TURN),
            PairPatch(sliding, quadratic, second, "upper", TURN),
        ]
    return found


def verify() -> Verified:
    """All patch tests, and matching meshes against one."""
    rows: list[Row] = []
    for patch in patches():
        rows += _rows(patch, patch.problem().solve(RESIDUAL))
    for kind in (("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2)):
        rows.append(_glued(kind))
    return Verified(tuple(rows), ())


def _rows(patch: PairPatch, solution: Solution) -> list[Row]:
    why = "exact for all elements, whatever the two meshes: rounding errors and the residual reached"
    surface = solution.problem.surface
    force = -surface.vectors(solution.contact_force.reshape(-1, 3))
    traction = force @ patch.turn / surface.area[:, None]
    assert surface.faces[0].startswith(patch.slave)
    expected = np.array([-patch.shear, 0.0, PRESSURE]) * (1.0 if patch.slave == "upper" else -1.0)
    off = _displacement_error(patch, solution)
    allowed = max(1e-9, solution.result.residual * amplification(solution.problem)), why
    return state_rows(patch.name, solution, patch.sliding, traction, expected, off, allowed, allowed, "point")


def _displacement_error(patch: PairPatch, solution: Solution) -> float:
    bodies = solution.problem.elasticity
    off, largest = 0.0, 0.0
    for member in bodies.members:
        exact = patch.exact(member.name, member.body.x.T).T
        off = max(off, float(np.abs(solution.displacement[member.nodes] - exact).max()))
        largest = max(largest, float(np.abs(exact).max()))
    return off / largest


def _glued(kind: Kind) -> Row:
    """Two cubes with matching meshes, clamped at the bottom, the top moved down and aside, against one box."""
    cell, degree = kind
    steel, cells = MATERIALS["lower"], (3, 3, 2) if degree == 1 else (2, 2, 1)
    down = (SLIP, 0.5 * SLIP, -4.0 * SLIP)
    cube = box((1.0, 1.0, 1.0), cells, cell, degree=degree)
    both = join(lower=cube, upper=moved(cube, (0.0, 0.0, 1.0)))
    problem = ContactProblem(
        both,
        steel,
        [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", down)],
        Contact("upper:bottom", _ROUGH, against="lower:top"),
    )
    solution = problem.solve(1e-13)
    whole = box((1.0, 1.0, 2.0), (*cells[:2], 2 * cells[2]), cell, degree=degree)
    one = Elasticity(whole, steel, [Clamp("bottom"), PrescribedDisplacement("top", down)])
    u, f = one.K.createVecs()
    one.f(one.at(0.0)).copy(f)
    DirectSolver(one.K).solve(f, u)
    exact = u.array_r.reshape(-1, 3)[cKDTree(one.x).query(problem.elasticity.x)[1]]
    off = float(np.abs(solution.displacement - exact).max() / np.abs(exact).max())
    cells_are = f"matching {cell.replace('ron', 'ra')}{' of second order' if degree == 2 else ''}"
    what = f"{cells_are}, sticking: displacement against one mesh, worst node, over the largest"
    return absolute(what, 0.0, off, 1e-9, "the same equations: rounding errors")
