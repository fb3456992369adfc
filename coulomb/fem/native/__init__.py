"""Kernels in C for the assembly of K and for internal forces; without a compiler DOLFINx and PETSc do it."""

from __future__ import annotations

import ctypes
import functools
import logging
import subprocess
from pathlib import Path

from ...compiled import compiled_library

_log = logging.getLogger(__name__)


@functools.cache
def kernels() -> ctypes.CDLL | None:
    """The compiled kernels; None without a compiler, and if the environment has COULOMB_KERNELS=0."""
    try:
        return compiled_library("assembly", [Path(__file__).parent / name for name in ("assembly.c", "forces.c")])
    except (OSError, subprocess.SubprocessError) as error:
        _log.info("no kernels in C, assembly is slower: %s", error)
        return None
