"""Host, time and command of a run, the entry `run` of summary.json, and its wall time by phases."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Any

from mpi4py import MPI

from ..version import __version__


def now() -> datetime:
    """The local time with its zone."""
    return datetime.now().astimezone()


def moment(time: datetime) -> str:
    """ISO 8601 with the zone, to the millisecond: 2026-01-31T12:00:00.000+01:00."""
    return time.isoformat(timespec="milliseconds")


def command() -> str:
    """The command line of this process as typed by a user: `coulomb run CASE.toml`, `python SCRIPT.py`."""
    script, *arguments = sys.argv or [""]
    name = os.path.basename(script)
    if name == "__main__.py":  # python -m PACKAGE
        name = os.path.basename(os.path.dirname(script))
    if name.endswith(".py"):
        return shlex.join(["python", script, *arguments])
    return shlex.join([name or "python", *([] if name in ("", "-c") else arguments)])


def provenance(started: datetime, comm: MPI.Comm) -> dict[str, Any]:
    """Host, time, command and version, the same on every rank; collective."""
    hosts = sorted(set(comm.allgather(platform.node() or "unknown")))
    entry = {
        "hosts": hosts,
        "ranks": comm.size,
        "started": moment(started),
        "ended": moment(now()),
        "command": command(),
        "coulomb": __version__,
    }
    return comm.bcast(entry)


@contextmanager
def timed(seconds: dict[str, float], phase: str) -> Iterator[None]:
    """Add the wall time of the block to a phase, without that of phases inside the block."""
    began, others = time.perf_counter(), sum(seconds.values())
    try:
        yield
    finally:
        others = sum(seconds.values()) - others
        seconds[phase] = seconds.get(phase, 0.0) + time.perf_counter() - began - others
