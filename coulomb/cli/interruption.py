"""Handling of Ctrl-C and the signals by which a batch system ends a job: stop after the current step and keep
everything."""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import Any

from mpi4py import MPI

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP)
"""Open MPI's mpirun passes SIGUSR1 on unchanged; after SIGINT and SIGTERM it kills its processes within a second
(docs/cluster.md).

SIGHUP is the end of the terminal, unless `nohup` ignores it."""


class Interruption:
    """Whether a signal has requested a stop; a context that restores the signal handlers at its end.

    Handlers are installed by the first call of `asked`.  Before, while K is assembled and factorised, there is nothing
    to
    keep, and Python could not run a handler: signals end the process at once.  A second signal does so, too.

    Args:
        comm: The ranks, which all stop if one of them receives a signal.
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
