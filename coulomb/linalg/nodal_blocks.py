"""K in 3 x 3 blocks, one per pair of coupled nodes, in formats of scipy and PETSc."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from petsc4py import PETSc

_Array = npt.NDArray[Any]


def nodal_blocks(K: PETSc.Mat) -> scipy.sparse.bsr_matrix:
    """This rank's rows of K, 3 rows per node, all columns."""
    indptr, indices, values = K.getValuesCSR()
    shape = (len(indptr) - 1, K.getSize()[1])
    return scipy.sparse.csr_matrix((values, indices, indptr), shape=shape).tobsr((3, 3))


def symmetric_blocks(K: PETSc.Mat) -> PETSc.Mat:
    """K as its upper triangle in blocks (PETSc's SBAIJ): a product reads half as much memory; collective.

    PETSc's own conversion takes fifty times as long.

    Args:
        K: Symmetric, assembled, 3 rows per node, those of a node on one rank.
    """
    pointers, columns, blocks = upper_blocks(nodal_blocks(K), K.getOwnershipRange()[0] // 3)
    matrix = PETSc.Mat().create(comm=K.comm)
    matrix.setSizes(K.getSizes(), 3)
    matrix.setType(PETSc.Mat.Type.SBAIJ)
    matrix.setPreallocationCSR((pointers.astype(PETSc.IntType), columns.astype(PETSc.IntType), blocks))
    matrix.assemble()
    return matrix


def upper_blocks(blocks: scipy.sparse.bsr_matrix, first: int) -> tuple[_Array, _Array, _Array]:
    """Pointers, columns and blocks on and above the diagonal, that on the diagonal first in its row, where there is
    none a block of zeros; `first` is the number of the first row."""
    rows = len(blocks.indptr) - 1
    row = np.repeat(np.arange(rows), np.diff(blocks.indptr))
    upper = blocks.indices >= row + first
    pointers = np.concatenate([[0], np.cumsum(np.bincount(row[upper], minlength=rows))])
    columns, values = blocks.indices[upper], blocks.data[upper]
    has_diagonal = np.zeros(rows, dtype=bool)
    has_diagonal[row[blocks.indices == row + first]] = True
    missing = np.flatnonzero(~has_diagonal)
    if len(missing) > 0:
        columns = np.insert(columns, pointers[missing], missing + first)
        values = np.insert(values, pointers[missing], 0.0, axis=0)
        pointers = pointers + np.concatenate([[0], np.cumsum(~has_diagonal)])
    return pointers, columns, values
