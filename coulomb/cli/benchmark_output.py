"""What the benchmarks have in common: options, rows as they are measured, CSV files and their figures."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..pictures.drawing_process import missing
from ..regular_file import unwritable
from .console import BAD_INPUT, FAILED, console, errors

if TYPE_CHECKING:
    from ..benchmarks.verification import Verified

Sizes = Annotated[list[int] | None, typer.Option("--p", min=1, help="Cells per metre of the block; repeat.")]
Peers = Annotated[list[str] | None, typer.Option("--peer", help="A peer, as GetFEM; repeat.")]
Repeats = Annotated[int, typer.Option("--repeats", min=1, help="Runs of each; the minimum time counts.")]
Tolerance = Annotated[float, typer.Option("--tolerance", min=1e-12, help="Coulomb residual to stop at.")]


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


def line(text: str) -> None:
    """Print one line of a table, however wide the terminal is."""
    console.print(text, markup=False, soft_wrap=True)


def one_of(option: str, given: str, allowed: Sequence[str]) -> None:
    """Check the value of an option.

    Raises:
        ValueError: If it is not among the allowed ones.
    """
    if given not in allowed:
        raise ValueError(f"{option} is {', '.join(allowed[:-1])} or {allowed[-1]}, not {given!r}")


@contextmanager
def measuring(
    directory: Path | None = None,
    name: str = "",
    fields: Sequence[str] = (),
    rows: Sequence[Sequence[object]] = (),
    figure: bool = True,
) -> Iterator[None]:
    """A benchmark whose rows are written at its end, also if a run fails or the benchmark is interrupted.

    Wrong input ends the command with exit code 2, a run that fails with exit code 1.

    Args:
        directory: For the table; None: it is not written.
        name: Of the table, name.csv.
        fields: Its columns.
        rows: Filled while the benchmark runs.
        figure: Whether there is a figure of the table, name.png, by the function of `plotting` with this name.
    """
    code = 0
    try:
        if directory is not None and (reason := unwritable(directory)):
            raise ValueError(f"--output {directory}: cannot be written: {reason}")
        yield
    except typer.Exit:
        raise
    except (ValueError, RuntimeError) as error:
        errors.print(f"error: {error}", markup=False)
        code = BAD_INPUT if isinstance(error, ValueError) else FAILED
    except KeyboardInterrupt:
        write_table(directory, name, fields, rows, figure)
        raise
    write_table(directory, name, fields, rows, figure)
    if code:
        raise typer.Exit(code)


def write_table(
    directory: Path | None,
    name: str,
    fields: Sequence[str],
    rows: Sequence[Sequence[object]],
    figure: bool = True,
) -> None:
    """Write name.csv and its figure name.png, if a directory is given and there are rows."""
    if directory is None or console.quiet or not rows:
        return
    write_csv(directory, name, fields, rows)
    files = [f"{name}.csv"]
    if figure:
        from ..pictures import plotting

        with figures(), writing(directory):
            files.append(getattr(plotting, name)(directory / f"{name}.csv").name)
    line(f"{' and '.join(files)} in {directory}{os.sep}")


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
