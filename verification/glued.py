"""What ties hold: two rings of different materials that are glued and cooled, and a sector of a twisted ring.

Rings a < r < b of the material 1 and b < r < c of 2 in plane strain (u_z = 0), glued at b without stress and heated by
T, press on each other with

    p = ((1 + nu1) a1 - (1 + nu2) a2) T/(s1 + s2)

where s is u_r/(p r) of each at b (`ring_pair.softness`).  Cooled, T < 0, the aluminium shrinks away from the steel: the
glue bears the tension -p, which contact could not.

A ring a < r < c of n equal sectors, held at a, under the torque M per length at c turns by

    u_t = r M/(4 pi G) (1/a^2 - 1/r^2)
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, SymmetryPlane, Traction, join
from coulomb.fem.contact import CyclicSymmetry, Tied
from coulomb.fem.geometry import Cylinder
from coulomb.fem.meshes import box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem

from .ring_pair import ALUMINIUM, BORE, FIT, LENGTH, RIM, STEEL, quarter, softness
from .table import Row, Verified, absolute, order, relative, worst

COOLED = -100.0
EXPANSION = {"inner": 2.3e-5, "outer": 1.2e-5}
SECTORS, TORQUE = 8, 1e6
FAR = Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 2.0 * RIM, hollow=True)
"""A foundation that is not reached."""


def bond(cells: int, cell: str, degree: int) -> FloatArray:
    """Normal stress of the glue at its nodes, pascals, shape (m,)."""
    bodies = {
        "inner": quarter(BORE, FIT, (cells, 4 * cells), cell, degree),
        "outer": quarter(FIT, RIM, (cells, 3 * cells), cell, degree),
    }
    materials = {
        name: replace(material, expansion=EXPANSION[name])
        for name, material in zip(bodies, (ALUMINIUM, STEEL), strict=True)
    }
    supports = [SymmetryPlane(f"{name}:{face}") for name in bodies for face in ("front", "back", "bottom", "top")]
    problem = ContactProblem(
        *(join(**bodies), materials, supports, Contact("outer:right", 0.1, foundation=FAR)),
        temperature=COOLED,
        ties=[Tied("inner:right", "outer:left")],
    )
    stresses, (tie,) = problem.solve().forces_at_nodes, problem.elasticity.constraints.ties
    found: FloatArray = stresses["peel_stress"][tie.nodes]
    return found


def sector(cells: tuple[int, int], degree: int) -> float:
    """Largest error of u_t over the largest u_t; the cuts of the sector are curved."""

    def place(x: FloatArray) -> FloatArray:
        r = BORE + (RIM - BORE) * x[0]
        angle = 2.0 * math.pi / SECTORS * x[1] + 0.3 * x[0]
        return np.stack([r * np.cos(angle), r * np.sin(angle), LENGTH * x[2]])

    shear = TORQUE / (2.0 * math.pi * RIM**2)
    load = Traction("right", lambda x: shear / RIM * np.stack([-x[1], x[0], 0.0 * x[0]]))
    problem = ContactProblem(
        box((1.0, 1.0, 1.0), (*cells, 1), place=place, degree=degree),
        STEEL,
        [Clamp("left"), SymmetryPlane("bottom"), SymmetryPlane("top")],
        Contact("right", 0.1, foundation=FAR),
        [load],
        ties=[CyclicSymmetry("front", "back", sectors=SECTORS)],
    )
    u, x = problem.solve().displacement, problem.elasticity.x
    r, nu = np.hypot(x[:, 0], x[:, 1]), float(STEEL.poisson)
    exact = r * TORQUE * (1.0 + nu) / (2.0 * math.pi * float(STEEL.young)) * (1.0 / BORE**2 - 1.0 / r**2)
    around = (x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0]) / r
    return float(np.max(np.abs(around - exact)) / np.max(exact))


def verify(cells: int = 4) -> Verified:
    """Glued rings of first and second order, whose meshes do not match; sectors of two meshes."""
    rows: list[Row] = []
    strain = [(1.0 + one.poisson) * EXPANSION[name] for name, one in (("inner", ALUMINIUM), ("outer", STEEL))]
    pull = -(strain[0] - strain[1]) * COOLED / (softness(ALUMINIUM, FIT, BORE) + softness(STEEL, FIT, RIM))
    angle = 0.5 * math.pi / (3 * cells)
    for cell, degree, tolerance, why in (
        ("hexahedron", 1, angle**2, "t^2, t the angle of a cell: linear elements"),
        ("tetrahedron", 2, 0.5 * angle**2, "half of t^2: stresses of second-order elements at nodes"),
        ("hexahedron", 2, 0.1 * angle**2, "a tenth of t^2: the same of 27-node hexahedra"),
    ):
        stress = bond(cells, cell, degree)
        name = f"glued rings, {cell}, order {degree}"
        rows.append(relative(f"{name}: mean stress of the glue, Pa", pull, float(np.mean(stress)), tolerance, why))
        rows.append(
            worst(f"{name}: stress of the glue, worst node, Pa", pull, stress, 8.0 * tolerance, f"8 times {why}")
        )
    for degree, meshes, expected in ((1, ((4, 3), (8, 6)), 2.0), (2, ((2, 1), (4, 2)), 3.0)):
        errors = [sector(mesh, degree) for mesh in meshes]
        name, why = f"sector of a twisted ring, order {degree}", f"h^{expected:g}, h a cell over the inner radius"
        h = (RIM - BORE) / BORE / meshes[-1][0]
        rows.append(absolute(f"{name}: displacement, worst node over the largest", 0.0, errors[-1], h**expected, why))
        found = order(np.array([2.0, 1.0]), np.array(errors))
        nodal, why = (2.0, "second order") if degree == 1 else (3.5, "between 3, that of the elements, and 4 at nodes")
        rows.append(absolute(f"{name}: order of its error", nodal, found, 0.5, why))
    return Verified(tuple(rows), ())
