"""Supports, loads and load curves of a case in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...arrays import FloatArray
from ...load_curve import LoadCurve
from .units import in_seconds, number, quantity, vector

_ROWS = 8
"""Maximum number of rows of a table in time that are shown."""

_AFTER = {"error": ", not defined after the last", "repeat": ", repeated"}


def supports_and_loads(case: dict[str, Any]) -> list[tuple[str, str]]:
    """Clamps, prescribed displacements, springs and loads of a case.json, as pairs of name and description."""
    facts = []
    for support in (*case.get("clamp", ()), *case.get("prescribed_displacement", ())):
        value = support.get("value", [0.0] * 3)
        kind, moved = ("prescribed displacement", f": {vector_at(value, 'm')}") if any(value) else ("clamp", " held")
        along = support.get("direction")
        directions = f"components {support.get('components', 'xyz')}" if along is None else f"along {_bare(along)}"
        facts.append((f"{kind} on {support['face']}", directions + moved + in_time(support.get("amplitude"))))
    for rotation in case.get("prescribed_rotation", ()):
        axis, point = _bare(rotation["axis"]), vector(rotation["point"], "m")
        free = "; free along the axis" if rotation.get("axial") == "free" else ""
        turned = f"{number(rotation['angle'])} rad about {axis} through {point}{free}"
        facts.append((f"prescribed rotation of {rotation['face']}", turned + in_time(rotation.get("amplitude"))))
    facts += [("plane of symmetry", str(symmetry["face"])) for symmetry in case.get("symmetry", ())]
    for spring in case.get("spring", ()):
        given = spring["stiffness"]
        stiffness = [float(given)] * 3 if isinstance(given, int | float) else given
        facts.append((f"spring on {spring['face']}", f"{_bare(stiffness)} N/m³ along x, y, z"))
    for load in case.get("traction", ()):
        facts.append((f"traction on {load['face']}", vector_at(load["value"], "Pa") + in_time(load.get("amplitude"))))
    for load in case.get("pressure", ()):
        given = load["value"]
        value = f"{given} Pa" if isinstance(given, str) else quantity(given, "Pa")
        facts.append((f"pressure on {load['face']}", value + in_time(load.get("amplitude"))))
    for load in case.get("total_force", ()):
        facts.append((f"total force on {load['face']}", vector(load["force"], "N") + in_time(load.get("amplitude"))))
    for key, name, unit in (("body_force", "body force", "N/m³"), ("gravity", "gravity", "m/s²")):
        value = case.get(key, ())
        if any(value):
            facts.append((name, f"{_bare(value)} {unit}{in_time(case.get(f'{key}_amplitude'))}"))
    for body in case.get("body", ()):
        if (own := body.get("gravity")) is not None:
            facts.append((f"gravity on {body['name']}", f"{_bare(own)} m/s²{in_time(case.get('gravity_amplitude'))}"))
    return facts


def vector_at(value: Sequence[float | str], unit: str) -> str:
    """A vector, whose components may be expressions of place."""
    numbers = [component for component in value if not isinstance(component, str)]
    return vector(numbers, unit) if len(numbers) == len(value) else f"{_bare(value)} {unit}"


def number_at(value: float | str) -> str:
    """A number, or an expression of place."""
    return value if isinstance(value, str) else number(value)


def _bare(value: Sequence[float | str]) -> str:
    return f"({', '.join(map(number_at, value))})"


def in_time(amplitude: Any) -> str:
    """A factor in time: rows [time, factor], or a load curve; empty without one."""
    rows, after = rows_and_after(amplitude)
    if not rows:
        return ""
    shown = ", ".join(f"{number(factor)} at {in_seconds(time)}" for time, factor in rows[:_ROWS])
    return f", factor {shown}{', …' if len(rows) > _ROWS else ''}{after}"


def values_in_time(given: Any, times: Sequence[float]) -> FloatArray:
    """Values of a table in time of a case.json at k times, shape (k, columns)."""
    rows, _ = rows_and_after(given)
    after: Any = given.get("after", "hold") if isinstance(given, dict) else "hold"
    curve = LoadCurve([row[0] for row in rows], [row[1:] for row in rows], after)
    return np.array([curve.at(time) for time in times])


def rows_and_after(given: Any) -> tuple[list[list[float]], str]:
    """Rows of a table in time of a case.json, and what follows the last in words, if it is not its value."""
    if isinstance(given, dict):
        return given["table"], _AFTER.get(given.get("after", "hold"), "")
    return given or [], ""
