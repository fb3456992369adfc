"""Output of the command line, on rank 0 only: its consoles, the messages that the library logs, the exit codes."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, NoReturn

import typer
from rich.console import Console

from .. import ranks

_TOGETHER: Final = 60.0
"""Seconds within which all ranks find the same input wrong."""

FAILED, BAD_INPUT, CRASHED, INTERRUPTED = 1, 2, 3, 130
"""Exit codes; 0: the answer counts."""

EXIT_CODES = """Exit codes:

0  the certificate passed and strains are small, or the command is done

1  not certified, outside the theory, not converged, or results not written; what exists is kept and marked

2  wrong input, not enough memory or disk, or the directory is in use or holds other results; nothing was solved

3  a crash: please report it

130  interrupted by Ctrl-C, SIGTERM, SIGHUP or SIGUSR1; what exists is kept and marked

130, 143, 129, 138  the same before there is anything to keep: immediate end without a message

141  the reader of standard output has closed it; a run continues
"""

_all = ranks.launched()
if _all is None:
    ranks.start_alone()
_silent = _all is not None and _all.rank != 0
console = Console(quiet=_silent, highlight=False)
errors = Console(quiet=_silent, highlight=False, stderr=True)


REPORTED = ("coulomb.model.solution", "coulomb.model.load_history", "coulomb.model.large_motions")
"""Loggers whose messages are not shown: the commands report the same, with their results."""


class LibraryMessages(logging.Handler):
    """Shows what the library logs: information on a console, warnings and errors on standard error."""

    def __init__(self, console: Console):
        super().__init__(logging.INFO)
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        if record.name in REPORTED:
            return
        if record.levelno >= logging.WARNING:
            errors.out(f"{record.levelname.lower()}: {record.getMessage()}")
        else:
            self._console.out(record.getMessage())


@contextmanager
def showing_messages(of_information: Console) -> Iterator[None]:
    """Show the library's log messages, those of level INFO on this console; inside another such context, in place of
    it."""
    library = logging.getLogger("coulomb")
    before = [handler for handler in library.handlers if isinstance(handler, LibraryMessages)]
    level, propagate = library.level, library.propagate
    messages = LibraryMessages(of_information)
    for handler in before:
        library.removeHandler(handler)
    library.addHandler(messages)
    library.setLevel(logging.INFO)
    library.propagate = False  # FFCx 2022 gives the root logger a handler
    try:
        yield
    finally:
        library.removeHandler(messages)
        library.setLevel(level)
        library.propagate = propagate
        for handler in before:
            library.addHandler(handler)


@contextmanager
def bad_input(kind: type[ValueError] = ValueError, but: tuple[type[ValueError], ...] = ()) -> Iterator[None]:
    """Turns an error of all ranks, but those of some kinds, into its message and exit code 2; that of a few ranks only
    is raised."""
    try:
        yield
    except kind as error:
        if isinstance(error, but) or not ranks.all_arrive(_TOGETHER):
            raise
        fail(str(error))


def fail(message: str, code: int = BAD_INPUT) -> NoReturn:
    """Print an error, and end the command with this exit code."""
    errors.out(f"error: {message}")
    raise typer.Exit(code) from None


def refuse_ranks(what: str) -> None:
    """End a command, `what`, that runs on one rank only if there are more."""
    if ranks.several():
        fail(f"{what} runs on one rank")
