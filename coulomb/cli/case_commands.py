"""`coulomb new` and `coulomb check-case`: write a template case file; validate a case and estimate its cost."""

from __future__ import annotations

from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from ..ranks import launched, on_rank_0
from .console import bad_input, console

Changes = Annotated[
    list[str] | None,
    typer.Option("--set", help="Replace a setting, for example mesh.cells=[18,6,6]; may be repeated."),
]


class Kind(StrEnum):
    """The templates."""

    block = "block"
    hertz = "hertz"
    history = "history"


def new(
    kind: Annotated[Kind, typer.Argument(help="The template.")],
    file: Annotated[Path | None, typer.Argument(help="File to write; by default KIND.toml.", metavar="[FILE]")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a case file with comments: a block pushed along a plane, a ball in rubber, or a load history."""
    target = file or Path(f"{kind.value}.toml")
    text = (resources.files("coulomb") / "templates" / f"{kind.value}.toml").read_text(encoding="utf-8")
    text = text.replace(f"{kind.value}.toml", str(target))

    def write() -> str:
        stream = target.open("w" if force else "x", encoding="utf-8")
        try:
            with stream:
                stream.write(text)
        except OSError:
            target.unlink(missing_ok=True)
            raise
        return ""

    with bad_input():
        try:
            on_rank_0(launched(), write)
        except FileExistsError:
            raise ValueError(f"{target}: already exists; --force replaces it") from None
        except OSError as error:
            raise ValueError(f"{target}: cannot be written: {error.strerror or error}") from None
    console.print(f"{target} written; next: coulomb check-case {target}", markup=False, soft_wrap=True)


def check_case(
    case: Annotated[Path, typer.Argument(help="Case file, TOML.", metavar="CASE.toml")],
    changes: Changes = None,
    directory: Annotated[Path | None, typer.Option("--output", help="As for coulomb run.")] = None,
) -> None:
    """Validate a case without solving it, and estimate size, memory and time; 0 if it can be run, 2 if not.

    Performs all steps of a run up to the factorisation of K: mesh, supports, loads and contact are checked, for every
    load step, and K is assembled.
    """
    from ..case.case import read_case

    with bad_input():
        settings = read_case(case, changes or ())

    from ..fem.compilation import announce
    from .posing import doubts, expected, posed
    from .terminal import introduce
    from .understood import show_understood

    announce()
    with bad_input():
        problem = posed(settings, directory or Path(settings.output.directory), force=False, now=False)
        for end in settings.history.ends if settings.history is not None else ():
            problem.at(end)
    introduce(console, case, problem)
    show_understood(console, settings, problem)
    doubts(settings, problem)
    for line in expected(settings, problem):
        console.print(line, markup=False, soft_wrap=True)
