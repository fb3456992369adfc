"""Input decks and results of CalculiX: a job in a directory of its own."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...process import peak_memory
from .answer import Unsolved

CONTROLS = "1e-7,1e-7,,,1e-7,,,-1."
"""Residual and correction over average force and increment; the last disables convergence by a zero residual: with
condensed multipliers the residual vanishes from the first steps on, while the contact state still changes."""


class Job(NamedTuple):
    """Results of a deck with one *NODE PRINT per step.

    Attributes:
        iterations: Of the equilibrium, in all increments.
        nodes: Numbers of the printed nodes, from 0, shape (k,).
        values: What is printed at the end, shape (k, 3).
        tables: What is printed at the end of each step.
        peak_memory_bytes: Of the process.
    """

    iterations: int
    nodes: npt.NDArray[np.int64]
    values: FloatArray
    peak_memory_bytes: int
    tables: tuple[FloatArray, ...] = ()


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
    return Job(iterations, table[:, 0].astype(np.int64) - 1, table[:, 1:], memory, tuple(one[:, 1:] for one in printed))


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
