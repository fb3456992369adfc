"""Recheck of the files of a run from the files alone, without the solver, K and A: `coulomb check`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..run_directory import RunDirectory
from .case_reference import CaseReference
from .history import HistoryFindings, check_history, check_large, check_step, is_large
from .run import Findings, check_run

__all__ = ["check"]


def check(directory: str | Path, say: Callable[[str], None] = lambda line: None) -> Findings | HistoryFindings:
    """Check what a run, a load history or one of its steps has written, on one rank.

    Mesh, displacement and contact forces are read, and the certificate is computed from them.  All written data that
    follow from these are recomputed and compared: the fields of solution.xdmf and contact.xdmf and the numbers of
    summary.json; for a load history each step relative to the step before, and the files of the whole history.  If
    there is a case.json, the input data are compared with the case: law and coefficients, materials, supports, springs,
    loads, the nodes of the contact face, their normals and gaps.  Data that could not be compared are listed.  Steps of
    large motions are judged in the problem of their case, posed anew (`check_large`).

    Args:
        directory: Its directory.
        say: Called with the result of each step of a history.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    folder, files = Path(directory), RunDirectory(Path(directory))
    try:
        if files.is_history:
            return (check_large if is_large(files) else check_history)(folder, say)
        return check_step(folder) if files.step_number is not None else check_run(folder, CaseReference.of(folder))
    except (KeyError, TypeError, IndexError, AttributeError) as error:  # entries of wrong type or structure
        raise ValueError(f"{folder}: is incomplete, or written by another version of coulomb: {error!r}") from None
