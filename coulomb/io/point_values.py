"""Nodal fields in the HDF5 file of an XDMF file, without rounding errors.

DOLFINx before 0.7 evaluates a function at the points of the mesh when it writes it: basis functions of other nodes are
zero there only up to rounding, so that a pressure of 1e8 Pa contributes 1e-8 Pa to a neighbouring open node.  Therefore
the exact values are written over these.
"""

from __future__ import annotations

import errno
from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem import compat
from .field_files import dataset


def dof_of_point(domain: Any, V: Any) -> npt.NDArray[np.int64]:
    """Block dof of a first-order space for each of this rank's mesh points, in their order."""
    dofs = np.zeros(len(domain.geometry.x), dtype=np.int64)
    dofs[compat.cell_geometry(domain)] = compat.cell_dofs(V)
    return dofs


def overwrite(comm: MPI.Comm, path: str, domain: Any, fields: Mapping[str, FloatArray]) -> None:
    """Overwrite nodal fields in a file; collective.

    Args:
        comm: The ranks.
        path: HDF5 file that DOLFINx has written, and closed.
        domain: The mesh in it.
        fields: By name, at the points that this rank owns, in their own order, shapes (p,) or (p, 3).

    Raises:
        OSError: On every rank, if the file cannot be written to.
    """
    first, _ = domain.geometry.index_map().local_range
    file: Any
    file, fault = _opened(path) if comm.rank == 0 else (None, "")
    for name, values in fields.items():
        own = (first, values if values.ndim == 2 else values[:, None])
        if comm.rank > 0:
            comm.send(own, dest=0)
            continue
        for rank in range(comm.size):  # in parts: no rank needs memory for the whole mesh
            start, part = own if rank == 0 else comm.recv(source=rank)
            try:
                if not fault:
                    dataset(file, name)[start : start + len(part)] = part
            except (OSError, KeyError, TypeError, ValueError) as error:
                fault = str(error) or type(error).__name__
    if file is not None:
        try:
            file.close()
        except (OSError, RuntimeError) as error:
            fault = fault or str(error)
    fault = comm.bcast(fault)
    if fault:
        raise OSError(errno.EIO, f"{path}: {fault}")


def _opened(path: str) -> tuple[Any, str]:
    """The file, or the reason why it cannot be opened."""
    try:
        return h5py.File(path, "r+"), ""
    except OSError as error:
        return None, str(error)
