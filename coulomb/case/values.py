"""Types of single values of a case, with wide bounds that exclude errors and overflow; and of values that depend on
place: a number, an expression as text, or a field of a file."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Final, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    ValidatorFunctionWrapHandler,
    model_serializer,
    model_validator,
)
from typing_extensions import TypeAliasType

import coulomb

from ..arrays import FloatArray
from .expression import expression

if TYPE_CHECKING:
    from ..fem.geometry import Coefficient
    from ..fem.geometry import Field as VectorField


TOLERANCE: Final = "_tolerance"
"""What is behind a key in the key of its tolerance."""

Tolerances = dict[str, float | tuple[float, ...]]


class Table(BaseModel):
    """A table of a case: other keys are refused, but KEY_tolerance beside a number or a list of numbers KEY.

    It is the tolerance of the number in its unit, or the list of those of each; `tolerances` has them by KEY.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    _tolerances: Tolerances = PrivateAttr(default_factory=dict)

    @model_validator(mode="wrap")
    @classmethod
    def _with_tolerances(cls, given: Any, validated: ValidatorFunctionWrapHandler) -> Self:
        of = {f"{key}{TOLERANCE}": key for key in given if key in cls.model_fields} if isinstance(given, dict) else {}
        of = {tolerance: key for tolerance, key in of.items() if tolerance in given}
        if not of:  # a tolerance without its key is another key
            return validated(given)
        table = validated({key: value for key, value in given.items() if key not in of})
        table._tolerances.update({key: _tolerance(tolerance, given, key) for tolerance, key in of.items()})
        return table

    @property
    def tolerances(self) -> Tolerances:
        return self._tolerances

    @model_serializer(mode="wrap")
    def _dumped(self, dumped: Any) -> dict[str, Any]:
        keys: dict[str, Any] = dumped(self)
        return keys | {f"{key}{TOLERANCE}": value for key, value in self._tolerances.items()}


def _tolerance(key: str, given: dict[str, Any], of: str) -> float | tuple[float, ...]:
    """That of a table, in the shape of the number or the list that it is `of`; ValueError if it has another."""
    value, tolerance = given[of], given[key]
    listed = isinstance(value, list | tuple)
    if not all(map(_is_number, value if listed else (value,))):
        raise ValueError(f"{key}: tolerances are of numbers and lists of numbers, which {of} is not")
    if listed != isinstance(tolerance, list | tuple) or (listed and len(tolerance) != len(value)):
        wanted = f"a list of {len(value)} numbers, one for each of {of}" if listed else f"one number, as {of}"
        raise ValueError(f"{key} should be {wanted}")
    each = tolerance if listed else (tolerance,)
    if not all(_is_number(one) and 0.0 <= one < np.inf for one in each) or not any(each):
        wanted = "numbers >= 0, not all 0" if listed else "a number > 0"
        raise ValueError(f"{key} should be {wanted}, in the unit of {of}")
    return tuple(map(float, each)) if listed else float(tolerance)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


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

# Of a type with a name pydantic makes the validator once, not at each of its places: 0.02 s of a start.
Number = TypeAliasType("Number", Annotated[float, _FINITE, _between(1e-60, 1e30, zero=True)])
"""Squares and products of a few of these neither overflow nor underflow."""

Length = Annotated[float, _POSITIVE, _between(1e-12, 1e12)]
"""Metres: a dimension or a unit of length."""

Clearance = Annotated[float, _NOT_NEGATIVE, _between(1e-12, 1e12, zero=True)]
"""Metres: the size of a gap, or 0."""

Duration = Annotated[float, _POSITIVE, _between(1e-30, 1e30)]
Young = Annotated[float, _POSITIVE, _between(1e-6, 1e24)]
Density = Annotated[float, _NOT_NEGATIVE, _between(1e-12, 1e12, zero=True)]
Expansion = Annotated[float, _FINITE, _between(1e-12, 1.0, zero=True)]
"""Thermal expansion in 1/K."""

Conductivity = Annotated[float, _POSITIVE, _between(1e-12, 1e12)]
"""Thermal conductivity in W/(m K)."""

Stiffness = Annotated[float, _NOT_NEGATIVE, _between(1e-12, 1e30, zero=True)]
Stress = Annotated[float, _NOT_NEGATIVE, _between(1e-30, 1e30, zero=True)]

ISOTROPIC, ORTHOTROPIC = "one coefficient", "two coefficients"
Friction = Annotated[float, _NOT_NEGATIVE, _between(1e-9, 1e3, zero=True)]
"""Smaller values are below the accuracy of an answer; larger ones are not physical."""

Speed = Annotated[float, _POSITIVE, _between(1e-30, 1e30)]
"""Metres per second."""

Vector = tuple[Number, Number, Number]


def _nonzero(vector: Vector) -> Vector:
    if not any(vector):
        raise ValueError("must not be zero")
    return vector


Direction = Annotated[Vector, AfterValidator(_nonzero)]

Cells = Annotated[int, Field(ge=1, le=1_000_000, strict=True)]
Steps = Annotated[int, Field(ge=1, le=100_000, strict=True)]
"""Load steps, each of which writes a directory."""

Rounds = Annotated[int, Field(ge=1, le=10_000, strict=True)]
GroupNumber = Annotated[int, Field(ge=-(2**31), lt=2**31, strict=True)]

ROWS: Final = 100_000
"""Maximum rows of a table in time, and load steps."""

TABLES: Final = 1_000
"""Maximum number of tables of one kind."""

Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
"""Name of a face or a group of cells."""

NODE_SET, NODES, PLACES = "the name of a set", "numbers of nodes", "places"
NodeNumber = Annotated[int, Field(ge=0, lt=2**53, strict=True)]


def _kind_of_nodes(given: Any) -> str:
    if isinstance(given, str) or not isinstance(given, list | tuple):
        return NODE_SET
    return PLACES if given and isinstance(given[0], list | tuple) else NODES


NodesValue = Annotated[
    Annotated[Name, Tag(NODE_SET)]
    | Annotated[tuple[NodeNumber | Name, ...], Field(min_length=1, max_length=ROWS), Tag(NODES)]
    | Annotated[tuple[Vector, ...], Field(min_length=1, max_length=ROWS), Tag(PLACES)],
    Discriminator(_kind_of_nodes),
]


def called_nodes(given: Any) -> str:
    """What nodes are called: the name of their set, or "nodes 11, 12 and 7 more", after the body of "body:11"; with a
    checksum of all where not all are named."""
    if not isinstance(given, list | tuple):
        return str(given)
    if given and isinstance(given[0], list | tuple):
        first = ", ".join(f"{x:g}" if isinstance(x, int | float) else str(x) for x in given[0])
        return f"nodes at ({first})" + (f" and {len(given) - 1} more places, {_checksum(given)}" if given[1:] else "")
    body, colon, _ = str(given[0]).rpartition(":")
    numbers = [str(node).rpartition(":")[2] for node in given]
    more = f" and {len(numbers) - 4} more, {_checksum(given)}" if len(numbers) > 5 else ""
    return f"{body}{colon}nodes {', '.join(numbers[:4] if more else numbers)}{more}"


def _checksum(given: Sequence[Any]) -> str:
    """That differs for other nodes, which may have the same first ones."""
    return f"{zlib.crc32(repr([list(one) if isinstance(one, tuple) else one for one in given]).encode()):08x}"


FileName = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_printable)]

# --- values that depend on place -------------------------------------------------------------------------------------

NUMBER, TWO_NUMBERS, EXPRESSION, FIELD = "a number", "two numbers", "an expression", "a field of a file"


def _expression(text: str) -> str:
    expression(text)
    return text


class FieldTable(Table):
    """A number at each node of the mesh of a file: the file, its field, and metres per unit of length of the mesh."""

    file: FileName
    field: Name
    scale: Length = 1.0

    def at(self) -> Coefficient:
        """A function of place; the file is read when it is first called: a check reports a missing one, and goes on."""

        @cache
        def read() -> coulomb.NodalField:

            return coulomb.NodalField.from_file(self.file, self.field, self.scale)

        return lambda x: read()(x)


def _kind(given: Any) -> str:
    return EXPRESSION if isinstance(given, str) else FIELD if isinstance(given, dict | FieldTable) else NUMBER


_OneKind = Discriminator(lambda given: EXPRESSION if isinstance(given, str) else NUMBER)
Expression = Annotated[str, AfterValidator(_expression)]

SpatialNumber = TypeAliasType(
    "SpatialNumber", Annotated[Annotated[Number, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)], _OneKind]
)
SpatialFriction = Annotated[Annotated[Friction, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)], _OneKind]
SpatialStress = Annotated[Annotated[Stress, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)], _OneKind]
SpatialSpeed = Annotated[Annotated[Speed, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)], _OneKind]
SpatialVector = tuple[SpatialNumber, SpatialNumber, SpatialNumber]

Closed = Annotated[
    Annotated[Clearance, Tag(NUMBER)] | Annotated[tuple[Clearance, Clearance], Tag(TWO_NUMBERS)],
    Discriminator(lambda given: TWO_NUMBERS if isinstance(given, list | tuple) else NUMBER),
]
"""The size of the gaps and penetrations that are closed, or one of each."""

SpatialGap = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)] | Annotated[FieldTable, Tag(FIELD)],
    Discriminator(_kind),
]


def coefficient(value: float | str | FieldTable) -> Coefficient:
    if isinstance(value, FieldTable):
        return value.at()
    return expression(value) if isinstance(value, str) else value


class _VectorOfPlace:
    """A vector of which components are expressions, `said` as it was given."""

    def __init__(self, value: tuple[float | str, float | str, float | str]):
        self.said = f"({', '.join(one if isinstance(one, str) else f'{one:g}' for one in value)})"
        self._components = [coefficient(component) for component in value]

    def __call__(self, x: FloatArray) -> FloatArray:
        return np.array([c(x) if callable(c) else np.full(x.shape[1], float(c)) for c in self._components])


def field(value: tuple[float | str, float | str, float | str]) -> VectorField:
    """A vector, or the function of place if a component is an expression."""
    numbers = [component for component in value if not isinstance(component, str)]
    if len(numbers) == 3:
        return tuple(numbers)
    return _VectorOfPlace(value)


class AlongAxes(Table):
    """Components along x, y and z, or about them; None where nothing is given."""

    x: Number | None = None
    y: Number | None = None
    z: Number | None = None

    @property
    def components(self) -> tuple[float | None, float | None, float | None]:
        return self.x, self.y, self.z
