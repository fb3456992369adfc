"""Kernels in C, compiled once per machine by the compiler that DOLFINx needs for its forms, and loaded by ctypes.

There is a library for each job, compiled when its first function is needed: the first run of a factorised body does not
wait for multigrid's, which take 3 s.  They are kept in `$XDG_CACHE_HOME/coulomb` (`~/.cache/coulomb`), under names made
of their sources, the compiler and the processor, since they use all that this processor can do.
"""

from __future__ import annotations

import ctypes
import fcntl
import functools
import hashlib
import os
import platform
import re
import shlex
import subprocess
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

_LIBRARIES: Final = {
    "bodies": ("assembly", "forces"),
    "factors": ("dissection", "fronts"),
    "multigrid": ("blocks", "coarsening", "vectors"),
    "rigid": ("block_pattern", "gauss_seidel"),
}
_FLAGS = ("-O3", "-march=native", "-fopenmp-simd", "-shared", "-fPIC")
_SECONDS: Final = 120  # limit of the compiler's time
_MOST_THREADS: Final = 64  # MOST_THREADS of lanes.h
_TYPES = {"void": None, "int": ctypes.c_int, "long": ctypes.c_long, "double": ctypes.c_double}
_FUNCTION = re.compile(r"^(void|int|long|double) (?:NAME\()?(\w+)\)?\(([^)]*)\)", re.MULTILINE)


class Kernels:
    """The compiled functions; they have the types that the sources declare, and take arrays as pointers.

    Raises:
        ValueError: If one is needed that cannot be compiled or loaded.
    """

    @functools.cached_property
    def _declared(self) -> dict[str, tuple[str, Any, list[Any]]]:
        return {
            name: (library, _TYPES[returned], [*map(_type, given.split(","))])
            for library in _LIBRARIES
            for returned, name, given in _FUNCTION.findall("\n".join(_texts(library)))
        }

    def __getattr__(self, name: str) -> Any:
        setattr(self, name, self[name])
        return self.__dict__[name]

    def __getitem__(self, name: str) -> Any:
        stem = name if name in self._declared else re.sub(r"_(float\d+|\d+|\d+_\d+)$", "", name)
        library, returned, arguments = self._declared[stem]
        loaded = _loaded(library)
        if isinstance(loaded, str):
            raise ValueError(loaded)
        function = loaded[name]
        function.restype, function.argtypes = returned, arguments
        return function


class _Pointer:
    """Type of a parameter: a contiguous array, which the kernel does not keep alive; None is NULL."""

    @staticmethod
    def from_param(given: Any) -> Any:
        if not isinstance(given, np.ndarray):
            return ctypes.c_void_p.from_param(given)
        try:
            return ctypes.byref(ctypes.c_char.from_buffer(given.data))  # in a third of the time of `address`
        except (TypeError, ValueError):  # read-only or empty
            return address(given)


def _type(argument: str) -> Any:
    return _Pointer if "*" in argument else _TYPES.get(argument.split()[-2], _Pointer)


@functools.cache
def kernels() -> Kernels:
    """The compiled kernels."""
    return Kernels()


def state() -> str:
    """The files of all libraries, or why there are none; compiles them."""
    loaded = map(_loaded, _LIBRARIES)
    return ", ".join(dict.fromkeys(one if isinstance(one, str) else str(one._name) for one in loaded))


@functools.cache
def _loaded(library: str) -> ctypes.CDLL | str:
    """A library, or why there is none, which is asked once."""
    try:
        compiler = shlex.split(os.environ.get("CC", "cc"))
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "coulomb"
        path = cache / f"{library}_{_key(library, compiler)}.so"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                with path.with_suffix(".lock").open("w") as lock:
                    fcntl.flock(lock, fcntl.LOCK_EX)  # one of this machine's processes compiles
                    if not path.exists():
                        _compile(library, compiler, path)
            return ctypes.CDLL(str(path))
        except OSError:  # a home that cannot be written
            with tempfile.TemporaryDirectory() as directory:
                path = Path(directory) / path.name
                _compile(library, compiler, path)
                return ctypes.CDLL(str(path))
    except subprocess.CalledProcessError as error:
        return f"the kernels in C cannot be compiled: {error.stderr.decode(errors='replace').strip()[-500:]}"
    except (OSError, subprocess.SubprocessError) as error:
        return f"the kernels in C cannot be compiled, for which a C compiler is needed as for DOLFINx's forms: {error}"


def _compile(library: str, compiler: list[str], path: Path) -> None:
    with tempfile.TemporaryDirectory(dir=path.parent) as directory:
        made = Path(directory) / path.name
        command = [*compiler, *_FLAGS, "-o", str(made), *map(str, _sources(library)), "-lm"]
        with_threads = subprocess.run([*command, "-fopenmp"], check=False, capture_output=True, timeout=_SECONDS)
        if with_threads.returncode != 0:  # a compiler without the library of OpenMP
            subprocess.run(command, check=True, capture_output=True, timeout=_SECONDS)
        made.replace(path)  # at once: other machines may do the same


def _sources(library: str) -> list[Path]:
    return [Path(__file__).with_name(f"{source}.c") for source in _LIBRARIES[library]]


def _texts(library: str) -> list[str]:
    """Of its sources and the headers that they name."""
    texts = [source.read_text() for source in _sources(library)]
    headers = sorted({header for text in texts for header in re.findall(r'"(\w+\.h)"', text)})
    return texts + [Path(__file__).with_name(header).read_text() for header in headers]


def _key(library: str, compiler: list[str]) -> str:
    """Of all on which the compiled library depends."""
    text = [*_texts(library), *compiler, *_FLAGS, platform.machine(), _processor()]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:16]


@functools.cache
def _processor() -> str:
    """The first processor's model and instructions."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return ""
    lines = info.read_text().split("\n\n")[0].splitlines()
    return "\n".join(line for line in lines if line.startswith(("model", "flags")))


def address(array: npt.NDArray[Any] | None) -> ctypes.c_void_p:
    """Where a contiguous array begins, for a structure of a kernel; None is NULL."""
    return ctypes.c_void_p(None if array is None else array.ctypes.data)


@functools.cache
def threads() -> int:
    """Threads of a kernel: as many as OMP_NUM_THREADS says, but no more than there are processors; 1 if it is unset, so
    that ranks do not compete."""
    first = os.environ.get("OMP_NUM_THREADS", "").split(",")[0].strip()
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(int(first), processors, _MOST_THREADS)) if first.isdigit() else 1
