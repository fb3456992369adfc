"""The ranks of a run, determined without starting MPI if the process has no launcher.

The start of MPI takes longer than reading a case, so a process without launcher does not start it before there is
something to compute.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar, cast

if TYPE_CHECKING:
    from mpi4py import MPI

RANK_VARIABLES = (
    "OMPI_COMM_WORLD_RANK",  # Open MPI
    "PMIX_RANK",  # Open MPI, PRRTE
    "PMI_RANK",  # MPICH, Intel MPI, Cray PALS
    "MV2_COMM_WORLD_RANK",  # MVAPICH2
    "FLUX_TASK_RANK",
    "SLURM_PROCID",  # also set in a batch script, which is one process according to MPI
)
"""Variables in which MPI launchers pass the number of a process; each sets one or several of these."""


def has_launcher() -> bool:
    """Whether there is a sign that a launcher has started this process."""
    return any(name in os.environ for name in RANK_VARIABLES)


def launched() -> MPI.Comm | None:
    """All ranks if a launcher has started this process; None if there is no sign of a launcher."""
    if not has_launcher():
        return None
    from mpi4py import MPI

    return MPI.COMM_WORLD


ALONE = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_pml": "ob1", "OMPI_MCA_btl": "self"}
"""Settings of Open MPI for a process without launcher; MPI processes that it starts must not inherit them."""


def start_alone() -> None:
    """Disable parts of Open MPI that a process without launcher does not need, which saves half a second.

    These are the daemon of Open MPI 4, for processes started by MPI, and the search for networks.
    """
    for name, value in ALONE.items():
        os.environ.setdefault(name, value)


def several() -> bool:
    """Whether a launcher has started more processes than this one."""
    comm = launched()
    return comm is not None and comm.size > 1


def all_arrive(seconds: float) -> bool:
    """Whether all ranks call this within some seconds; after False the processes can only be aborted.

    The others may be in any collective call, where they would wait for this rank for ever.
    """
    comm = launched()
    if comm is None or comm.size == 1:
        return True
    together, until = comm.Ibarrier(), time.monotonic() + seconds
    while not together.Test():
        if time.monotonic() > until:
            return False
        time.sleep(1e-3)
    return True


Value = TypeVar("Value")


def on_rank_0(comm: MPI.Comm | None, action: Callable[[], Value]) -> Value:
    """Result of an action of rank 0 on every rank; its error is raised on every rank.  None: there is one rank."""
    if comm is None:
        return action()
    result: Value | None = None
    fault: Exception | None = None
    if comm.rank == 0:
        try:
            result = action()
        except Exception as error:
            fault = error
    same = fault  # of other types only the words are sent: not every error can be
    if isinstance(fault, ValueError):
        same = ValueError(str(fault))
    elif fault is not None and not isinstance(fault, OSError):
        same = RuntimeError(repr(fault))
    result, same = comm.bcast((result, same))
    if same is not None:
        raise fault or same
    return cast(Value, result)
