"""The log file of a run: all output and every path-following step, with the time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from io import RawIOBase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from rich.console import Console, ConsoleRenderable, RenderHook
from rich.text import Text

from ..ranks import on_rank_0
from .console import errors

if TYPE_CHECKING:
    from ..solvers.results import Progress


class Log(RenderHook):
    """A text file to which lines are appended without buffering; only rank 0 writes.

    Args:
        path: The file, appended to if it exists; None for no log.
        comm: The ranks.

    Raises:
        ValueError: On every rank, if it cannot be written.
    """

    def __init__(self, path: Path | None, comm: MPI.Comm):
        self._path, self._file = path, None if path is None else _opened(path, comm)
        self._began, self._steps = time.perf_counter(), list[str]()

    @contextmanager
    def hearing(self, *consoles: Console) -> Iterator[None]:
        """Log everything printed on these consoles, even if they are quiet; closes the log at the end."""
        if self._file is None:
            yield
            return
        for console in consoles:
            console.push_render_hook(self)
        try:
            yield
        finally:
            for console in consoles:
                console.pop_render_hook()
            if self._file is not None:
                self._file.close()

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        for said in renderables:
            if isinstance(said, Text) and said.plain not in self._steps:  # a display may repeat a step
                self.line(said.plain)
        return renderables

    def step(self, progress: Progress) -> None:
        """A path-following step."""
        self._steps = [*self._steps[-1:], str(progress)]
        self.line(self._steps[-1])

    def line(self, text: str) -> None:
        if self._file is None:
            return
        now, since = datetime.now().isoformat(sep=" ", timespec="milliseconds"), time.perf_counter() - self._began
        try:
            lines = "".join(f"{now} {since:9.2f} s  {line}\n" for line in text.splitlines())
            self._file.write(lines.encode())
        except OSError as error:  # a full disk: the run continues without its log
            self._file.close()
            self._file = None
            errors.print(f"warning: the log {self._path} ends here: {error.strerror or error}", markup=False)


def _opened(path: Path, comm: MPI.Comm) -> RawIOBase | None:
    opened: list[Any] = []

    def open_() -> str:
        path.parent.mkdir(parents=True, exist_ok=True)
        opened.append(path.open("ab", buffering=0))  # unbuffered: no pending output when it fails
        return ""

    try:
        on_rank_0(comm, open_)
    except OSError as error:
        raise ValueError(f"--log {path}: cannot be written: {error.strerror or error}") from None
    return opened[0] if opened else None
