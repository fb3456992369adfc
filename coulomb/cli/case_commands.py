"""`coulomb new`, `check-case`, `contacts` and `convert`: template cases, validation of a case, the pairs of faces that
it finds, and meshes as XDMF."""

from __future__ import annotations

import os
from collections.abc import Sequence
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from ..ranks import launched, on_rank_0
from .console import FAILED, bad_input, console, errors, fail, refuse_ranks

if TYPE_CHECKING:
    from ..case.case import Case

Ignored = Annotated[
    list[str] | None,
    typer.Option("--ignore", help="Leave out a card of an input file that cannot be followed; may be repeated."),
]
Changes = Annotated[
    list[str] | None, typer.Option("--set", help="Replace a setting, for example mesh.cells=[18,6,6]; may be repeated.")
]


def case_of(file: Path, changes: Sequence[str], ignore: Sequence[str] | None, speaking: Console = console) -> Case:
    """The case of a file; for an input file of CalculiX or Abaqus what becomes of its cards is printed first.

    Raises:
        ValueError: As `read_case`.
    """
    from ..case.case import read_case
    from ..case.decks import is_deck, read_deck

    if not is_deck(file):
        if ignore:
            raise ValueError(f"{file}: --ignore leaves out cards of an input file of CalculiX or Abaqus (.inp)")
        return read_case(file, changes)
    deck = read_deck(file, ignore or ())
    width = max(len(row.keyword) for row in deck.cards)
    for row in deck.cards:
        times = f"{row.count} x" if row.count > 1 else ""
        why = f"; {row.why}" if row.why else ""
        speaking.out(f"card     {times:>6} *{row.keyword:<{width}}  {row.fate}{why}")
    for note in deck.notes:
        speaking.out(f"note     {note}")
    return read_case(file, changes, deck)


def import_deck(
    deck: Annotated[Path, typer.Argument(help="Input file of CalculiX or Abaqus.", metavar="DECK.inp")],
    file: Annotated[Path | None, typer.Argument(help="By default DECK.toml.", metavar="[CASE.toml]")] = None,
    ignored: Ignored = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write the case file that says what an input file of CalculiX or Abaqus says, to be edited and run."""
    refuse_ranks("coulomb import")
    from ..case.decks import is_deck
    from ..io.run_directory import as_toml

    target = file or deck.with_suffix(".toml")
    with bad_input():
        if not is_deck(deck):
            raise ValueError(f"{deck}: the name of an input file ends in .inp")
        found = case_of(deck, (), ignored).deck
        assert found is not None
        notes = "".join(f"# {note}\n" for note in found.notes)
        names = {"file": os.path.relpath(deck, target.absolute().parent)}
        tables = found.tables | {"mesh": found.tables["mesh"] | names} if "mesh" in found.tables else found.tables
        if "body" in tables:
            tables = tables | {"body": [body | names for body in tables["body"]]}
        _write(target, f"# The case of {deck.name}.\n{notes}{as_toml(tables)}\n", force)
    console.out(f"{target} written; next: coulomb run {target}")


def _write(target: Path, text: str, force: bool) -> None:
    """Write a case or a script; ValueError on every rank, and no file, if there is one (unless forced), or no room."""

    def write() -> None:
        stream = target.open("w" if force else "x", encoding="utf-8")
        try:
            with stream:
                stream.write(text)
        except OSError:
            target.unlink(missing_ok=True)
            raise

    try:
        on_rank_0(launched(), write)
    except FileExistsError:
        raise ValueError(f"{target}: already exists; --force replaces it") from None
    except OSError as error:
        raise ValueError(f"{target}: cannot be written: {error.strerror or error}") from None


class Kind(StrEnum):
    """The templates."""

    block = "block"
    hertz = "hertz"
    history = "history"
    pair = "pair"
    forms = "forms"


def new(
    kind: Annotated[Kind, typer.Argument(help="The template.")],
    file: Annotated[Path | None, typer.Argument(help="By default KIND.toml, or forms.py.", metavar="[FILE]")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a case file with comments: a block pushed along a plane, a ball in rubber, a load history, two bodies; or a
    script with your own forms."""
    name, stored = ("forms.py", "forms.py.txt") if kind is Kind.forms else (f"{kind.value}.toml",) * 2
    target = file or Path(name)
    text = (resources.files("coulomb") / "templates" / stored).read_text(encoding="utf-8")
    with bad_input():
        _write(target, text.replace(name, str(target)), force)
    then = "python" if kind is Kind.forms else "coulomb check-case"
    console.out(f"{target} written; next: {then} {target}")


def named_directory(given: str) -> Path:
    """The directory of `--output`, which is not empty, as that of an unset variable, which would be the current one."""
    with bad_input():
        if not given:
            raise ValueError('--output should name a directory, as results/block, or "." for this one, but is empty')
    return Path(given)


def check_case(
    case: Annotated[Path, typer.Argument(help="Case file, TOML.", metavar="CASE.toml")],
    changes: Changes = None,
    directory: Annotated[
        Path | None, typer.Option("--output", parser=named_directory, metavar="DIRECTORY", help="As for coulomb run.")
    ] = None,
    ignored: Ignored = None,
) -> None:
    """Validate a case without solving it, and estimate memory and disk; 0 if it can be run, 2 if not.

    Performs all steps of a run up to the factorisation of K: mesh, supports, loads and contact are checked, for every
    load step, and K is assembled.
    """
    with bad_input():
        settings = case_of(case, changes or (), ignored)

    from ..fem.compilation import announce
    from .preparation import expected, prepared, refuse_unwritable
    from .terminal import introduce, show_input

    announce()
    target = directory or Path(settings.output.directory)
    with bad_input():
        refuse_unwritable(target)
        settings, problem = prepared(settings, target, force=False)
        if settings.history is not None:
            start = settings.load_history().beginning(problem)  # supports that begin move nodes from some state
            for end in settings.history.ends:
                problem.at(end, start)
    introduce(console, case, problem)
    show_input(console, settings, problem)
    for line in expected(settings, problem):
        console.out(line)


def contacts(
    case: Annotated[Path, typer.Argument(help="Case file, TOML, with the table auto_contact.", metavar="CASE.toml")],
    changes: Changes = None,
) -> None:
    """Print the pairs of faces that auto_contact finds as tables of contact, to be put in the case and edited."""
    from ..case.case import read_case

    with bad_input():
        settings = read_case(case, changes or ())
        if settings.auto_contact is None:
            raise ValueError(
                f"{case}: has no [auto_contact]: add it, or --set auto_contact.distance=1e-4 --set "
                "auto_contact.friction=0.2"
            )

    from mpi4py import MPI

    from .terminal import found_in_words

    with bad_input():
        found = settings.resolved(MPI.COMM_WORLD)
    given = list(settings.contacts.values())
    if made := found.made_faces:
        console.out(
            f"# [auto_contact] has made {', '.join(map(repr, made))} of facets without a name: keep that table; what "
            "is given as [[contact]] counts, and is not found again"
        )
    for table, pair in found.found:
        if table not in given:
            console.out(f"\n# {found_in_words(table, pair)}\n{table.toml()}")


def convert(
    mesh: Annotated[Path, typer.Argument(help="Mesh file of any format that a case can name.", metavar="MESH")],
    file: Annotated[Path, typer.Argument(help="File to write; the arrays are written beside it.", metavar="FILE.xdmf")],
    force: Annotated[bool, typer.Option("--force", help="Replace the files if they exist.")] = False,
) -> None:
    """Write a mesh file as XDMF, with the names of its faces and groups of cells: ranks then read it in parts.

    Coordinates stay in the unit of the file.  The mesh is checked as before a run, on one rank, which needs the memory
    for all of it.
    """
    refuse_ranks("coulomb convert")
    with bad_input():
        if file.suffix != ".xdmf":
            raise ValueError(f"{file}: the name of the file to write must end in .xdmf")
        for target in (file, file.with_suffix(".h5")):
            if target.exists() and not force:
                raise ValueError(f"{target}: already exists; --force replaces it")
        if file.resolve() == mesh.resolve():
            raise ValueError(f"{file}: is the mesh file itself; give another name")
        if not file.absolute().parent.is_dir():
            raise ValueError(f"{file}: there is no folder {file.parent}; create it first")

    from mpi4py import MPI

    from ..fem.meshes import inspect, known_format, read_file, write

    with bad_input():
        known_format(mesh)
        try:
            inspected = inspect(read_file(str(mesh), {}, {}), 1.0, MPI.COMM_SELF)
        except OSError as error:
            raise ValueError(f"{error.filename or mesh}: cannot be read: {error.strerror or error}") from None
    for reason in inspected.refused.values():
        errors.out(f"warning: not converted: {reason}")
    try:
        write(inspected, file)
    except OSError as error:
        fail(f"{file}: cannot be written: {error.strerror or error}", FAILED)
    faces, groups = (", ".join(of) or "none" for of in (inspected.face_groups, inspected.cell_groups))
    console.out(
        f"{file} and {file.with_suffix('.h5').name} written: {len(inspected.cells)} cells; faces: {faces}; "
        f"groups of cells: {groups}"
    )
