"""Press fit of two elastic rings, of different materials and with meshes that do not match.

Lame, plane strain (u_z = 0): a ring a < r < b of the material 1 in a ring b < r < c of the material 2, which overlap by
the interference d at b before the fit,

    d = p b ((1 + nu2)/E2 ((1 - 2 nu2) b^2 + c^2)/(c^2 - b^2) + (1 + nu1)/E1 ((1 - 2 nu1) b^2 + a^2)/(b^2 - a^2))

and the radial displacement is -(1 + nu1)/E1 p b^2/(b^2 - a^2) ((1 - 2 nu1) r + a^2/r) in the inner ring and
(1 + nu2)/E2 p b^2/(c^2 - b^2) ((1 - 2 nu2) r + c^2/r) in the outer one.

Quarters between planes of symmetry.  The interference is given, as `gap=-d` on rings that both have the radius b, or
geometry: an inner ring with the outer radius b + d, which is an interference d to d/b.

Linear elements have chords in place of the circle, off by b t^2/8 for an angle t of a cell, more than the interference:
what chords of different length leave open or overlap is closed without strain (`adjust`).  Curved edges of second-order
elements are off by b t^4/960 in the mean, less than the interference by far.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Load, Material, SymmetryPlane, join
from coulomb.fem.geometry import Cylinder
from coulomb.fem.meshes import NamedMesh
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import quarter_ring
from .table import Curve, Panel, Row, Verified, absolute, order, relative

ALUMINIUM, STEEL = Material(young=7e10, poisson=0.33), Material(young=2.1e11, poisson=0.3)
BORE, FIT, RIM, LENGTH = 0.1, 0.15, 0.2, 0.05
"""Radii a, b, c and length along the axis, metres."""

INTERFERENCE, FRICTION = 5e-5, 0.2
"""d in metres; friction does no work: both rings move along the radius."""

CELLS, CELLS_OF_SECOND_ORDER = (2, 4, 8), (1, 2, 4)
"""Cells along the radius of the outer ring; three times as many around the quarter, around the inner one four times."""


def lame() -> float:
    """Pressure of the fit in pascals."""
    return INTERFERENCE / (FIT * (softness(ALUMINIUM, FIT, BORE) + softness(STEEL, FIT, RIM)))


def softness(material: Material, r: float, free: float) -> float:
    """u_r/r per pressure at r of a ring whose other side is free, at the radius `free`."""
    nu = material.poisson
    return (1.0 + nu) / material.young * ((1.0 - 2.0 * nu) * r**2 + free**2) / abs(free**2 - r**2)


def displacement(r: FloatArray, outer: bool) -> FloatArray:
    """Radial displacement by the formula at radii (k,), shape (k,)."""
    material, free = (STEEL, RIM) if outer else (ALUMINIUM, BORE)
    nu, p = material.poisson, lame() if outer else -lame()
    scale = (1.0 + material.poisson) / material.young * p * FIT**2 / abs(free**2 - FIT**2)
    found: FloatArray = scale * ((1.0 - 2.0 * nu) * r + free**2 / r)
    return found


def quarter(inner: float, outer: float, cells: tuple[int, int], cell: str, degree: int) -> NamedMesh:
    """A quarter of a ring of the length LENGTH, cells along its radius and around."""
    return quarter_ring(inner, outer, LENGTH, (*cells, 1), cell, degree)


Facets = Literal["as they are", "closed", "smooth", "cylinders"]
"""How gaps between the facets of both rings are measured: as they are; with those of the meshes closed by `adjust`; on
smooth surfaces; on the cylinders."""


def rings(
    cells: int,
    kinds: tuple[str, str],
    degrees: tuple[int, int],
    by_geometry: bool = False,
    facets: Facets = "closed",
) -> ContactProblem:
    """Both rings; kinds of cells and degrees of the inner and the outer one."""
    radius = FIT + (INTERFERENCE if by_geometry else 0.0)
    surfaces = [Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), r) if facets == "cylinders" else None for r in (radius, FIT)]
    bodies = {
        "inner": quarter(BORE, radius, (cells, 4 * cells), kinds[0], degrees[0]),
        "outer": quarter(FIT, RIM, (cells, 3 * cells), kinds[1], degrees[1]),
    }
    contact = Contact(
        "inner:right",
        against="outer:left",
        friction=FRICTION,
        gap=0.0 if by_geometry else -INTERFERENCE,
        adjust=0.5 * FIT * (0.5 * math.pi / (3 * cells)) ** 2 if max(degrees) == 1 and facets == "closed" else 0.0,
        smooth=facets == "smooth",
        surface=surfaces[0],
        against_surface=surfaces[1],
    )
    return fitted(bodies, ("front", "back", "bottom", "top"), contact)


def fitted(
    bodies: Mapping[str, NamedMesh], planes: Sequence[str], contact: Contact, loads: Sequence[Load] = ()
) -> ContactProblem:
    """A body of aluminium in one of steel, between planes of symmetry."""
    materials = dict(zip(bodies, (ALUMINIUM, STEEL), strict=True))
    supports = [SymmetryPlane(f"{name}:{face}") for name in bodies for face in planes]
    return ContactProblem(join(**bodies), materials, supports, contact, loads)


def mean_pressure(solution: Solution) -> float:
    """Normal force over the area b pi/2 LENGTH in pascals."""
    return float(solution.contact_force[0::3].sum()) / (0.5 * math.pi * FIT * LENGTH)


def verify(cells: tuple[int, ...] = CELLS, second_order: tuple[int, ...] = CELLS_OF_SECOND_ORDER) -> Verified:
    """Pressures on several meshes, hexahedra in tetrahedra too, first and second order."""
    rows: list[Row] = []
    known = lame()
    for inner, outer in (("hexahedron", "hexahedron"), ("hexahedron", "tetrahedron"), ("tetrahedron", "tetrahedron")):
        name = f"{inner} in {outer}"
        h = np.array([(RIM - FIT) / FIT / n for n in cells])
        errors = [mean_pressure(rings(n, (inner, outer), (1, 1)).solve()) / known - 1.0 for n in cells]
        angle = 0.5 * math.pi / (3 * cells[-1])
        why = "t^2, t the angle of a cell: linear elements, chords in place of the circle"
        rows.append(relative(f"{name}: mean pressure, Pa", known, known * (1.0 + errors[-1]), angle**2, why))
        if len(cells) > 2:
            found = order(h, np.abs(errors))
            rows.append(absolute(f"{name}: order of its error", 2.0, found, 0.25, "second order; three meshes"))
    named = rings(cells[-1], ("hexahedron", "hexahedron"), (1, 1), by_geometry=True, facets="cylinders").solve()
    angle, name = (
        0.5 * math.pi / (3 * cells[-1]),
        "hexahedron in hexahedron, the interference by geometry, on cylinders",
    )
    why = "t^2, t the angle of a cell: linear elements, gaps between the cylinders themselves"
    rows.append(relative(f"{name}: mean pressure, Pa", known, mean_pressure(named), angle**2, why))
    finest = rings(second_order[-1], ("hexahedron", "hexahedron"), (2, 2), by_geometry=True).solve()
    rows.append(
        relative(
            "second order, the interference by geometry: mean pressure, Pa",
            known,
            mean_pressure(finest),
            INTERFERENCE / FIT + (0.5 * math.pi / (3 * second_order[-1])) ** 4 * FIT / INTERFERENCE / 960.0,
            "d/b = 3e-4: the radius b + d of the inner ring; and the curved edges",
        )
    )
    return Verified(tuple(rows), (_panel(finest),))


def _panel(solution: Solution) -> Panel:
    curves = []
    for k, (member, a, b) in enumerate(zip(solution.problem.elasticity.members, (BORE, FIT), (FIT, RIM), strict=True)):
        x, u = solution.problem.elasticity.x[member.nodes], solution.displacement[member.nodes]
        r = np.hypot(x[:, 0], x[:, 1])
        radial = np.einsum("ki,ki->k", u[:, :2], x[:, :2]) / r
        line = np.linspace(a, b, 50)
        label = ("inner, aluminium", "outer, steel")[k]
        curves.append(Curve(f"Lame, {label}", 1e3 * line, 1e6 * displacement(line, k == 1), formula=True))
        curves.append(Curve(f"coulomb, {label}", 1e3 * r, 1e6 * radial))
    return Panel("press fit of two rings", "r, mm", "radial displacement, micrometres", tuple(curves))
