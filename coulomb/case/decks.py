"""Input files of CalculiX and Abaqus as cases, read on one rank."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..ranks import launched, on_rank_0

if TYPE_CHECKING:
    from ..decks.tables import Translation


def is_deck(path: str | Path) -> bool:
    """Whether a file is an input file of CalculiX or Abaqus, by the end of its name."""
    return Path(path).suffix.lower() == ".inp"


def read_deck(path: str | Path, ignore: Sequence[str] = (), large: bool = False) -> Translation:
    """What an input file of CalculiX or Abaqus is as a case; rank 0 reads.

    Args:
        ignore: The cards that are left out, by keyword.
        large: For large motions, in load steps.

    Raises:
        ValueError: On every rank, if it, or a file that it includes, cannot be read or is damaged.
    """
    from ..decks.tables import translate

    try:
        return on_rank_0(launched(), lambda: translate(str(path), ignore, large))
    except OSError as error:
        raise ValueError(f"{error.filename or path}: cannot be read: {error.strerror or error}") from None
