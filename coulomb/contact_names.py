"""Names of contacts in files and tables: a face that is in several contacts has one for each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

AGAINST = " against "
"""Between the names of a face and of that opposite, where a face is in several contacts."""


def side_names(contacts: Iterable[tuple[str, str | None]]) -> list[tuple[str, str | None]]:
    """Names in files of the two sides of every contact: the faces, or of one in several contacts "FACE against OTHER".

    Args:
        contacts: Of every contact its face, and that opposite; None against a foundation.
    """
    given = list(contacts)
    count = Counter(face for pair in given for face in pair)

    def name(face: str, other: str | None) -> str:
        return face if other is None or count[face] == 1 else f"{face}{AGAINST}{other}"

    return [(name(face, other), None if other is None else name(other, face)) for face, other in given]


def sides_of(faces: Iterable[Mapping[str, Any]]) -> list[tuple[str, str | None]]:
    """`side_names` of the entries `faces` of a summary."""
    return side_names((face["faces"][0], face.get("against")) for face in faces)


def named_faces(faces: Sequence[Mapping[str, Any]]) -> list[tuple[str, Mapping[str, Any]]]:
    """Name (`side_names`) and entry of every contact in the entries `faces` of a summary."""
    return [(name, face) for (name, _), face in zip(sides_of(faces), faces, strict=True)]


def normal_forces(row: Mapping[str, Any]) -> dict[str, Any]:
    """Normal force of every contact in a line of history.csv, newtons, by its name, of the only one by ""."""
    end = "normal_force"
    if end in row:
        return {"": row[end]}
    return {name.removesuffix(f"_{end}"): value for name, value in row.items() if name.endswith(f"_{end}")}
