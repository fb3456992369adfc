"""The files of a run, read for showing them."""

from __future__ import annotations

import csv
import functools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..plotting import Grid, alarm, read_grid
from .units import in_seconds

Rows = list[dict[str, float]]


@dataclass(frozen=True)
class Step:
    """A state of the body: the one of a single run, or one of a load history.

    Attributes:
        directory: With its solution.xdmf, contact.xdmf, summary.json and history.csv.
        time: When; None of a single run.
    """

    directory: Path
    time: float | None

    def grid(self, file: str) -> Grid:
        """The grid of "contact" or "solution".

        Raises:
            ValueError: If the file is missing or not whole.
        """
        path = self.directory / f"{file}.xdmf"
        try:
            return _read_once(path, path.stat().st_mtime_ns)
        except (OSError, KeyError, SyntaxError) as error:
            raise ValueError(f"{path}: cannot be read: {error}") from None


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
        iterations: history.csv of the (last) solve.
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
    iterations: Rows

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


def read_run(directory: str | Path) -> Run:
    """Read the files of a run.

    Raises:
        ValueError: If the directory holds no run, or a file that cannot be read: which, and why.
    """
    folder = Path(directory)
    told = _json(folder / "summary.json")
    if told is None:
        raise ValueError(f"{folder}: holds no run: there is no summary.json")
    steps: tuple[Step, ...] = (Step(folder, None),)
    rows: Rows = []
    last = told
    if "steps" in told:
        rows, last = _rows(folder / "history.csv"), told["last"]
        steps = tuple(Step(folder / "steps" / f"{int(row['step']):04d}", row["time"]) for row in rows)
    missing = [key for key in ("status", "law", "certificate", "nodes", "maximum") if key not in last]
    if "steps" in told and "history" not in told:
        missing.append("history")
    if missing or not steps:
        raise ValueError(f"{folder / 'summary.json'}: has no {(missing or ['steps'])[0]!r}: not a summary of coulomb's")
    return Run(
        directory=folder,
        summary=last,
        history=told.get("history", {}),
        certified=bool(told["certificate"]["passed"]),
        alarm=alarm(told),
        outside=_violations(told),
        warnings=_warnings(told),
        case=_json(folder / "case.json"),
        steps=steps,
        rows=rows,
        iterations=_rows(steps[-1].directory / "history.csv"),
    )


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


def _json(path: Path) -> dict[str, Any] | None:
    """Contents of a file; None where there is none."""
    try:
        told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: is not JSON: {error}") from None
    if not isinstance(told, dict):
        raise ValueError(f"{path}: is not an object of JSON")
    return told


def _rows(path: Path) -> Rows:
    """A table of numbers; words and empty places are nan, True and False are 1 and 0."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return [{key: _number(value) for key, value in row.items()} for row in csv.DictReader(file)]
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None


def _number(text: str) -> float:
    try:
        return {"True": 1.0, "False": 0.0}.get(text, math.nan) if text in ("True", "False") else float(text)
    except ValueError:
        return math.nan
