"""The cards of an input file of CalculiX or Abaqus: keyword lines with their parameters, and the data lines below.

Blanks and case do not count, in names neither; `**` begins a comment; `*INCLUDE` is followed; numbers are Fortran's
(`1.D3`, `1+3`).  Lines before the first card and below `*HEADING` are free text.  (CalculiX 2.20's manual, "Input deck
format"; Abaqus' "Input syntax rules".)
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray
from ..regular_file import read_bytes

_INCLUDES: Final = 10  # nested *INCLUDE
_INCLUDE = re.compile(r"\*\s*INCLUDE\b", re.IGNORECASE)
_WITHOUT_E = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))([+-]\d+)")
_FLAGS = {"GENERATE", "INTERNAL", "UNSORTED", "SMALLSLIDING", "NLGEOM", "PERTURBATION", "DELETE", "DIRECT", "FIXED"}


def key_of(name: str) -> str:
    """A name as it is compared: without blanks and quotation marks, in upper case."""
    return "".join(name.split()).strip('"').upper()


@dataclass
class Card:
    """A keyword line with its parameters, names in upper case, and the data lines below.

    Attributes:
        keyword: In upper case, with single blanks, without the star.
        parameters: Values as they are written, without quotation marks; "" for one without a value.
        file: The file of the keyword line.
        line: Its number.
        lines: The data lines, those that say nothing left out.
    """

    keyword: str
    parameters: dict[str, str]
    file: str
    line: int
    lines: list[str] = field(default_factory=list)
    _numbers: array[int] = field(default_factory=lambda: array("L"), repr=False)
    _files: list[tuple[int, str]] = field(default_factory=list, repr=False)

    @property
    def kind(self) -> str:
        """The keyword without blanks, as it is compared."""
        return self.keyword.replace(" ", "")

    def add(self, text: str, file: str, number: int) -> None:
        """Append a data line."""
        if not self._files or self._files[-1][1] != file:
            self._files.append((len(self.lines), file))
        self.lines.append(text)
        self._numbers.append(number)

    def fault(self, text: str, row: int | None = None) -> ValueError:
        """An error about the card, or about one of its data lines."""
        file, line = self.file, self.line
        if row is not None:
            file = next(name for first, name in reversed(self._files) if first <= row)
            line = self._numbers[row]
        return ValueError(f"{file}: line {line}: *{self.keyword}: {text}")

    def get(self, name: str, default: str = "") -> str:
        """Value of a parameter as it is written."""
        return self.parameters.get(name, default)

    def key(self, name: str) -> str:
        """Value of a parameter as names are compared; "" if it is not given."""
        return key_of(self.parameters.get(name, ""))

    def needs(self, name: str) -> str:
        """Value of a parameter; ValueError if it is missing."""
        if not self.parameters.get(name):
            raise self.fault(f"{name} is missing")
        return self.parameters[name]

    def words(self, row: int) -> list[str]:
        """The fields of a data line."""
        return [word.strip().strip('"').strip() for word in self.lines[row].split(",")]

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """The fields of every data line, with its number among them."""
        for row in range(len(self.lines)):
            yield row, self.words(row)

    def number(self, word: str, row: int) -> float:
        """One real number."""
        try:
            return number_of(word)
        except ValueError:
            raise self.fault(f"damaged: {word!r} is no number", row) from None

    def whole(self, word: str, row: int) -> int:
        """One whole number."""
        value = self.number(word, row)
        if value != int(value):
            raise self.fault(f"damaged: {word!r} should be a whole number", row)
        return int(value)

    def floats(self, rows: Iterable[int] | None = None) -> FloatArray:
        """All numbers of some data lines, by default all; commas at their ends do not count, empty fields are 0."""
        chosen = range(len(self.lines)) if rows is None else list(rows)
        lines = self.lines if rows is None else [self.lines[row] for row in chosen]
        if not lines:
            return np.empty(0)
        words = ",".join(line.rstrip(", \t") for line in lines).upper().replace("D", "E").split(",")
        try:
            return np.array(words, dtype=np.float64)
        except ValueError:
            return np.array(
                [
                    self.number(word, row)
                    for row, line in zip(chosen, lines, strict=True)
                    for word in line.rstrip(", \t").split(",")
                ]
            )

    def integers(self, rows: Iterable[int] | None = None) -> IntArray:
        """All numbers of some data lines, which must be whole."""
        chosen = None if rows is None else list(rows)
        values = self.floats(chosen)
        numbers = values.astype(np.int64) if np.all(np.abs(values) < 2.0**53) else np.zeros(1, dtype=np.int64)
        if not np.array_equal(numbers, values):
            for row in chosen if chosen is not None else range(len(self.lines)):
                for word in self.lines[row].rstrip(", \t").split(","):
                    self.whole(word, row)
            raise self.fault("damaged: numbers of nodes and elements must be whole")
        return numbers


def number_of(word: str) -> float:
    """A real number as Fortran reads it; an empty field is 0."""
    text = word.strip().upper().replace("D", "E")
    if not text:
        return 0.0
    bare = _WITHOUT_E.fullmatch(text)
    return float(f"{bare[1]}E{bare[2]}" if bare else text)


def read_cards(path: str) -> list[Card]:
    """The cards of a file and of those that it includes, in their order.

    Raises:
        OSError: If a file cannot be read.
        ValueError: If there is no card.
    """
    cards: list[Card] = []
    going_on = False
    for file, number, text in _lines(path):
        if going_on and not text.startswith("*") and _is_parameters(text):
            words = text.split(",")
        elif text.startswith("*"):
            words = text.lstrip("*").split(",")
            cards.append(Card(" ".join(words.pop(0).upper().split()), {}, file, number))
        else:
            going_on = False
            if cards and cards[-1].keyword != "HEADING":
                cards[-1].add(text, file, number)
            continue
        for word in filter(None, (word.strip() for word in words)):
            name, _, value = word.partition("=")
            cards[-1].parameters["".join(name.split()).upper()] = value.strip().strip('"').strip()
        going_on = text.rstrip().endswith(",")
    if not cards:
        empty = not read_bytes(path).strip()
        raise ValueError(
            f"{path}: is empty"
            if empty
            else f"{path}: is no input file of Abaqus or CalculiX: it has no card like *NODE"
        )
    return cards


def _is_parameters(line: str) -> bool:
    """Whether a line goes on with the parameters of a keyword line that ends in a comma, and is no data."""
    return "=" in line or all(key_of(word) in _FLAGS for word in line.split(",") if word.strip())


def _lines(path: str, depth: int = 0) -> Iterator[tuple[str, int, str]]:
    """Every line that is no comment with its file and number, those of included files too."""
    if depth > _INCLUDES:
        raise ValueError(f"{path}: *INCLUDE: more than {_INCLUDES} files inside each other")
    for number, line in enumerate(read_bytes(path).decode("utf-8-sig", "replace").splitlines(), 1):
        text = line.strip() if line[:1] in " \t" else line
        if text.startswith("**") or not text or text.isspace():
            continue
        if text.startswith("*") and _INCLUDE.match(text):
            name = text.partition("=")[2].strip().strip('"')
            file = Path(path).parent / name
            if not file.exists():
                raise ValueError(f"{path}: line {number}: *INCLUDE: there is no file {str(file)!r}")
            yield from _lines(str(file), depth + 1)
        else:
            yield path, number, text
