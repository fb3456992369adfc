"""Results of a case: rows of the table, and curves for its picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coulomb.arrays import FloatArray


@dataclass(frozen=True)
class Row:
    """A row of the table: a quantity with its unit, the known answer, what was computed, and the error allowed.

    Attributes:
        error: Distance of the two, relative to the formula unless that is 0, an order or a share.
        why: Reason of the tolerance: theory or mesh size.
    """

    quantity: str
    formula: float
    ours: float
    error: float
    tolerance: float
    why: str

    @property
    def passed(self) -> bool:
        return self.error <= self.tolerance


def relative(quantity: str, formula: float, ours: float, tolerance: float, why: str) -> Row:
    """A row whose error is |ours - formula| / |formula|."""
    return Row(quantity, formula, ours, abs(ours - formula) / abs(formula), tolerance, why)


def absolute(quantity: str, formula: float, ours: float, tolerance: float, why: str) -> Row:
    """A row whose error is |ours - formula|."""
    return Row(quantity, formula, ours, abs(ours - formula), tolerance, why)


def at_least(quantity: str, least: float, ours: float, tolerance: float, why: str) -> Row:
    """A row whose error is what is missing."""
    return Row(f"{quantity}, at least", least, ours, max(0.0, least - ours), tolerance, why)


def worst(quantity: str, formula: float, values: FloatArray, tolerance: float, why: str) -> Row:
    """`relative`, of the value that is farthest from the formula."""
    return relative(quantity, formula, float(values[np.argmax(np.abs(values - formula))]), tolerance, why)


@dataclass(frozen=True)
class Curve:
    """A curve: the formula as a line (points if it is known at single places), or computed values as dots."""

    label: str
    x: FloatArray
    y: FloatArray
    formula: bool = False
    line: bool = True


@dataclass(frozen=True)
class Panel:
    """One pair of axes with its curves."""

    title: str
    xlabel: str
    ylabel: str
    curves: tuple[Curve, ...]
    logarithmic: bool = False


@dataclass(frozen=True)
class Verified:
    """A case that has been computed: its rows of the table, and its picture."""

    rows: tuple[Row, ...]
    panels: tuple[Panel, ...]


def order(sizes: Sequence[float] | FloatArray, errors: Sequence[float] | FloatArray) -> float:
    """Order of convergence: slope of the straight line fitted to log(error) over log(size)."""
    slope: float = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    return float(slope)
