"""picture.png in the directory of a run: drawn by a separate process, and recorded in the run's summary; and the
pictures of a `Solution` in memory, which is written into a temporary directory and drawn as from there."""

from __future__ import annotations

import base64
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mpi4py import MPI

from ..io.output import write, write_json
from ..io.run_directory import PICTURE, RunDirectory
from ..model.provenance import moment, now
from ..model.solution import Solution
from ..ranks import on_rank_0
from .drawing_process import DrawingProcess


def write_with_picture(
    solution: Solution, directory: str | Path, fields: Mapping[str, Any] | None = None, overwrite: bool = True
) -> dict[str, Any]:
    """See `Solution.write`."""
    problem = solution.problem
    written = write(solution, directory, overwrite=overwrite, fields=fields)
    contents = add_picture(written, Path(directory), problem.comm)
    problem.seconds.update(contents["seconds"])
    return contents


def add_picture(
    contents: dict[str, Any],
    target: Path,
    comm: MPI.Comm,
    stop: Callable[[], bool] = lambda: False,
    renderer: DrawingProcess | None = None,
) -> dict[str, Any]:
    """Draw picture.png of the results in a directory, as `draw`; collective.

    Returns:
        Their summary `contents`, with the picture and its seconds; it is written again.

    Raises:
        OSError: On every rank, if the summary cannot be written.
    """

    def add() -> dict[str, Any]:
        drawing = time.perf_counter()
        trouble = draw(target, stop, renderer)
        contents["picture"] = "interrupted" if trouble and stop() else trouble or PICTURE
        contents["seconds"]["picture"] = time.perf_counter() - drawing
        contents["run"]["ended"] = moment(now())
        write_json(contents, RunDirectory(target).summary)
        return contents

    return on_rank_0(comm, add)


def draw(directory: Path, stop: Callable[[], bool] = lambda: False, renderer: DrawingProcess | None = None) -> str:
    """Draw picture.png of a run, or of the end of a load history; returns an error message, or nothing.

    In a separate process, perhaps one that has been started already, since a renderer may crash.  `stop` is called
    repeatedly; a true result stops the drawing.
    """
    code, said = (renderer or DrawingProcess("overview")).finish(str(directory.absolute()), stop=stop)
    if not code:
        return ""
    picture = RunDirectory(directory).picture
    for file in (picture, picture.with_name(f".{PICTURE}")):  # the old picture, and a partial new one
        file.unlink(missing_ok=True)
    return f"could not be drawn: {said}"


@contextmanager
def _written(solution: Solution) -> Iterator[Path]:
    """A directory with the answer, whose name is in the pictures; collective."""
    with TemporaryDirectory() as own:
        folder = Path(solution.problem.comm.bcast(own), "answer")
        write(solution, folder)
        yield folder


def plot_solution(solution: Solution, field: str, scale: float | None, view: str | None) -> Any:
    """See `Solution.plot`."""
    from .report.picture import plot

    with _written(solution) as folder:
        return plot(folder, field, scale, view, show=False) if solution.problem.comm.rank == 0 else None


def picture(solution: Solution) -> str:
    """picture.png of the answer as an HTML image; empty where it cannot be drawn; on one rank."""
    with _written(solution) as folder:
        if draw(folder):
            return ""
        data = base64.b64encode(RunDirectory(folder).picture.read_bytes()).decode()
        return f'<img src="data:image/png;base64,{data}" style="max-width:min(100%,720px)">'


def plot_history(solution: Solution) -> Any:
    """See `Solution.plot_history`."""
    from .report.charts import convergence_figure
    from .report.files import read_run

    with _written(solution) as folder:
        if solution.problem.comm.rank > 0:
            return None
        figure = convergence_figure(read_run(folder, ()))
        figure.set_facecolor("white")
        return figure
