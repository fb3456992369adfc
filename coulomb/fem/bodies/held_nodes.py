"""The nodes of one body or of several, numbered over the ranks, and the directions along which they are held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from .constraints import HeldDirections


@dataclass(frozen=True)
class Numbering:
    """Global numbers of this rank's nodes: those of the ranks follow each other.

    Attributes:
        first: Number of this rank's first node.
        local: How many this rank has.
        total: How many all ranks have.
    """

    first: int
    local: int
    total: int


class Nodes(Protocol):
    """Nodes with displacements, of one body or of several.

    Attributes:
        x: Coordinates of this rank's nodes in metres, shape (k, 3).
    """

    x: FloatArray

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share them."""
        ...

    @property
    def numbering(self) -> Numbering:
        """Their global numbers."""
        ...

    @property
    def lifetime(self) -> object:
        """What matrices on these nodes must keep alive (`compat.assemble_matrix`)."""
        ...

    def linear_between_vertices(self, values: FloatArray) -> FloatArray:
        """A nodal field that is linear on all edges and has these values (k,) or (k, d <= 3) at vertices."""
        ...


class HeldNodes(Nodes, Protocol):
    """Nodes whose displacement is prescribed along some directions.

    Attributes:
        held: The directions along which this rank's nodes are held.
    """

    held: HeldDirections

    @property
    def fixed(self) -> npt.NDArray[np.bool_]:
        """Which components are prescribed whatever the others are, shape (k, 3)."""
        return self.held.components

    def held_part(self, v: FloatArray) -> FloatArray:
        """The part of nodal vectors along prescribed directions; shapes (k, 3), or (k, 3, j)."""
        return self.held.held_part(v)

    def free_part(self, v: FloatArray) -> FloatArray:
        """The part of nodal vectors along free directions; shapes (k, 3), or (k, 3, j)."""
        return self.held.free_part(v)

    def projection(self) -> PETSc.Mat:
        """P, the projection on the free directions of the nodes: block diagonal, shape (n, n), distributed."""
        nodes, numbering = self.held.count, self.numbering
        number, blocks = np.arange(nodes), np.broadcast_to(np.eye(3), (nodes, 3, 3)).copy()
        blocks[self.held.nodes] -= self.held.projector
        shape = (3 * nodes, 3 * numbering.total)
        rows = scipy.sparse.bsr_matrix((blocks, numbering.first + number, np.arange(nodes + 1)), shape=shape).tocsr()
        return distributed_rows(rows, shape, self)


def distributed_rows(
    rows: scipy.sparse.csr_matrix, columns: tuple[int, int], nodes: Nodes, block: int | None = 3
) -> PETSc.Mat:
    """The matrix of the rows of every rank, with so many columns on this rank and in all.

    Args:
        rows: This rank's rows, with global numbers of columns.
        columns: Their numbers.
        nodes: The nodes to which rows or columns belong.
        block: Block size; None for none.
    """
    matrix = PETSc.Mat().createAIJ(
        ((rows.shape[0], PETSc.DETERMINE), columns),
        bsize=block,
        csr=(rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data),
        comm=nodes.comm,
    )
    matrix.setAttr("mesh", nodes.lifetime)  # keeps it alive: see compat.assemble_matrix
    return matrix
