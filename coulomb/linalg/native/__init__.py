"""Kernels in C, compiled once per machine by the compiler that DOLFINx needs as well, and loaded by ctypes.

A compiled library is kept in `$XDG_CACHE_HOME/coulomb` (`~/.cache/coulomb`), under a name made of its source, the
compiler and the processor, since it uses all that this processor can do.  Without a compiler there are no kernels, and
PETSc and numpy do the work.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import logging
import os
import platform
import shlex
import subprocess
import tempfile
from pathlib import Path

_log = logging.getLogger(__name__)

_COMPILED = tuple(Path(__file__).parent / name for name in ("blocks.c", "fronts.c"))
_SOURCES = (*_COMPILED, *(source.with_suffix(".h") for source in _COMPILED))
_FLAGS = ("-O3", "-march=native", "-fopenmp-simd", "-shared", "-fPIC")
_SECONDS = 120  # limit of the compiler's time


@functools.cache
def kernels() -> ctypes.CDLL | None:
    """The compiled kernels; None without a compiler, and if the environment has COULOMB_KERNELS=0."""
    if os.environ.get("COULOMB_KERNELS") == "0":
        return None
    try:
        return _loaded()
    except (OSError, subprocess.SubprocessError) as error:
        _log.info("no kernels in C, factorisation and multigrid are slower: %s", error)
        return None


def _loaded() -> ctypes.CDLL:
    compiler = shlex.split(os.environ.get("CC", "cc"))
    library = _cache() / f"blocks_{_key(compiler)}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as directory:
            made = Path(directory) / library.name
            command = [*compiler, *_FLAGS, "-o", str(made), *map(str, _COMPILED)]
            subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
            made.replace(library)  # at once: other processes may do the same
    loaded = ctypes.CDLL(str(library))
    loaded.advance.restype = ctypes.c_double
    loaded.to_blocks.restype = ctypes.c_long
    return loaded


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "coulomb"


def _key(compiler: list[str]) -> str:
    """Of all on which the compiled library depends."""
    text = [source.read_text() for source in _SOURCES] + [*compiler, *_FLAGS, platform.machine()]
    info = Path("/proc/cpuinfo")
    if info.exists():  # the first processor's model and instructions
        text += [line for line in info.read_text().split("\n\n")[0].splitlines() if line.startswith(("model", "flags"))]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:16]
