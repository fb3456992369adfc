"""GetFEM's large-sliding contact, the die the slave."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from coulomb.arrays import FloatArray

from ..peers.large_getfem import LargeSliding
from ..processes import processor_time
from . import DIE, DIE_YOUNG, FRICTION, SLAB, YOUNG, Run, constants, faces, grid, times, way, width

AUGMENTATION = 1.0
"""Young's modulus of the slab over millimetres."""

RELEASE = 0.5
"""Millimetres: less than the thickness of the bodies."""


def solve(p: int, drawing: int) -> Run:
    """Iterations are Newton's; Unsolved without an answer."""
    began = processor_time()
    both = LargeSliding(FRICTION, AUGMENTATION, RELEASE)
    for name, young in ((DIE, DIE_YOUNG), (SLAB, YOUNG)):
        contact = partial(_contact, name)
        both.add_body(name, *grid(name, p), constants(young), partial(_held, name), contact, slave=name == DIE)
    forces, iterations, completed = both.steps(DIE, way, times(drawing))
    return Run(processor_time() - began, iterations, completed, forces / width(p))


def _held(body: str, x: FloatArray) -> npt.NDArray[np.bool_]:
    held: npt.NDArray[np.bool_] = np.repeat(faces(body, x).held[:, None], 3, axis=1)
    held[:, 1] = True
    return held


def _contact(body: str, x: FloatArray) -> npt.NDArray[np.bool_]:
    return faces(body, x).contact
