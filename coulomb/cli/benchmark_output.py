"""What the benchmarks print and write: the table of a verification, CSV files and their figures."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..pictures.apart import missing
from .console import FAILED, console, errors

if TYPE_CHECKING:
    from ..benchmarks.verification import Verified


def print_verified(name: str, verified: Verified) -> None:
    """The table of a case, and the reasons for its tolerances."""
    from rich.table import Column, Table

    reasons = list(dict.fromkeys(row.why for row in verified.rows))
    right = [
        Column(head, justify="right", no_wrap=True) for head in ("formula", "ours", "error", "tolerance", "why", "")
    ]
    table = Table("quantity", *right, title=name, title_justify="left", box=None, padding=(0, 1))
    for row in verified.rows:
        numbers = (f"{row.formula:.5g}", f"{row.ours:.5g}", f"{row.error:.1e}", f"{row.tolerance:.1e}")
        verdict = "ok" if row.passed else "FAILED"
        table.add_row(row.quantity, *numbers, f"({reasons.index(row.why) + 1})", verdict)
    console.print(table)
    for number, reason in enumerate(reasons, 1):
        console.print(f"({number}) {reason}", markup=False)
    console.print()


def write_table(directory: Path | None, name: str, fields: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write name.csv and its figure name.png, if a directory is given."""
    if directory is None or console.quiet or not rows:
        return
    from ..pictures import plotting

    write_csv(directory, name, fields, rows)
    files = [f"{name}.csv"]
    with figures(), writing(directory):
        files.append(getattr(plotting, name)(directory / f"{name}.csv").name)
    console.print(f"{' and '.join(files)} in {directory}{os.sep}", soft_wrap=True)


@contextmanager
def figures() -> Iterator[None]:
    """Keep the table without a figure if the packages for drawing are missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        if not missing(error):
            raise
        errors.print(f"warning: no figure: {missing(error)}", markup=False)


@contextmanager
def writing(directory: Path) -> Iterator[None]:
    """End the command with a message if its files cannot be written."""
    try:
        yield
    except OSError as error:
        errors.print(
            f"error: {error.filename or directory}: cannot be written: {error.strerror or error}", markup=False
        )
        raise typer.Exit(FAILED) from None


def write_csv(directory: Path, name: str, fields: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    with writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
    with writing(directory), (directory / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(fields)
        writer.writerows(rows)
