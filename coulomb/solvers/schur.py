"""Schur complements from MUMPS: two PETSc functions that petsc4py does not wrap, called in its own libpetsc.

MatFactorSetSchurIS and MatFactorCreateSchurComplement work on one rank only, with MUMPS (PETSc 3.22 and older ones).
"""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from ..arrays import FloatArray

_NEEDED = ("MatFactorSetSchurIS", "MatFactorCreateSchurComplement", "MatDenseGetArrayRead", "MatDestroy")


@cache
def _petsc() -> ctypes.CDLL:
    """petsc4py's extension module: looking up a symbol in it also searches the libpetsc it is linked to."""
    return ctypes.CDLL(PETSc.__file__)


def available(comm: PETSc.Comm) -> bool:
    """Whether a Schur complement can be had on these ranks."""
    real = np.dtype(PETSc.ScalarType) == np.float64
    return comm.getSize() == 1 and real and all(hasattr(_petsc(), name) for name in _NEEDED)


def eliminate_all_but(factor: PETSc.Mat, rows: npt.NDArray[np.int32]) -> None:
    """Before the factorisation: stop at these rows, and leave their Schur complement.

    Args:
        factor: MUMPS factor whose solver type is set and which is not yet factorised.
        rows: Rows to keep, ascending.
    """
    kept = PETSc.IS().createGeneral(rows.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    _call("MatFactorSetSchurIS", ctypes.c_void_p(factor.handle), ctypes.c_void_p(kept.handle))
    kept.destroy()


def schur_complement(factor: PETSc.Mat) -> FloatArray:
    """After it, and before the first solve: the Schur complement's lower triangle, shape (k, k), Fortran order."""
    complement, status, data = ctypes.c_void_p(), ctypes.c_int(), ctypes.POINTER(ctypes.c_double)()
    handle = ctypes.c_void_p(factor.handle)
    _call("MatFactorCreateSchurComplement", handle, ctypes.byref(complement), ctypes.byref(status))
    try:
        size = ctypes.c_int64() if np.dtype(PETSc.IntType).itemsize == 8 else ctypes.c_int32()
        _call("MatGetSize", complement, ctypes.byref(size), None)
        _call("MatDenseGetArrayRead", complement, ctypes.byref(data))
        entries = np.ctypeslib.as_array(data, shape=(size.value, size.value)).T.copy(order="F")
        _call("MatDenseRestoreArrayRead", complement, ctypes.byref(data))
    finally:
        _call("MatDestroy", ctypes.byref(complement))
    return entries


def _call(name: str, *arguments: object) -> None:
    code = getattr(_petsc(), name)(*arguments)
    if code:
        raise RuntimeError(f"PETSc's {name} failed with error {code}")
