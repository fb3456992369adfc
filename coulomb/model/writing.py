"""The writer behind `Solution.write`, supplied by the package: the model knows no file format.

`coulomb/__init__.py`, which runs before any module of the package, calls `supply` with that of `coulomb.io`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from .solution import Solution


class Writer(Protocol):
    """Writes a solution into a directory; collective."""

    def __call__(self, solution: Solution, directory: str | Path) -> object: ...


_supplied: list[Writer] = []


def supply(writer: Writer) -> None:
    """Set the writer of `Solution.write`."""
    _supplied[:] = [writer]


def supplied() -> Writer:
    """The writer in use."""
    return _supplied[0]
