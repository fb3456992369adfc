"""The writer behind `Solution.write`, supplied by the package: the model knows no file format.

`coulomb/__init__.py`, which runs before any module of the package, calls `supply` with that of `coulomb.io`.
"""

from __future__ import annotations

from collections.abc import Callable

Writer = Callable[..., object]
"""Writes a `Solution`, its first argument, into a directory, its second, with the user's functions, its third;
collective."""

_supplied: list[Writer] = []


def supply(writer: Writer) -> None:
    """Set the writer of `Solution.write`."""
    _supplied[:] = [writer]


def supplied() -> Writer:
    """The writer in use."""
    return _supplied[0]
