"""picture.png in the directory of a run: drawn by a separate process, and recorded in the run's summary."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..io.output import write, write_json
from ..io.run_directory import PICTURE, RunDirectory
from ..model.provenance import moment, now
from ..model.solution import Solution
from ..ranks import on_rank_0
from . import drawing_process
from .drawing_process import DrawingProcess


def write_with_picture(
    solution: Solution, directory: str | Path, fields: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Write all results into a directory (`io.output.write`), and draw its picture; collective.

    Args:
        solution: The answer.
        directory: Created if necessary.
        fields: The user's functions to be written beside, by name.

    Returns:
        The summary.

    Raises:
        OSError: On every rank, if the directory cannot be written to.
        ValueError: On every rank, if a function cannot be written.
    """
    problem = solution.problem
    contents = add_picture(write(solution, directory, fields=fields), Path(directory), problem.comm)
    problem.seconds.update(contents["seconds"])
    return contents


def add_picture(
    contents: dict[str, Any],
    target: Path,
    comm: MPI.Comm,
    stop: Callable[[], bool] = lambda: False,
    renderer: DrawingProcess | None = None,
) -> dict[str, Any]:
    """Draw picture.png of results on disk and record it in their summary; collective.

    Args:
        contents: The summary.
        target: Their directory.
        comm: The ranks.
        stop: Called repeatedly; a true result stops the drawing.
        renderer: The drawing process, if it has been started already.

    Returns:
        The summary, with the picture and its seconds.

    Raises:
        OSError: On every rank, if the summary cannot be written.
    """

    def add() -> str:
        drawing = time.perf_counter()
        trouble = draw(target, stop, renderer)
        contents["picture"] = "interrupted" if trouble and stop() else trouble or PICTURE
        contents["seconds"]["picture"] = time.perf_counter() - drawing
        contents["run"]["ended"] = moment(now())
        write_json(contents, RunDirectory(target).summary)
        return json.dumps(contents)

    return dict(json.loads(on_rank_0(comm, add)))


def draw(directory: Path, stop: Callable[[], bool] = lambda: False, renderer: DrawingProcess | None = None) -> str:
    """Draw picture.png of a run, or of the end of a load history; returns an error message, or nothing.

    In a separate process, since a renderer may crash.

    Args:
        directory: Directory of the run.
        stop: Called repeatedly; a true result stops the drawing.
        renderer: The drawing process, if it has been started already (`drawing_process.begin`).
    """
    code, said = (renderer or drawing_process.begin()).finish(str(directory.absolute()), stop=stop)
    if not code:
        return ""
    picture = RunDirectory(directory).picture
    for file in (picture, picture.with_name(f".{PICTURE}")):  # the old picture, and a partial new one
        file.unlink(missing_ok=True)
    return f"could not be drawn: {said}"
