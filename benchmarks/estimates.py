"""Estimates of `coulomb check-case` against measured memory and time: the block, each run in a separate process."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from coulomb.io.run_directory import RunDirectory
from coulomb.linalg.compliance import DirectSolver, IterativeSolver, LinearSolver
from coulomb.model.estimate import estimate

from .processes import alone

SIZES = (8, 16, 24)

METHODS: tuple[tuple[str, LinearSolver, bool], ...] = (
    ("direct, A formed", DirectSolver, True),
    ("direct, A matrix-free", DirectSolver, False),
    ("multigrid", IterativeSolver, False),
)


class Row(NamedTuple):
    """A row of the table; bytes, and processor seconds, which do not depend on the load of the machine."""

    p: int
    method: str
    unknowns: int
    contact: int
    memory_expected: float
    memory_measured: float
    seconds_expected: float
    seconds_measured: float


def measure(sizes: Iterable[int]) -> Iterator[Row]:
    """Rows as they are measured.

    Raises:
        RuntimeError: If a run fails.
    """
    case = str(resources.files("coulomb") / "templates" / "block.toml")
    for p in sizes:
        for name, solver, explicit in METHODS:
            kind = "direct" if solver is DirectSolver else "iterative"
            form = "explicit" if explicit else "matrix-free"
            with tempfile.TemporaryDirectory() as directory:
                command = [sys.executable, "-m", "coulomb", "run", case, "--quiet", "--force", "--output", directory]
                for change in (
                    f"mesh.cells=[{3 * p},{p},{p}]",
                    f"solver={{linear_solver='{kind}', compliance='{form}'}}",
                    "output.picture=false",
                ):
                    command += ["--set", change]
                process = subprocess.Popen(command, env=alone())
                _, status, used = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
                if process.returncode != 0:
                    raise RuntimeError(f"p = {p}, {name}: coulomb run ended with {process.returncode}")
                summary = RunDirectory(Path(directory)).read_summary()
            n, m = summary["unknowns"]["displacement"], summary["unknowns"]["contact"]
            expected = estimate(n, m, 1, solver, explicit)
            seconds = used.ru_utime + used.ru_stime
            yield Row(p, name, n, m, expected.memory, float(summary["peak_memory_bytes"]), expected.seconds, seconds)
