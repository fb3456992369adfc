"""The fields of a run that can be shown: files, units, colours and their ranges."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

import matplotlib
import numpy as np

from ...arrays import FloatArray, IntArray
from ...contact_fields import AGAINST, CONTACT_FIELDS
from ...io.field_files import OPPOSITE, Grid
from .files import Run
from .grids import contact_points
from .words import in_few

ZONES = {0: ("open", "#dde6ea"), 1: ("stick", "#2159a8"), 2: ("slip", "#e68a1e"), 3: ("no contact point", "#2b2b2b")}
"""Name and colour of every status in contact.xdmf: a luminance contrast of 2 between any two, for greyscale,
and colours that the colour-blind can distinguish."""

SEQUENTIAL, SHARE, SIGNED = "viridis", "cividis", "RdBu_r"
"""Colour maps of magnitudes, of fractions, and of signed values; all are suitable for the colour-blind."""

AXES = ("#d55e00", "#009e73", "#0b84d8")
"""Colours of x, y and z."""

INK = "#202020"
"""Colour of text and arrows."""

_HELD: Final = 3
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
        """Whether its values are the codes of `ZONES`."""
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
        values: FloatArray = np.asarray(grid.fields[self.name], dtype=np.float64)
        if self.zones and OPPOSITE in grid.fields:  # on faces opposite what has no partner is shown as open
            return np.where((grid.fields[OPPOSITE] >= 0.0) & (np.rint(values) == _HELD), 0.0, values)
        if not self.vector:
            return values
        magnitude: FloatArray = np.linalg.norm(values, axis=-1)
        return magnitude if self.component is None else values[:, self.component]

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
    Field("peel_stress", "solution", "normal stress of ties", "Pa", SIGNED),
    Field("shear_stress", "solution", "shear stress of ties", "Pa"),
    Field("stress_error", "solution", "error of the stress", "Pa"),
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


def zone_counts(contact: Grid) -> dict[str, int]:
    """Number of contact nodes per zone, by name."""
    status = np.rint(contact.fields["status"]).astype(int)[contact_points(contact)]
    return {name: int(np.count_nonzero(status == code)) for code, (name, _) in ZONES.items()}


_ALIKE: Final = 4.0
"""Faces whose largest values differ by a smaller factor share a range: its lowest quarter would be all one colour."""


class Bar(NamedTuple):
    """A colour bar: its range, the smallest and largest value, in the bare unit, and its contacts, if not all."""

    low: float
    high: float
    smallest: float
    largest: float
    of: str = ""


@dataclass(frozen=True)
class Limits:
    """Range of the colours, in the bare unit of the field.

    Attributes:
        high: Its end, of several ranges that of the largest.
        least: Magnitudes up to this are rounding errors of the answer, shown as 0.
        ends: By number of the contact the end of its range, which starts at 0, or at minus the end if `low` is not 0;
            empty if all have the same.
        names: Names of the contacts with ranges of their own.
    """

    low: float
    high: float
    least: float = 0.0
    ends: tuple[float, ...] = ()
    names: tuple[str, ...] = ()

    def end_at(self, contact: Grid) -> FloatArray | float:
        """End of the range at every point of the contact faces."""
        return np.array(self.ends)[_contacts(contact)] if self.ends else self.high

    def exact(self, values: FloatArray) -> FloatArray:
        """Values without rounding errors."""
        return np.where(np.abs(values) > self.least, values, 0.0)

    def stretched(self, values: FloatArray, grid: Grid) -> FloatArray:
        """Values of the field whose colours in the largest range are those in their own."""
        return self.exact(values) * (self.high / self.end_at(grid))

    def bars(self, values: FloatArray, grid: Grid) -> list[Bar]:
        """The colour bars for values in one state, the largest first."""
        values = self.exact(values)
        if not self.ends:
            return [Bar(self.low, self.high, float(np.min(values)), float(np.max(values)))]
        end_of, bars = self.end_at(grid), []
        for end in sorted(set(self.ends), reverse=True):
            names = [name for name, own in zip(self.names, self.ends, strict=True) if own == end]
            mine = values[end_of == end]
            ends = (float(np.min(mine, initial=0.0)), float(np.max(mine, initial=0.0)))
            bars.append(Bar(end * self.low / self.high, end, *ends, in_few(names, room=50)))
        return bars


def limits_of(run: Run, field: Field) -> Limits:
    """Range of the colours of a field; of contacts with much smaller values than others their own."""
    if field.zones:
        return Limits(0.0, float(max(ZONES)))
    least = run.accuracy.get(field.unit, 0.0)
    grids = [step.grid(field.file) for step in run.steps]
    values = [field.values(grid) for grid in grids]
    low, high = field.limits(np.concatenate([np.ravel(of_step) for of_step in values]), least)
    names = [AGAINST.join([*face["faces"], *([face["against"]] if "against" in face else [])]) for face in run.faces]
    if field.file != "contact" or field.colours == SHARE or len(names) < 2:
        return Limits(low, high, least)
    largest = np.zeros(len(names))
    for grid, of_step in zip(grids, values, strict=True):
        np.maximum.at(largest, _contacts(grid), np.abs(of_step))
    ends, end = np.full(len(names), high), high
    for k in np.argsort(-largest):
        if least < largest[k] < end / _ALIKE:
            end = float(largest[k])
        ends[k] = end
    if end == high:
        return Limits(low, high, least)
    return Limits(low, high, least, tuple(ends.tolist()), tuple(names))


def _contacts(grid: Grid) -> IntArray:
    """Number of the contact at every point of the contact faces, on faces opposite that of the pair."""
    numbers = np.asarray(grid.fields["face"])
    if OPPOSITE in grid.fields:
        numbers = np.where(grid.fields[OPPOSITE] >= 0.0, grid.fields[OPPOSITE], numbers)
    return np.rint(numbers).astype(np.int64)
