"""Rotations of the foundations in the files of a run: from the case, or without one as the run recorded them."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from ...fem.geometry import Spin, spin
from ..run_files import WrittenRun
from .case_reference import CaseReference
from .face_nodes import FaceNodes, face_names

AS_WRITTEN = (
    "taken as written, without a case.json: the foundation's displacement, the same at all nodes of a face but for its "
    "rotation, whose axis and angle are those of summary.json"
)


def case_spins(run: WrittenRun, case: CaseReference, time: float, started: float | None) -> tuple[Spin | None, ...]:
    """Rotations of the foundations in the step from `started`, None without one, to a time, by the case.

    There is one for each contact face of the run: the case may be another one, with fewer faces.
    """
    now = case.rigid_motions(time)
    if started is None:
        spins = [spin(motion, None, 1.0) for motion in now]
    else:
        pairs = zip(now, case.rigid_motions(started), strict=True)
        spins = [spin(motion, before, time - started) for motion, before in pairs]
    return (*spins, *[None] * (len(face_names(run)) - len(spins)))


def written_spins(run: WrittenRun) -> tuple[Spin | None, ...]:
    """Rotations of the foundations of the faces according to summary.json.

    Raises:
        ValueError: If one is incomplete.
    """
    faces = run.summary.get("faces")
    if not isinstance(faces, list) or len(faces) != len(face_names(run)):
        return (None,) * len(face_names(run))
    return tuple(_written(run, entry) if isinstance(entry, dict) and "torque" in entry else None for entry in faces)


def _written(run: WrittenRun, entry: dict[str, object]) -> Spin:
    try:
        axis = entry["axis"]
        point, direction = (np.array(axis[name], dtype=np.float64) for name in ("point", "direction"))  # type: ignore[index]
        angle, velocity = entry["angle"], entry["angular_velocity"]
        if point.shape != (3,) or direction.shape != (3,):
            raise ValueError
        return Spin(point, direction, float(angle), None if velocity is None else float(velocity))  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{run.files.summary}: a face with a torque has no axis, angle and angular_velocity") from None


def foundation_displacement(
    nodes: FaceNodes, spins: tuple[Spin | None, ...], x: FloatArray, before: FloatArray, duration: float
) -> FloatArray:
    """Displacement of the foundations in a step at the nodes, without a case: recorded rotation and mean translation.

    Args:
        nodes: The nodes with the slip origin as written.
        spins: Rotations of the foundations of the faces.
        x: Coordinates of the nodes in metres, shape (m, 3).
        before: Their displacement after the step before, metres, shape (m, 3).
        duration: Of the step in seconds.

    Returns:
        Metres, shape (m, 3).
    """
    moved = np.zeros_like(x)
    for part, turning in enumerate(spins):
        on = nodes.part == part
        if turning is not None and turning.angular_velocity is not None:
            moved[on] = duration * turning.angular_velocity * np.cross(turning.axis, x[on] - turning.centre)
        known = on & nodes.written
        if np.any(known):
            moved[on] += np.mean((nodes.origin - before - moved)[known], axis=0)
    moved[nodes.paired] = 0.0  # what moves there is in the displacement
    return moved
