"""Ctrl-C, and the signals by which a batch system ends a job: stop after the current step, with everything kept."""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import Any

from mpi4py import MPI

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
"""Open MPI's mpirun passes SIGUSR1 on as it is; after SIGINT and SIGTERM it kills in a second (docs/cluster.md).

SIGHUP is the end of the terminal, unless `nohup` has it ignored."""


class Interruption:
    """Whether somebody wants the run to stop; a context that puts the handlers of the signals back at its end.

    It listens from the first time it is asked.  Before, while K is assembled and factorised, there is nothing to keep,
    and Python would not come to hear of a signal: it acts as ever, at once.  The second signal ends the process.

    Args:
        comm: The ranks, which stop together, whichever of them was told.
    """

    def __init__(self, comm: MPI.Comm):
        self._comm = comm
        self._before: dict[signal.Signals, Any] = {}
        self._told = self._said = False

    def __enter__(self) -> Interruption:
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    @property
    def told(self) -> bool:
        """Whether this rank knows that somebody wants the run to stop; not collective."""
        return self._told

    def asked(self) -> bool:
        """Whether to stop, the same on every rank; collective."""
        if not self._before:
            heard = [n for n in SIGNALS if n is not signal.SIGHUP or signal.getsignal(n) is not signal.SIG_IGN]
            self._before = {number: signal.signal(number, self._receive) for number in heard}
        told: bool = self._comm.allreduce(self._told, op=MPI.LOR)
        if told:
            self._say()
        self._told = told
        return told

    def _receive(self, number: int, _: FrameType | None) -> None:
        if self._told:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        self._told = True
        self._say()

    def _say(self) -> None:
        """Straight to the terminal: a handler must not use the buffers it may have interrupted."""
        if not self._said and self._comm.rank == 0:
            os.write(2, b"\nstopping after this step, everything is kept; once more to stop at once\n")
        self._said = True
