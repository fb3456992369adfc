"""The array type of all packages, and what a number is among the user's values."""

from collections.abc import Iterable
from typing import Any, cast

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating[Any]]
"""Double precision; written so that numpy 1 and 2 infer it alike."""

IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]  # DOLFINx's numbers on this rank
BoolArray = npt.NDArray[np.bool_]


def as_list(values: npt.NDArray[Any]) -> list[Any]:
    """An array with at least one axis as a list; types of `tolist` depend on the version of NumPy."""
    return cast(list[Any], values.tolist())


def is_of_ufl(value: object) -> bool:
    """Whether a value is an expression of UFL, or an object of DOLFINx that stands for one."""
    return hasattr(value, "ufl_shape") or hasattr(value, "ufl_expression")


def is_number(value: object, least: float = 0.0) -> bool:
    """Whether a value is one finite number, not smaller than `least`; a text is none, nor is
    a constant of UFL, of which float() calls itself for ever."""
    if isinstance(value, str | bytes) or is_of_ufl(value) or np.ndim(cast(npt.ArrayLike, value)) != 0:
        return False
    try:
        number = float(cast(float, value))
    except (TypeError, ValueError):
        return False
    return bool(np.isfinite(number)) and number >= least


def real_numbers(values: object) -> FloatArray:
    """An array of double precision; ValueError for texts and None, which NumPy would take for numbers, for complex
    numbers, of which it would drop a part, and for expressions of UFL, of which float() calls itself for ever."""
    if _has_ufl(values):
        raise ValueError("the values must be numbers, but are expressions of UFL; a fem.Constant has one in .value")
    array = np.asarray(values)
    if np.iscomplexobj(array):
        raise ValueError("the values must be real numbers, but are complex")
    if array.dtype.kind in "USO" and any(one is None or isinstance(one, str) for one in array.flat):
        raise ValueError("the values must be numbers, but are texts or None")
    return np.asarray(array, dtype=np.float64)


def _has_ufl(value: object) -> bool:
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.dtype == object and value.ndim):
        return any(map(_has_ufl, value))
    return is_of_ufl(value)


def short(value: object) -> str:
    """What a value is, in words that are the same on all ranks."""
    text = repr(value)
    return text if len(text) <= 60 and " at 0x" not in text else f"a {type(value).__name__}"


def squares(y: FloatArray) -> FloatArray:
    """|y|^2 of pairs (m, 2), shape (m,)."""
    return y[:, 0] ** 2 + y[:, 1] ** 2


def distinct(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Where each distinct row of whole numbers >= 0 (k, m) is first, in their order, and the number of every row among
    them, shape (k,): as `np.unique`, in less than half its time."""
    number, count = rows[:, 0], rows.max(initial=0) + 1
    for column in rows.T[1:]:
        _, first, number = np.unique(number * count + column, return_index=True, return_inverse=True)
    return first, number


def rows_among(rows: IntArray, some: IntArray) -> BoolArray:
    """Which of some rows of whole numbers >= 0 are among others, shape (k,)."""
    number = distinct(np.vstack([rows, some]))[1]
    return np.isin(number[len(rows) :], number[: len(rows)])


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) over their lengths; 0 remains."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def in_words(place: Iterable[float]) -> str:
    """Coordinates for a message: "0.5, 0, 1.25"."""
    return ", ".join(f"{value:.6g}" for value in place)


def rows_of(known: IntArray, some: IntArray) -> IntArray:
    """Where some numbers (k,) are among known ones (m,), each of which is once; shape (k,)."""
    order = np.argsort(known)
    return order[np.searchsorted(known, some, sorter=order)]
