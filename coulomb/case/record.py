"""The case that a run keeps in its directory, and the record of it in every load step, which prevents a continuation
with another case."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from mpi4py import MPI
from pydantic import ValidationError

from ..io.history_files import read_summary
from ..io.run_directory import CASE, RunDirectory
from ..ranks import launched, on_rank_0
from ..regular_file import refuse_irregular, replacing
from .case import Case, read_case
from .files import named_files, rename_files


def write_case(case: Case, directory: Path, comm: MPI.Comm) -> None:
    """Keep a case as DIRECTORY/case.json, for `written_case`; collective.

    Raises:
        OSError: On every rank, if it cannot be written.
    """

    def write() -> None:
        directory.mkdir(parents=True, exist_ok=True)
        with replacing(RunDirectory(directory).case) as partial:
            partial.write_text(case_text(case), encoding="utf-8")

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
    files = RunDirectory(directory)

    def look() -> str:
        if files.case.exists():
            return ""
        with suppress(ValueError):
            summary = files.read_summary()
            if "forms" in summary or "forms" in (summary.get("last") or {}):
                return (
                    "these are results of a body of your own forms, which are not in the files: continue in the script "
                    f"that has them: LoadHistory.run(problem, HistoryFiles({str(directory)!r}, resume=True))"
                )
        return f"no case to resume: it has no {CASE}"

    if fault := on_rank_0(launched(), look):
        raise ValueError(f"{directory}: {fault}")
    return read_case(files.case)


FREE = ("output", "solver", "history.halvings", "history.friction_error", "small_strain")
"""What may change between steps: the output, the solution method, and the treatment of large strains."""


def case_record(case: Case, comm: MPI.Comm) -> dict[str, Any]:
    """The case without its output, and a digest of each of its files; collective, the same on every rank.

    Raises:
        ValueError: On every rank, if a file cannot be read.
    """
    tables = case.model_dump(mode="json", exclude_unset=True, exclude={"output"})
    names = {".".join(map(str, place)): name for place, name in sorted(named_files(tables).items(), key=str)}
    try:
        files = on_rank_0(comm, lambda: {key: _digest(Path(name)) for key, name in names.items()})
        return {"tables": tables, "files": files}
    except OSError as error:
        raise ValueError(f"{error.filename}: cannot be read: {error.strerror or error}") from None


def changes_of_case(before: Mapping[str, Any], case: Case, comm: MPI.Comm) -> tuple[list[str], list[str]]:
    """How a case differs from the record of an earlier one, and in what may change between load steps, in words that
    name the place of each difference; collective.

    Raises:
        ValidationError: If the record is that of no case.
        ValueError: On every rank, if a file cannot be read.
    """
    now, then = case_record(case, comm), Case.model_validate(before["tables"]).model_dump(mode="json")
    changed = [f"the contents of {key}" for key in before["files"] if now["files"].get(key) != before["files"][key]]
    same, differences = before["files"].keys(), list(_differences(then, case.model_dump(mode="json")))
    free = [text for key, text in differences if key.startswith(FREE) and not key.startswith("output")]
    return changed + [text for key, text in differences if key not in same and not key.startswith(FREE)], free


def refuse_another_case(case: Case, directory: Path, number: int, comm: MPI.Comm) -> list[str]:
    """Descriptions of the permitted changes of a case since a load step was computed, by its number in the directory of
    the history; collective.

    Raises:
        ValueError: On every rank, with the differences, if there are other changes.
    """
    step = RunDirectory(directory).step(number).path
    try:
        changed, free = changes_of_case(read_summary(step, comm)["step"]["case"], case, comm)
    except (KeyError, TypeError, AttributeError, ValidationError):
        without = "has no record of the case it was computed from, or that of another version of coulomb"
        raise ValueError(f"{step}: {without}; run the case again") from None
    if changed:
        listed = "; ".join(changed[:5]) + (f"; and {len(changed) - 5} more" if len(changed) > 5 else "")
        raise ValueError(
            f"{directory}: the case is no longer the one that its {number} load steps were computed from: {listed}; "
            "undo the changes (case.json), or run the changed case in another directory"
        )
    return free


def _differences(then: Any, now: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Keys at which two cases differ, with a description of each difference."""
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for name in {**then, **now}:
            yield from _differences(then.get(name), now.get(name), f"{key}.{name}" if key else str(name))
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for number, (one, other) in enumerate(zip(then, now, strict=True)):
            yield from _differences(one, other, f"{key}.{number}")
    elif then != now:
        yield key, f"{key} is {_shown(now)}, was {_shown(then)}"


def _shown(value: Any) -> str:
    if value is None:
        return "not given"
    text = json.dumps(value)
    return text if len(text) < 60 else f"{text[:50]} ..."


def _digest(path: Path) -> str:
    """SHA-256 of a file, and of the files it names: HDF5 files in XDMF, included ones in Abaqus' format."""
    refuse_irregular(path)
    digest = hashlib.sha256()
    files = [path]
    if path.suffix == ".xdmf":
        names = re.findall(r"([^\s<>:\"]+):/", path.read_text(encoding="utf-8", errors="replace"))
        files += [path.parent / name for name in dict.fromkeys(names)]
    if path.suffix.lower() == ".inp":
        text = path.read_text(encoding="utf-8", errors="replace")
        names = re.findall(r'^\*\s*INCLUDE\b.*?=\s*"?([^"\n]+)', text, re.IGNORECASE | re.MULTILINE)
        files += [path.parent / name.strip() for name in names]
    for file in files:
        if file == path or file.is_file():
            with file.open("rb") as stream:
                digest.update(hashlib.file_digest(stream, "sha256").digest())
    return digest.hexdigest()
