"""What a single value of a case may be: wide bounds, beyond which nobody means what he writes, or can compute it."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field


def _between(low: float, high: float, zero: bool = False) -> AfterValidator:
    """Sizes from `low` to `high`; and 0 where that means something."""

    def check(value: float) -> float:
        if not (low <= abs(value) <= high or (zero and value == 0.0)):
            raise ValueError(f"should be {'0, or ' if zero else ''}from {low:g} to {high:g} in size")
        return value

    return AfterValidator(check)


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("should have no control characters")
    return text


_FINITE = Field(allow_inf_nan=False, strict=True)
_NOT_NEGATIVE = Field(ge=0.0, allow_inf_nan=False, strict=True)
_POSITIVE = Field(gt=0.0, allow_inf_nan=False, strict=True)

Number = Annotated[float, _FINITE, _between(1e-60, 1e30, zero=True)]
"""Squares and products of a few of these neither overflow nor vanish."""

Length = Annotated[float, _POSITIVE, _between(1e-12, 1e12)]
"""Metres, of a body or of a unit of length."""

Duration = Annotated[float, _POSITIVE, _between(1e-30, 1e30)]
Young = Annotated[float, _POSITIVE, _between(1e-6, 1e24)]
Stiffness = Annotated[float, _NOT_NEGATIVE, _between(1e-12, 1e30, zero=True)]
Stress = Annotated[float, _NOT_NEGATIVE, _between(1e-30, 1e30, zero=True)]

Friction = Annotated[float, _NOT_NEGATIVE, _between(1e-9, 1e3, zero=True)]
"""Less than that is nothing beside the accuracy of an answer, more is glue."""

Vector = tuple[Number, Number, Number]

Cells = Annotated[int, Field(ge=1, le=1_000_000, strict=True)]
Steps = Annotated[int, Field(ge=1, le=100_000, strict=True)]
"""Load steps: each leaves a directory with its files."""

Rounds = Annotated[int, Field(ge=1, le=10_000, strict=True)]
GroupNumber = Annotated[int, Field(ge=-(2**31), lt=2**31, strict=True)]

ROWS = 100_000
"""Rows of a table in time, and load steps."""

TABLES = 1_000
"""Tables of one kind: clamps, loads, regions."""

Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
"""Of a face or a group of cells."""

FileName = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_printable)]

AmplitudeTable = Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1, max_length=ROWS)]
"""Rows [time, factor]: what a load is multiplied by in the course of a history; linear in between, before the first
row and after the last as there."""
