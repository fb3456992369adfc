"""The numbers of a case that have tolerances, KEY_tolerance beside KEY, by their places."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from .files import KeyPath
from .values import Table

_OTHERS: Final = ("auto_contact", "history", "output", "probe", "solver", "units")
"""Tables whose numbers are no inputs of the problem, or of how it is found."""


def tolerances(table: Table, path: KeyPath = ()) -> Iterator[tuple[KeyPath, float]]:
    """The places of numbers, or of all of the numbers of a place, with their tolerances."""
    for key, given in table.tolerances.items():
        several = enumerate(given) if isinstance(given, tuple) else ()
        yield from (((*path, key, number), one) for number, one in several if one > 0.0)
        if not isinstance(given, tuple):
            yield (*path, key), given
    for key, value in table:
        if isinstance(value, Table):
            yield from tolerances(value, (*path, key))
        for number, one in enumerate(value) if isinstance(value, tuple) else ():
            if isinstance(one, Table):
                yield from tolerances(one, (*path, key, number))


def place_of(case: Table, name: str) -> KeyPath:
    """The place of a number, or of the numbers of a list, that is an input of the problem, as it is `called`; () if
    there is none."""
    path = tuple(int(key) if key.isdecimal() else key for key in name.split("."))
    try:
        found = isinstance(number_at(case, path), float) and path[0] not in _OTHERS
    except (AttributeError, IndexError, TypeError, ValueError):
        found = False
    return path if found else ()


def refuse_others(case: Table) -> None:
    """ValueError if there is a tolerance of what is no input."""
    for path, _ in tolerances(case):
        if path[0] in _OTHERS or isinstance(number_at(case, path), int):
            raise ValueError(f"{called(path)}: is no input of the problem: it has no derivatives, and no tolerance")


def number_at(case: Table, path: KeyPath) -> Any:
    """What is at a place; of a list that was given as one number, this."""
    value: Any = case
    for key in path:
        value = value[int(key)] if isinstance(value, tuple) else getattr(value, str(key))
    return value[0] if isinstance(value, tuple) else value


def called(path: KeyPath) -> str:
    """A place as it is called: "contact.0.friction"."""
    return ".".join(map(str, path))
