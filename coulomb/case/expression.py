"""Functions of place as text: "-1e6*(1 + x/2)", of x, y, z in metres.

Text of a case file must not be able to run code.  The text is parsed by Python's `ast`, and only the nodes below are
evaluated; nothing is passed to `eval`.  Libraries were considered: numexpr 2.8.4 of Debian 12 passes the text to
`eval`, later versions search it for forbidden patterns before; simpleeval restricts general Python (attributes,
indices, text, assignments), of which an expression needs nothing, and its `and`, `or`, `if` and powers do not work with
arrays.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from ..arrays import FloatArray, in_words

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
