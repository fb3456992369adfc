"""Types of single values of a case, with wide bounds that exclude errors and overflow."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class Table(BaseModel):
    """A table of a case: other keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def _between(low: float, high: float, zero: bool = False) -> AfterValidator:
    """Magnitudes from `low` to `high`, and 0 if it is allowed."""

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
"""Squares and products of a few of these neither overflow nor underflow."""

Length = Annotated[float, _POSITIVE, _between(1e-12, 1e12)]
"""Metres: a dimension or a unit of length."""

Clearance = Annotated[float, _NOT_NEGATIVE, _between(1e-12, 1e12, zero=True)]
"""Metres: the size of a gap, or 0."""

Duration = Annotated[float, _POSITIVE, _between(1e-30, 1e30)]
Young = Annotated[float, _POSITIVE, _between(1e-6, 1e24)]
Density = Annotated[float, _POSITIVE, _between(1e-12, 1e12)]
Expansion = Annotated[float, _FINITE, _between(1e-12, 1.0, zero=True)]
"""Thermal expansion in 1/K."""

Stiffness = Annotated[float, _NOT_NEGATIVE, _between(1e-12, 1e30, zero=True)]
Stress = Annotated[float, _NOT_NEGATIVE, _between(1e-30, 1e30, zero=True)]

ISOTROPIC, ORTHOTROPIC = "one coefficient", "two coefficients"
Friction = Annotated[float, _NOT_NEGATIVE, _between(1e-9, 1e3, zero=True)]
"""Smaller values are below the accuracy of an answer; larger ones are not physical."""

Speed = Annotated[float, _POSITIVE, _between(1e-30, 1e30)]
"""Metres per second."""

Vector = tuple[Number, Number, Number]

Cells = Annotated[int, Field(ge=1, le=1_000_000, strict=True)]
Steps = Annotated[int, Field(ge=1, le=100_000, strict=True)]
"""Load steps, each of which writes a directory."""

Rounds = Annotated[int, Field(ge=1, le=10_000, strict=True)]
GroupNumber = Annotated[int, Field(ge=-(2**31), lt=2**31, strict=True)]

ROWS = 100_000
"""Maximum rows of a table in time, and load steps."""

TABLES = 1_000
"""Maximum number of tables of one kind."""

Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
"""Name of a face or a group of cells."""

FileName = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_printable)]
