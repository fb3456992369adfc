"""Reads the files of a run for pictures and the report."""

from __future__ import annotations

import math
import shlex
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...contact_fields import normal_forces
from ...io.accuracy import TOLERANCE, accuracy
from ...io.field_files import Grid, read_grids
from ...io.run_directory import HISTORY, SUMMARY, RunDirectory, read_json, read_table, step_place
from ...units import in_seconds, use
from .grids import first_order, merged

Rows = list[dict[str, float]]


@dataclass(frozen=True)
class Step:
    """A state of the body: of a single run, or of one step of a load history.

    Attributes:
        directory: Directory with its solution.xdmf, contact.xdmf, summary.json and history.csv.
        time: Its time; None for a single run.
        needs: The files that must be complete; others are replaced by a placeholder if they are not.
    """

    directory: Path
    time: float | None
    needs: tuple[str, ...] = ("contact", "solution")

    def grid(self, file: str) -> Grid:
        """The grid of "contact" or "solution"; those of several bodies or faces as one (`merged`).

        Raises:
            ValueError: If the file is needed, and is missing or incomplete.
        """
        path = RunDirectory(self.directory).fields(file)
        try:
            return _read_once(path, path.stat().st_mtime_ns)
        except (OSError, KeyError, SyntaxError) as error:
            if file not in self.needs:
                return self._placeholder(file)
            raise ValueError(f"{path}: cannot be read: {error}") from None

    def _placeholder(self, file: str) -> Grid:
        """For the body the undeformed contact face, for this a point of the body without facets."""
        if file == "solution":
            contact = self.grid("contact")
            return Grid(contact.cell, contact.cells, contact.points, {"displacement": np.zeros_like(contact.points)})
        fields = {"status": np.array([3.0]), "normal": np.array([[0.0, 0.0, -1.0]]), "area": np.zeros(1)}
        return Grid("Triangle", np.empty((0, 3), dtype=np.int64), self.grid("solution").points[:1], fields)

    @property
    def lacks(self) -> str:
        """The file that is replaced by a placeholder; empty if both are complete."""
        for file in ("contact", "solution"):
            try:
                replace(self, needs=(file,)).grid(file)
            except ValueError:
                return RunDirectory(self.directory).fields(file).name
        return ""


_KEPT: Final = 500e6
"""Bytes of grids that are kept: those of all steps of a small history, and of the last ones of a large one."""

_grids: dict[tuple[Path, int], Grid] = {}


def _read_once(path: Path, written: int) -> Grid:
    """Cached grids, used by many pictures."""
    if (path, written) not in _grids:
        grid = merged({name: first_order(grid) for name, grid in read_grids(path).items()})
        size = sum(array.nbytes for array in (grid.points, grid.cells, *grid.fields.values()))
        while len(_grids) >= max(_KEPT // max(size, 1), 4):
            del _grids[next(iter(_grids))]
        _grids[path, written] = grid
    return _grids[path, written]


@dataclass(frozen=True)
class Run:
    """The results of a run, except its fields.

    Attributes:
        summary: summary.json; for a history that of the last step.
        history: Sums and largest values of all steps of a history; empty for a single run.
        certified: Whether the certificate passed; for a history, in every step.
        alarm: The alarm in red; empty if the answer counts.
        outside: Violations of the theory; empty if there are none, or if they were accepted.
        warnings: Other warnings and remarks.
        case: case.json, None without one.
        steps: The states of the body; one for a single run.
        rows: history.csv of a load history, a row per step; empty for a single run.
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
        """iterations.csv of the (last) solve; empty if it is missing.

        Raises:
            ValueError: If it is not a table.
        """
        path = RunDirectory(self.steps[-1].directory).iterations
        return _rows(path) if path.exists() else []

    @property
    def title(self) -> str:
        """Name of the case file, from the command of the run; without one that of the directory."""
        command = self.made[0]["command"] if self.made else ""
        try:
            cases = [word for word in shlex.split(command) if word.endswith(".toml")]
        except ValueError:  # changed by hand
            cases = []
        return Path(cases[0]).stem if cases else self.directory.resolve().name

    @property
    def tolerance(self) -> float:
        """Of the solver."""
        given = ((self.case or {}).get("solver") or {}).get("tolerance")
        return float(given) if isinstance(given, float | int) else TOLERANCE

    @cached_property
    def accuracy(self) -> dict[str, float]:
        """Amounts up to which numbers are shown as 0, by unit; empty without a summary."""
        if not self.summary:
            return {}
        forces = [force for row in self.rows for force in normal_forces(row).values()]
        forces += [row[name] for row in self.rows for name in ("force_x", "force_y", "force_z") if name in row]
        return accuracy(self.summary, self.tolerance, self.history, forces)

    @property
    def faces(self) -> list[dict[str, Any]]:
        """The entries of the contacts in the summary; empty if they are unknown."""
        return list(self.summary.get("faces") or ())

    @property
    def is_history(self) -> bool:
        return bool(self.rows)

    @property
    def made(self) -> list[dict[str, Any]]:
        """Host, date and command: one entry, and one per resume; empty if unknown."""
        if self.is_history:
            return list(self.history.get("runs", []))
        return [self.summary["run"]] if self.summary.get("run") else []

    @property
    def certificate(self) -> dict[str, Any]:
        """The measures of every condition; for a history, at the worst step of each."""
        return self.history["certificate"] if self.is_history else self.summary["certificate"]

    @property
    def end(self) -> str:
        """Time of the last state: "at the end, time 6 s"; empty for a single run."""
        return f"at the end, time {in_seconds(self.rows[-1]['time'])}" if self.is_history else ""


def read_run(directory: str | Path, needs: tuple[str, ...] | None = None) -> Run:
    """Read the files of a run, in whose units numbers are shown from then on; if it `needs` only those of "contact" and
    "solution" that will be shown, other files may be missing.

    Raises:
        ValueError: If the directory holds no run, or a file cannot be read, with the reason.
    """
    folder, files, strict = Path(directory), RunDirectory(Path(directory)), needs is None
    if strict and not files.summary.exists():
        raise ValueError(f"{folder}: holds no run: there is no {SUMMARY}")
    known, summary = True, {}
    try:
        summary = files.read_summary()
    except ValueError:
        if needs is None:
            raise
        known = False
    is_history, last = "steps" in summary, summary.get("last", summary)
    units = last.get("units", {})
    use(units.get("length", "m"), units.get("stress", "Pa"))
    rows = _rows_of_history(folder, strict) if is_history or not known else []
    steps = tuple(Step(files.step(int(row["step"])).path, row["time"]) for row in rows)
    if not is_history and not steps:
        steps = (Step(folder, None),)
        if not known and needs and not any(files.fields(file).exists() for file in needs):
            names = " or ".join(files.fields(file).name for file in needs)
            raise ValueError(f"{folder}: holds no run: there is no {names}")
    needed = ("status", "law", "certificate", "nodes", "maximum", "totals", "faces", "reactions", "method", "versions")
    missing = [key for key in needed if key not in last]
    if is_history and "history" not in summary:
        missing.append("history")
    if known and (missing or not steps):
        raise ValueError(f"{files.summary}: has no {(missing or ['steps'])[0]!r}: not a summary of coulomb's")
    return Run(
        directory=folder,
        summary=last,
        history=summary.get("history", {}),
        certified=known and bool(summary["certificate"]["passed"]),
        alarm=alarm(summary) if known else f"certificate unknown: {SUMMARY} cannot be read",
        outside=_violations(summary),
        warnings=_warnings(summary),
        case=_read_case(files, strict) if known else None,
        steps=steps if needs is None else tuple(replace(step, needs=needs) for step in steps),
        rows=rows,
    )


def _read_case(files: RunDirectory, strict: bool) -> dict[str, Any] | None:
    """case.json; None without one, or if it is not needed (not strict) and cannot be read."""
    try:
        return read_json(files.case) if files.case.exists() else None
    except ValueError:
        if strict:
            raise
        return None


def _rows_of_history(folder: Path, strict: bool) -> Rows:
    """history.csv of a load history; if it is missing (or not a table, if not strict), from the steps' summaries."""
    files = RunDirectory(folder)
    if files.history.exists() and files.is_history:
        try:
            return _rows(files.history)
        except ValueError:
            if strict:
                raise
    rows: Rows = []
    for count, number in enumerate(files.begun_steps, 1):
        step = files.step(number)
        try:
            summary = step.read_summary()
        except ValueError:
            summary = {}
        row = (summary.get("step") or {}).get("row")
        if row is None and strict:
            raise ValueError(f"{folder}: neither {HISTORY} nor {step_place(number)}/{SUMMARY} has the row of its step")
        given = row or {"step": number, "time": float(count)}
        rows.append({key: math.nan if value is None else float(value) for key, value in given.items()})
    return rows


def _violations(summary: dict[str, Any]) -> tuple[str, ...]:
    """Violations of the theory, unless they were accepted; for a history, of all steps."""
    if "steps" in summary:
        return tuple((summary.get("history") or {}).get("violations", ()))
    strain = summary.get("small_strain") or {}
    return () if strain.get("accepted", True) else tuple(strain["violations"])


def _warnings(summary: dict[str, Any]) -> tuple[str, ...]:
    """Other warnings and remarks."""
    history = summary.get("history") or {}
    strain, outside = history or summary.get("small_strain") or {}, " ".join(_violations(summary))
    remarks = (history or summary).get("remarks", ())
    of_bars = (summary.get("error") or {}).get("warnings", ())
    return (*remarks, *of_bars, *(text for text in strain.get("warnings", ()) if text not in outside))


def _rows(path: Path) -> Rows:
    """A table of numbers; text and empty fields are nan, True and False are 1 and 0."""
    return [
        {key: float(value) if isinstance(value, float | int) else math.nan for key, value in row.items()}
        for row in read_table(path)
    ]


def alarm(contents: dict[str, Any]) -> str:
    """The alarm in red for a run with this summary.json; empty if its answer counts."""
    if not contents["certificate"]["passed"]:
        return "NOT CERTIFIED"
    return "" if contents.get("valid", True) else "OUTSIDE THE THEORY"
