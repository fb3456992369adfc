"""The process that draws picture.png, started early, since it needs a second to load its libraries."""

from __future__ import annotations

import os
from collections.abc import Sequence

from ..ranks import RANK_VARIABLES
from .apart import Apart

_WITHOUT = {"--help", "output.picture=false"}

_early: Apart | None = None


def begin_early(arguments: Sequence[str]) -> None:
    """Start the process before the command line is parsed, if a run may need it and there is a second processor.

    `begin` takes it over; `stop_early` ends it if the case does not need it.  It also ends with the program.

    Args:
        arguments: The command line, starting with the command.
    """
    global _early
    runs = arguments[:1] == ["run"] and not _WITHOUT.intersection(arguments)
    if runs and processors() > 1 and not any(name in os.environ for name in RANK_VARIABLES):
        _early = _new()


def begin() -> Apart:
    """The process started early, or a new one; it reads the directory of the run from its standard input."""
    global _early
    begun, _early = _early, None
    return begun or _new()


def stop_early() -> None:
    """End the process started early, if there is one that has not been taken over."""
    if _early is not None:
        begin().stop()


def _new() -> Apart:
    return Apart("coulomb.pictures.report", ["overview"])


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
