"""Whether a run may replace the results in its directory: those of the same case, or if the user asks for it."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from ..case.case import Case
from ..ranks import on_rank_0
from .case_record import case_record, differences
from .replacing import Present, present
from .run_directory import CASE, RunDirectory
from .written_case import case_in

_REMEDY = "replace them by --overwrite, or choose another directory (--output)"


def refuse_to_replace(case: Case, target: Path, overwrite: bool, comm: MPI.Comm) -> None:
    """Check that a run destroys nothing without being asked to; collective.

    The results of a single run may be replaced by those of the same case; the method of solution, the output and the
    treatment of large strains may differ.  All other results need `overwrite`.  Files that are not results of this
    package, and write-protected ones, are never replaced.

    Args:
        case: The case to be run.
        target: Directory of the results.
        overwrite: Whether the user has asked to replace them.
        comm: The ranks.

    Raises:
        ValueError: On every rank, with a remedy.
    """
    digests = case_record(case, comm)["files"]

    def look() -> str:
        found = present(target)
        return found.fault() or ("" if overwrite else _refusal(case, digests, found))

    try:
        fault = on_rank_0(comm, look)
    except OSError as error:
        fault = f"output {target}: cannot be read: {error.strerror or error}"
    if fault:
        raise ValueError(fault)


def _refusal(case: Case, digests: dict[str, str], found: Present) -> str:
    if found.steps:
        again = "" if case.history is None else f"continue with `coulomb resume {found.folder}`, "
        return f"{found.folder} already holds {found.steps} load steps: {again}{_REMEDY}"
    if not found.results:
        return ""
    if case.history is not None:
        return f"{found.folder} holds the results of a single run, this case has a [history]: {_REMEDY}"
    if CASE not in found.names:
        return f"{found.folder} holds results of a run from Python, or without its {CASE}: {_REMEDY}"
    try:
        before = case_in(RunDirectory(found.folder).case)
    except ValueError:
        return f"{found.folder} holds results of a case that cannot be read, or of another version: {_REMEDY}"
    recorded = RunDirectory(found.folder).read_summary().get("mesh_files") or {}
    changed = differences(before, recorded, case, digests)
    if not changed:
        return ""
    listed = "; ".join(changed[:3]) + (f"; and {len(changed) - 3} more" if len(changed) > 3 else "")
    return f"{found.folder} holds the results of another case ({listed}): {_REMEDY}"
