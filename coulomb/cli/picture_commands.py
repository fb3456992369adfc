"""`coulomb plot` and `coulomb report`: pictures and the report from the files of a run, made in a separate process."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..contact_fields import names
from ..io.atomic_output import finish_for_reader
from ..io.run_directory import REPORT, RunDirectory
from ..pictures.drawing_process import DrawingProcess
from ..ranks import launched, on_rank_0
from .console import BAD_INPUT, FAILED, console, fail, refuse_ranks

if TYPE_CHECKING:
    from ..case.case import Case

Directory = Annotated[Path, typer.Argument(help="Directory of the results of a run.")]


def plot(
    directory: Directory,
    field: Annotated[
        str,
        typer.Option(
            help=f"{', '.join(name for name in names() if name not in names(shown=''))}, displacement, "
            "von_mises_stress, stress_xx (_yy, _zz, _yz, _xz, _xy), principal_stress_1 (_2, _3), temperature_change, "
            "peel_stress, shear_stress, stress_error; "
            "of vectors with _x, _y or _z a component."
        ),
    ] = "pressure",
    scale: Annotated[float | None, typer.Option(help="Factor of the displacement; by default a visible one.")] = None,
    view: Annotated[
        str | None, typer.Option(help="contact, iso, below, top, bottom, front, back, left, right.")
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(help="FILE.png, .jpg, .pdf or .svg; of a load history also .gif or .mp4. Without it: a window."),
    ] = None,
    step: Annotated[int | None, typer.Option(help="Step of a load history, from 1; by default the last.")] = None,
) -> None:
    """Show or save a picture of a run, or a film of a load history."""
    refuse_ranks("coulomb plot")
    if save is None and not _display():
        save = Path("plot.png")
        console.out("there is no display: the picture is written to a file")
    if scale is not None and not (math.isfinite(scale) and 0.0 <= scale <= 1e12):
        fail(f"--scale must be from 0 to 1e12, but is {scale}")
    _refuse_nowhere(save)
    finish_for_reader(directory)
    _draw("plot", json.dumps([str(directory), field, scale, view, save and str(save), step]))


def report(
    directory: Directory,
    save: Annotated[Path | None, typer.Option(help=f"File of the page; by default DIRECTORY/{REPORT}.")] = None,
) -> None:
    """Write one HTML page about a run, certified or not: case, certificate, pictures, convergence, a 3D view."""
    refuse_ranks("coulomb report")
    _refuse_nowhere(save)
    finish_for_reader(directory)
    _draw("page", str(directory), str(save or RunDirectory(directory).report))


@contextmanager
def drawing_soon(settings: Case) -> Iterator[DrawingProcess | None]:
    """The process that draws picture.png of a single run loads its libraries while the run computes.

    None under MPI, whose ranks need all cores, and for large meshes, which need the memory: there it starts afterwards.
    """
    soon = settings.output.picture and settings.history is None and launched() is None and settings.small
    renderer = DrawingProcess("overview") if soon else None
    try:
        yield renderer
    finally:
        if renderer is not None:
            renderer.stop()


def write_report(directory: Path, stop: Callable[[], bool], what: Literal["page", "both"] = "page") -> str:
    """Write the report into the directory of a run, and picture.png as well (`both`), unless `stop`, called repeatedly,
    is true; collective.  Returns an error message, or nothing: a run does not fail because of its report."""

    def write() -> str:
        code, said = DrawingProcess(what, str(directory), str(RunDirectory(directory).report)).finish(stop=stop)
        return f"{REPORT} could not be written: {said}" if code else ""

    return on_rank_0(launched(), write)


def _refuse_nowhere(save: Path | None) -> None:
    """Check that the folder of a file exists, before anything is drawn."""
    if save is None:
        return
    if not os.path.isdir(save.parent):
        fail(f"--save {save}: there is no folder {save.parent}; create it first")
    if os.path.isdir(save):
        fail(f"--save {save}: is a folder; name the file in it")


def _draw(*arguments: str) -> None:
    code, said = DrawingProcess(*arguments).finish(seconds=None)
    if code == 0:
        if said:
            console.out(said)
        return
    fail(said, BAD_INPUT if code == BAD_INPUT else FAILED)


def _display() -> bool:
    """Whether a window can be opened."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
