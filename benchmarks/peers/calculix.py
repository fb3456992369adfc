"""CalculiX: dual mortar contact (LINMORTAR) of fully integrated C3D8 on one fixed element, Newton, SPOOLES.

On a plane rigid foundation the biorthogonal multipliers decouple the nodes, so that the contact law is nodal, as in the
other packages.  Contact is regularised: pressure and shear stress are a slope times penetration and elastic slip; the
multipliers allow a slope so large that both are negligible.  (Its node-to-surface contact, a penalty, converges up to
slopes of about 1e14 Pa/m; the error of its forces is then 5e-3 at p = 10.)
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from coulomb.arrays import FloatArray
from coulomb.process import peak_memory

from .answer import FRICTION, LENGTHS, POISSON, STEPS, TRACTIONS, YOUNG, Answer, Unsolved, stacked, tractions

SLOPE = 1e20
"""Pressure over penetration, and shear stress over elastic slip, in Pa/m."""


def solve(p: int) -> Answer:
    """Iterations are those of the equilibrium; reading and writing the files is counted."""
    began = time.perf_counter()
    x, cells, load = grid(p)
    contact = np.flatnonzero((x[:, 2] == 0.0) & (x[:, 0] > 0.0))
    job = run(_deck(x, cells, load, contact))
    forces = job.values - load[job.nodes]  # the printed forces are the element forces
    return Answer(time.perf_counter() - began, job.iterations, x[job.nodes], forces, job.peak_memory_bytes)


def solve_history(p: int) -> Answer:
    """The load history, a *STEP per load step."""
    began = time.perf_counter()
    x, cells, whole = grid(p)
    contact = np.flatnonzero((x[:, 2] == 0.0) & (x[:, 0] > 0.0))
    ever = np.argwhere(whole != 0.0)  # a load of an earlier step stays until it is replaced
    lines, loads = preamble(x, cells, contact), []
    for number in range(1, STEPS + 1):
        load = grid(p, tractions(float(number)))[2]
        loads.append(load)
        lines += ["*STEP, INC=1000", "*STATIC, DIRECT", "1.,1.", "*CONTROLS, PARAMETERS=FIELD", CONTROLS, "*CLOAD"]
        lines += [f"{node + 1},{axis + 1},{load[node, axis]:.16g}" for node, axis in ever]
        lines += ["*NODE PRINT, NSET=CONTACT", "RF", "*END STEP"]
    job: Job = run(lines, STEPS)
    forces = [values - load[job.nodes] for values, load in zip(job.tables, loads, strict=True)]
    return Answer(time.perf_counter() - began, job.iterations, x[job.nodes], stacked(forces), job.peak_memory_bytes)


def grid(
    p: int, on_faces: Mapping[str, Sequence[float]] = TRACTIONS
) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
    """Nodes in metres, shape (k, 3); cells, shape (c, 8), those on z = 0 first; loads in newtons, shape (k, 3)."""
    n = [round(length * p) for length in LENGTHS]
    number = np.arange(np.prod([k + 1 for k in n])).reshape(n[2] + 1, n[1] + 1, n[0] + 1)
    k, j, i = np.indices(number.shape).reshape(3, -1)
    x = np.column_stack([i, j, k]) / p
    lower = [number[:-1, a : a + n[1], b : b + n[0]].ravel() for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))]
    upper = [number[1:, a : a + n[1], b : b + n[0]].ravel() for a, b in ((0, 0), (0, 1), (1, 1), (1, 0))]
    load = np.zeros_like(x)
    for face, axis in (("top", 2), ("right", 0)):
        area = np.where(x[:, axis] == LENGTHS[axis], 1.0 / p**2, 0.0)
        for other in {0, 1, 2} - {axis}:
            area[(x[:, other] == 0.0) | (x[:, other] == LENGTHS[other])] *= 0.5
        load += np.outer(area, on_faces[face])
    return x, np.column_stack(lower + upper), load


def _deck(x: FloatArray, cells: npt.NDArray[np.int64], load: FloatArray, contact: npt.NDArray[np.int64]) -> list[str]:
    loaded = [(node, axis) for node, axis in np.argwhere(load != 0.0)]
    lines = preamble(x, cells, contact)
    lines += ["*STEP", "*STATIC, DIRECT", "1.,1.", "*CONTROLS, PARAMETERS=FIELD", CONTROLS]
    lines += ["*CLOAD", *(f"{node + 1},{axis + 1},{load[node, axis]:.16g}" for node, axis in loaded)]
    lines += ["*NODE PRINT, NSET=CONTACT", "RF", "*END STEP"]
    return lines


def preamble(x: FloatArray, cells: npt.NDArray[np.int64], contact: npt.NDArray[np.int64]) -> list[str]:
    """The lines of a deck before its steps."""
    below = int(np.count_nonzero(x[cells].min(axis=1)[:, 2] == 0.0))  # cells on the contact face
    corners = [(-1, -1), (4, -1), (4, 2), (-1, 2)]
    foundation = np.array([(a, b, z) for z in (-1, 0) for a, b in corners], dtype=np.float64)
    first = len(x)
    fixed = np.concatenate([np.flatnonzero(x[:, 0] == 0.0), first + np.arange(8)])
    lines = ["*NODE", *numbered(np.concatenate([x, foundation]))]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=BODY", *numbered(cells + 1)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=FOUNDATION", f"{len(cells) + 1},{row(first + 1 + np.arange(8))}"]
    lines += ["*NSET, NSET=FIXED", *(str(node + 1) for node in fixed)]
    lines += ["*NSET, NSET=CONTACT", *(str(node + 1) for node in contact)]
    lines += ["*SURFACE, NAME=SLAVE", *(f"{cell + 1},S1" for cell in range(below))]
    lines += ["*SURFACE, NAME=MASTER", f"{len(cells) + 1},S2"]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{YOUNG},{POISSON}"]
    lines += [f"*SOLID SECTION, ELSET={part}, MATERIAL=STEEL" for part in ("BODY", "FOUNDATION")]
    lines += ["*SURFACE INTERACTION, NAME=CONTACT"]
    lines += ["*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{SLOPE:g}", "*FRICTION", f"{FRICTION},{SLOPE:g}"]
    lines += ["*CONTACT PAIR, INTERACTION=CONTACT, TYPE=LINMORTAR", "SLAVE,MASTER"]
    lines += ["*BOUNDARY", "FIXED,1,3"]
    return lines


CONTROLS = "1e-7,1e-7,,,1e-7,,,-1."
"""Residual and correction over average force and increment; the last disables convergence by a zero residual: with
condensed multipliers the residual vanishes from the first steps on, while the contact state still changes."""


class Job(NamedTuple):
    """Results of a deck with one *NODE PRINT per step.

    Attributes:
        iterations: Of the equilibrium, in all increments, also those that were given up.
        nodes: Numbers of the printed nodes, from 0, shape (k,).
        values: What is printed at the end, shape (k, 3).
        tables: What is printed at the end of each step.
        peak_memory_bytes: Of the process.
        increments: Completed ones of all steps.
    """

    iterations: int
    nodes: npt.NDArray[np.int64]
    values: FloatArray
    peak_memory_bytes: int
    tables: tuple[FloatArray, ...] = ()
    increments: int = 0


def run(deck: Iterable[str], steps: int = 1) -> Job:
    """The results of a deck with so many steps of duration 1.

    Raises:
        Unsolved: If CalculiX ends with an error, or before the end of the load.
    """
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        (directory / "job.inp").write_text("\n".join([*deck, ""]), encoding="ascii")
        memory = _run(directory)
        increments = [line.split() for line in _lines(directory / "job.sta")[2:]]
        if float(increments[-1][4]) < steps:
            raise Unsolved(f"not converged: ccx ended at {float(increments[-1][4]) / steps:.0%} of the load")
        lines = _lines(directory / "job.dat")
        starts = [k for k, line in enumerate(lines) if "time" in line]
        ends = [*starts[1:], len(lines)]
        printed = [np.loadtxt(lines[a + 1 : b], ndmin=2) for a, b in zip(starts, ends, strict=True)]
        table = printed[-1]
    iterations = sum(int(increment[3]) for increment in increments)
    tables = tuple(one[:, 1:] for one in printed)
    completed = sum(not increment[2].endswith("U") for increment in increments)
    return Job(iterations, table[:, 0].astype(np.int64) - 1, table[:, 1:], memory, tables, completed)


def _run(directory: Path) -> int:
    """ccx on job.inp; its peak memory in bytes."""
    environment = {"OMP_NUM_THREADS": "1"} | os.environ
    memory, log = 0, directory / "log"
    with log.open("w", encoding="utf-8") as file:
        process = subprocess.Popen(
            ["ccx", "-i", "job"], cwd=directory, env=environment, stdout=file, stderr=subprocess.STDOUT
        )
        while process.poll() is None:
            memory = max(memory, peak_memory(process.pid))
            time.sleep(0.01)
    if process.returncode != 0 or not _lines(directory / "job.dat"):
        faults = [line.strip() for line in _lines(log) if "*ERROR" in line] or ["no error message"]
        raise Unsolved(f"ccx ended with code {process.returncode}: {faults[0]}")
    return memory


def _lines(path: Path) -> list[str]:
    """Its non-empty lines; none if there is no such file."""
    text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
    return [line for line in text.splitlines() if line.strip()]


def numbered(rows: npt.NDArray[np.int64] | FloatArray, first: int = 1) -> Iterable[str]:
    """Lines with a number and a row, as nodes and elements have."""
    return (f"{number},{row(values)}" for number, values in enumerate(rows, first))


def row(values: Iterable[float]) -> str:
    """One line of numbers."""
    return ",".join(f"{value:.16g}" for value in values)
