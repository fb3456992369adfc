"""Kernels in C, compiled once per machine by the compiler that DOLFINx needs as well, and loaded by ctypes.

A compiled library is kept in `$XDG_CACHE_HOME/coulomb` (`~/.cache/coulomb`), under a name made of its source, the
compiler and the processor, since it uses all that this processor can do.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shlex
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

_FLAGS = ("-O3", "-march=native", "-fopenmp-simd", "-shared", "-fPIC")
_SECONDS = 120  # limit of the compiler's time


def compiled_library(name: str, sources: Sequence[Path], headers: Sequence[Path] = ()) -> ctypes.CDLL:
    """The library of these sources.

    Args:
        name: First part of the name of its file.
        sources: Compiled together.
        headers: Which they include.

    Raises:
        OSError: If there is no compiler, or the environment has COULOMB_KERNELS=0.
        SubprocessError: If the compiler fails.
    """
    if os.environ.get("COULOMB_KERNELS") == "0":
        raise OSError("COULOMB_KERNELS=0")
    compiler = shlex.split(os.environ.get("CC", "cc"))
    library = _cache() / f"{name}_{_key(compiler, (*sources, *headers))}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=library.parent) as directory:
            made = Path(directory) / library.name
            command = [*compiler, *_FLAGS, "-o", str(made), *map(str, sources), "-lm"]
            with_threads = subprocess.run([*command, "-fopenmp"], check=False, capture_output=True, timeout=_SECONDS)
            if with_threads.returncode != 0:  # a compiler without the library of OpenMP
                subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
            made.replace(library)  # at once: other processes may do the same
    return ctypes.CDLL(str(library))


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "coulomb"


def _key(compiler: list[str], files: Sequence[Path]) -> str:
    """Of all on which the compiled library depends."""
    text = [file.read_text() for file in files] + [*compiler, *_FLAGS, platform.machine(), _processor()]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:16]


@functools.cache
def _processor() -> str:
    """The first processor's model and instructions."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return ""
    lines = info.read_text().split("\n\n")[0].splitlines()
    return "\n".join(line for line in lines if line.startswith(("model", "flags")))
