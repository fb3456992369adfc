"""CalculiX: dual mortar contact (LINMORTAR) of fully integrated C3D8 on one fixed element, Newton, SPOOLES.

On a plane rigid foundation the biorthogonal multipliers decouple the nodes, so that the contact law is nodal, as in the
other packages.  Contact is regularised: pressure and shear stress are a slope times penetration and elastic slip; the
multipliers allow a slope so large that both are negligible.  (Its node-to-surface contact, a penalty, converges up to
slopes of about 1e14 Pa/m; the error of its forces is then 5e-3 at p = 10.)
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from .answer import FRICTION, LENGTHS, POISSON, TRACTIONS, YOUNG, Answer
from .ccx import CONTROLS, numbered, row, run

SLOPE = 1e20
"""Pressure over penetration, and shear stress over elastic slip, in Pa/m."""


def solve(p: int) -> Answer:
    """Iterations are those of the equilibrium; reading and writing the files is counted."""
    began = time.perf_counter()
    x, cells, load = grid(p)
    contact = np.flatnonzero((x[:, 2] == 0.0) & (x[:, 0] > 0.0))
    job = run(_deck(x, cells, load, contact))
    forces = job.values - load[job.nodes]  # the printed forces are the element forces
    return Answer(time.perf_counter() - began, job.iterations, x[job.nodes], forces, job.peak_memory_bytes)


def grid(
    p: int, tractions: Mapping[str, Sequence[float]] = TRACTIONS
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
    """Nodes in metres, shape (k, 3); cells, shape (c, 8), those on z = 0 first; loads in newtons, shape (k, 3)."""
    n = [round(length * p) for length in LENGTHS]
    number = np.arange(np.prod([k + 1 for k in n])).reshape(n[2] + 1, n[1] + 1, n[0] + 1)
    k, j, i = np.indices(number.shape).reshape(3, -1)
    x = np.column_stack([i, j, k]) / p
    lower = [number[:-1, a : a + n[1], b : b + n[0]].ravel() for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))]
    upper = [number[1:, a : a + n[1], b : b + n[0]].ravel() for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))]
    load = np.zeros_like(x)
    for face, axis in (("top", 2), ("right", 0)):
        area = np.where(x[:, axis] == LENGTHS[axis], 1.0 / p**2, 0.0)
        for other in {0, 1, 2} - {axis}:
            area[(x[:, other] == 0.0) | (x[:, other] == LENGTHS[other])] *= 0.5
        load += np.outer(area, tractions[face])
    return x, np.column_stack(lower + upper), load


def _deck(x: FloatArray, cells: npt.NDArray[np.int64], load: FloatArray, contact: npt.NDArray[np.int64]) -> list[str]:
    loaded = [(node, axis) for node, axis in np.argwhere(load != 0.0)]
    lines = preamble(x, cells, contact)
    lines += ["*STEP", "*STATIC, DIRECT", "1.,1.", "*CONTROLS, PARAMETERS=FIELD", CONTROLS]
    lines += ["*CLOAD", *(f"{node + 1},{axis + 1},{load[node, axis]:.16g}" for node, axis in loaded)]
    lines += ["*NODE PRINT, NSET=CONTACT", "RF", "*END STEP"]
    return lines


def preamble(x: FloatArray, cells: npt.NDArray[np.int64], contact: npt.NDArray[np.int64]) -> list[str]:
    """The lines of a deck before its steps."""
    below = int(np.count_nonzero(x[cells].min(axis=1)[:, 2] == 0.0))  # cells on the contact face
    corners = [(-1, -1), (4, -1), (4, 2), (-1, 2)]
    foundation = np.array([(a, b, z) for z in (-1, 0) for a, b in corners], dtype=np.float64)
    first = len(x)
    fixed = np.concatenate([np.flatnonzero(x[:, 0] == 0.0), first + np.arange(8)])
    lines = ["*NODE", *numbered(np.concatenate([x, foundation]))]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=BODY", *numbered(cells + 1)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=FOUNDATION", f"{len(cells) + 1},{row(first + 1 + np.arange(8))}"]
    lines += ["*NSET, NSET=FIXED", *(str(node + 1) for node in fixed)]
    lines += ["*NSET, NSET=CONTACT", *(str(node + 1) for node in contact)]
    lines += ["*SURFACE, NAME=SLAVE", *(f"{cell + 1},S1" for cell in range(below))]
    lines += ["*SURFACE, NAME=MASTER", f"{len(cells) + 1},S2"]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{YOUNG},{POISSON}"]
    lines += [f"*SOLID SECTION, ELSET={part}, MATERIAL=STEEL" for part in ("BODY", "FOUNDATION")]
    lines += ["*SURFACE INTERACTION, NAME=CONTACT"]
    lines += ["*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{SLOPE:g}", "*FRICTION", f"{FRICTION},{SLOPE:g}"]
    lines += ["*CONTACT PAIR, INTERACTION=CONTACT, TYPE=LINMORTAR", "SLAVE,MASTER"]
    lines += ["*BOUNDARY", "FIXED,1,3"]
    return lines
