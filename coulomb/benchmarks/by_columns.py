"""A = B K^-1 B^T column by column, as a code does that has MUMPS but no Schur complement; to compare with."""

from __future__ import annotations

from petsc4py import PETSc

from ..arrays import FloatArray
from ..linalg.compliance import DirectSolver

_COLUMNS_AT_ONCE = 512  # right-hand sides of one MatMatSolve: bounds the memory to this many displacement fields


def compliance_by_columns(B: PETSc.Mat, solver: DirectSolver) -> FloatArray:
    """A as an array, shape (3 m, 3 m); on one rank.

    Args:
        B: Contact matrix, 3 rows per contact node; its columns are the rows of K.
        solver: The factorised K.
    """
    rows, columns = B.getSize()
    A = PETSc.Mat().createDense((rows, rows), comm=B.getComm())
    A.setUp()
    block: FloatArray = A.getDenseArray()
    every_column = PETSc.IS().createStride(columns, 0, 1, comm=B.getComm())
    for start in range(0, rows, _COLUMNS_AT_ONCE):
        stop = min(start + _COLUMNS_AT_ONCE, rows)
        chosen = PETSc.IS().createStride(stop - start, start, 1, comm=B.getComm())
        part = B.createSubMatrix(chosen, every_column)
        rhs = PETSc.Mat().createTranspose(part)  # MUMPS takes sparse right-hand sides: 1.5 times faster than dense ones
        u = PETSc.Mat().createDense((columns, stop - start), comm=B.getComm())
        u.setUp()
        u.assemble()
        solver.factor.matSolve(rhs, u)
        product = B.matMult(u)
        block[:, start:stop] = product.getDenseArray()
        for done in (product, u, rhs, part, chosen):
            done.destroy()
    every_column.destroy()
    return block.copy()
