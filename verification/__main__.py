"""`python -m verification`: the table of the cases with known answers, and their pictures."""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import Annotated

import typer

from coulomb.cli.console import FAILED, bad_input, console, errors, refuse_ranks
from coulomb.pictures.drawing_process import missing
from coulomb.regular_file import unwritable

from . import CASES, Verified

app = typer.Typer(pretty_exceptions_enable=False)


@app.command()
def verification(
    names: Annotated[list[str] | None, typer.Option("--case", help="A case, as hertz; repeat.")] = None,
    directory: Annotated[Path | None, typer.Option("--output", help="For verification.csv and the pictures.")] = None,
) -> None:
    """Compare with known answers: patch tests, SSNV128, Hertz, Cattaneo-Mindlin, NAFEMS, and others.

    Exit code 1 if a tolerance is exceeded.
    """
    refuse_ranks("python -m verification")
    with bad_input():
        for name in names or ():
            if name not in CASES:
                raise ValueError(f"there is no case {name!r}; the cases are {', '.join(CASES)}")
        if directory is not None and (reason := unwritable(directory)):
            raise ValueError(f"--output {directory}: cannot be written: {reason}")
    found = {}
    for name in names or CASES:
        found[name] = CASES[name]()
        _print(name, found[name])
    if directory is not None:
        try:
            _write(directory, found)
        except OSError as error:
            reason = f"{error.filename or directory}: cannot be written: {error.strerror or error}"
            errors.out(f"error: {reason}")
            raise typer.Exit(FAILED) from None
    passed = [row.passed for verified in found.values() for row in verified.rows]
    console.out(f"{sum(passed)} of {len(passed)} within their tolerance")
    if not all(passed):
        raise typer.Exit(FAILED)


def _print(name: str, verified: Verified) -> None:
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


def _write(directory: Path, found: dict[str, Verified]) -> None:
    """verification.csv, and a picture of each case; without pictures if the packages for drawing are missing."""
    directory.mkdir(parents=True, exist_ok=True)
    with (directory / "verification.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("case", "quantity", "formula", "ours", "error", "tolerance", "passed", "why"))
        for name, verified in found.items():
            for row in verified.rows:
                numbers = (row.formula, row.ours, row.error, row.tolerance)
                writer.writerow((name, row.quantity, *numbers, row.passed, row.why))
    drawn = ""
    try:
        from .figures import draw

        pictures = {name: verified.panels for name, verified in found.items() if verified.panels}
        for name, panels in pictures.items():
            draw(panels, directory / f"{name}.png")
        drawn = f" and {len(pictures)} pictures"
    except ModuleNotFoundError as error:
        if not missing(error):
            raise
        errors.out(f"warning: no figure: {missing(error)}")
    console.out(f"verification.csv{drawn} in {directory}{os.sep}")


if __name__ == "__main__":
    app(prog_name="python -m verification")
