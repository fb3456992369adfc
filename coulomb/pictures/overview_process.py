"""The process that draws picture.png: begun before it is needed, since it needs a second to load what it draws with."""

from __future__ import annotations

import os
from collections.abc import Sequence

from ..ranks import RANK_VARIABLES
from .apart import Apart

_WITHOUT = {"--help", "output.picture=false"}

_early: Apart | None = None


def begin_early(arguments: Sequence[str]) -> None:
    """Begin the process before the command line is read, where a run may need it and a second processor is there.

    `begin` takes it over; `stop_early` ends it where the case turns out not to need it.  If the program ends before,
    the process ends too.

    Args:
        arguments: Of the command line, the command first.
    """
    global _early
    runs = arguments[:1] == ["run"] and not _WITHOUT.intersection(arguments)
    if runs and _processors() > 1 and not any(name in os.environ for name in RANK_VARIABLES):
        _early = _new()


def begin() -> Apart:
    """The process begun early, or else a new one: it waits to read the directory of the run from its standard input."""
    global _early
    begun, _early = _early, None
    return begun or _new()


def stop_early() -> None:
    """End the process begun early, if there is one and nothing has taken it over."""
    if _early is not None:
        begin().stop()


def _new() -> Apart:
    return Apart("coulomb.pictures.report", ["overview"])


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
