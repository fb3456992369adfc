"""The geometry of a deck as its case and its mesh have it, read from the file once."""

from __future__ import annotations

import os

from .geometry import Geometry
from .rigid_surfaces import add_layers

_KEPT: dict[tuple[str, int, int], Geometry] = {}
"""The geometry that was read last, until it is used again: the case of a deck is read before its mesh."""


def read_geometry(path: str, again: bool = False) -> Geometry:
    """The geometry of a deck with solids for its rigid surfaces, perhaps as it was read before; `again`: it will be
    read once more.

    Raises:
        OSError, ValueError: As `Geometry` and `add_layers`.
    """
    state = os.stat(path)
    key = str(path), state.st_mtime_ns, state.st_size
    geometry = _KEPT.pop(key, None)
    if geometry is None:
        geometry = Geometry(path)
        add_layers(geometry)
    _KEPT.clear()
    if again:
        _KEPT[key] = geometry
    return geometry
