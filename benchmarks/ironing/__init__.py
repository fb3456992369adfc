"""Ironing (Puso and Laursen 2004): a die is pressed into a softer slab and drawn along it, by coulomb's large motions,
GetFEM and CalculiX, on the same mesh.

Plane strain, one hexahedron across; neo-Hookean, the die ten times as stiff as the slab, its bottom part of a circle;
Coulomb friction.  The top of the die goes down until time 1, and then along the slab until time 2.  Lengths are in
millimetres, forces in newtons.

Every run is a process of its own, `python -m benchmarks.ironing`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from coulomb.arrays import FloatArray

from ..peers import PROBLEMS, Peer, missing
from ..processes import alone

LENGTH, HEIGHT = 9.0, 3.0
"""Of the slab, which is held at the bottom."""

RADIUS, HALF, DIE_HEIGHT, START = 2.0, 1.5, 1.5, 2.5
"""Of the die: radius of its bottom, half of its width, height, and where its middle is."""

DEPTH, WAY = 0.6, 3.0
"""How far the top of the die goes down, and along."""

YOUNG, DIE_YOUNG, POISSON = 1.0, 10.0, 0.3
FRICTION = 0.3
PRESSING = 3
"""Load steps of pressing."""

SLAB, DIE = "slab", "die"


def constants(young: float) -> tuple[float, float]:
    """C10 and D1 of the energy C10 (J^(-2/3) I1 - 3) + (J - 1)^2 / D1."""
    return young / (4.0 * (1.0 + POISSON)), 6.0 * (1.0 - 2.0 * POISSON) / young


def times(drawing: int) -> list[float]:
    """Ends of the load steps, so many of them of drawing; 0: two steps, pressing and drawing."""
    if drawing == 0:
        return [1.0, 2.0]
    return [k / PRESSING for k in range(1, PRESSING + 1)] + [1.0 + k / drawing for k in range(1, drawing + 1)]


def way(time: float) -> tuple[float, float, float]:
    """Displacement of the top of the die."""
    return WAY * max(time - 1.0, 0.0), 0.0, -DEPTH * min(time, 1.0)


def width(p: int) -> float:
    return 1.0 / p


def cells_of(p: int) -> dict[str, tuple[int, int, int]]:
    """Numbers of cells along x, y, z with so many cells of the slab per millimetre; those of the die are smaller."""
    return {
        SLAB: (round(LENGTH * p), 1, round(HEIGHT * p)),
        DIE: (round(3.0 * HALF * p), 1, round(DIE_HEIGHT * p)),
    }


def box_of(p: int) -> dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Corners of the bodies, the die before its bottom is bent."""
    return {
        SLAB: ((0.0, 0.0, 0.0), (LENGTH, width(p), HEIGHT)),
        DIE: ((START - HALF, 0.0, HEIGHT), (START + HALF, width(p), HEIGHT + DIE_HEIGHT)),
    }


def bent(x: FloatArray) -> FloatArray:
    """Points of the die, shape (k, 3), with the round bottom."""
    y = x.copy()
    rise = RADIUS - np.sqrt(np.maximum(RADIUS**2 - (x[:, 0] - START) ** 2, 0.0))
    y[:, 2] += rise * (1.0 - (x[:, 2] - HEIGHT) / DIE_HEIGHT)
    return y


class Faces(NamedTuple):
    """Which points, shape (k, 3), are on the held face, on the contact face."""

    held: npt.NDArray[np.bool_]
    contact: npt.NDArray[np.bool_]


def faces(body: str, x: FloatArray) -> Faces:
    """Of a body before deformation."""
    if body == SLAB:
        return Faces(np.isclose(x[:, 2], 0.0), np.isclose(x[:, 2], HEIGHT))
    flat = np.column_stack([x[:, 0], x[:, 1], np.full(len(x), HEIGHT)])
    return Faces(np.isclose(x[:, 2], HEIGHT + DIE_HEIGHT), np.isclose(x[:, 2], bent(flat)[:, 2]))


def grid(body: str, p: int) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Points (k, 3) and cells (c, 8) of a body, corners of a cell with x fastest, then y, then z."""
    n, (low, high) = cells_of(p)[body], box_of(p)[body]
    number = np.arange(np.prod([k + 1 for k in n])).reshape(n[2] + 1, n[1] + 1, n[0] + 1)
    axes = [np.linspace(a, b, k + 1) for a, b, k in zip(low, high, n, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    corners = [number[c : c + n[2], b : b + n[1], a : a + n[0]].ravel() for c in (0, 1) for b in (0, 1) for a in (0, 1)]
    return (bent(points) if body == DIE else points), np.column_stack(corners)


class Run(NamedTuple):
    """An answer of one program.

    Attributes:
        seconds: Of the processor, from the geometry to the last forces.
        iterations: Linear systems, of coulomb linear contact problems.
        steps: That have been completed, increments or load steps.
        forces: Of the slab on the die in newtons per millimetre of width, (k, 3), at the ends of the load steps.
    """

    seconds: float
    iterations: int
    steps: int
    forces: FloatArray


PROGRAMS = {
    "coulomb": Peer("ours", "solve", "coulomb"),
    "GetFEM": Peer("getfem", "solve", *PROBLEMS["block"]["GetFEM"][2:4]),
    "CalculiX": Peer("calculix", "solve", *PROBLEMS["block"]["CalculiX"][2:4]),
}


class Row(NamedTuple):
    """Of a program: processor seconds of the quickest run, iterations, steps; and while the die is drawn means of the
    forces on it, and their largest changes from step to step over the means (`roughness`)."""

    program: str
    seconds: float
    iterations: int
    steps: int
    tangential: float | None
    normal: float | None
    tangential_change: float | None
    normal_change: float | None


def measure(
    p: int, drawing: int, names: Sequence[str] | None = None, repeats: int = 1
) -> Iterator[tuple[Row, Run] | str]:
    """Rows and answers as they are measured, or why there is none.

    Raises:
        ValueError: If there is no such program.
    """
    for name in names or PROGRAMS:
        if name not in PROGRAMS:
            raise ValueError(f"there is no program {name!r}; the programs are {', '.join(PROGRAMS)}")
        if reason := missing(PROGRAMS[name]):
            yield f"{name}: {reason}"
            continue
        runs = [one_run(name, p, drawing) for _ in range(repeats)]
        failed = [run for run in runs if isinstance(run, str)]
        if failed:
            yield f"{name}: {failed[0]}"
            continue
        best = min((run for run in runs if not isinstance(run, str)), key=lambda run: run.seconds)
        yield row_of(name, best, drawing), best


def row_of(name: str, run: Run, drawing: int) -> Row:
    if drawing == 0:
        return Row(name, run.seconds, run.iterations, run.steps, None, None, None, None)
    drawn = sliding(run.forces)
    along, _, across = np.abs(drawn.mean(axis=0)).tolist()
    return Row(name, run.seconds, run.iterations, run.steps, along, across, *roughness(drawn))


def sliding(forces: FloatArray) -> FloatArray:
    """Those of the load steps that begin when the die has been drawn by an eighth of the way, and slides."""
    drawing = len(forces) - PRESSING
    return forces[PRESSING + max(drawing // 8, 1) :]


def roughness(forces: FloatArray) -> tuple[float, float]:
    """Largest changes of the tangential and of the normal force from step to step over their means."""
    if len(forces) < 2:
        return 0.0, 0.0
    change = np.abs(np.diff(forces, axis=0)).max(axis=0) / np.abs(forces.mean(axis=0))
    return float(change[0]), float(change[2])


def one_run(name: str, p: int, drawing: int) -> Run | str:
    """In a separate process; or why there is no answer."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "forces.npy"
        command = [sys.executable, "-m", "benchmarks.ironing", name, str(p), str(drawing), str(output)]
        done = subprocess.run(command, env=alone(), capture_output=True, text=True, errors="replace", check=False)
        try:
            report = json.loads(done.stdout.strip().splitlines()[-1])
        except (IndexError, ValueError):
            complaint = done.stderr.strip().splitlines()[-1:] or ["no error message"]
            return f"ended with code {done.returncode}: {complaint[0][:300]}"
        return str(report["failed"]) if "failed" in report else Run(**report, forces=np.load(output))


def histories(runs: Mapping[str, Run], drawing: int) -> Iterator[dict[str, float]]:
    """Tangential and normal forces of all programs at the ends of the load steps, columns by name."""
    for number, time in enumerate(times(drawing)):
        yield {"time": time} | {
            f"{name} {letter}": float(abs(run.forces[number, axis]))
            for name, run in runs.items()
            for letter, axis in (("T", 0), ("N", 2))
        }
