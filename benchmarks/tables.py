"""Tables of benchmarks: printed as they are measured, and written as CSV files."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import typer

from coulomb.regular_file import unwritable

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit codes: a run failed, wrong input, Ctrl-C; rows until then are written."""

Fields = Mapping[str, object]
"""A row: columns by name."""


def table(name: str, rows: Iterable[Fields | str], directory: Path | None = None) -> list[Fields]:
    """Print the rows as they come, and write them as name.csv at the end, also after a failure or Ctrl-C.

    Texts among the rows, about runs without one, are printed on standard error.

    Raises:
        typer.Exit: With BAD_INPUT for a ValueError, FAILED for a RuntimeError or a file that cannot be written,
            INTERRUPTED for Ctrl-C.
    """
    code = 0
    found: list[Fields] = []
    try:
        if directory is not None and (reason := unwritable(directory)):
            raise ValueError(f"--output {directory}: cannot be written: {reason}")
        for row in rows:
            if isinstance(row, str):
                print(row, file=sys.stderr)
                continue
            widths = {column: max(len(column), 20 if isinstance(value, str) else 9) for column, value in row.items()}
            if not found:
                print("  ".join(f"{column:>{width}}" for column, width in widths.items()))
            print("  ".join(f"{shown(row[column]):>{width}}" for column, width in widths.items()), flush=True)
            found.append(row)
    except (ValueError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        code = BAD_INPUT if isinstance(error, ValueError) else FAILED
    except KeyboardInterrupt:
        code = INTERRUPTED
    if directory is not None and found:
        try:
            directory.mkdir(parents=True, exist_ok=True)
            with (directory / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, list(found[0]))
                writer.writeheader()
                writer.writerows(found)
        except OSError as error:
            print(f"error: {directory}: cannot be written: {error.strerror or error}", file=sys.stderr)
            code = code or FAILED
    if code:
        raise typer.Exit(code)
    return found


def shown(value: object) -> str:
    """A number or a text of a row, as printed."""
    return f"{value:.3g}" if isinstance(value, float) else "-" if value is None else str(value)


def one_of(option: str, given: str, allowed: Sequence[str]) -> str:
    """The value of an option.

    Raises:
        typer.BadParameter: If it is not among the allowed ones.
    """
    if given not in allowed:
        raise typer.BadParameter(f"{option} is {', '.join(allowed[:-1])} or {allowed[-1]}, not {given!r}")
    return given
