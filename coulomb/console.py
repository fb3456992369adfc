"""Where the command line speaks: on rank 0 alone; and the exit codes."""

from mpi4py import MPI
from rich.console import Console

FAILED, BAD_INPUT = 1, 2
"""Exit codes: not converged or not certified; the input is wrong.  0: the certificate passed."""

console = Console(quiet=MPI.COMM_WORLD.rank != 0, highlight=False)
errors = Console(quiet=MPI.COMM_WORLD.rank != 0, highlight=False, stderr=True, soft_wrap=True)
