"""Kernels in C for factorisation and multigrid; without a compiler PETSc and numpy do the work."""

from __future__ import annotations

import ctypes
import functools
import logging
import os
import subprocess
from pathlib import Path

from ...compiled import compiled_library

_log = logging.getLogger(__name__)

_SOURCES = tuple(
    Path(__file__).parent / name for name in ("blocks.c", "coarsening.c", "dissection.c", "fronts.c", "vectors.c")
)
_HEADERS = tuple(
    Path(__file__).parent / name
    for name in ("blocks.h", "coarsening.h", "exchange.h", "fronts.h", "lanes.h", "shapes.h")
)
_MOST_THREADS = 64  # MOST_THREADS of lanes.h


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


@functools.cache
def threads() -> int:
    """Threads of a kernel: as many as OMP_NUM_THREADS says, but no more than there are processors; 1 if it is unset, so
    that ranks do not compete."""
    first = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(int(first), processors, _MOST_THREADS)) if first.isdigit() else 1
