"""The files of a run, read for showing them."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...io.field_files import Grid, read_grid
from ...io.run_directory import HISTORY, SUMMARY, RunDirectory, read_json, step_place
from ..plotting import alarm
from .units import in_seconds

Rows = list[dict[str, float]]


@dataclass(frozen=True)
class Step:
    """A state of the body: the one of a single run, or one of a load history.

    Attributes:
        directory: With its solution.xdmf, contact.xdmf, summary.json and history.csv.
        time: When; None of a single run.
        needs: The files that must be whole; where another one is not, something plain stands in for it.
    """

    directory: Path
    time: float | None
    needs: tuple[str, ...] = ("contact", "solution")

    def grid(self, file: str) -> Grid:
        """The grid of "contact" or "solution".

        Raises:
            ValueError: If the file is needed, and is missing or incomplete.
        """
        path = RunDirectory(self.directory).fields(file)
        try:
            return _read_once(path, path.stat().st_mtime_ns)
        except (OSError, KeyError, SyntaxError) as error:
            if file not in self.needs:
                return _face_alone(self.grid("contact")) if file == "solution" else _no_face(self.grid("solution"))
            raise ValueError(f"{path}: cannot be read: {error}") from None

    @property
    def lacks(self) -> str:
        """The file that something stands in for; empty if both are whole."""
        for file in ("contact", "solution"):
            try:
                replace(self, needs=(file,)).grid(file)
            except ValueError:
                return RunDirectory(self.directory).fields(file).name
        return ""


def _face_alone(contact: Grid) -> Grid:
    """The contact face in place of the body, where it was."""
    return Grid(contact.cell, contact.cells, contact.points, {"displacement": np.zeros_like(contact.points)})


def _no_face(body: Grid) -> Grid:
    """No contact face: a point of the body without a facet."""
    normal = np.array([[0.0, 0.0, -1.0]])
    fields = {"status": np.array([3.0]), "normal": normal, "area": np.zeros(1)}
    return Grid("Triangle", np.empty((0, 3), dtype=np.int64), body.points[:1], fields)


@functools.lru_cache(maxsize=4)
def _read_once(path: Path, written: int) -> Grid:
    """A run has few large files, which many pictures need; a history has many small ones."""
    return read_grid(path)


@dataclass(frozen=True)
class Run:
    """What a run has written, but for its fields.

    Attributes:
        directory: Of the run.
        summary: summary.json; of the last step of a history.
        history: Sums and largest values of all steps of a history; empty of a single run.
        certified: Whether the certificate passed; of a history, at every step.
        alarm: What must be said in red of it; empty if it counts.
        outside: Why it is outside the theory, in words; empty if it is inside, or if that was accepted.
        warnings: What else is to be said of it, in words.
        case: case.json, None where there is none.
        steps: The states of the body; one of a single run.
        rows: history.csv of a load history, a row for each step; empty of a single run.
    """

    directory: Path
    summary: dict[str, Any]
    history: dict[str, Any]
    certified: bool
    alarm: str
    outside: tuple[str, ...]
    warnings: tuple[str, ...]
    case: dict[str, Any] | None
    steps: tuple[Step, ...]
    rows: Rows

    @property
    def iterations(self) -> Rows:
        """history.csv of the (last) solve; nothing where it is missing.

        Raises:
            ValueError: If it is no table.
        """
        files = RunDirectory(self.steps[-1].directory)
        return _rows(files) if files.history.exists() else []

    @property
    def is_history(self) -> bool:
        return bool(self.rows)

    @property
    def made(self) -> list[dict[str, Any]]:
        """Where, when and by which command: one entry, and one more for every resume; empty where it is not known."""
        if self.is_history:
            return list(self.history.get("runs", []))
        return [self.summary["run"]] if self.summary.get("run") else []

    @property
    def certificate(self) -> dict[str, Any]:
        """The measures of every condition; of a history, at the step where each is worst."""
        found: dict[str, Any] = self.history["certificate"] if self.is_history else self.summary["certificate"]
        return found

    @property
    def end(self) -> str:
        """When the last state is: "at the end, time 6 s"; empty of a single run."""
        return f"at the end, time {in_seconds(self.rows[-1]['time'])}" if self.is_history else ""


def read_run(directory: str | Path, needs: tuple[str, ...] | None = None) -> Run:
    """Read the files of a run.

    Args:
        directory: Of the run.
        needs: Of "contact" and "solution" those that will be shown, and nothing else: other files may be missing.

    Raises:
        ValueError: If the directory holds no run, or a file that cannot be read: which, and why.
    """
    folder, files = Path(directory), RunDirectory(Path(directory))
    if needs is not None and not _is_whole(folder):
        return _fields_alone(folder, needs)
    if not files.summary.exists():
        raise ValueError(f"{folder}: holds no run: there is no {SUMMARY}")
    told = files.read_summary()
    steps: tuple[Step, ...] = (Step(folder, None),)
    rows: Rows = []
    last = told
    if "steps" in told:
        rows, last = _rows_of_history(folder, strict=needs is None), told["last"]
        steps = tuple(Step(files.step(int(row["step"])).path, row["time"]) for row in rows)
    if needs is not None:
        steps = tuple(replace(step, needs=needs) for step in steps)
    missing = [key for key in ("status", "law", "certificate", "nodes", "maximum") if key not in last]
    if "steps" in told and "history" not in told:
        missing.append("history")
    if missing or not steps:
        raise ValueError(f"{files.summary}: has no {(missing or ['steps'])[0]!r}: not a summary of coulomb's")
    return Run(
        directory=folder,
        summary=last,
        history=told.get("history", {}),
        certified=bool(told["certificate"]["passed"]),
        alarm=alarm(told),
        outside=_violations(told),
        warnings=_warnings(told),
        case=read_json(files.case) if needs is None and files.case.exists() else None,
        steps=steps,
        rows=rows,
    )


def _is_whole(folder: Path) -> bool:
    """Whether the summary of a run can be read."""
    try:
        RunDirectory(folder).read_summary()
    except ValueError:
        return False
    return True


def _fields_alone(folder: Path, needs: tuple[str, ...]) -> Run:
    """A run without its summary, for a picture of its fields.

    Raises:
        ValueError: If there are no fields either.
    """
    files, rows = RunDirectory(folder), _rows_of_history(folder, strict=False)
    steps = tuple(Step(files.step(int(row["step"])).path, row["time"], needs) for row in rows)
    if not steps and not any(files.fields(file).exists() for file in needs):
        raise ValueError(
            f"{folder}: holds no run: there is no {' or '.join(files.fields(file).name for file in needs)}"
        )
    return Run(
        directory=folder,
        summary={},
        history={},
        certified=False,
        alarm=f"certificate unknown: {SUMMARY} cannot be read",
        outside=(),
        warnings=(),
        case=None,
        steps=steps or (Step(folder, None, needs),),
        rows=rows,
    )


def _rows_of_history(folder: Path, strict: bool) -> Rows:
    """history.csv of a load history; where it is missing (or no table, if not strict) by what its steps say."""
    files = RunDirectory(folder)
    if files.history.exists() and files.is_history:
        try:
            return _rows(files)
        except ValueError:
            if strict:
                raise
    rows: Rows = []
    for count, number in enumerate(files.begun_steps, 1):
        step = files.step(number)
        try:
            told = step.read_summary()
        except ValueError:
            told = {}
        row = (told.get("step") or {}).get("row")
        if row is None and strict:
            raise ValueError(f"{folder}: neither {HISTORY} nor {step_place(number)}/{SUMMARY} tells of its step")
        given = row or {"step": number, "time": float(count)}
        rows.append({key: math.nan if value is None else float(value) for key, value in given.items()})
    return rows


def _violations(told: dict[str, Any]) -> tuple[str, ...]:
    """Why the answer is outside the theory, unless that was accepted; of a history, of all its steps."""
    if "steps" in told:
        return tuple((told.get("history") or {}).get("violations", ()))
    strain = told.get("small_strain") or {}
    return () if strain.get("accepted", True) else tuple(strain["violations"])


def _warnings(told: dict[str, Any]) -> tuple[str, ...]:
    """What else is to be said of the answer."""
    history = told.get("history") or {}
    strain, outside = history or told.get("small_strain") or {}, " ".join(_violations(told))
    remarks = (history or told).get("remarks", ())
    return (*remarks, *(text for text in strain.get("warnings", ()) if text not in outside))


def _rows(files: RunDirectory) -> Rows:
    """A table of numbers; words and empty places are nan, True and False are 1 and 0."""
    return [{key: _number(value) for key, value in row.items()} for row in files.read_history()]


def _number(text: str | None) -> float:
    if not isinstance(text, str):  # a line that is too short or too long
        return math.nan
    try:
        return {"True": 1.0, "False": 0.0}.get(text, math.nan) if text in ("True", "False") else float(text)
    except ValueError:
        return math.nan
