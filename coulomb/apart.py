"""Runs a drawing module in a process of its own: a renderer may take its process down, and must not start MPI.

As a script, `python apart.py coulomb.report ...`, it runs the module without the package's `__init__`, which would
bring DOLFINx and MPI along: the modules it serves know neither.
"""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
import types
from collections.abc import Sequence
from pathlib import Path

PACKAGES = {
    "matplotlib": "matplotlib",
    "PIL": "pillow",
    "jinja2": "jinja2",
    "pyvista": "pyvista",
    "vtk": "vtk",
    "vtkmodules": "vtk",
}
"""What only pictures need (the extra `pictures` of pyproject.toml): modules, and the packages that hold them."""

LAUNCHER = ("OMPI_", "PMIX_", "PMI_", "HYDRA_", "SLURM_")
"""Variables by which MPI's launcher speaks to its processes; this one is none of them."""


def run(module: str, arguments: Sequence[str], seconds: float | None = 600.0) -> tuple[int, str]:
    """Run `python -m module arguments` apart.

    Args:
        module: Full name, for example "coulomb.report".
        arguments: Of its command line.
        seconds: When to give it up; None to wait, as for a window.

    Returns:
        Its exit code, and what it said: its standard output if the code is 0, else its last line of error.
    """
    environment = {key: value for key, value in os.environ.items() if not key.startswith(LAUNCHER)}
    command = [sys.executable, str(Path(__file__).resolve()), module, *arguments]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=seconds)
    except (OSError, subprocess.TimeoutExpired) as error:
        return 1, str(error)
    if done.returncode == 0:
        return 0, done.stdout.strip()
    said = done.stderr.strip().splitlines()
    return done.returncode, said[-1] if said else f"the renderer ended with code {done.returncode}"


def missing(error: ModuleNotFoundError) -> str:
    """What to install where a package of PACKAGES is missing; nothing if it is another one."""
    module = (error.name or "").partition(".")[0]
    if module not in PACKAGES:
        return ""
    every = " ".join(dict.fromkeys(PACKAGES.values()))
    return f"{PACKAGES[module]} is not installed, and pictures need it: ./install.sh, or pip install {every}"


def _bare_package() -> None:
    """`coulomb` as a place where modules lie, and nothing else."""
    here = Path(__file__).resolve().parent
    package = types.ModuleType(here.name)
    package.__path__ = [str(here)]
    sys.modules[here.name] = package
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != here]


if __name__ == "__main__":
    _bare_package()
    del sys.argv[0]
    try:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    except ModuleNotFoundError as error:
        if not missing(error):
            raise
        sys.exit(missing(error))
