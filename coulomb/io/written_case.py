"""The case that a run keeps in its directory."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from ..case.case import Case
from ..case.error_messages import fault_of
from ..case.files import LARGEST, named_files, read_text, rename_files
from ..ranks import launched, on_rank_0
from .run_directory import CASE, RunDirectory

if TYPE_CHECKING:
    from mpi4py import MPI


def write_case(case: Case, directory: Path, comm: MPI.Comm) -> None:
    """Keep a case as DIRECTORY/case.json, for `written_case`; collective.

    Raises:
        OSError: On every rank, if it cannot be written.
    """

    def write() -> str:
        directory.mkdir(parents=True, exist_ok=True)
        file = RunDirectory(directory).case
        partial = file.with_name(f".{CASE}")
        partial.write_text(case_text(case), encoding="utf-8")
        os.replace(partial, file)
        return ""

    on_rank_0(comm, write)


def case_text(case: Case) -> str:
    """A case as the contents of case.json."""
    tables = case.model_dump(mode="json", exclude_unset=True)
    rename_files(tables, {place: str(Path(name).absolute()) for place, name in named_files(tables).items()})
    return json.dumps(tables, indent=2) + "\n"


def written_case(directory: Path) -> Case:
    """The case that a run has kept in its directory; the same on every rank.

    Raises:
        ValueError: On every rank, if there is none or it cannot be read.
    """
    file = RunDirectory(directory).case
    try:
        text = on_rank_0(launched(), lambda: read_text(file, 20 * LARGEST))
    except OSError as error:
        if on_rank_0(launched(), lambda: str(int(_of_forms(directory)))) == "1":
            raise ValueError(
                f"{directory}: these are results of a body of your own forms, which are not in the files: continue in "
                f"the script that has them: LoadHistory.run(problem, HistoryFiles({str(directory)!r}, resume=True))"
            ) from None
        raise ValueError(f"{directory}: no case to resume: {CASE} cannot be read: {error.strerror or error}") from None
    return _validated(text, file)


def _of_forms(directory: Path) -> bool:
    """Whether results, or the last load step, are of a `Body`; on one rank."""
    try:
        summary = RunDirectory(directory).read_summary()
    except ValueError:
        return False
    last = summary.get("last")
    return "forms" in summary or (isinstance(last, dict) and "forms" in last)


def case_in(file: Path) -> Case:
    """The case in a file case.json; on one rank.

    Raises:
        ValueError: If it cannot be read.
    """
    try:
        return _validated(read_text(file, 20 * LARGEST), file)
    except OSError as error:
        raise ValueError(f"{file}: cannot be read: {error.strerror or error}") from None


def _validated(text: str, file: Path) -> Case:
    try:
        return Case.model_validate_json(text)
    except ValidationError as error:
        raise fault_of(error, str(file), Case) from None
