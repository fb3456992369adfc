"""Kernels in C for factorisation and multigrid; without a compiler PETSc and numpy do the work."""

from __future__ import annotations

import ctypes
import functools
import logging
import subprocess
from pathlib import Path

from ...compiled import compiled_library

_log = logging.getLogger(__name__)

_SOURCES = tuple(Path(__file__).parent / name for name in ("blocks.c", "fronts.c"))
_HEADERS = tuple(source.with_suffix(".h") for source in _SOURCES)


@functools.cache
def kernels() -> ctypes.CDLL | None:
    """The compiled kernels; None without a compiler, and if the environment has COULOMB_KERNELS=0."""
    try:
        library = compiled_library("blocks", _SOURCES, _HEADERS)
    except (OSError, subprocess.SubprocessError) as error:
        _log.info("no kernels in C, factorisation and multigrid are slower: %s", error)
        return None
    library.advance.restype = ctypes.c_double
    library.to_blocks.restype = ctypes.c_long
    return library
