"""Results that a new load history replaces: set aside until it is complete."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from mpi4py import MPI

from ..io.replacing import aside_in, discard, put_back, set_aside
from ..io.run_directory import RunDirectory
from ..ranks import on_rank_0
from .console import bad_input, errors


@contextmanager
def in_place_of(target: Path, overwrite: bool, resume: bool, comm: MPI.Comm) -> Iterator[None]:
    """Around a load history: set the results in its directory aside if they are to be overwritten; collective.

    They are removed once the history is complete, also by a later `coulomb resume`; moved back if it ends before its
    first step; kept otherwise.
    """

    def begin() -> str:
        aside = set_aside(target) if overwrite else None
        return "" if aside is None else str(aside)

    with bad_input():
        try:
            aside = on_rank_0(comm, begin)
        except OSError as error:
            raise ValueError(f"output {target}: cannot be written: {error.strerror or error}") from None

    def end() -> None:
        try:
            remark = on_rank_0(comm, lambda: _settle(target, aside, overwrite or resume))
        except OSError as error:
            remark = f"the results before are in {aside}: {error.strerror or error}"
        if remark:
            errors.print(f"warning: {remark}", markup=False)

    try:
        yield
    except typer.Exit:  # on all ranks; other exceptions may be those of one
        end()
        raise
    end()


def _settle(target: Path, aside: str, replaced: bool) -> str:
    """What becomes of the results that were set aside; on one rank."""
    files = RunDirectory(target)
    done = files.complete_steps
    if not done:
        if not aside or files.failed.path.exists():
            return f"the results before are in {aside}" if aside else ""
        put_back(Path(aside), target)
        return f"no load step was completed: {target} has its earlier results"
    try:
        complete = not files.step(done[-1]).read_summary().get("step", {}).get("pending")
    except ValueError:
        complete = False
    if complete and replaced:
        discard(target)
    left = aside_in(target)
    return f"{', '.join(map(str, left))}: earlier results, kept until the load history is complete" if left else ""
