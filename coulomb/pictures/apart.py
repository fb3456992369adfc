"""Runs a drawing module in a separate process: a renderer may crash, and must not start MPI.

As a script, `python apart.py coulomb.pictures.report ...`, it runs the module without the package's `__init__`; such
modules import neither DOLFINx nor MPI.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
import types
from collections.abc import Callable, Sequence
from pathlib import Path

PACKAGES = {
    "matplotlib": "matplotlib",
    "PIL": "pillow",
    "jinja2": "jinja2",
    "pyvista": "pyvista",
    "vtk": "vtk",
    "vtkmodules": "vtk",
}
"""Modules that only pictures need, and their packages (the extra `pictures` of pyproject.toml)."""

LAUNCHER = ("OMPI_", "PMIX_", "PMI_", "HYDRA_", "SLURM_")
"""Variables that MPI's launcher sets for its processes; the drawing process is not one of them."""


_LINUX_DIE_WITH_PARENT = 1  # prctl's PR_SET_PDEATHSIG


class Apart:
    """`python -m module arguments` in a separate process, started at once.

    In a separate session, so that only the caller receives Ctrl-C and can let the drawing finish.

    Args:
        module: Full name, for example "coulomb.pictures.report".
        arguments: Its command line.
    """

    def __init__(self, module: str, arguments: Sequence[str]):
        environment = {key: value for key, value in os.environ.items() if not key.startswith(LAUNCHER)}
        command = [sys.executable, str(Path(__file__).resolve()), module, *arguments]
        self._process: subprocess.Popen[str] | None = None
        self._fault = ""
        self._line, its_end = (
            socket.socketpair()
        )  # writing to a pipe that it has closed would end this process by SIGPIPE, due to PETSc
        try:
            self._process = subprocess.Popen(
                command,
                env=environment,
                stdin=its_end.fileno(),
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        except OSError as error:
            self._fault = str(error)
        its_end.close()

    def finish(
        self, line: str = "", seconds: float | None = 600.0, stop: Callable[[], bool] = lambda: False
    ) -> tuple[int, str]:
        """Wait for it to end.

        Args:
            line: Text for its standard input.
            seconds: Time limit; None to wait without limit, as for a window.
            stop: Called repeatedly; a true result ends the process.

        Returns:
            Its exit code, and its standard output if the code is 0, else its last line of standard error.
        """
        process = self._process
        if process is None or process.returncode is not None:
            return 1, self._fault or "the renderer was stopped"
        until = math.inf if seconds is None else time.monotonic() + seconds
        try:
            with self._line, contextlib.suppress(OSError):  # it may have ended already: its error output has the reason
                self._line.sendall(line.encode(), socket.MSG_NOSIGNAL)
            while True:
                try:
                    out, error = process.communicate(timeout=0.1)
                    break
                except subprocess.TimeoutExpired:
                    if stop() or time.monotonic() > until:
                        return 1, "interrupted" if stop() else f"it took more than {seconds:g} seconds"
        finally:
            self.stop()
        code = process.wait()
        if code == 0:
            return 0, out.strip()
        said = error.strip().splitlines()
        return code, said[-1] if said else f"the renderer ended with code {code}"

    def stop(self) -> None:
        """End it if it has not ended; may be called more than once."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.communicate()
        self._line.close()


def run(
    module: str, arguments: Sequence[str], seconds: float | None = 600.0, stop: Callable[[], bool] = lambda: False
) -> tuple[int, str]:
    """Run `python -m module arguments` in a separate process and wait for it, as `Apart.finish`."""
    return Apart(module, arguments).finish(seconds=seconds, stop=stop)


def missing(error: ModuleNotFoundError) -> str:
    """Advice on a missing package of PACKAGES; empty for other packages."""
    module = (error.name or "").partition(".")[0]
    if module not in PACKAGES:
        return ""
    every = " ".join(dict.fromkeys(PACKAGES.values()))
    return f"{PACKAGES[module]} is not installed, and pictures need it: ./install.sh, or pip install {every}"


def _bare_package() -> None:
    """Register `coulomb` as a namespace without running its `__init__`."""
    here = Path(__file__).resolve().parent
    package = types.ModuleType("coulomb")
    package.__path__ = [str(here.parent)]
    sys.modules["coulomb"] = package
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != here]


def _end_with_parent() -> None:
    """On Linux: end this process when its parent ends."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_LINUX_DIE_WITH_PARENT, int(signal.SIGKILL), 0, 0, 0)


if __name__ == "__main__":
    _end_with_parent()
    _bare_package()
    del sys.argv[0]
    try:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    except ModuleNotFoundError as error:
        if not missing(error):
            raise
        sys.exit(missing(error))
