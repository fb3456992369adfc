"""Rows of whole numbers, such as the corners of facets: the distinct ones, where some are among others, and sets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ...arrays import IntArray


def distinct(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Where each distinct row of whole numbers >= 0 (k, m) is first, in their order, and the number of every row among
    them, shape (k,): as `np.unique`, in less than half its time."""
    number, count = rows[:, 0], rows.max(initial=0) + 1
    for column in rows.T[1:]:
        _, first, number = np.unique(number * count + column, return_index=True, return_inverse=True)
    return first, number


def places(rows: IntArray, some: IntArray) -> IntArray:
    """Where some rows are among distinct rows."""
    first, number = distinct(np.vstack([rows, some]))
    return first[number[len(rows) :]]


def sets(count: int, groups: Mapping[str, IntArray]) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Of so many things with groups of some, the number of the set of groups that each is in, shape (count,), and which
    groups are in each set, shape (sets, groups)."""
    member = np.zeros((count, len(groups)), dtype=bool)
    for k, some in enumerate(groups.values()):
        member[some, k] = True
    first, number = distinct(np.column_stack([np.zeros((count, 2), dtype=np.int64), member]))
    return number, member[first]
