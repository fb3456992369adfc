"""The fields of a run that can be shown: files, units and colours."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace
from typing import Literal

import matplotlib
import numpy as np

from ...arrays import FloatArray
from ...contact_fields import CONTACT_FIELDS
from ...io.field_files import OPPOSITE, Grid
from ..plotting import ZONES

SEQUENTIAL, SHARE, SIGNED = "viridis", "cividis", "RdBu_r"
"""Colour maps of magnitudes, of fractions, and of signed values; all are suitable for the colour-blind."""

_HELD = 3
"""The status of nodes that are no contact nodes."""


@dataclass(frozen=True)
class Field:
    """A field of contact.xdmf or solution.xdmf.

    Attributes:
        name: Name in the file.
        file: "contact" or "solution".
        title: Name in pictures.
        unit: Unit without prefix.
        colours: Matplotlib's name of the colour map.
        vector: Whether it has three components; its magnitude is shown, or one of them.
        component: 0, 1 or 2 for a component of a vector; None for the magnitude.
    """

    name: str
    file: Literal["contact", "solution"]
    title: str
    unit: str = ""
    colours: str = SEQUENTIAL
    vector: bool = False
    component: int | None = None

    @property
    def zones(self) -> bool:
        """Whether its values are the codes of `plotting.ZONES`."""
        return self.name == "status"

    @property
    def signed(self) -> bool:
        return self.colours == SIGNED

    def values(self, grid: Grid) -> FloatArray:
        """Values on a grid, one number per point or cell.

        Raises:
            ValueError: If the file does not have the field.
        """
        if self.name not in grid.fields:
            raise ValueError(f"{self.file}.xdmf has no field {self.name}; it has {', '.join(sorted(grid.fields))}")
        found: FloatArray = np.asarray(grid.fields[self.name], dtype=np.float64)
        if self.zones and OPPOSITE in grid.fields:  # on faces opposite what has no partner is shown as open
            return np.where((grid.fields[OPPOSITE] >= 0.0) & (np.rint(found) == _HELD), 0.0, found)
        if not self.vector:
            return found
        magnitude: FloatArray = np.linalg.norm(found, axis=-1)
        return magnitude if self.component is None else found[:, self.component]

    def limits(self, values: FloatArray, least: float = 0.0) -> tuple[float, float]:
        """Range of the colours: symmetric for signed values, from 0 for magnitudes, 0 to 1 for fractions and where no
        value exceeds `least`."""
        if self.colours == SHARE:
            return 0.0, 1.0
        most = float(np.max(np.abs(values) if self.signed else values))
        most = most if most > least else 1.0
        return (-most if self.signed else 0.0), most


FIELDS = (
    *(
        Field(of.name, "contact", of.title, of.unit, SHARE if of.fraction else SEQUENTIAL, of.vector)
        for of in CONTACT_FIELDS
        if of.shown
    ),
    Field("displacement", "solution", "displacement", "m", vector=True),
    Field("von_mises_stress", "solution", "von Mises stress", "Pa"),
    *(
        Field(f"stress_{pair}", "solution", f"stress {pair}", "Pa", SIGNED)
        for pair in ("xx", "yy", "zz", "yz", "xz", "xy")
    ),
    Field("principal_stress_1", "solution", "first (largest) principal stress", "Pa", SIGNED),
    Field("principal_stress_2", "solution", "second principal stress", "Pa", SIGNED),
    Field("principal_stress_3", "solution", "third (smallest) principal stress", "Pa", SIGNED),
    Field("temperature_change", "solution", "temperature change", "K", SIGNED),
)


def named(name: str) -> Field:
    """The field of this name; `_x`, `_y` or `_z` chooses a component of a vector.

    Raises:
        ValueError: If there is none; the message has the known names, and the closest.
    """
    known = {field.name: field for field in FIELDS}
    for field in FIELDS:
        if field.vector:
            for number, axis in enumerate("xyz"):
                title = f"{field.title} along {axis}"
                known[f"{field.name}_{axis}"] = replace(field, title=title, component=number, colours=SIGNED)
    if name in known:
        return known[name]
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    shown = ", ".join(field.name + ("[_x|_y|_z]" if field.vector else "") for field in FIELDS)
    raise ValueError(f"there is no field {name!r}{hint} (known: {shown})")


def ramp(field: Field, count: int = 65) -> list[str]:
    """Colours of a field from its lowest to its highest value, or of the zones, as #rrggbb."""
    if field.zones:
        return [colour for _, colour in ZONES.values()]
    colours = matplotlib.colormaps[field.colours](np.linspace(0.0, 1.0, count))
    return [matplotlib.colors.to_hex(colour) for colour in colours]
