"""Values of a case that may depend on place: a number, or an expression as text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, Discriminator, Tag

from ..arrays import FloatArray
from .expression import expression
from .values import Friction, Number, Speed, Stress

if TYPE_CHECKING:
    from ..fem.geometry import Coefficient, Field

NUMBER, EXPRESSION = "a number", "an expression"


def _expression(text: str) -> str:
    """The text as it stands, if it is an expression."""
    expression(text)
    return text


def _kind(given: Any) -> str:
    return EXPRESSION if isinstance(given, str) else NUMBER


Expression = Annotated[str, AfterValidator(_expression)]

NumberAt = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)],
    Discriminator(_kind),
]
FrictionAt = Annotated[
    Annotated[Friction, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)],
    Discriminator(_kind),
]
StressAt = Annotated[
    Annotated[Stress, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)],
    Discriminator(_kind),
]
SpeedAt = Annotated[
    Annotated[Speed, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)],
    Discriminator(_kind),
]
VectorAt = tuple[NumberAt, NumberAt, NumberAt]


def coefficient(value: float | str) -> Coefficient:
    """A number, or the function of place that a text describes."""
    return expression(value) if isinstance(value, str) else value


def field(value: tuple[float | str, float | str, float | str]) -> Field:
    """A vector, or the function of place if a component is an expression."""
    numbers = [component for component in value if not isinstance(component, str)]
    if len(numbers) == 3:
        return tuple(numbers)
    components = [coefficient(component) for component in value]

    def at(x: FloatArray) -> FloatArray:
        return np.array([c(x) if callable(c) else np.full(x.shape[1], float(c)) for c in components])

    return at
