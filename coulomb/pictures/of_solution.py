"""Pictures of a `Solution` in memory: for `Solution.plot`, `plot_history` and notebooks.

The answer is written into a temporary directory and drawn as from there, so that all pictures are the same.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ..io.output import write
from ..io.run_directory import RunDirectory
from ..model.solution import Solution
from . import picture_of_run


@contextmanager
def _written(solution: Solution) -> Iterator[Path]:
    """A directory with the answer, whose name is in the pictures; collective."""
    with TemporaryDirectory() as own:
        folder = Path(solution.problem.comm.bcast(own), "answer")
        write(solution, folder)
        yield folder


def plot(solution: Solution, field: str, scale: float | None, view: str | None) -> Any:
    """See `Solution.plot`."""
    from .report.picture import plot

    with _written(solution) as folder:
        return plot(folder, field, scale, view, show=False) if solution.problem.comm.rank == 0 else None


def picture(solution: Solution) -> str:
    """picture.png of the answer as an HTML image; empty where it cannot be drawn; on one rank."""
    with _written(solution) as folder:
        if picture_of_run.draw(folder):
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
