"""A load history of the block: pressed in 4 load steps, then dragged to and fro in 20; friction by slip increments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray
from .answer import TRACTIONS

STEPS = 24
"""Load steps of the whole history; the last is at the time STEPS."""

_PRESSED = ((0.0, 4.0, STEPS), (0.0, 1.0, 1.0))
_DRAGGED = ((0.0, 4.0, 9.0, 19.0, STEPS), (0.0, 0.0, 1.0, -1.0, 0.0))


def pressed(time: float) -> float:
    """Factor of the normal traction on the top at a time."""
    return float(np.interp(time, *_PRESSED))


def dragged(time: float) -> float:
    """Factor of the tractions on the top and on the right that drag the block along the foundation."""
    return float(np.interp(time, *_DRAGGED))


def tractions(time: float) -> dict[str, tuple[float, float, float]]:
    """Tractions in pascals on the faces at a time; 4 steps after the last dragging those of a single run."""
    return {face: (dragged(time) * x, dragged(time) * y, pressed(time) * z) for face, (x, y, z) in TRACTIONS.items()}


def stacked(forces: Sequence[FloatArray]) -> FloatArray:
    """Forces of all steps, each (m, 3), as one array of a row per node, shape (m, 3 steps)."""
    return np.concatenate(forces, axis=1)
