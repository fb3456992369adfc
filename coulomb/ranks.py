"""Which process speaks and reads for all of them, asked without MPI where nobody has started this one under it.

MPI takes longer to start than a case takes to be read, so a process that no launcher has started does without it until
there is something to compute.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI

RANK_VARIABLES = (
    "OMPI_COMM_WORLD_RANK",  # Open MPI
    "PMIX_RANK",  # Open MPI, PRRTE
    "PMI_RANK",  # MPICH, Intel MPI, Cray PALS
    "MV2_COMM_WORLD_RANK",  # MVAPICH2
    "FLUX_TASK_RANK",
    "SLURM_PROCID",  # also of a batch script, which is one process: MPI says so
)
"""What a launcher of MPI calls a process's number; each of them sets one or several of these."""


def launched() -> MPI.Comm | None:
    """All ranks where a launcher has started this process; None where it is alone as far as one can see."""
    if not any(name in os.environ for name in RANK_VARIABLES):
        return None
    from mpi4py import MPI

    world: MPI.Comm = MPI.COMM_WORLD
    return world


ALONE = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_pml": "ob1", "OMPI_MCA_btl": "self"}
"""Settings of Open MPI for a process that no launcher has started; those that it launches must not inherit them."""


def start_alone() -> None:
    """Spare Open MPI what a process without launcher has no use for: together half a second of its start.

    That is the daemon of Open MPI 4, for processes that this one would start by MPI, and the search for networks.
    """
    for name, value in ALONE.items():
        os.environ.setdefault(name, value)


def is_rank_0() -> bool:
    """Whether this process is the first rank, or the only one."""
    comm = launched()
    return comm is None or comm.rank == 0


def several() -> bool:
    """Whether a launcher has started more processes than this one."""
    comm = launched()
    return comm is not None and comm.size > 1


def on_rank_0(comm: MPI.Comm | None, action: Callable[[], str]) -> str:
    """Result of an action of rank 0 on every rank; its OSError is raised on every rank.  None: there is one rank."""
    if comm is None:
        return action()
    result: str = ""
    fault: OSError | None = None
    if comm.rank == 0:
        try:
            result = action()
        except OSError as error:
            fault = error
    result, fault = comm.bcast((result, fault))
    if fault is not None:
        raise fault
    return result
