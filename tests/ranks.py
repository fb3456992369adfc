"""What tests on several ranks share."""

import numpy as np
import pytest
from mpi4py import MPI

comm = MPI.COMM_WORLD


def everywhere(values):
    """Rows of all ranks, on every rank."""
    return np.concatenate(comm.allgather(values))


def same_error(action):
    """The ValueError of an action; every rank must raise the same one."""
    with pytest.raises(ValueError) as failure:
        action()
    texts = comm.allgather(str(failure.value))
    assert len(set(texts)) == 1
    return texts[0]


def by_place(x, values):
    """Rows in the order of their places."""
    return values[np.lexsort(x.round(9).T)]
