"""Software versions of a run, for the summary and for bug reports."""

from __future__ import annotations

import importlib.metadata
import platform
import sys
from functools import cache
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from threadpoolctl import threadpool_info

from .. import native
from ..fem import compat
from ..version import __version__

_PACKAGES = "mumps scalapack hypre superlu_dist suitesparse metis parmetis scotch ptscotch ml".split()

_PYTHON_PACKAGES = ("numpy", "scipy", "mpi4py", "petsc4py", "h5py", "meshio", "pyvista", "vtk")


def versions() -> dict[str, str]:
    """Versions by name, without paths."""
    return {
        "coulomb": __version__,
        "Python": platform.python_version(),
        "DOLFINx": compat.VERSION,
        "PETSc": ".".join(map(str, PETSc.Sys.getVersion())),
        **{name: version(name) for name in _PYTHON_PACKAGES[:5]},
    }


def details() -> dict[str, str]:
    """Information for a bug report: versions, PETSc's packages and number types, MPI, BLAS, and their paths."""
    petsc = ".".join(map(str, PETSc.Sys.getVersion()))
    return {
        "coulomb": __version__,
        "Python": f"{platform.python_version()} ({sys.executable})",
        "platform": platform.platform(),
        "DOLFINx": compat.VERSION,
        "PETSc": f"{petsc}, {np.dtype(PETSc.ScalarType).name}, {8 * np.dtype(PETSc.IntType).itemsize} bit integers",
        "PETSc's packages": ", ".join(name for name in _PACKAGES if PETSc.Sys.hasExternalPackage(name)),
        "MPI": MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\0"),
        "BLAS": ", ".join(sorted({_blas(entry) for entry in threadpool_info() if entry["user_api"] == "blas"})),
        "kernels in C": native.state(),
        **{name: version(name) for name in _PYTHON_PACKAGES},
    }


def _blas(entry: dict[str, Any]) -> str:
    """Path of a library, and the processor whose kernels it takes."""
    kernels = entry.get("architecture")
    return f"{entry.get('filepath')}" + (f" (kernels for {kernels})" if kernels else "")


@cache  # every load step writes them, and they are read from files
def version(name: str) -> str:
    """Version of an installed package."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        try:
            return str(__import__(name).__version__)
        except ImportError:
            return "not installed"
