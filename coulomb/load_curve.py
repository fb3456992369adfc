"""Tables in time: linear between their rows; constant, an error, or repeated after the last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, get_args

import numpy as np

from .arrays import FloatArray

After = Literal["hold", "error", "repeat"]
"""After the last row of a load curve: the last value, an error, or the curve again."""

_SAME_TIME: Final = 1e-12
"""Of the duration of a curve, or of the time if it is longer: a time nearer to a row is that of the row.  With 1e-16 in
place of 0 where a load vanishes, all forces of a load step would be rounding errors."""


@dataclass(frozen=True)
class LoadCurve:
    """A factor, or a vector, as a piecewise linear function of time.

    Before the first row it is constant.  With "repeat" it is periodic from the first row on, with the duration of the
    table as its period; the last values must equal the first, so that there is no jump (write one as a short ramp).

    Attributes:
        times: Times in seconds, increasing, shape (k,).
        values: Values at these times, shape (k,), or (k, columns) for vectors.
        after: After the last row: "hold" keeps its value, "error" refuses the time, "repeat" begins again.

    Raises:
        ValueError: If times and values do not match, are not finite, the times do not increase, or a repeated curve
            does not end with the value with which it begins.
    """

    times: Sequence[float] | FloatArray
    values: Sequence[float] | Sequence[Sequence[float]] | FloatArray
    after: After = "hold"

    def __post_init__(self) -> None:
        rows = self.rows
        if not (rows.ndim == 2 and rows.shape[0] > 0 and rows.shape[1] > 1 and np.all(np.isfinite(rows))):
            raise ValueError("load curve: needs as many times as values, at least one, all of them finite numbers")
        if np.any(np.diff(rows[:, 0]) <= 0.0):
            raise ValueError(f"load curve: the times must increase, but are {rows[:, 0].tolist()}")
        if self.after not in get_args(After):
            raise ValueError(f"load curve: after must be 'hold', 'error' or 'repeat', but is {self.after!r}")
        if self.after == "repeat":
            refuse_jump(rows)

    @cached_property
    def rows(self) -> FloatArray:
        """Time and values, shape (k, 1 + columns); empty if times and values do not match."""
        try:
            times, values = np.array(self.times, dtype=np.float64), np.array(self.values, dtype=np.float64)
            return np.column_stack([times, values])
        except (TypeError, ValueError):
            return np.empty((0, 0))

    @property
    def columns(self) -> int:
        """Number of components of the values."""
        return int(self.rows.shape[1]) - 1

    def at(self, time: float) -> FloatArray:
        """The values at a time, shape (columns,).

        Raises:
            ValueError: If the curve has ended and `after` is "error".
        """
        times = self.rows[:, 0]
        first, last = float(times[0]), float(times[-1])
        near = _SAME_TIME * max(last - first, abs(time))
        if time > last:
            if self.after == "error" and time - last > near:
                raise ValueError(
                    f"the load curve ends at time {last:g}, but its value at time {time:g} is needed: "
                    'give more rows, or after = "hold" or "repeat"'
                )
            if self.after == "repeat":
                time = first + (time - first) % (last - first)
        row = int(np.argmin(np.abs(times - time)))
        if abs(times[row] - time) <= near:
            return self.rows[row, 1:].copy()
        return np.array([np.interp(time, times, column) for column in self.rows[:, 1:].T])


def refuse_jump(rows: FloatArray) -> None:
    """Check that a curve, rows of time and values (k, 1 + columns), can be repeated.

    Raises:
        ValueError: If it has one row, or its last values differ from the first by more than rounding.
    """
    if len(rows) < 2:
        raise ValueError("load curve: a curve of one row cannot be repeated")
    size = np.max(np.abs(rows[:, 1:]))
    if np.any(np.abs(rows[-1, 1:] - rows[0, 1:]) > 1e-9 * size):
        raise ValueError(
            f"load curve: a repeated curve must end with the value with which it begins, {rows[0, 1:].tolist()}, "
            f"but ends with {rows[-1, 1:].tolist()}; write a jump as a short ramp"
        )
