"""A bolt through a sleeve: tightened, locked, and pulled apart, against the formulas of VDI 2230.

Bolt and sleeve of the cross sections A and B, steel, clamp the length l between head and nut.  The resiliences are

    delta_S = (l + 2 0.4 d)/(E A),   delta_P = l/(E B)

with 0.4 d for each of head and nut (VDI 2230-1:2015, 5.1.1; cylindrical heads).  The force F needs the shortening
s = F (delta_S + delta_P).  Locked, and pulled at head and nut by F_A, the bolt has

    F_S = F + F_A delta_P/(delta_S + delta_P)

as long as the sleeve is pressed, F_A < F (1 + delta_P/delta_S), and F_A afterwards.
"""

from __future__ import annotations

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Material, SymmetryPlane, TotalForce, join
from coulomb.fem.contact import Pretension, Tied
from coulomb.fem.meshes import NamedMesh
from coulomb.model.contact import Contact
from coulomb.model.load_history import LoadHistory
from coulomb.model.problem import ContactProblem

from .array_mesh import quarter_cylinder, quarter_disc, quarter_ring
from .table import Row, Verified, relative

STEEL = Material(2.1e11, 0.3)
SHANK, HOLE, HEAD = 5e-3, 5.5e-3, 8e-3  # radii, m
LENGTH, CUT, TALL = 0.06, 0.02, 7e-3  # m: clamped, from the nut to the section, of head and nut
FORCE, PULL = 1e4, 3e3  # N


def _part(radii: list[float], start: float, end: float, cells: tuple[int, int]) -> NamedMesh:
    disc = quarter_disc(cells[0], 0.5 * SHANK, np.array(radii))
    levels = np.tile(np.linspace(start, end, cells[1] + 1), (len(disc[0]), 1))
    return quarter_cylinder(disc, levels)


def pulled(cells: int) -> FloatArray:
    """Force and shortening of the whole bolt when it is tightened, pulled, and pulled until the sleeve is loose, shape
    (3, 2); N, m."""
    rings = [SHANK * (0.75 + 0.25 * k / cells) for k in range(cells + 1)]
    flange = [*rings, *(SHANK + (HEAD - SHANK) * k / (2 * cells) for k in range(1, 2 * cells + 1))]
    sleeve = quarter_ring(HOLE, HEAD, LENGTH, (2 * cells, 4 * cells, 8 * cells))
    bodies = join(
        nut=_part(flange, -TALL, 0.0, (cells, 3 * cells)),
        low=_part(rings, 0.0, CUT, (cells, 4 * cells)),
        up=_part(rings, CUT, LENGTH, (cells, 8 * cells)),
        head=_part(flange, LENGTH, LENGTH + TALL, (cells, 3 * cells)),
        sleeve=sleeve,
    )
    supports = [SymmetryPlane(f"{name}:{face}") for name in ("nut", "low", "up", "head") for face in ("left", "front")]
    supports += [SymmetryPlane("sleeve:front"), SymmetryPlane("sleeve:back"), SymmetryPlane("nut:bottom")]
    contacts = [Contact("sleeve:top", 0.15, against="head:bottom"), Contact("sleeve:bottom", 0.15, against="nut:top")]
    bolt = Pretension("up:bottom", "low:top", force=FORCE / 4.0, amplitude=lambda t: min(t, 1.0), lock=1.0)
    ties = [bolt, Tied("low:bottom", "nut:top", slave=True), Tied("up:top", "head:bottom", slave=True)]
    load = TotalForce("head:top", (0.0, 0.0, PULL / 4.0), amplitude=lambda t: max(t - 1.0, 0.0))
    problem = ContactProblem(bodies, STEEL, supports, contacts, [load], ties=ties)
    steps = [step.solution.bolts[0] for step in LoadHistory([1.0, 2.0, 9.0]).steps(problem)]
    return np.array([(4.0 * bolt.force, bolt.shortening) for bolt in steps])


def verify(cells: int = 2) -> Verified:
    """The joint diagram on one mesh."""
    young = float(STEEL.young)
    of_bolt = (LENGTH + 2.0 * 0.4 * 2.0 * SHANK) / (young * np.pi * SHANK**2)
    of_sleeve = LENGTH / (young * np.pi * (HEAD**2 - HOLE**2))
    found = pulled(cells)
    share = of_sleeve / (of_bolt + of_sleeve)
    why = "VDI 2230's resilience of head and nut is a mean of tests; polygons of the mesh in place of circles"
    ends = f"{why}; the pull is on the ends of the bolt, not in the planes of clamping"
    rows: list[Row] = [
        relative("shortening when tightened, m", FORCE * (of_bolt + of_sleeve), float(found[0, 1]), 0.05, why),
        relative("part of the pull that the bolt takes", share, float(found[1, 0] - FORCE) / PULL, 0.1, ends),
        relative("force when the sleeve is loose, N", 8.0 * PULL, float(found[2, 0]), 1e-6, "equilibrium"),
    ]
    return Verified(tuple(rows), ())
