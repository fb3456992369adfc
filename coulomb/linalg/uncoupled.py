"""The parts of a body that its stiffness does not couple, as bodies that only contact forces connect.

Each has its own forces, and an error that is small beside those of another may be all there is of its own: residuals
are relative to the forces on each part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.csgraph import connected_components

from ..arrays import FloatArray
from .petsc_arrays import distributed_entries
from .reductions import Reductions, concatenated, summed


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of a vector.

    Attributes:
        comm: The ranks.
        count: Number of parts.
        number: Of every unknown of this rank from 0, shape (n,); empty if there is one part.
    """

    comm: MPI.Comm
    count: int
    number: npt.NDArray[np.int64]

    def norms(self, v: FloatArray) -> FloatArray:
        """Of the parts of a vector (n,), shape (count,); collective."""
        if self.count == 1:
            return np.array([Reductions(self.comm).norm(v)])
        squares = np.asarray(np.bincount(self.number, v * v, self.count), dtype=np.float64)
        return np.sqrt(summed(self.comm, squares))

    def scaled(self, v: FloatArray, factors: FloatArray) -> FloatArray:
        """A vector (n,) with its parts times factors (count,); of a single part itself."""
        return v if self.count == 1 else v * factors[self.number]

    def zero(self, chosen: npt.NDArray[np.bool_], v: FloatArray) -> None:
        """v <- 0 in the parts that are chosen, shape (count,)."""
        if np.any(chosen):
            v[slice(None) if self.count == 1 else chosen[self.number]] = 0.0


def parts_of(K: PETSc.Mat) -> Parts:
    """Of a stiffness, three rows per node; collective.

    Its attribute "components" has a number from 0 for every node of this rank: nodes of one number are of one part, as
    are those of several between which there is an entry.  Without it there is one part.
    """
    known, component = K.getAttr("parts"), K.getAttr("components")
    if isinstance(known, Parts):
        return known
    if component is None:
        return Parts(K.comm.tompi4py(), 1, np.empty(0, np.int64))
    matrix = distributed_entries(K)
    every = concatenated(matrix.comm, component)
    count = 1 + int(every.max())
    coupled = np.eye(count)
    for rows, columns in ((matrix.own, np.repeat(component, 3)), (matrix.others, every[matrix.columns // 3])):
        if rows is not None:
            row, column = np.repeat(np.repeat(component, 3), np.diff(rows.indptr)), columns[rows.indices]
            differ = row != column
            coupled[row[differ], column[differ]] = 1.0
    parts, of_component = connected_components(summed(matrix.comm, coupled), directed=False)
    number = np.repeat(of_component[component].astype(np.int64), 3 if parts > 1 else 0)
    parts_of_K = Parts(matrix.comm, int(parts), number)
    K.setAttr("parts", parts_of_K)
    return parts_of_K
