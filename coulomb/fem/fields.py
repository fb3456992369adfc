"""What a user gives as a value or as a function of place, evaluated so that a fault on one rank is an error on all."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray

Field = Sequence[float] | Callable[[FloatArray], FloatArray]
"""A vector, or a function of x, shape (3, k), in metres, that returns vectors, shape (3, k)."""

Coefficient = float | Callable[[FloatArray], FloatArray]
"""A number, or a function of x, shape (3, k), in metres, that returns k numbers."""


def evaluate_vectors(field: Field, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
    """Vectors (k, 3) of a field at the points x (k, 3).

    Raises:
        ValueError: On every rank, if a function fails, or a value has not three finite components, on any.
    """

    def evaluate() -> FloatArray:
        if callable(field):
            if len(x) == 0:
                return np.empty((0, 3))
            values = np.asarray(field(x.T.copy()), dtype=np.float64)
            if values.shape != (3, len(x)):
                raise ValueError(f"the function must return shape (3, {len(x)}), but returned {values.shape}")
            return _finite(values.T, x)
        values = np.asarray(field, dtype=np.float64)
        if values.shape != (3,):
            raise ValueError(f"the value must have three components, but is {field!r}")
        return _finite(np.broadcast_to(values, (len(x), 3)), x)

    return _on_all(evaluate, what, comm)


def evaluate_numbers(coefficient: Coefficient, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
    """Numbers >= 0 (k,) of a coefficient at the points x (k, 3).

    Raises:
        ValueError: On every rank, if a function fails, or a value is negative or not finite, on any.
    """

    def evaluate() -> FloatArray:
        if not callable(coefficient):
            return np.full(len(x), float(coefficient))
        if len(x) == 0:
            return np.empty(0)
        values = np.asarray(coefficient(x.T.copy()), dtype=np.float64)
        if values.shape not in ((), (len(x),)):
            raise ValueError(f"the function must return {len(x)} numbers, but returned shape {values.shape}")
        values = np.broadcast_to(values, (len(x),)).copy()
        bad = ~(np.isfinite(values) & (values >= 0.0))
        if np.any(bad):
            raise ValueError(f"must be >= 0 everywhere, but is {values[np.argmax(bad)]} at x = {_place(x, bad)}")
        return values

    return _on_all(evaluate, what, comm)


def _finite(values: FloatArray, x: FloatArray) -> FloatArray:
    bad = ~np.all(np.isfinite(values), axis=1)
    if np.any(bad):
        raise ValueError(f"the value has entries that are not finite (first seen at x = {_place(x, bad)})")
    return values


def _place(x: FloatArray, where: npt.NDArray[np.bool_]) -> str:
    return ", ".join(f"{c:.6g}" for c in x[np.argmax(where)])


def _on_all(evaluate: Callable[[], FloatArray], what: str, comm: MPI.Comm) -> FloatArray:
    """What it returns; or an error on every rank, with the first fault of any."""
    fault = ""
    values: FloatArray = np.empty(0)
    try:
        values = evaluate()
    except Exception as error:  # whatever a user's function raises
        fault = str(error) or type(error).__name__
    faults = [text for text in comm.allgather(fault) if text]
    if faults:
        raise ValueError(f"{what}: {faults[0]}")
    return values
