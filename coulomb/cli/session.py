"""Console, log and interruption of a run; uses MPI, but not DOLFINx."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from mpi4py import MPI
from rich.console import Console

from .. import process
from ..model.provenance import now
from .console import bad_input, console, errors, showing_messages
from .interruption import Interruption
from .log import Log

if TYPE_CHECKING:
    from ..solvers.results import Progress, ProgressCallback
    from .terminal import Display


@dataclass(frozen=True)
class Session:
    """Console, log, interruption and start time of a run."""

    console: Console
    log: Log
    interruption: Interruption
    began: float
    started: datetime = field(default_factory=now)

    def progress(self, display: Display) -> ProgressCallback:
        """Callback that shows a step, logs it, and returns whether to stop."""

        def progress(at: Progress) -> bool:
            display(at)
            self.log.step(at)
            return self.interruption.asked()

        return progress


@contextmanager
def opened(quiet: bool, log_file: Path | None) -> Iterator[Session]:
    """A session, to the end of its run.

    Args:
        quiet: Whether to print only warnings and errors.
        log_file: File to which all output is appended, with the time.
    """
    process.go_on_unheard()
    process.hear_signals_again()
    began, speaking = time.perf_counter(), Console(quiet=True) if quiet else console
    with bad_input():
        log = Log(log_file, MPI.COMM_WORLD)
    with (
        log.hearing(speaking, errors),
        showing_messages(speaking),
        Interruption(MPI.COMM_WORLD) as interruption,
    ):
        log.line(" ".join(["coulomb", *sys.argv[1:]]))
        yield Session(speaking, log, interruption, began)
