"""The arrays of assembled matrices of PETSc's type AIJ, without copies, which petsc4py does not offer; 3 x 3 blocks.

With the copies of `getValuesCSR` the block takes as long, and 6 and 8 % more memory at p = 24 and 32.
"""

from __future__ import annotations

import ctypes
import functools
import itertools
from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

_prefixes = (f"coulomb_{number}_" for number in itertools.count())


def configured_ksp(
    K: PETSc.Mat, ksp_type: str, values: Mapping[str, object], operator: PETSc.Mat | None = None
) -> PETSc.KSP:
    """A KSP set up with the given options only; they are removed from PETSc's database afterwards.

    `operator` is the matrix of the system if it is not K, of which the preconditioner is made.
    """
    prefix = next(_prefixes)
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K if operator is None else operator, K)
    ksp.setType(ksp_type)
    ksp.setErrorIfNotConverged(True)
    ksp.setOptionsPrefix(prefix)
    database = PETSc.Options(prefix)
    for key, value in values.items():
        database[key] = value
    try:
        ksp.setFromOptions()
        ksp.setUp()
    finally:
        for key in values:
            database.delValue(key)
    return ksp


CHOLESKY: dict[str, str | float] = {
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_14": 60,
    "mat_mumps_icntl_7": 5,
}
"""MUMPS's factorisation.  ICNTL(14): per cent of memory beyond the estimate, for delayed pivots and parallel fronts.
ICNTL(7): METIS; without it, as on Debian, MUMPS uses PORD.  Its own choice (7) took up to twice as long."""


_Array = npt.NDArray[Any]


class Entries(NamedTuple):
    """Rows in compressed form, ascending in each row; arrays of PETSc are valid while the matrix lives."""

    indptr: _Array
    indices: _Array
    values: _Array


Rows = TypeVar("Rows")


class Distributed(NamedTuple, Generic[Rows]):
    """Rows of this rank of a distributed matrix, in entries or in blocks.

    Attributes:
        comm: The ranks.
        own: What is in this rank's columns, counted from its first one.
        others: What is in columns of other ranks, as places in `columns`; None on one rank.
        columns: Numbers of columns of other ranks, ascending.
        starts: Number of the first column of each rank, and of all columns, shape (ranks + 1,).
    """

    comm: MPI.Comm
    own: Rows
    others: Rows | None
    columns: _Array
    starts: _Array


DistributedEntries = Distributed[Entries]


def distributed_entries(matrix: PETSc.Mat) -> DistributedEntries:
    """Of an assembled matrix of type AIJ; its arrays, valid while it lives."""
    starts = np.asarray(matrix.getOwnershipRangesColumn())
    return DistributedEntries(matrix.comm.tompi4py(), *own_and_others(matrix), starts)


_INTEGER = ctypes.c_int64 if np.dtype(PETSc.IntType).itemsize == 8 else ctypes.c_int32


@functools.cache
def _petsc() -> ctypes.CDLL:
    """petsc4py's library is linked to PETSc's."""
    return ctypes.CDLL(PETSc.__file__)


def _entries(matrix: ctypes.c_void_p, rows: int) -> Entries:
    library = _petsc()
    count, done = _INTEGER(), ctypes.c_int()
    indptr, indices, values = (ctypes.c_void_p() for _ in range(3))
    out = [ctypes.byref(thing) for thing in (count, indptr, indices, done)]
    _check(library.MatGetRowIJ(matrix, _INTEGER(0), 0, 0, *out))
    _check(library.MatSeqAIJGetArrayRead(matrix, ctypes.byref(values)))
    pointers = _viewed(indptr, rows + 1, PETSc.IntType)
    entries = Entries(
        pointers, _viewed(indices, int(pointers[-1]), PETSc.IntType), _viewed(values, int(pointers[-1]), np.float64)
    )
    _check(library.MatSeqAIJRestoreArrayRead(matrix, ctypes.byref(values)))
    _check(library.MatRestoreRowIJ(matrix, _INTEGER(0), 0, 0, *out))
    return entries


def _viewed(address: ctypes.c_void_p, size: int, dtype: npt.DTypeLike) -> _Array:
    """An array where PETSc has it."""
    kind = np.dtype(dtype)
    if size == 0 or not address.value:
        return np.empty(0, kind)
    memory = ctypes.cast(address, ctypes.POINTER(ctypes.c_uint8))
    return np.ctypeslib.as_array(memory, (size * kind.itemsize,)).view(kind)


def _check(error: int) -> None:
    if error:
        raise PETSc.Error(error)


def own_and_others(matrix: PETSc.Mat) -> tuple[Entries, Entries | None, _Array]:
    """`own`, `others` and `columns` of `Distributed`, of an assembled matrix of type AIJ."""
    rows = matrix.getLocalSize()[0]
    handle = ctypes.c_void_p(matrix.handle)
    if matrix.getType() == PETSc.Mat.Type.SEQAIJ:
        return _entries(handle, rows), None, np.empty(0, PETSc.IntType)
    if matrix.getType() != PETSc.Mat.Type.MPIAIJ:
        raise ValueError(f"a matrix of PETSc's type {matrix.getType()}, where AIJ was expected")
    own, others, columns = (ctypes.c_void_p() for _ in range(3))
    _check(_petsc().MatMPIAIJGetSeqAIJ(handle, *(ctypes.byref(thing) for thing in (own, others, columns))))
    elsewhere = _entries(others, rows)
    count = _width(others)
    return _entries(own, rows), elsewhere, _viewed(columns, count, PETSc.IntType)


def _width(matrix: ctypes.c_void_p) -> int:
    rows, columns = _INTEGER(), _INTEGER()
    _check(_petsc().MatGetSize(matrix, ctypes.byref(rows), ctypes.byref(columns)))
    return int(columns.value)


class NodalRows:
    """Rows of K node by node: coupled nodes, and where their 3 x 3 blocks are among its values, which are not copied.

    Attributes:
        indptr, indices: Coupled nodes of every node, ascending, as all of 64 bits.
        first, stride: Where the block of each pair begins among the values, and from one of its rows to the next.
        values: The values of K, on one rank.
    """

    def __init__(self, K: PETSc.Mat | scipy.sparse.bsr_matrix):
        if isinstance(K, PETSc.Mat):
            stored = own_and_others(K)[0]
            if _whole(stored.indptr, stored.indices):
                self._take(*stored)
                return
            K = nodal_blocks(K)
        K.sort_indices()
        self.indptr: _Array = K.indptr.astype(np.int64)
        self.indices: _Array = K.indices.astype(np.int64)
        self.values: _Array = np.ascontiguousarray(K.data, dtype=np.float64).ravel()
        self.first: _Array = 9 * np.arange(len(K.indices))
        self.stride: _Array = np.full(len(K.indices), 3)

    def _take(self, indptr: _Array, indices: _Array, values: _Array) -> None:
        """Rows of which every block is stored wholly."""
        length = np.diff(indptr)[::3]
        coupled = length // 3
        self.indptr = np.concatenate([[0], np.cumsum(coupled)])
        inside = np.arange(self.indptr[-1]) - np.repeat(self.indptr[:-1], coupled)
        self.values, self.first = values, np.repeat(indptr[:-1:3].astype(np.int64), coupled) + 3 * inside
        self.stride = np.repeat(length.astype(np.int64), coupled)
        self.indices = indices[self.first].astype(np.int64) // 3


def _whole(indptr: _Array, indices: _Array) -> bool:
    """Whether rows (n,) and columns of a matrix consist of 3 x 3 blocks of which every entry is stored."""
    length = np.diff(indptr).reshape(-1, 3)
    if len(indices) % 3 > 0 or np.any(length % 3 > 0) or np.any(length != length[:, :1]):
        return False
    triples = indices.reshape(-1, 3)
    return bool(np.all(triples[:, 0] % 3 == 0) and np.all(triples[:, 2] == triples[:, 0] + 2))


def nodal_blocks(K: PETSc.Mat) -> scipy.sparse.bsr_matrix:
    """This rank's rows of K, 3 rows per node, all columns."""
    indptr, indices, values = K.getValuesCSR()
    shape = (len(indptr) - 1, K.getSize()[1])
    return scipy.sparse.csr_matrix((values, indices, indptr), shape=shape).tobsr((3, 3))
