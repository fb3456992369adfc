"""`coulomb check`: the answer in the files of a run, judged in the problem posed anew, and every file compared with
what would be written of that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..io.run_directory import RunDirectory
from ..model.problem import ContactProblem
from .comparison import complete
from .findings import Findings
from .history import check_history
from .posed import Posed
from .run import check_run

__all__ = ["check"]


def check(
    directory: str | Path, problem: ContactProblem | None = None, say: Callable[[str], None] = lambda line: None
) -> Findings:
    """Check what a run, a load history or one of its steps has written.

    The problem is posed anew by case.json, or given.  Displacement and contact forces are read from the files and put
    into it: they are judged (the certificate, by code that the solver does not use), and all that follows from them and
    from the problem is computed again, without solving: fields of solution.xdmf and contact.xdmf, summary.json, and of
    a load history each step from the one before, and the files of the whole.  What is compared must agree; what could
    not be is listed.  Without a problem the files alone are judged (`files_alone`).

    Args:
        directory: Its directory.
        problem: The problem of a script, on all ranks that share it; collective then.  By default that of case.json, on
            one rank.
        say: Called with the result of each step of a history.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others or the problem.
    """
    files = RunDirectory(Path(directory))
    posed = Posed.of((files.of_history if files.step_number is not None else files).path, problem)
    return complete(
        files.path, lambda: check_history(files, posed, say) if files.is_history else check_run(files, posed)
    )
