"""Processes of their own for the runs that are measured."""

from __future__ import annotations

import os
from pathlib import Path

from coulomb.ranks import ALONE


def alone(threads: int = 1) -> dict[str, str]:
    """Environment of a process on so many threads, without what a launcher of MPI has set, that finds this folder."""
    launcher = ("OMPI_COMM", "OMPI_UNIVERSE", "PMIX", "PRTE", *ALONE)
    environment = {key: value for key, value in os.environ.items() if not key.startswith(launcher)}
    environment |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS"), str(threads))
    folders = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")]
    return environment | {"PYTHONPATH": os.pathsep.join(folder for folder in folders if folder)}


def several() -> dict[str, str]:
    """The same for mpirun, on one thread per rank."""
    environment = alone()
    if os.geteuid() == 0:  # Open MPI asks root for a confirmation
        environment |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    return environment


def processor_time() -> float:
    """Seconds of processor time of this process, and of those that it has started and that have ended."""
    return sum(os.times()[:4])
