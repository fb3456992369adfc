"""Console, log and interruption of a run; uses MPI, but not DOLFINx."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from io import RawIOBase
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from rich.console import Console, ConsoleRenderable, RenderHook
from rich.text import Text

from .. import process
from ..model.provenance import now
from ..ranks import on_rank_0
from .console import bad_input, console, errors, showing_messages

if TYPE_CHECKING:
    from ..solvers.results import Progress, ProgressCallback
    from .terminal import Display


@dataclass
class Session:
    """Console, log, interruption and start time of a run, the directory that keeps the results before, and whether an
    answer has been written."""

    console: Console
    log: Log
    interruption: Interruption
    began: float
    started: datetime = field(default_factory=now)
    kept: str = ""
    written: bool = False

    def progress(self, display: Display) -> ProgressCallback:
        """Callback that shows a step, logs it, and returns whether to stop."""

        def progress(state: Progress) -> bool:
            try:
                display(state)
                self.log.step(state)
            finally:  # also where this rank fails, since the others ask
                stop = self.interruption.asked()
            return stop

        return progress


@contextmanager
def opened(quiet: bool, log_file: Path | None) -> Iterator[Session]:
    """A session, to the end of its run: `quiet` prints only warnings and errors; all output is appended to the log."""
    process.ignore_broken_pipes()
    process.restore_signal_handlers()
    began, speaking = time.perf_counter(), Console(quiet=True) if quiet else console
    with bad_input():
        log = Log(log_file, MPI.COMM_WORLD)
    with log.attached_to(speaking, errors), showing_messages(speaking), Interruption(MPI.COMM_WORLD) as interruption:
        log.line(" ".join(["coulomb", *sys.argv[1:]]))
        yield Session(speaking, log, interruption, began)


# --- interruption -------------------------------------------------------------------------------------------------

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
"""Ctrl-C and the signals by which a batch system ends a job.

Open MPI's mpirun passes SIGUSR1 on unchanged; after SIGINT and SIGTERM it kills its processes within a second
(docs/cluster.md).  SIGHUP is the end of the terminal, unless `nohup` ignores it."""


class Interruption:
    """Whether a signal has requested a stop after the current step; a context that restores the handlers at its end.

    Handlers are installed by the first call of `asked`.  Before, while K is assembled and factorised, there is nothing
    to keep, and Python could not run a handler: signals end the process at once.  A second signal does so, too.  All
    ranks stop if one of them receives a signal.
    """

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self._before: dict[signal.Signals, Any] = {}
        self._received = self._known = self._said = False

    def __enter__(self) -> Interruption:
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    @property
    def requested(self) -> bool:
        """Whether this rank has received a request to stop or knows of one; not collective."""
        return self._received or self._known

    def asked(self) -> bool:
        """Whether to stop, the same on every rank; collective."""
        if not self._before:
            heard = [n for n in SIGNALS if n is not signal.SIGHUP or signal.getsignal(n) is not signal.SIG_IGN]
            self._before = {number: signal.signal(number, self._receive) for number in heard}
        self._known = self._comm.allreduce(self._received, op=MPI.LOR)
        if self._known:
            self._say()
        return self._known

    def _receive(self, number: int, _: FrameType | None) -> None:
        if self._received:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        self._received = True
        self._say()

    def _say(self) -> None:
        """Write to the terminal directly: a handler must not use buffers that it may have interrupted."""
        if not self._said and self._comm.rank == 0:
            os.write(2, b"\nstopping after this step, everything is kept; once more to stop at once\n")
        self._said = True


# --- log ----------------------------------------------------------------------------------------------------------


class Log(RenderHook):
    """A text file, if a path is given, to which rank 0 appends all output and every path-following step with the time.

    Raises:
        ValueError: On every rank, if it cannot be written.
    """

    def __init__(self, path: Path | None, comm: MPI.Comm):
        self._path, self._file = path, None if path is None else _opened(path, comm)
        self._began, self._steps = time.perf_counter(), list[str]()

    @contextmanager
    def attached_to(self, *consoles: Console) -> Iterator[None]:
        """Log everything printed on these consoles, even if they are quiet; closes the log at the end."""
        if self._file is None:
            yield
            return
        for one in consoles:
            one.push_render_hook(self)
        try:
            yield
        finally:
            for one in consoles:
                one.pop_render_hook()
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
            errors.out(f"warning: the log {self._path} ends here: {error.strerror or error}")


def _opened(path: Path, comm: MPI.Comm) -> RawIOBase | None:
    opened: list[Any] = []

    def open_() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        opened.append(path.open("ab", buffering=0))  # unbuffered: no pending output when it fails

    try:
        on_rank_0(comm, open_)
    except OSError as error:
        raise ValueError(f"--log {path}: cannot be written: {error.strerror or error}") from None
    return opened[0] if opened else None
