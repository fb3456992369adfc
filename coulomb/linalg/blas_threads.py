"""How many threads BLAS may use, where it is OpenBLAS.

For some milliseconds after every call the threads of OpenBLAS wait for the next one in busy loops, in which they take
processors from the threads of our kernels, which are OpenMP's.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from scipy.linalg import cython_blas

_CALLERS = ("numpy._core._multiarray_umath", "numpy.core._multiarray_umath", cython_blas.__name__)
"""Modules that are linked to BLAS, perhaps to one each."""

_NAMES = tuple(f"{prefix}openblas_{{}}_num_threads{suffix}" for prefix in ("", "scipy_") for suffix in ("", "64_"))


class _OpenBLAS(NamedTuple):
    threads: Callable[[], int]
    choose: Callable[[int], None]


@functools.cache
def _found() -> tuple[_OpenBLAS, ...]:
    """Every OpenBLAS in use."""
    found = []
    for caller in filter(None, map(sys.modules.get, _CALLERS)):
        try:
            library = ctypes.CDLL(caller.__file__)
        except OSError:
            continue
        for name in _NAMES:
            if hasattr(library, name.format("set")) and hasattr(library, name.format("get")):
                found.append(_OpenBLAS(library[name.format("get")], library[name.format("set")]))
    return tuple(found)


@contextmanager
def one_blas_thread(wanted: bool = True) -> Iterator[None]:
    """One thread of OpenBLAS if `wanted`, and afterwards as many as before."""
    libraries = _found() if wanted else ()
    before = [library.threads() for library in libraries]
    for library in libraries:
        library.choose(1)
    try:
        yield
    finally:
        for library, count in zip(libraries, before, strict=True):
            library.choose(count)
