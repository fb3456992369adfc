"""Settings of the solvers: values whose numbers are checked in one place."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Any


def within(interval: str, default: Any) -> Any:
    """A field of `Settings` with a default: a number, or a tuple of numbers, within an interval such as "(0, 1]", whose
    ends are numbers or names of other fields."""
    return field(default=default, metadata={"within": interval})


@dataclass(frozen=True)
class Settings:
    """Base of values whose numbers are within intervals.

    Raises:
        ValueError: If a field is not a number within its interval, or not an integer where that is asked for.
    """

    def __post_init__(self) -> None:
        for one in fields(self):
            given, interval, kind = getattr(self, one.name), one.metadata.get("within"), str(one.type)
            if interval is None or (given is None and "None" in kind):
                continue
            low, high = (self._end(end) for end in interval[1:-1].split(", "))
            values = given if kind.startswith("tuple") and isinstance(given, tuple) else (given,)
            if not values or not all(
                isinstance(value, Integral if kind == "int" else Real)
                and not isinstance(value, bool)
                and (low < value or (interval[0] == "[" and low == value))
                and (value < high or (interval[-1] == "]" and value == high))
                for value in values
            ):
                must = _in_words(interval) + (", or None" if "None" in kind else "")
                what = "an integer " if kind == "int" else ""
                raise ValueError(f"{type(self).__name__}: {one.name} must be {what}{must}, but is {given!r}")

    def _end(self, end: str) -> Any:
        """A number, or the value of another field."""
        return getattr(self, end) if hasattr(self, end) else float(end)


def _in_words(interval: str) -> str:
    low, high = interval[1:-1].split(", ")
    if high == "inf":
        return f"> {low}" if interval[0] == "(" else f"at least {low}"
    return f"in {interval}"
