"""Estimates of `coulomb check-case` against measured memory: the block, each run in a separate process."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from coulomb.io.run_directory import RunDirectory
from coulomb.linalg.compliance import DirectSolver, IterativeSolver, LinearSolver
from coulomb.model.memory import memory_needed

from .processes import alone

SIZES = (8, 16, 24)

METHODS: tuple[tuple[str, LinearSolver, bool], ...] = (
    ("direct, A formed", DirectSolver, True),
    ("direct, A matrix-free", DirectSolver, False),
    ("multigrid", IterativeSolver, False),
)


class Row(NamedTuple):
    """A row of the table, in bytes."""

    p: int
    method: str
    unknowns: int
    contact: int
    memory_expected: float
    memory_measured: float


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
                code = subprocess.run(command, env=alone(), check=False).returncode
                if code != 0:
                    raise RuntimeError(f"p = {p}, {name}: coulomb run ended with {code}")
                summary = RunDirectory(Path(directory)).read_summary()
            n, m = summary["unknowns"]["displacement"], summary["unknowns"]["contact"]
            expected = memory_needed(n, m, 1, solver, explicit)
            yield Row(p, name, n, m, expected, float(summary["peak_memory_bytes"]))
