"""Types of single values of a case, with wide bounds that exclude errors and overflow; and of values that depend on
place: a number, an expression as text, or a field of a file."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from functools import cache, lru_cache, reduce
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Discriminator, Field, Tag

from ..arrays import FloatArray, in_words

if TYPE_CHECKING:
    from ..fem.geometry import Coefficient
    from ..fem.geometry import Field as VectorField
    from ..fem.meshes import NodalField


LONGEST, DEEPEST = 1000, 100
"""Maximum number of characters, and of operations inside each other."""

_PLACE = ("x", "y", "z")
_CONSTANTS = {"pi": np.float64(np.pi)}

_FUNCTIONS: dict[str, tuple[Callable[..., Any], int, int]] = {
    **{name: (getattr(np, name), 1, 1) for name in ("sqrt", "sin", "cos", "tan", "exp", "log", "tanh", "abs")},
    "atan2": (np.arctan2, 2, 2),
    "min": (lambda *values: reduce(np.minimum, values), 2, 20),
    "max": (lambda *values: reduce(np.maximum, values), 2, 20),
    "where": (np.where, 3, 3),
}
"""Every function with the least and the largest number of its arguments."""

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    **{ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv},
    **{ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: np.logical_not},
    **{ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge},
    **{ast.And: np.logical_and, ast.Or: np.logical_or},
}

ALLOWED = (
    f"numbers, {', '.join(_PLACE)} (metres), {', '.join(_CONSTANTS)}, + - * / **, parentheses, "
    f"< <= > >=, and, or, not, {', '.join(_FUNCTIONS)}"
)
"""What an expression may consist of, for messages and documentation."""


class Expression:
    """A function of place; ValueError if the text is no expression, or contains what is not allowed."""

    def __init__(self, text: str):
        self.text = text
        self._tree = _parsed(text)
        _refuse(self._tree, text)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Values at points x (3, k) in metres, shape (k,); ValueError if one is not finite."""
        with np.errstate(all="ignore"):
            values = np.asarray(_value(self._tree, dict(zip(_PLACE, x, strict=True))), dtype=np.float64)
        values = np.broadcast_to(values, x.shape[1:]).copy()
        bad = ~np.isfinite(values)
        if np.any(bad):
            place = in_words(x[:, np.argmax(bad)])
            raise ValueError(f"the expression {self.text!r} is {values[np.argmax(bad)]} at ({place})")
        return values


expression = lru_cache(maxsize=1000)(Expression)


def _parsed(text: str) -> ast.expr:
    fault = ""
    if len(text) > LONGEST:
        raise ValueError(f"should be an expression of at most {LONGEST} characters")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        fault = str(error.msg)
    except (ValueError, RecursionError, MemoryError):  # null characters; nested without end
        pass
    raise ValueError(f"is not an expression{f' ({fault})' if fault else ''}; allowed are {ALLOWED}")


def _refuse(node: ast.expr, text: str, depth: int = 0) -> None:
    """Check that a tree has only what is allowed."""
    if depth > DEEPEST:
        raise ValueError(f"should be an expression with at most {DEEPEST} operations inside each other")
    said = ast.get_source_segment(text.strip(), node) or type(node).__name__
    parts: list[ast.expr] = []
    fault = f"{said[:80]!r} is not allowed in an expression"
    match node:
        case ast.Constant(value=bool() | complex() | str()):
            pass
        case ast.Constant(value=int() | float()):
            return
        case ast.Name(id=name):
            if name in _PLACE or name in _CONSTANTS:
                return
            fault = f"{name!r} is not known in an expression"
            if name in ("t", "time"):
                fault += " of place (time is a matter of the amplitude)"
        case ast.Call(func=ast.Name(id=name), args=parts, keywords=[]):
            if name in _FUNCTIONS:
                _, least, most = _FUNCTIONS[name]
                fault = "" if least <= len(parts) <= most else f"{name} needs {least} values, but has {len(parts)}"
            else:
                fault = f"{name!r} is not a known function of an expression"
        case ast.BinOp(op=op, left=left, right=right):
            parts, fault = [left, right], "" if type(op) in _OPERATORS else fault
            if isinstance(op, ast.BitXor):
                fault = f"{said[:80]!r}: a power is written **"
        case ast.UnaryOp(op=op, operand=operand):
            parts, fault = [operand], "" if type(op) in _OPERATORS else fault
        case ast.BoolOp(values=parts):
            fault = ""
        case ast.Compare(left=left, ops=ops, comparators=others):
            parts, fault = [left, *others], "" if all(type(op) in _OPERATORS for op in ops) else fault
    if fault:
        raise ValueError(f"{fault}; allowed are {ALLOWED}")
    for part in parts:
        _refuse(part, text, depth + 1)


def _value(node: ast.expr, place: dict[str, FloatArray]) -> Any:
    """The value of a tree that has been checked."""
    match node:
        case ast.Constant(value=number):
            return np.float64(str(number))  # so that powers overflow to infinity, as those of arrays
        case ast.Name(id=name):
            return place[name] if name in place else _CONSTANTS[name]
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name][0](*(_value(part, place) for part in args))
        case ast.BinOp(op=op, left=left, right=right):
            a, b = (1.0 * _value(part, place) for part in (left, right))  # a comparison counts as 0 or 1
            return _OPERATORS[type(op)](a, b)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return np.logical_not(_value(operand, place))
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATORS[type(op)](1.0 * _value(operand, place))
        case ast.BoolOp(op=op, values=values):
            return reduce(_OPERATORS[type(op)], (_value(part, place) for part in values))
        case ast.Compare(left=left, ops=ops, comparators=others):
            sides = [_value(part, place) for part in (left, *others)]
            held = [_OPERATORS[type(op)](a, b) for op, a, b in zip(ops, sides, sides[1:], strict=False)]
            return reduce(np.logical_and, held)
    raise AssertionError(ast.dump(node))


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

ROWS = 100_000
"""Maximum rows of a table in time, and load steps."""

TABLES = 1_000
"""Maximum number of tables of one kind."""

Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
"""Name of a face or a group of cells."""

FileName = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_printable)]

# --- values that depend on place -------------------------------------------------------------------------------------

NUMBER, EXPRESSION, FIELD = "a number", "an expression", "a field of a file"


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
        def read() -> NodalField:
            from ..fem.meshes import NodalField

            return NodalField.from_file(self.file, self.field, self.scale)

        return lambda x: read()(x)


def _kind(given: Any) -> str:
    return EXPRESSION if isinstance(given, str) else FIELD if isinstance(given, dict | FieldTable) else NUMBER


_OneKind = Discriminator(lambda given: EXPRESSION if isinstance(given, str) else NUMBER)
_ExpressionText = Annotated[str, AfterValidator(_expression)]

SpatialNumber = Annotated[Annotated[Number, Tag(NUMBER)] | Annotated[_ExpressionText, Tag(EXPRESSION)], _OneKind]
SpatialFriction = Annotated[Annotated[Friction, Tag(NUMBER)] | Annotated[_ExpressionText, Tag(EXPRESSION)], _OneKind]
SpatialStress = Annotated[Annotated[Stress, Tag(NUMBER)] | Annotated[_ExpressionText, Tag(EXPRESSION)], _OneKind]
SpatialSpeed = Annotated[Annotated[Speed, Tag(NUMBER)] | Annotated[_ExpressionText, Tag(EXPRESSION)], _OneKind]
SpatialVector = tuple[SpatialNumber, SpatialNumber, SpatialNumber]
SpatialGap = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[_ExpressionText, Tag(EXPRESSION)] | Annotated[FieldTable, Tag(FIELD)],
    Discriminator(_kind),
]


def coefficient(value: float | str | FieldTable) -> Coefficient:
    if isinstance(value, FieldTable):
        return value.at()
    return expression(value) if isinstance(value, str) else value


def field(value: tuple[float | str, float | str, float | str]) -> VectorField:
    """A vector, or the function of place if a component is an expression."""
    numbers = [component for component in value if not isinstance(component, str)]
    if len(numbers) == 3:
        return tuple(numbers)
    components = [coefficient(component) for component in value]

    def at(x: FloatArray) -> FloatArray:
        return np.array([c(x) if callable(c) else np.full(x.shape[1], float(c)) for c in components])

    return at
