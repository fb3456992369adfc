"""Format of a directory of results: names of the files, the reading of their tables, and a case as text.

Standard library only: the command line and the processes that draw use it without loading DOLFINx, PETSc or MPI.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SUMMARY = "summary.json"
"""The numbers of a run, of a load step, or of a whole load history."""

HISTORY = "history.csv"
"""A row per load step of a load history."""

ITERATIONS = "iterations.csv"
"""A row per Newton step or Tresca problem of a run, or of a load step."""

CASE = "case.json"
"""The case as it was run."""

PICTURE = "picture.png"
REPORT = "report.html"

SOLUTION, CONTACT = "solution.xdmf", "contact.xdmf"
"""Fields on the body and on the contact face, each with its data in a .h5 file of the same name."""

FIELDS = (SOLUTION, CONTACT)

FRD = "results.frd"
"""Results at the nodes as CalculiX writes them."""

OTHERS = ("solution.vtkhdf", "contact.vtkhdf", "contact.csv", FRD)
"""The same fields in other formats, if they are asked for."""

FILES = (HISTORY, ITERATIONS, CASE, PICTURE, REPORT, *FIELDS, *OTHERS)
"""The files beside the summary; each of the fields has another with its data."""

LOCK = "run.lock"
"""Exists while a run uses the directory."""

STEPS, FAILED = "steps", "failed"
"""Directories of the load steps, and of the last iterate of one that failed."""

MESH = "mesh"
"""Directory of the meshes that a run has made itself by refinement, .xdmf with .h5, which its case names."""

OLD = "incomplete, or written by another version of coulomb: run the case again"


class _File:
    """A file of a directory of results."""

    def __init__(self, name: str):
        self._name = name

    def __get__(self, run: RunDirectory, _: type | None = None) -> Path:
        return run.path / self._name


@dataclass(frozen=True)
class RunDirectory:
    """The directory of a run, of a load history, or of one of its load steps."""

    path: Path

    summary, history, iterations, case = _File(SUMMARY), _File(HISTORY), _File(ITERATIONS), _File(CASE)
    picture, report, solution, contact = _File(PICTURE), _File(REPORT), _File(SOLUTION), _File(CONTACT)

    def fields(self, of: str) -> Path:
        """The XDMF file of "solution" or "contact"."""
        return {"solution": self.solution, "contact": self.contact}[of]

    @property
    def failed(self) -> RunDirectory:
        """Directory of the last iterate of a failed load step."""
        return RunDirectory(self.path / FAILED)

    def step(self, number: int) -> RunDirectory:
        """Directory of a load step, from 1."""
        return RunDirectory(self.path / step_place(number))

    @property
    def moving(self) -> bool:
        """Whether complete results are still to be moved to their place (`atomic_output`)."""
        return any((*self.path.glob(f".partial*/{SUMMARY}"), *self.path.glob(".old")))

    @property
    def is_history(self) -> bool:
        """Whether it belongs to a load history."""
        return (self.path / STEPS).is_dir()

    @property
    def step_number(self) -> int | None:
        """Number of the load step whose directory this is; None for other directories."""
        place = self.path.absolute()
        return int(place.name) if place.parent.name == STEPS and place.name.isdigit() else None

    @property
    def of_history(self) -> RunDirectory:
        """The load history of which this is a step."""
        return RunDirectory(self.path.absolute().parents[1])

    @property
    def begun_steps(self) -> list[int]:
        """Numbers of the load steps that have a directory, in order."""
        if not self.is_history:
            return []
        places = (self.path / STEPS).iterdir()
        return sorted(int(place.name) for place in places if re.fullmatch(r"\d{4,}", place.name))

    @property
    def complete_steps(self) -> list[int]:
        """Numbers of the complete load steps, from 1 without a gap; a step with a summary is complete."""
        steps: list[int] = []
        while self.step(len(steps) + 1).summary.is_file():
            steps.append(len(steps) + 1)
        return steps

    def read_summary(self, needed: tuple[str, ...] = ()) -> dict[str, Any]:
        """The contents of summary.json.

        Raises:
            ValueError: If it cannot be read, is not a summary, or lacks a required entry.
        """
        if not self.summary.exists() and self.moving:
            raise ValueError(
                f"{self.path}: a run was killed while it moved results: the next coulomb run here finishes that"
            )
        contents = read_json(self.summary)
        for key in needed:
            if key not in contents:
                raise ValueError(f"{self.summary}: has no {key!r}: {OLD}")
        return contents


def read_table(path: Path) -> list[dict[str, Any]]:
    """The rows of history.csv or iterations.csv, by column names: numbers, booleans, and texts; None for nan, inf and
    nothing, as in JSON.

    Raises:
        ValueError: If it cannot be read.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return [{name: _parsed(text) for name, text in row.items()} for row in csv.DictReader(file)]
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path}: cannot be read: it is not a text table: {error}") from None


def _parsed(text: Any) -> Any:
    if not text or not isinstance(text, str):  # a row that is too short or too long
        return None
    if text in ("True", "False"):
        return text == "True"
    try:
        value = float(text)
    except ValueError:
        return text
    if not math.isfinite(value):
        return None
    return int(value) if re.fullmatch(r"-?\d+", text) else value


def step_place(number: int) -> str:
    """Directory of a load step relative to that of its history."""
    return f"{STEPS}/{number:04d}"


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object.

    Raises:
        ValueError: If the file cannot be read, or is not a JSON object.
    """
    try:
        contents: Any = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: is not JSON: {error}") from None
    if not isinstance(contents, dict):
        raise ValueError(f"{path}: is not an object of JSON")
    return contents


def as_toml(tables: Mapping[str, Any], of: str = "") -> str:
    """Tables as the text of a case file; those inside a table with a name, as the materials of a body, are tables of
    their own, the others are inline."""
    lines = [f"{key} = {_value(value)}" for key, value in tables.items() if not _is_table(value, of)]
    for key, value in tables.items():
        if not _is_table(value, of):
            continue
        several = isinstance(value, list)
        for one in value if several else [value]:
            title = f"[[{of}{key}]]" if several else f"[{of}{key}]"
            lines.append(f"{title}\n{as_toml(one, f'{of}{key}.')}")
    return "\n".join(lines)


def _is_table(value: Any, of: str) -> bool:
    """Whether a value is written as a table with a title, in the table `of`, at the top ""."""
    if of not in ("", "body."):
        return False
    return isinstance(value, Mapping) or (isinstance(value, list) and bool(value) and isinstance(value[0], Mapping))


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_value(one)}' for key, one in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float) and "e" in (short := f"{value:g}") and float(short) == value:
        return short  # 2e+11
    return json.dumps(value, ensure_ascii=False)
