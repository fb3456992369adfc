"""The cards of an input file of CalculiX or Abaqus: keyword lines with their parameters, and the data lines below.

Blanks and case do not count, in names neither; `**` begins a comment; `*INCLUDE` is followed; numbers are Fortran's
(`1.D3`, `1+3`).  Lines before the first card and below `*HEADING` are free text.  (CalculiX 2.20's manual, "Input deck
format"; Abaqus' "Input syntax rules".)
"""

from __future__ import annotations

import difflib
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from ..arrays import FloatArray, IntArray
from ..regular_file import read_bytes

_INCLUDES: Final = 10  # nested *INCLUDE
_KEYWORD = re.compile(r"^[ \t]*\*(?!\*)[^\n]*", re.MULTILINE)
_INCLUDE = re.compile(r"\*\s*INCLUDE\b", re.IGNORECASE)
_INPUT = re.compile(r"INPUT\s*=\s*([^,]*[^,\s])", re.IGNORECASE)
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
        data: The text below it, in pieces: the file, the number of the first line, and the lines.
    """

    keyword: str
    parameters: dict[str, str]
    file: str
    line: int
    data: list[tuple[str, int, str]] = field(default_factory=list, repr=False)

    @cached_property
    def lines(self) -> list[str]:
        """The data lines, those that say nothing left out."""
        return [line for _, _, text in self.data for line in text.split("\n") if _says(line)]

    def _place(self, row: int) -> tuple[str, int]:
        """File and number of a data line."""
        for file, first, text in self.data:
            for number, line in enumerate(text.split("\n"), first):
                if _says(line):
                    row -= 1
                if row < 0:
                    return file, number
        return self.file, self.line

    @property
    def kind(self) -> str:
        """The keyword without blanks, as it is compared."""
        return self.keyword.replace(" ", "")

    def fault(self, text: str, row: int | None = None) -> ValueError:
        """An error about the card, or about one of its data lines."""
        file, line = (self.file, self.line) if row is None else self._place(row)
        return ValueError(f"{file}: line {line}: *{self.keyword}: {text}")

    def lacks(self, what: str, name: str, known: Iterable[str], row: int | None = None) -> ValueError:
        """An error about a name that the deck does not have, with the closest of those of its kind."""
        names = {key_of(one): one for one in known}
        close = [names[key] for key in difflib.get_close_matches(key_of(name), list(names), n=3)]
        listed = close or list(names.values())[:6]
        others = "" if len(listed) == len(names) or close else ", ..."
        hint = f"; did you mean {' or '.join(map(repr, close))}?" if close else ""
        if not close:
            hint = f"; there are {', '.join(map(repr, listed))}{others}" if names else "; there is none at all"
        return self.fault(f"there is no {what} {name!r}{hint}", row)

    def place_of(self, name: str) -> str | None:
        """File and line where the card has a name or a number, among its data or its parameters; None if nowhere."""
        key = key_of(name)
        for row, line in enumerate(self.lines):
            if key in map(key_of, line.split(",")):
                return str(self.fault("", row))[:-2]
        return str(self.fault(""))[:-2] if key in map(key_of, self.parameters.values()) else None

    def places_of(self, number: str) -> Iterator[str]:
        """Files and lines that begin with a number."""
        for row, line in enumerate(self.lines):
            if line.split(",", 1)[0].strip() == number:
                yield str(self.fault("", row)).partition(": *")[0]

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

    def _line(self, row: int) -> str:
        """A data line; ValueError if there is none."""
        if row >= len(self.lines):
            raise self.fault(f"has {len(self.lines)} data lines, and needs another")
        return self.lines[row]

    def words(self, row: int) -> list[str]:
        """The fields of a data line."""
        return [word.strip().strip('"').strip() for word in self._line(row).split(",")]

    def rows(self, needs: str = "", least: int = 1) -> Iterator[tuple[int, list[str]]]:
        """The fields of every data line, with its number among them; ValueError, with what it needs, where one has
        fewer than the least."""
        for row in range(len(self.lines)):
            words = self.words(row)
            if len(words) < least or not words[0]:
                raise self.fault(f"needs {needs or f'{least} fields'}", row)
            yield row, words

    def setting(self, name: str, default: float = 0.0) -> float:
        """Value of a parameter that is a number."""
        text = self.get(name)
        try:
            value = number_of(text) if text else default
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.fault(f"{name}={text} is no number")
        return value

    def number(self, word: str, row: int) -> float:
        """One real number."""
        try:
            value = number_of(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.fault(f"damaged: {word.strip()!r} is no number", row)
        return value

    def vector(self, row: int, count: int = 3) -> FloatArray:
        """The first numbers of a data line; ValueError if there are not as many."""
        values = self.floats([row])[:count]
        if len(values) < count:
            raise self.fault(f"needs {count} numbers, not {len(values)}", row)
        return values

    def whole(self, word: str, row: int) -> int:
        """One whole number."""
        value = self.number(word, row)
        if value != int(value):
            raise self.fault(f"damaged: {word.strip()!r} should be a whole number", row)
        return int(value)

    def freedoms(self, words: Sequence[str], row: int) -> range:
        """From the first degree of freedom of a data line to the last, which may be left out."""
        first = self.whole(words[0], row)
        last = self.whole(words[1], row) if len(words) > 1 and words[1] else first
        if not 1 <= first <= last:
            raise self.fault(f"there are no degrees of freedom from {first} to {last}", row)
        return range(first, last + 1)

    def floats(self, rows: Iterable[int] | None = None) -> FloatArray:
        """All numbers of some data lines, by default all; commas at their ends do not count, empty fields are 0."""
        if rows is None:
            quickly = self._all_floats()
            if quickly is not None:
                return quickly
        chosen = range(len(self.lines)) if rows is None else list(rows)
        return np.array(
            [self.number(word, row) for row in chosen for word in self._line(row).rstrip(", \t").split(",")],
            dtype=np.float64,
        )

    def _all_floats(self) -> FloatArray | None:
        """All numbers, if no field is empty and all are such as C reads."""
        parts = []
        for _, _, text in self.data:
            bare = text.replace(" ", "").replace("\t", "")
            if "**" in text or ",," in bare or "\n," in bare:
                return None
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                try:
                    parts.append(np.fromstring(text.replace(",", " "), dtype=np.float64, sep=" "))
                except (DeprecationWarning, ValueError):
                    return None
        values = np.concatenate(parts) if parts else np.empty(0)
        return values if np.all(np.isfinite(values)) else None

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
    for file, number, text, keyword in _pieces(path):
        if keyword:
            words = text.lstrip("*").split(",")
            cards.append(Card(" ".join(words.pop(0).upper().split()), {}, file, number))
            _parameters(cards[-1], words)
            going_on = text.rstrip().endswith(",")
        elif cards and cards[-1].keyword != "HEADING":
            data, first = text, number
            while going_on and data:  # the keyword line goes on below
                line, _, rest = data.partition("\n")
                if _says(line):
                    going_on = _is_parameters(line)
                    if not going_on:
                        break
                    _parameters(cards[-1], line.split(","))
                    going_on = line.rstrip().endswith(",")
                data, first = rest, first + 1
            if data.strip():
                cards[-1].data.append((file, first, data))
    if not cards:
        empty = not read_bytes(path).strip()
        raise ValueError(
            f"{path}: is empty"
            if empty
            else f"{path}: is no input file of Abaqus or CalculiX: it has no card like *NODE"
        )
    return cards


def _parameters(card: Card, words: Iterable[str]) -> None:
    for word in filter(None, (word.strip() for word in words)):
        name, _, value = word.partition("=")
        card.parameters["".join(name.split()).upper()] = value.strip().strip('"').strip()


def _is_parameters(line: str) -> bool:
    """Whether a line goes on with the parameters of a keyword line that ends in a comma, and is no data."""
    return "=" in line or all(key_of(word) in _FLAGS for word in line.split(",") if word.strip())


def _says(line: str) -> bool:
    """Whether a line is neither empty nor a comment."""
    text = line.lstrip()
    return bool(text) and not text.startswith("**")


def _pieces(path: str, depth: int = 0) -> Iterator[tuple[str, int, str, bool]]:
    """The keyword lines of a file, and the text between them, those of included files too: file, number of the line, or
    of the first, text, and whether it is a keyword line."""
    if depth > _INCLUDES:
        raise ValueError(f"{path}: *INCLUDE: more than {_INCLUDES} files inside each other")
    text = read_bytes(path).decode("utf-8-sig", "replace").replace("\r\n", "\n").replace("\r", "\n")
    number, begin = 1, 0
    for keyword in _KEYWORD.finditer(text):
        between = text[begin : keyword.start()]
        if between.strip():
            yield path, number, between, False
        number += text.count("\n", begin, keyword.start())
        line, begin = keyword[0].strip(), keyword.end()
        if _INCLUDE.match(line):
            named = _INPUT.search(line)
            if named is None:
                raise ValueError(f"{path}: line {number}: *INCLUDE: needs INPUT=FILE on the same line")
            file = Path(path).parent / named[1].strip(" \t\"'")
            if not file.exists():
                raise ValueError(f"{path}: line {number}: *INCLUDE: there is no file {str(file)!r}")
            yield from _pieces(str(file), depth + 1)
        else:
            yield path, number, line, True
    if text[begin:].strip():
        yield path, number, text[begin:], False
