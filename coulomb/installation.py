"""What is missing, or does not fit, where DOLFINx cannot be used: causes and remedies."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, cast

REMEDY = 'On Debian: ./install.sh; on any Linux with Python 3.12 or newer: pip install ".[fenicsx]" in the checkout.'


class Unusable(ImportError):
    """DOLFINx, PETSc or MPI is missing, or they do not fit together."""


@contextmanager
def dolfinx_import() -> Iterator[None]:
    """Around the import of DOLFINx.

    Debian 12's sets RTLD_GLOBAL and does not reset it; VTK's wheels, imported later, then abort.  Its UFL and FFCx ask
    pkg_resources for their versions, which looks through all installed packages: a quarter of the import's time.
    """
    from importlib.metadata import distribution  # takes 5 ms to load

    set_flags, versions = sys.setdlopenflags, cast(Any, ModuleType("pkg_resources"))
    versions.get_distribution = distribution
    sys.setdlopenflags = lambda flags: None
    sys.modules.setdefault("pkg_resources", versions)
    try:
        yield
    finally:
        sys.setdlopenflags = set_flags
        if sys.modules.get("pkg_resources") is versions:
            del sys.modules["pkg_resources"]


def why_not_imported(error: BaseException, environment: Mapping[str, str]) -> str:
    """Of an import of DOLFINx that failed."""
    said = f"({type(error).__name__}: {error})" if str(error) else f"({type(error).__name__})"
    if "GLIBC" in said:
        return (
            f"DOLFINx is built for a newer C library than this system has {said}: the wheel of PyPI needs glibc 2.34 "
            "or newer (Debian 12, Ubuntu 22.04). Take a newer system, or DOLFINx of conda-forge"
        )
    if "libmpi" in said:
        return (
            f"DOLFINx does not find its MPI library {said}. With PyPI's dolfinx-solver-real: import coulomb before "
            "dolfinx, or reinstall mpich and mpi4py, which it needs, in the same environment"
        )
    if "PETSC_DIR" in environment:
        return f"DOLFINx cannot be imported {said}; PETSC_DIR is set ({environment['PETSC_DIR']}): try without"
    if isinstance(error, AssertionError) or getattr(error, "name", None) == "petsc4py":
        return f"coulomb needs a DOLFINx with petsc4py, which this one does not have {said}. {REMEDY}"
    return f"coulomb needs DOLFINx 0.5 or newer with petsc4py and mpi4py {said}. {REMEDY}"


def unusable(error: Exception) -> str:
    """What to say instead of a traceback if DOLFINx, PETSc or MPI cannot be used; empty for other exceptions."""
    if isinstance(error, Unusable):
        return str(error)
    of_platform = isinstance(error, ImportError) and str(error.name).split(".")[0] in ("dolfinx", "petsc4py", "mpi4py")
    return why_not_imported(error, os.environ) if of_platform else ""


COMPLEX = (
    "coulomb needs a PETSc with real numbers, this one is complex. Debian's package is python3-dolfinx-real, PyPI's "
    'dolfinx-solver-real (pip uninstall dolfinx-solver dolfinx-solver-complex first), conda-forge\'s petsc="*=real*"'
)


def loaded_libraries() -> set[str]:
    """Files of the libraries of this process; none if the system does not say."""
    try:
        lines = Path("/proc/self/maps").read_text(errors="replace").splitlines()
    except OSError:
        return set()
    return {columns[5] for line in lines if len(columns := line.split(maxsplit=5)) == 6}


def why_mpi_does_not_fit(libraries: Iterable[str], size: int, library: str, environment: Mapping[str, str]) -> str:
    """Two MPI libraries in one process, by the files of its libraries, or a launcher of another MPI, by its environment
    and the size according to the MPI library of this name; empty if neither."""
    mpis = sorted(file for file in libraries if re.search(r"/libmpi(ch)?\.so[.\d]*$", file))
    if len(mpis) > 1:
        return (
            f"mpi4py and DOLFINx use different MPI libraries ({', '.join(mpis)}): install an mpi4py of DOLFINx's MPI, "
            "and unset MPI4PY_LIBMPI and MPI4PY_MPIABI"
        )
    started = max((int(n) for n in map(environment.get, _SIZES) if n and n.isdigit()), default=1)
    if started > 1 and size == 1:
        return (
            f"started as one of {started} processes by a launcher of another MPI than {library}, according to which "
            "there is one: use the mpiexec of this Python's environment"
        )
    return ""


_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE")  # Open MPI; MPICH and Intel MPI
