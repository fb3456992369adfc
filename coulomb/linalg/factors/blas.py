"""BLAS and LAPACK on blocks of dense matrices, in place and without the interpreter's lock.

scipy's own functions copy a block of a larger matrix before they work on it, and hold the lock, so that two threads
wait for each other.  These are the same routines, called at the addresses that scipy publishes for Cython.

All matrices are of float32 or of float64, shape (m, n), with columns that are contiguous (Fortran order), each a stride
after the one before.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import cython_blas, cython_lapack

Real = npt.NDArray[Any]
"""Numbers in single or double precision."""

_LETTER = {np.dtype(np.float32): "s", np.dtype(np.float64): "d"}


def gemm(alpha: float, A: Real, B: Real, beta: float, C: Real, transposed: bool = False) -> None:
    """C <- alpha A B + beta C, or alpha A B^T + beta C."""
    m, n, k = C.shape[0], C.shape[1], A.shape[1]
    if m and n and (k or beta != 1.0):
        a, b, trans = _number(C.dtype, alpha), _number(C.dtype, beta), b"T" if transposed else b"N"
        _routine("gemm", C.dtype)(b"N", trans, _i(m), _i(n), _i(k), a, *_block(A), *_block(B), b, *_block(C))


def potrf(A: Real) -> int:
    """A <- L, A = L L^T, the lower triangles; 0, or the number of the first pivot that is not positive."""
    failed = ctypes.c_int(0)
    if len(A):
        _routine("potrf", A.dtype)(b"L", _i(len(A)), *_block(A), ctypes.byref(failed))
    return failed.value


def trsm_right(L: Real, B: Real, transposed: bool) -> None:
    """B <- B L^-1, or B L^-T; L a lower triangle."""
    m, n = B.shape
    if m and n:
        one = _number(B.dtype, 1.0)
        trans = b"T" if transposed else b"N"
        _routine("trsm", B.dtype)(b"R", b"L", trans, b"N", _i(m), _i(n), one, *_block(L), *_block(B))


def trtri(L: Real) -> None:
    """L <- L^-1, lower triangles."""
    failed = ctypes.c_int(0)
    if len(L):
        _routine("trtri", L.dtype)(b"L", b"N", _i(len(L)), *_block(L), ctypes.byref(failed))


@cache
def _routine(name: str, dtype: np.dtype[Any]) -> Any:
    """A routine whose arguments are pointers; while it runs, the interpreter's lock is free."""
    found = _LETTER[dtype] + name
    capsule = (cython_lapack if name in ("potrf", "trtri") else cython_blas).__pyx_capi__[found]
    called = ctypes.pythonapi.PyCapsule_GetName
    called.restype, called.argtypes = ctypes.c_char_p, [ctypes.py_object]
    signature = called(capsule)
    address = ctypes.pythonapi.PyCapsule_GetPointer
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    count = signature.count(b",") + 1
    pointer = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count)
    return pointer(address(capsule, signature))


def _i(value: int) -> Any:
    return ctypes.byref(ctypes.c_int(value))


def _number(dtype: np.dtype[Any], value: float) -> Any:
    return ctypes.byref(ctypes.c_float(value) if dtype == np.float32 else ctypes.c_double(value))


def _block(A: Real) -> tuple[Any, Any]:
    """Address and leading dimension of a matrix."""
    rows, columns = A.shape
    size = A.itemsize
    stride = A.strides[1] if columns > 1 else size * max(rows, 1)
    if (rows > 1 and A.strides[0] != size) or stride % size or stride < size * rows:
        raise ValueError("a matrix in Fortran order is needed")
    return A.ctypes.data, _i(stride // size)
