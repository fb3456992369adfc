"""Values of a case that are a field of a file, and the names of all files of a case."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Discriminator, Tag

from ..arrays import FloatArray
from .place import EXPRESSION, NUMBER, Expression, coefficient
from .values import FileName, Length, Name, Number, Table

if TYPE_CHECKING:
    from ..fem.geometry import Coefficient
    from ..fem.meshes import NodalField

OF_FILE = "a field of a file"

FILES = {"mesh": ("file", "facets", "cell_groups"), "temperature": ("file",)}
"""Keys whose values are names of files, by table."""

Place = tuple[str | int, ...]
"""A key in its tables, as ("contact", 0, "gap", "file")."""


class FieldTable(Table):
    """A number at each node of the mesh of a file: the file, its field, and metres per unit of length of the mesh."""

    file: FileName
    field: Name
    scale: Length = 1.0

    def at(self) -> Coefficient:
        """A function of place; the file is read when it is first called."""
        return _WhenNeeded(self)


class _WhenNeeded:
    """A field that is read when it is first evaluated: a check reports a missing file, and goes on."""

    def __init__(self, table: FieldTable):
        self._table = table

    def __call__(self, x: FloatArray) -> FloatArray:
        return self._field(x)

    @cached_property
    def _field(self) -> NodalField:
        from ..fem.meshes import NodalField

        return NodalField.from_file(self._table.file, self._table.field, self._table.scale)


def _kind(given: Any) -> str:
    if isinstance(given, dict | FieldTable):
        return OF_FILE
    return EXPRESSION if isinstance(given, str) else NUMBER


GapAt = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[Expression, Tag(EXPRESSION)] | Annotated[FieldTable, Tag(OF_FILE)],
    Discriminator(_kind),
]
"""A number, an expression, or a field of a file."""


def gap_of(given: float | str | FieldTable) -> Coefficient:
    """A gap in metres."""
    return given.at() if isinstance(given, FieldTable) else coefficient(given)


def named_files(tables: Mapping[str, Any]) -> dict[Place, str]:
    """The names of the files of a case, by their place.

    Args:
        tables: The tables of the case.
    """
    found: dict[Place, str] = {}
    for name, keys in FILES.items():
        table = tables.get(name)
        given = {key: table.get(key) for key in keys} if isinstance(table, Mapping) else {}
        found |= {(name, key): value for key, value in given.items() if isinstance(value, str)}
    bodies = tables.get("body")
    for number, table in enumerate(bodies if isinstance(bodies, list | tuple) else ()):
        of_body = {key: table.get(key) for key in FILES["mesh"]} if isinstance(table, Mapping) else {}
        found |= {("body", number, key): value for key, value in of_body.items() if isinstance(value, str)}
    contact = tables.get("contact")
    several = isinstance(contact, list | tuple)
    for number, table in enumerate(contact if isinstance(contact, list | tuple) else [contact]):
        gap = table.get("gap") if isinstance(table, Mapping) else None
        if isinstance(gap, Mapping) and isinstance(gap.get("file"), str):
            found["contact", *((number,) if several else ()), "gap", "file"] = gap["file"]
    return found


def rename_files(tables: dict[str, Any], names: Mapping[Place, str]) -> None:
    """Put other names of files in their places."""
    for (*tops, key), name in names.items():
        table: Any = tables
        for top in tops:
            table = table[top]
        table[key] = name
