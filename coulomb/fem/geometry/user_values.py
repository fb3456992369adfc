"""User data, values or functions of place and time, evaluated such that a fault on one rank is an error on all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

import numpy as np

from ...arrays import BoolArray, FloatArray, in_words, is_of_ufl, real_numbers, short
from ...load_curve import LoadCurve

if TYPE_CHECKING:
    from mpi4py import MPI

Value = TypeVar("Value")

Field = Sequence[float] | Callable[[FloatArray], FloatArray]
"""A vector, or a function of x, shape (3, k), in metres, that returns vectors, shape (3, k), as `interpolate` of
DOLFINx takes it; or a fem.Constant, a fem.Function of any space, a fem.Expression, or an expression of UFL."""

Coefficient = float | Callable[[FloatArray], FloatArray]
"""A number, or a function of x, shape (3, k), in metres, that returns k numbers; or an object of DOLFINx or UFL, as
for `Field`."""

Amplitude = float | Callable[[float], float] | Sequence[tuple[float, float]] | LoadCurve
"""Factor of a load: a number, a function of time, a table of (time, factor), or a `LoadCurve`.

A table is linear between its rows, and constant before the first and after the last row; a `LoadCurve` may also be
periodic, or refuse times after its last row."""

Motion = Callable[[float], Sequence[float]] | Sequence[tuple[float, float, float, float]] | LoadCurve
"""A translation in metres: a function of time, a table of (time, x, y, z), interpolated as for `Amplitude`, or a
`LoadCurve` with three columns."""


_NO_VALUE: Final = 1e-12  # values of functions of time below this are rounding errors


def evaluate_amplitude(amplitude: Amplitude, time: float, what: str, name: str = "amplitude") -> float:
    """The factor at a time, in errors the `name` of `what`; tables are linear between rows and constant beyond.

    A value of a function below 1e-12 is a rounding error, as that of sin(pi t) at t = 1, and counts as 0: a step whose
    loads are rounding errors has contact forces that are rounding errors, and these never converge.

    Raises:
        ValueError: If a function fails or its value is not a finite number, the table's times do not increase, or a
            `LoadCurve` has ended.
    """
    if isinstance(amplitude, int | float):
        return float(amplitude)
    if is_of_ufl(amplitude):
        raise ValueError(
            f"{what}: the {name} must be a number, or a function or table of time, but is {short(amplitude)}: multiply "
            "what it is the factor of by it, or give lambda time: constant.value"
        )
    if callable(amplitude):
        try:
            value = float(real_numbers(amplitude(time)))
        except Exception as error:  # user functions may raise anything
            raise ValueError(f"{what}: the {name} failed at time {time:g}: {error}") from None
        if not np.isfinite(value):
            raise ValueError(f"{what}: the {name} at time {time:g} is {value}")
        return value if abs(value) >= _NO_VALUE else 0.0
    return float(_curve(amplitude, time, 1, f"{what}: {name}")[0])


def amplitude_entry(amplitude: Amplitude) -> dict[str, Any]:
    """An amplitude as in the tables of a case, for JSON: {"amplitude": rows (time, factor)}; empty for the factor 1."""
    if isinstance(amplitude, int | float):
        return {} if amplitude == 1.0 else {"amplitude": [[0.0, float(amplitude)]]}
    if callable(amplitude):
        return {"amplitude": "a function of time"}
    curve = amplitude if isinstance(amplitude, LoadCurve) else LoadCurve(*np.transpose(real_numbers(amplitude)))
    rows = curve.rows.tolist()
    return {"amplitude": rows if curve.after == "hold" else {"table": rows, "after": curve.after}}


def evaluate_motion(motion: Motion | None, time: float, what: str) -> FloatArray:
    """The translation at a time, shape (3,); zero without a motion; ValueError as of `evaluate_amplitude`."""
    if motion is None:
        return np.zeros(3)
    if callable(motion):
        try:
            value = real_numbers(motion(time)).copy()
        except Exception as error:  # user functions may raise anything
            raise ValueError(f"{what}: the motion failed at time {time:g}: {error}") from None
        if value.shape != (3,) or not np.all(np.isfinite(value)):
            raise ValueError(f"{what}: the motion at time {time:g} must be three finite numbers, but is {value}")
        return value
    return _curve(motion, time, 3, f"{what}: motion")


def _curve(table: LoadCurve | Sequence[Sequence[float]], time: float, columns: int, what: str) -> FloatArray:
    """The values of a table at a time, shape (columns,)."""
    if not isinstance(table, LoadCurve):
        try:
            rows = real_numbers(table)
        except (TypeError, ValueError):
            rows = np.empty((0, 0))
        if rows.ndim != 2 or rows.shape[0] == 0 or rows.shape[1] != 1 + columns or not np.all(np.isfinite(rows)):
            form = "[time, factor]" if columns == 1 else "[time, x, y, z]"
            raise ValueError(f"{what} must be a table of rows {form}, but is {table}")
        if np.any(np.diff(rows[:, 0]) <= 0.0):
            raise ValueError(f"{what}: the times of the table must increase, but are {rows[:, 0].tolist()}")
        table = LoadCurve(rows[:, 0], rows[:, 1:])
    if table.columns != columns:
        raise ValueError(f"{what}: the load curve must have {columns} column{'s'[: columns - 1]}, has {table.columns}")
    try:
        return table.at(time)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None


def of_place(value: object) -> bool:
    """Whether a value may change with the place: a function, or an object of DOLFINx or UFL."""
    return callable(value) or is_of_ufl(value)


def evaluated_by_ufl(value: Any, x: FloatArray, what: str, comm: MPI.Comm, shape: tuple[int, ...] = ()) -> Any:
    """An object of DOLFINx or UFL as a function of the points x (k, 3), of which it has the values; else the value
    itself; errors as of `evaluate_numbers`, also if it has another `shape`; collective."""
    if not is_of_ufl(value):
        return value
    from ..ufl_values import UflValues  # with DOLFINx, which other values do not need

    given = on_all_ranks(lambda: UflValues(value), what, comm)
    if given.shape != shape:
        needed = "three components are needed" if shape else "a number is needed"
        raise ValueError(f"{what}: {given.name} has values of shape {given.shape}; {needed}")
    if given.constant is not None:
        constant = np.multiply.outer(given.constant, np.ones(len(x)))
        return lambda _: constant
    points = np.concatenate(comm.allgather(x))
    near = on_all_ranks(lambda: given.cells.near(points), what, comm)
    outside = np.full(len(points), np.inf)
    np.minimum.at(outside, near.point, near.outside)
    outside = np.min(comm.allgather(outside), axis=0)
    if np.any(far := np.isinf(outside)):
        raise ValueError(f"{what}: {given.name} has no value at x = {first_place(points, far)}: its mesh is elsewhere")
    sums = comm.allgather(on_all_ranks(lambda: given.sums(points, near, outside), what, comm))
    total, count = (np.sum(one, axis=0) for one in zip(*sums, strict=True))
    first = sum(comm.allgather(len(x))[: comm.rank])
    mean = total / count[:, None]
    mean[np.abs(mean) <= _NO_VALUE * np.max(np.abs(mean), initial=0.0)] = 0.0  # no friction of -1e-17
    own = mean[first : first + len(x)]
    values = np.moveaxis(own.reshape(len(x), *given.shape), 0, -1)
    return lambda _: values


def evaluate_vectors(field: Field, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
    """Vectors (k, 3) of a field at points x (k, 3); ValueError on every rank if the function fails, or a value has not
    three finite components."""
    field = evaluated_by_ufl(field, x, what, comm, (3,))

    def evaluate() -> FloatArray:
        if callable(field):
            if len(x) == 0:
                return np.empty((0, 3))
            values = real_numbers(field(x.T.copy()))
            if values.shape != (3, len(x)):
                raise ValueError(f"the function must return shape (3, {len(x)}), but returned {values.shape}")
            return _finite(values.T, x)
        try:
            values = real_numbers(field)
        except (TypeError, ValueError):  # text, None, rows of different lengths
            values = np.empty(0)
        if values.shape != (3,):
            raise ValueError(
                f"the value must have three components, numbers, or be a function of x, but is {short(field)}"
            )
        return _finite(np.broadcast_to(values, (len(x), 3)), x)

    return on_all_ranks(evaluate, what, comm)


def evaluate_numbers(coefficient: Coefficient, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
    """Numbers >= 0 (k,) of a coefficient at points x (k, 3); ValueError on every rank if the function fails, or a value
    is negative or not finite."""
    coefficient = evaluated_by_ufl(coefficient, x, what, comm)

    def evaluate() -> FloatArray:
        values = _numbers(coefficient, x)
        bad = ~(np.isfinite(values) & (values >= 0.0))
        if np.any(bad) and callable(coefficient):
            raise ValueError(f"must be >= 0 everywhere, but is {values[np.argmax(bad)]} at x = {first_place(x, bad)}")
        return values

    return on_all_ranks(evaluate, what, comm)


def evaluate_signed_numbers(coefficient: Coefficient, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
    """Numbers of either sign (k,) of a coefficient at points x (k, 3); ValueError on every rank if the function fails,
    or a value is not finite."""
    coefficient = evaluated_by_ufl(coefficient, x, what, comm)

    def evaluate() -> FloatArray:
        values = _numbers(coefficient, x)
        _finite(values[:, None], x)
        return values

    return on_all_ranks(evaluate, what, comm)


def _numbers(coefficient: Coefficient, x: FloatArray) -> FloatArray:
    if not callable(coefficient):
        try:
            number = real_numbers(coefficient)
        except (TypeError, ValueError):
            number = np.empty(0)
        if number.shape:
            raise ValueError(f"must be a number or a function of x, but is {short(coefficient)}")
        return np.full(len(x), number)
    if len(x) == 0:
        return np.empty(0)
    values = real_numbers(coefficient(x.T.copy()))
    if values.shape not in ((), (len(x),)):
        raise ValueError(f"the function must return {len(x)} numbers, but returned shape {values.shape}")
    return np.broadcast_to(values, (len(x),)).copy()


def _finite(values: FloatArray, x: FloatArray) -> FloatArray:
    bad = ~np.all(np.isfinite(values), axis=1)
    if np.any(bad):
        raise ValueError(f"the value has entries that are not finite (first seen at x = {first_place(x, bad)})")
    return values


def first_place(x: FloatArray, where: BoolArray) -> str:
    """Coordinates of the first of the points x (k, 3) where a condition (k,) holds, for a message."""
    place = x[np.argmax(where)]
    return in_words(np.where(np.abs(place) < 1e-12 * np.max(np.abs(x)), 0.0, place))


class Refused(ValueError):
    """A face, foundation or function cannot be used at a place or time, on every rank: a load step may end there."""


def on_all_ranks(evaluate: Callable[[], Value], what: str, comm: MPI.Comm) -> Value:
    """The result of a call; or Refused on every rank with the first fault of any rank, after `what` if it is given."""
    fault = ""
    value: Value | None = None
    try:
        value = evaluate()
    except Exception as error:  # user functions may raise anything
        fault = str(error) or type(error).__name__
    faults = [text for text in comm.allgather(fault) if text]
    if faults:
        raise Refused(f"{what}: {faults[0]}" if what else faults[0])
    return cast(Value, value)


def on_every_rank(call: Callable[[], Value], what: str, comm: MPI.Comm) -> list[Value]:
    """The results of a call on all ranks, by rank; where it raises an exception, this goes on there, and the others
    raise a RuntimeError with its words after `what`."""
    value: Value | None = None
    fault: Exception | None = None
    try:
        value = call()
    except Exception as error:  # user functions may raise anything
        fault = error
    if comm.size > 1:
        results = comm.allgather((value, None if fault is None else f"{type(fault).__name__}: {fault}"))
    else:
        results = [(value, None)]
    if fault is not None:
        raise fault
    for rank, (_, said) in enumerate(results):
        if said is not None:
            raise RuntimeError(f"{what} failed on rank {rank}: {said}")
    return [cast(Value, result) for result, _ in results]


def same_on_all_ranks(arguments: Mapping[str, object], comm: MPI.Comm) -> None:
    """Refuse arguments that differ between ranks, before collective calls wait for each other for ever; collective.

    Numbers, texts, and fields of dataclasses are compared, entry by entry; of functions, arrays of the mesh's size and
    other objects only the type.

    Raises:
        ValueError: On every rank, with the first argument that differs, and its values.
    """
    if comm.size == 1:
        return
    mine = [entry for name, value in arguments.items() for entry in _entries(name, value)]
    first = comm.bcast(mine)
    pairs = [pair for pair in zip(first, mine, strict=False) if pair[0] != pair[1]]
    if not pairs and len(first) != len(mine):
        pairs = [(("the arguments", f"{len(first)} entries"), ("", f"{len(mine)}"))]
    of_ranks = comm.allgather(pairs[0] if pairs else None)
    for rank, pair in enumerate(of_ranks):
        if pair is not None:
            (name, there), (_, here) = pair
            raise ValueError(f"{name} must be the same on all ranks, but is {there} on rank 0, {here} on rank {rank}")


_COMPARED: Final = 64  # entries of an array up to which they are compared


def _entries(name: str, value: object) -> Iterator[tuple[str, str]]:
    """Names and texts of what can be compared of a value."""
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.size <= _COMPARED else f"an array of type {value.dtype}"
    if isinstance(value, Real):
        yield name, repr(float(value)).removesuffix(".0")
    elif isinstance(value, str) or value is None:
        yield name, repr(value)
    elif is_dataclass(value) and not isinstance(value, type):
        yield name, type(value).__name__
        for one in fields(value):
            if one.compare:
                yield from _entries(f"{name}.{one.name}", getattr(value, one.name))
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from _entries(f"{name}[{key!r}]", part)
    elif isinstance(value, Sequence):
        yield f"the number of entries of {name}", str(len(value))
        for number, part in enumerate(value):
            yield from _entries(f"{name}[{number}]", part)
    else:
        yield name, f"a {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"
