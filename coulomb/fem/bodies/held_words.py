"""What a support holds, in words: for the list of what was understood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray
from ..geometry import Field


def held_in_words(components: str, direction: Field | None, value: Field) -> str:
    """Held components or direction, and the prescribed displacement unless it is zero.

    Args:
        components: Letters of "xyz", "normal" or "tangential".
        direction: In place of components.
        value: The displacement in metres.
    """
    letters = direction is None and not set(components) - set("xyz")
    if direction is not None:
        held = "along a function of x" if callable(direction) else f"along {vector_in_words(direction)}"
    elif letters:
        held = ", ".join(components)
    else:
        held = "along the normal" if components == "normal" else "across the normal"
    if callable(value):
        return f"{held}: a function of x"
    given = np.asarray(value, dtype=np.float64)
    if not np.any(given):
        return held
    if letters:
        return ", ".join(f"{letter} = {given['xyz'.index(letter)]:g} m" for letter in components)
    return f"{held}: the part of {vector_in_words(given)} m"


def vector_in_words(vector: Sequence[float] | FloatArray) -> str:
    """(1, 0, -0.5)."""
    return f"({', '.join(f'{value:g}' for value in np.asarray(vector, dtype=np.float64))})"
