"""Is what a run has written right?  From its files alone: without the solver, K and A; on one rank.

The mesh, the displacement and the contact forces are read back, and the certificate is computed from them.  All else
that is written and follows from these is computed again and compared: the fields of solution.xdmf and contact.xdmf and
the numbers of summary.json; of a load history each step against the step before, and what is said of all steps.  Where
there is a case.json, what was given is the case's: law and coefficients, materials, clamps, springs, loads, the nodes
of the contact face, their normals and gaps.  What could be compared with nothing is listed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..run_directory import RunDirectory
from .case_reference import CaseReference
from .history import HistoryFindings, check_history, check_step
from .run import Findings, check_run


def check(directory: str | Path, say: Callable[[str], None] = lambda line: None) -> Findings | HistoryFindings:
    """Check what a run, a load history or one of its steps has written.

    Args:
        directory: Where it is.
        say: Called with what was found of each step of a history, as soon as it was.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not fit to the others.
    """
    folder, files = Path(directory), RunDirectory(Path(directory))
    try:
        if files.is_history:
            return check_history(folder, say)
        return check_step(folder) if files.step_number is not None else check_run(folder, CaseReference.of(folder))
    except (KeyError, TypeError, IndexError, AttributeError) as error:  # entries that are not what they should be
        raise ValueError(f"{folder}: is not whole, or written by another version of coulomb: {error!r}") from None
