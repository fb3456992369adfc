"""Where the command line speaks: on rank 0 alone; and the exit codes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console

from .. import ranks

FAILED, BAD_INPUT, CRASHED, INTERRUPTED = 1, 2, 3, 130
"""Exit codes; 0: the answer counts."""

EXIT_CODES = """Exit codes:

0  the certificate passed and strains are small, or what was asked for is done

1  not certified, outside the theory, not converged, or results not written; what there is is kept, marked so

2  wrong input, or more memory needed than there is; nothing was solved

3  a crash: a bug worth reporting

130  interrupted by Ctrl-C, SIGTERM, SIGHUP or SIGUSR1; everything is kept, marked so

130, 143, 129, 138  the same before there is something to keep: at once, in silence

141  what reads the output has gone; a run goes on
"""

_all = ranks.launched()
if _all is None:
    ranks.start_alone()
_silent = _all is not None and _all.rank != 0
console = Console(quiet=_silent, highlight=False)
errors = Console(quiet=_silent, highlight=False, stderr=True, soft_wrap=True)


@contextmanager
def bad_input() -> Iterator[None]:
    """A ValueError is the user's to mend: its text, and exit code 2."""
    try:
        yield
    except ValueError as error:
        errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None


def refuse_ranks(what: str) -> None:
    """End a command that works on one rank where there are more.

    Args:
        what: Who says so, as "coulomb plot".
    """
    if ranks.several():
        errors.print(f"error: {what} runs on one rank", markup=False)
        raise typer.Exit(BAD_INPUT)
