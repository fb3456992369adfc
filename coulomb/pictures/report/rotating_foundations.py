"""Rotating foundations in the report: what the case prescribes, and torque and power of the contact."""

from __future__ import annotations

from typing import Any

from .files import Run
from .given import rows_and_after
from .units import in_seconds, number, quantity, vector

_SHOWN = 6  # rows of a table


def prescribed(contact: dict[str, Any], where: str) -> list[tuple[str, str]]:
    """The rotation of a contact face of the case, a row; none without one; `where` is appended to its name."""
    rotation = contact.get("rotation")
    if not rotation:
        return []
    rows, after = rows_and_after(rotation["angle"])
    shown = ", ".join(f"{number(turned)} rad at {in_seconds(time)}" for time, turned in rows[:_SHOWN])
    shown += (", …" if len(rows) > _SHOWN else "") + after
    axis = f"about ({', '.join(map(number, rotation['axis']))}) through {vector(rotation['point'], 'm')}"
    return [(f"rotation of the foundation{where}", f"{axis}: {shown}" if shown else axis)]


def figures(run: Run) -> list[tuple[str, str]]:
    """Torque and power of every rotating foundation at the end of the run, or of its last step."""
    summary, accuracy = run.summary, run.accuracy
    turning = [face for face in summary.get("faces") or [] if "torque" in face]
    rows = []
    for face in turning:
        where = f" of {face['faces'][0]}" if len(summary["faces"]) > 1 else ""
        at = f"{quantity(face['torque'], 'N m', 5, accuracy)} at {number(face['angle'], 5)} rad"
        rows.append((f"torque of the contact on the foundation{where}", at))
        if face["power"] is not None:
            least = {"W": accuracy["N m"] * abs(face["angular_velocity"])}
            speed = f"{quantity(face['power'], 'W', 5, least)} at {number(face['angular_velocity'], 5)} rad/s"
            rows.append((f"power of the contact on the foundation{where}", speed))
    return rows
