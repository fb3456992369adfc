"""The text of a case, from a file or --set, with messages about syntax errors; and the names of the files in it."""

from __future__ import annotations

import codecs
import errno
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ..regular_file import read_bytes

FILES = {"mesh": ("file", "facets", "cell_groups"), "temperature": ("file",)}
"""Keys whose values are names of files, by table."""

KeyPath = tuple[str | int, ...]
"""A key in its tables, as ("contact", 0, "gap", "file")."""

LARGEST: Final = 4_000_000
"""Maximum bytes of a case file: a hundred thousand rows of an amplitude.  TOML is read at about a megabyte per
second."""

RECORDED: Final = 20 * LARGEST
"""The same of a case that a run has written, in which tables of amplitudes are in full."""

_DEEPEST: Final = 20
"""Maximum number of names in a dotted key; a case needs four."""

_TOO_DEEP = re.compile(rf'(?:\b[\w-]{{1,50}}"?[ \t]*\.[ \t]*"?){{{_DEEPEST}}}\w')
"""A key with more names: the time of tomllib grows with the square of their number."""

_OTHER_TEXT = ((codecs.BOM_UTF32_LE, "UTF-32"), (codecs.BOM_UTF16_LE, "UTF-16"), (codecs.BOM_UTF16_BE, "UTF-16"))


def read_text(path: str | Path, most: int = LARGEST) -> str:
    """Text of a file, without a byte order mark.

    Raises:
        OSError: If it cannot be read as UTF-8, or has more than `most` bytes, with the reason.
    """
    content = read_bytes(path, most)
    for mark, name in _OTHER_TEXT:
        if content.startswith(mark):
            raise OSError(errno.EILSEQ, f"it is text in {name}; save it as UTF-8", str(path))
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, f"it is not UTF-8 text: {error}", str(path)) from None


def recorded(text: str, path: str | Path) -> dict[str, Any]:
    """The tables of a case that a run has written; ValueError if it is no JSON object."""
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is not JSON of a case: {error}") from None
    if not isinstance(record, dict):
        raise ValueError(f"{path}: is not JSON of a case")
    return record


def parsed(text: str, path: str | Path, several: frozenset[str]) -> dict[str, Any]:
    """The tables of a case, of which those in `several` may be several.

    Raises:
        ValueError: If it is not TOML, with the position, the line, and a hint.
    """
    lines = text.splitlines()
    try:
        if _TOO_DEEP.search(text):
            raise RecursionError
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"{path}: is not a case: lists or tables are nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, and of int("...") with thousands of digits
        place = re.search(r"at line (\d+)", str(error))
        line = lines[int(place[1]) - 1].strip() if place and int(place[1]) <= len(lines) else ""
        what = str(error).partition("; use sys.")[0]  # Python's advice on its limit of digits
        raise ValueError(f"{path}: is not TOML: {what}{_line(line)}{_hint(what, line, several)}") from None


def _line(line: str) -> str:
    return f": {line[:80]}{' ...' if len(line) > 80 else ''}" if line else ""


def _hint(fault: str, line: str, several: frozenset[str]) -> str:
    table = re.fullmatch(r"\[\s*([\w.]+)\s*\]\s*(#.*)?", line)
    if table and table[1] in several:
        return f"; there may be several: each is written [[{table[1]}]]"
    value = line.partition("=")[2].strip()
    if "Invalid value" in fault and value.split("#")[0].strip() in ("True", "False"):
        return f"; in TOML it is {value.split('#')[0].strip().lower()}"
    if "Invalid value" in fault and re.match(r"[A-Za-z_]", value):
        return "; text must be in quotes"
    if re.fullmatch(r"[-+]?\d+,\d+\s*(#.*)?", value):
        return f"; decimals are written with a point: {value.split('#')[0].strip().replace(',', '.')}"
    if re.match(r"[-+.\d]+(e[-+]?\d+)?\s*[A-Za-z]", value):
        return "; numbers have no unit: they are in the case's [units], by default m, N, Pa"
    return ""


def apply(tables: dict[str, Any], change: str) -> None:
    """Put a setting "key.key=value" into the tables; ValueError if it is none, or there is no such place."""
    key, equals, value = change.partition("=")
    parts, said = key.strip().split("."), f"--set {change[:80]}{' ...' if len(change) > 80 else ''}"
    if not equals or not all(parts) or len(parts) > _DEEPEST:
        raise ValueError(f"{said}: must be key.key=value, for example mesh.cells=[18,6,6]")
    try:
        new = tomllib.loads(f"value = {value}")["value"]
    except RecursionError:
        raise ValueError(f"{said}: lists or tables are nested too deeply") from None
    except ValueError:
        new = value.strip()
    place: Any = tables
    try:
        for part in parts[:-1]:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        if isinstance(place, list):
            place[int(parts[-1])] = new
        else:
            place[parts[-1]] = new
    except (ValueError, IndexError, TypeError, AttributeError):
        raise ValueError(f"{said}: there is no such place in the case; lists are numbered from 0") from None


def named_files(tables: Mapping[str, Any]) -> dict[KeyPath, str]:
    """The names of the files of a case, by their place."""
    names: dict[KeyPath, str] = {}
    for top, keys in FILES.items():
        table = tables.get(top)
        given = {key: table.get(key) for key in keys} if isinstance(table, Mapping) else {}
        names |= {(top, key): value for key, value in given.items() if isinstance(value, str)}
    bodies = tables.get("body")
    for number, table in enumerate(bodies if isinstance(bodies, list | tuple) else ()):
        of_body = {key: table.get(key) for key in FILES["mesh"]} if isinstance(table, Mapping) else {}
        names |= {("body", number, key): value for key, value in of_body.items() if isinstance(value, str)}
    contact = tables.get("contact")
    several = isinstance(contact, list | tuple)
    for number, table in enumerate(contact if isinstance(contact, list | tuple) else [contact]):
        for key in ("gap", "foundation", "surface", "against_surface"):
            part = table.get(key) if isinstance(table, Mapping) else None
            name = part.get("file") if isinstance(part, Mapping) else None
            if isinstance(name, str):
                names["contact", *((number,) if several else ()), key, "file"] = name
    return names


def rename_files(tables: dict[str, Any], names: Mapping[KeyPath, str]) -> None:
    """Put other names of files in their places."""
    for (*tops, key), name in names.items():
        table: Any = tables
        for top in tops:
            table = table[top]
        table[key] = name
