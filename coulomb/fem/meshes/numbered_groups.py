"""Groups of facets or cells that a file marks by numbers, and the names a user gives them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .mesh_file import IntArray


def titles(where: str, present: list[int], names: Mapping[str, int], key: str) -> dict[str, int]:
    """Every number that occurs, by its name, or by the number itself, as in "3".

    Args:
        where: The file, for messages.
        present: The numbers.
        names: Names with their numbers.
        key: Name of the argument `names` in messages.

    Raises:
        ValueError: If a name has a number that does not occur.
    """
    for name, number in names.items():
        if number not in present:
            listed = ", ".join(map(str, present))
            raise ValueError(f"{where}: {key} has {name!r} = {number}, but the numbers there are {listed}")
    title = {number: name for name, number in names.items()}
    return {title.get(number, str(number)): number for number in present}


def members_by_name(where: str, numbers: IntArray, names: Mapping[str, int], key: str) -> dict[str, IntArray]:
    """The positions of every number, by the name of the number, or by the number itself, as in "3".

    Args:
        where: The file, for messages.
        numbers: The number of every facet or cell.
        names: Names with their numbers.
        key: Name of the argument `names` in messages.

    Raises:
        ValueError: If a name has a number that does not occur.
    """
    present: list[int] = list(map(int, np.unique(numbers)))
    return {name: np.flatnonzero(numbers == number) for name, number in titles(where, present, names, key).items()}


def only_set(where: str, sets: list[str]) -> str:
    """The one set of numbers to use.

    Raises:
        ValueError: If there are several without a known order of preference.
    """
    if len(sets) > 1:  # meshio writes gmsh's own numbers beside the physical ones
        sets = [name for name in sets if name == "gmsh:physical"] or sets
    if len(sets) > 1:
        raise ValueError(f"{where}: has several sets of numbers ({', '.join(sets)}), but needs one; write one only")
    return sets[0]
