"""The six rigid motions of a body, and which of them nothing prevents."""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray

_NAMES = (
    *("translation along x", "translation along y", "translation along z"),
    *("rotation about x", "rotation about y", "rotation about z"),
)


def rigid_modes(x: FloatArray, comm: MPI.Comm) -> FloatArray:
    """Translations along x, y, z and rotations about these axes through the mean of all nodes; collective.

    Each has the size 1: the translations at every node, the rotations in the root mean square of all nodes.

    Args:
        x: Coordinates of this rank's nodes in metres, shape (k, 3).
        comm: The ranks.

    Returns:
        Shape (k, 3, 6).
    """
    count = comm.allreduce(len(x), op=MPI.SUM)
    r = x - comm.allreduce(x.sum(axis=0), op=MPI.SUM) / count
    size = math.sqrt(comm.allreduce(float(np.sum(r**2)), op=MPI.SUM) / count) or 1.0
    modes = np.zeros((*x.shape, 6))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        modes[:, k, k] = 1.0
        modes[:, i, 3 + k], modes[:, j, 3 + k] = -r[:, j] / size, r[:, i] / size
    return modes


def free_motions(energy: FloatArray, limit: float) -> str:
    """Names of the rigid motions that cost no energy, as text; empty if there is none.

    Args:
        energy: Products of the `rigid_modes` with the forces that they cause, shape (6, 6).
        limit: Energy of a motion of size 1 up to which it is free.
    """
    eigenvalues, vectors = np.linalg.eigh(energy)
    free = vectors[:, eigenvalues <= limit]
    return ", ".join(name for name, row in zip(_NAMES, free, strict=True) if np.linalg.norm(row) > 0.3)
