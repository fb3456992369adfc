"""Where the command line speaks: on rank 0 alone; and the exit codes."""

from mpi4py import MPI
from rich.console import Console

FAILED, BAD_INPUT, CRASHED, INTERRUPTED = 1, 2, 3, 130
"""Exit codes; 0: the certificate passed."""

EXIT_CODES = """Exit codes:

0  the certificate passed, or what was asked for is done

1  not certified, not converged, or results not written; what there is is kept, marked so

2  wrong input, or more memory needed than there is; nothing was solved

3  a crash: a bug worth reporting

130  interrupted by Ctrl-C, SIGTERM or SIGUSR1; everything is kept, marked so
"""

console = Console(quiet=MPI.COMM_WORLD.rank != 0, highlight=False)
errors = Console(quiet=MPI.COMM_WORLD.rank != 0, highlight=False, stderr=True, soft_wrap=True)
