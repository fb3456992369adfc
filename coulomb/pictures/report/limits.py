"""Ranges of the colours of a field: one for all steps of a run, and for faces with values of the same size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...contact_names import AGAINST
from ...io.field_files import OPPOSITE, Grid
from ..plotting import ZONES
from .files import Run
from .shown_fields import SHARE, Field
from .units import in_few

_ALIKE = 4.0
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
        low: Its start.
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
        at, found = self.end_at(grid), []
        for end in sorted(set(self.ends), reverse=True):
            names = [name for name, own in zip(self.names, self.ends, strict=True) if own == end]
            mine = values[at == end]
            ends = (float(np.min(mine, initial=0.0)), float(np.max(mine, initial=0.0)))
            found.append(Bar(end * self.low / self.high, end, *ends, in_few(names)))
        return found


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


def _contacts(grid: Grid) -> npt.NDArray[np.int64]:
    """Number of the contact at every point of the contact faces, on faces opposite that of the pair."""
    numbers = np.asarray(grid.fields["face"])
    if OPPOSITE in grid.fields:
        numbers = np.where(grid.fields[OPPOSITE] >= 0.0, grid.fields[OPPOSITE], numbers)
    return np.rint(numbers).astype(np.int64)
