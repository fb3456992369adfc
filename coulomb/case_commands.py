"""`coulomb new` and `coulomb check-case`: a case file to begin with, and what a case will take."""

from __future__ import annotations

from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer
from mpi4py import MPI

from .case import Case, read_case
from .console import console, errors
from .estimate import estimate_of, gigabytes, refuse_too_large, refuse_too_many_cells
from .fem.body import LOCKING_ABOVE, Material
from .lock import refuse_in_use
from .output import on_rank_0, refuse_full_disk, size_on_disk
from .problem import ContactProblem
from .running import bad_input, refuse_unwritable
from .terminal import introduce
from .time_left import about

Changes = Annotated[
    list[str] | None,
    typer.Option("--set", help="Replace a setting, for example mesh.cells=[18,6,6]; may be repeated."),
]


class Kind(StrEnum):
    """The cases there are to begin with."""

    block = "block"
    hertz = "hertz"
    history = "history"


def new(
    kind: Annotated[Kind, typer.Argument(help="What to begin with.")],
    file: Annotated[Path | None, typer.Argument(help="File to write; by default KIND.toml.", metavar="[FILE]")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it exists.")] = False,
) -> None:
    """Write a case file with comments: a block dragged along a plane, a ball in rubber, friction that remembers."""
    target = file or Path(f"{kind.value}.toml")
    text = (resources.files(__package__) / "templates" / f"{kind.value}.toml").read_text(encoding="utf-8")
    text = text.replace(f"{kind.value}.toml", str(target))

    def write() -> str:
        with target.open("w" if force else "x", encoding="utf-8") as stream:
            stream.write(text)
        return ""

    with bad_input():
        try:
            on_rank_0(MPI.COMM_WORLD, write)
        except FileExistsError:
            raise ValueError(f"{target}: exists already; --force replaces it") from None
        except OSError as error:
            raise ValueError(f"{target}: cannot be written: {error.strerror or error}") from None
    console.print(f"{target} written; next: coulomb check-case {target}", markup=False, soft_wrap=True)


def check_case(
    case: Annotated[Path, typer.Argument(help="Case file, TOML.", metavar="CASE.toml")],
    changes: Changes = None,
    directory: Annotated[Path | None, typer.Option("--output", help="As for coulomb run.")] = None,
) -> None:
    """Validate a case without solving it, and estimate size, memory and time; 0 if it can be run, 2 if not.

    All is done that a run does before it factorises K: mesh, clamps, loads and contact are looked at, for every load
    step, and K is assembled.
    """
    with bad_input():
        settings = read_case(case, changes or (), MPI.COMM_WORLD)
        problem = posed(settings, directory or Path(settings.output.directory), force=False, now=False)
        for end in settings.history.ends if settings.history is not None else ():
            problem.unsolved_at(end)
    introduce(console, case, problem)
    doubts(settings)
    taken, ranks = estimate_of(problem), problem.comm.size
    seconds, steps = taken.seconds, 1
    lines = [f"K {problem.stiffness_method}, A {'explicit' if problem.explicit else 'matrix-free'}"]
    if settings.history is not None:
        steps = len(settings.history.ends)
        seconds += (steps - 1) * taken.seconds_a_step
        lines.append(f"{steps} load steps, each halved up to {settings.history.halvings} times where it fails")
    disk = steps * size_on_disk(problem)
    lines.append(
        f"about {gigabytes(taken.memory)} of memory, {gigabytes(disk)} on disk and {about(seconds)}"
        f"{f' on {ranks} ranks, a core for each' if ranks > 1 else ' on one core'}, good to a factor of two on bodies "
        "like the block of docs/measurements.md"
    )
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)


def posed(settings: Case, target: Path, force: bool, now: bool = True) -> ContactProblem:
    """The problem of a case, once it is clear that memory and disk have room for it; collective.

    Args:
        settings: The case.
        target: Where the results will go.
        force: Not to mind memory and disk.
        now: Whether it is to run at once, so that the directory must be free.

    Raises:
        ValueError: On every rank.
    """
    comm = MPI.COMM_WORLD
    refuse_unwritable(target, comm)
    if now:
        refuse_in_use(target, comm)
    if settings.mesh.cells is not None and not force:
        refuse_too_many_cells(settings.mesh.cells, comm)
    problem = settings.problem(comm)
    if not force:
        refuse_too_large(problem)
        steps = 1 if settings.history is None else len(settings.history.ends)
        try:
            refuse_full_disk(problem, target, steps)
        except OSError as error:
            raise ValueError(f"output {target}: {error.strerror}; --force runs all the same") from None
    return problem


def doubts(settings: Case) -> None:
    """Say what is allowed, but hardly meant."""
    materials = settings.materials()
    given = [materials] if isinstance(materials, Material) else list(materials.values())
    highest = max(material.poisson for material in given)
    if highest > LOCKING_ABOVE:
        errors.print(
            f"warning: material: poisson = {highest} is near 0.5: above {LOCKING_ABOVE:g} first-order elements lock "
            "and give far too stiff an answer, whatever the certificate says of the discrete problem",
            markup=False,
        )
