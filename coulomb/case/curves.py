"""Tables in time of a case: rows, or a load curve with rows or a CSV file and what follows its last row."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..arrays import FloatArray
from ..load_curve import After, LoadCurve
from ..ranks import launched, on_rank_0
from .files import read_text
from .values import ROWS, FileName, Number, Table

if TYPE_CHECKING:
    from ..fem.geometry import Amplitude, Motion

ROWS_ALONE, CURVE = "rows", "a load curve"

FactorRows = Annotated[tuple[tuple[Number, Number], ...], Field(min_length=1, max_length=ROWS)]
"""Rows [time, factor]."""

MotionRows = Annotated[tuple[tuple[Number, Number, Number, Number], ...], Field(min_length=1, max_length=ROWS)]
"""Rows [time, x, y, z]."""


class CurveTable(Table):
    """Rows of time and values, and what follows the last; `file` names the CSV file from which the rows were read."""

    table: FactorRows | MotionRows
    after: After = "hold"
    file: FileName | None = None

    @model_validator(mode="after")
    def _usable(self) -> CurveTable:
        self.curve()
        return self

    def curve(self) -> LoadCurve:
        """ValueError if the times do not increase, or a repeated curve has a jump."""
        return LoadCurve([row[0] for row in self.table], [row[1:] for row in self.table], self.after)


class FactorCurveTable(CurveTable):
    """A curve of factors."""

    table: FactorRows


class MotionCurveTable(CurveTable):
    """A curve of translations in metres."""

    table: MotionRows


def _kind(given: Any) -> str:
    return CURVE if isinstance(given, dict | CurveTable) else ROWS_ALONE


def _no_text(given: Any) -> Any:
    if isinstance(given, str):
        raise ValueError(f'should be a table of rows, or {{ file = "{given[:80]}" }} for a CSV file')
    return given


AmplitudeTable = Annotated[
    Annotated[FactorRows, Tag(ROWS_ALONE)] | Annotated[FactorCurveTable, Tag(CURVE)],
    Discriminator(_kind),
    BeforeValidator(_no_text),
]
"""A factor in time: rows, constant after the last, or a load curve."""

MotionTable = Annotated[
    Annotated[MotionRows, Tag(ROWS_ALONE)] | Annotated[MotionCurveTable, Tag(CURVE)],
    Discriminator(_kind),
    BeforeValidator(_no_text),
]
"""A translation in time: rows, constant after the last, or a load curve."""

Factors = tuple[tuple[float, float], ...] | FactorCurveTable
Translations = tuple[tuple[float, float, float, float], ...] | MotionCurveTable


def in_radians(given: Any) -> Any:
    """A table of a case with `angle` in place of `degrees`: a number, or rows of time and angle."""
    if not isinstance(given, dict) or "degrees" not in given:
        return given
    if "angle" in given:
        raise ValueError("give angle (radians) or degrees, one of the two")

    def turned(angle: Any) -> Any:
        return math.radians(angle) if isinstance(angle, int | float) and not isinstance(angle, bool) else angle

    degrees = given["degrees"]
    if isinstance(degrees, dict):
        degrees = {**degrees, "table": in_radians({"degrees": degrees.get("table")})["angle"]}
    elif isinstance(degrees, list | tuple):
        degrees = [[*row[:1], *map(turned, row[1:])] if isinstance(row, list | tuple) else row for row in degrees]
    return {**{key: value for key, value in given.items() if key != "degrees"}, "angle": turned(degrees)}


def amplitude_of(given: Factors | None) -> Amplitude:
    """The factor 1 without a table."""
    if given is None:
        return 1.0
    return given.curve() if isinstance(given, CurveTable) else given


def motion_of(given: Translations | None) -> Motion | None:
    return given.curve() if isinstance(given, CurveTable) else given


def values_at(given: Factors | Translations, time: float) -> FloatArray:
    """A factor, shape (1,), or a translation, shape (3,), at a time."""
    curve = given.curve() if isinstance(given, CurveTable) else CurveTable(table=given).curve()
    return curve.at(time)


def rows_of(given: Factors | Translations) -> tuple[tuple[float, ...], ...]:
    return given.table if isinstance(given, CurveTable) else given


def refuse_ended(given: Factors | Translations, end: float) -> None:
    """ValueError if a table ends before the end of a history, and `after` is "error"."""
    if isinstance(given, CurveTable):
        given.curve().at(end)


# --- CSV files ----------------------------------------------------------------------------------------------------

_COLUMNS = {"amplitude": "time, factor", "motion": "time, x, y, z", "angle": "time, angle", "degrees": "time, angle"}
"""Keys of tables in time, alone or after an underscore as in friction_amplitude, and their columns."""


def columns_of(key: str) -> str:
    """The columns of a table in time; empty for other keys."""
    return _COLUMNS.get(key.rpartition("_")[2], "")


def read_curves(case: Path, tables: Any, recorded: bool = False, key: str = "") -> None:
    """Put the rows of CSV files, relative to the directory of the case, into the tables of a case; a recorded one has
    them, beside the name of the file.

    Raises:
        ValueError: On every rank, if a file cannot be read, with key, file and line.
    """
    if isinstance(tables, list):
        for number, table in enumerate(tables):
            if isinstance(table, dict):  # not the rows of a table in time
                read_curves(case, table, recorded, f"{key}.{number}")
    if not isinstance(tables, dict):
        return
    for name, value in tables.items():
        here = f"{key}.{name}" if key else str(name)
        if isinstance(value, dict) and columns_of(str(name)) and isinstance(value.get("file"), str):
            if "table" in value and recorded:
                continue
            if "table" in value:
                raise ValueError(f"{case}: {here}: give either table or file, one of the two")
            columns = columns_of(str(name))
            value["table"] = _rows(case.parent / value["file"], columns, f"{case}: {here}")
            value["file"] = str(case.parent / value["file"])
        elif isinstance(value, dict | list):
            read_curves(case, value, recorded, here)


def _rows(path: Path, columns: str, what: str) -> list[list[float]]:
    try:
        text = on_rank_0(launched(), lambda: read_text(path))
    except OSError as error:
        raise ValueError(f"{what}: {path}: cannot be read: {error.strerror or error}") from None
    rows: list[list[float]] = []
    lines = [(n, line.strip()) for n, line in enumerate(text.splitlines(), 1)]
    lines = [(n, line) for n, line in lines if line and not line.startswith("#")]
    for number, line in lines:
        hint = "; a decimal sign must be a point" if ";" in line and "," in line else ""
        cells = [
            cell.strip().strip('"') for cell in re.split(r"[,;\t]" if re.search(r"[,;\t]", line) else r"\s+", line)
        ]
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            if number == lines[0][0] and not any(map(_is_number, cells)):  # a header
                continue
            raise ValueError(f"{what}: {path}, line {number}: {line[:60]!r} is no row of numbers{hint}") from None
        if len(rows[-1]) != columns.count(",") + 1 or not all(math.isfinite(value) for value in rows[-1]):
            expected = f"{columns.count(',') + 1} finite numbers, {columns}"
            raise ValueError(f"{what}: {path}, line {number}: {line[:60]!r} should be {expected}{hint}")
    if not rows:
        raise ValueError(f"{what}: {path}: has no rows of numbers")
    return rows


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


_RAMPED: Final = (
    *("prescribed_displacement", "prescribed_rotation", "traction", "pressure", "total_force", "point_load"),
    *("nodal_force", "volume_force", "temperature"),
)
"""Tables of what is applied, each with its amplitude."""


def in_one_history(case: dict[str, Any]) -> dict[str, Any]:
    """The tables of a case; of large motions without a history with one from 0 to 1 s, in which all that is applied and
    has no amplitude grows with time, so that load steps can be halved."""
    solver = case.get("solver")
    if not isinstance(solver, dict) or solver.get("kinematics") != "large" or case.get("history") is not None:
        return case
    ramp: Any = [[0.0, 0.0], [1.0, 1.0]]

    def ramped(tables: Any, of: str = "") -> Any:
        if isinstance(tables, list | tuple):
            return [ramped(table, of) for table in tables]
        wanted = isinstance(tables, dict) and (not of or of in tables)
        key = f"{of}_amplitude".lstrip("_")
        return {**tables, key: ramp} if wanted and tables.get(key) is None else tables

    grown = {name: ramped(case[name]) for name in _RAMPED if case.get(name)}
    gaps = {"contact": ramped(ramped(case["contact"], "gap"), "force")} if case.get("contact") else {}
    with_weight = [case, *(case["body"] if isinstance(case.get("body"), list | tuple) else [])]
    forces = {
        f"{name}_amplitude": case.get(f"{name}_amplitude", ramp)
        for name in ("body_force", "gravity")
        if any(name in table for table in with_weight)
    }
    return {**case, **grown, **gaps, **forces, "history": {"end": 1.0, "steps": 1}}
