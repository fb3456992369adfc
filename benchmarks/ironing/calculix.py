"""CalculiX (NLGEOM): C3D8, contact between surfaces by a penalty, the die the slave; it chooses its own increments."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..peers.calculix import numbered, row, run
from ..processes import processor_time
from . import DIE, DIE_YOUNG, FRICTION, SLAB, YOUNG, Run, constants, faces, grid, times, way, width

PENALTY, STICK = 200.0, 100.0
"""Pressure over penetration, and shear stress over elastic slip, N/mm^3."""

_ORDER = (0, 1, 3, 2, 4, 5, 7, 6)
"""CalculiX's corners of a cell in ours."""


def solve(p: int, drawing: int) -> Run:
    """Iterations are those of the equilibrium, also of increments that it gave up; RuntimeError without an answer."""
    began = processor_time()
    job = run(_deck(p, drawing), len(times(drawing)))
    forces = -np.array([table.sum(axis=0) for table in job.tables]) / width(p)
    return Run(processor_time() - began, job.iterations, job.increments, forces)


def _deck(p: int, drawing: int) -> Iterator[str]:
    nodes, cells = 1, 1
    parts = ((SLAB, YOUNG, "S2"), (DIE, DIE_YOUNG, "S1"))  # contact on top; at the bottom
    for body, young, side in parts:
        x, corners = grid(body, p)
        yield from ("*NODE", *numbered(x, nodes))
        yield from (f"*ELEMENT, TYPE=C3D8, ELSET={body}", *numbered(nodes + corners[:, _ORDER], cells))
        yield from (f"*NSET, NSET=ALL{body}, GENERATE", f"{nodes},{nodes + len(x) - 1}")
        at = faces(body, x)
        yield from (f"*NSET, NSET=HELD{body}", *(str(nodes + node) for node in np.flatnonzero(at.held)))
        there = np.flatnonzero(at.contact[corners].sum(axis=1) == 4)
        yield from (f"*SURFACE, NAME=CONTACT{body}", *(f"{cells + cell},{side}" for cell in there))
        yield from (f"*MATERIAL, NAME=RUBBER{body}", "*HYPERELASTIC, NEO HOOKE", row(constants(young)))
        yield f"*SOLID SECTION, ELSET={body}, MATERIAL=RUBBER{body}"
        nodes, cells = nodes + len(x), cells + len(corners)
    yield from ("*SURFACE INTERACTION, NAME=FRICTION", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{PENALTY:g}")
    yield from ("*FRICTION", f"{FRICTION},{STICK:g}")
    yield from ("*CONTACT PAIR, INTERACTION=FRICTION, TYPE=SURFACE TO SURFACE", f"CONTACT{DIE},CONTACT{SLAB}")
    yield from ("*BOUNDARY", f"ALL{SLAB},2,2", f"ALL{DIE},2,2", f"HELD{SLAB},1,3")
    for end in times(drawing):
        along, _, up = way(end)
        yield from ("*STEP, NLGEOM, INC=5000", "*STATIC", "1.,1.")
        yield from ("*BOUNDARY", f"HELD{DIE},1,1,{along}", f"HELD{DIE},3,3,{up}")
        yield from (f"*NODE PRINT, NSET=HELD{DIE}, FREQUENCY=5000", "RF", "*END STEP")
