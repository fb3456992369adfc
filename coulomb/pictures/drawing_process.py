"""Drawing in a separate process, `python -m coulomb.pictures.report`: a renderer may crash, and must not start MPI.

The one that draws picture.png loads its libraries, and VTK opens its first window, while the run solves: 0.5 to 1 s for
which a run that drew itself would wait.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
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

_LAUNCHER = ("OMPI_", "PMIX_", "PMI_", "HYDRA_", "SLURM_")
"""Variables that MPI's launcher sets for its processes; the drawing process is not one of them."""


class DrawingProcess:
    """`python -m coulomb.pictures.report arguments`, started at once.

    In a separate session, so that only the caller receives Ctrl-C and can let the drawing finish; it ends with the
    caller.
    """

    def __init__(self, *arguments: str):
        environment = {key: value for key, value in os.environ.items() if not key.startswith(_LAUNCHER)}
        here = str(Path(__file__).resolve().parents[2])
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (environment.get("PYTHONPATH"), here)))
        self._process: subprocess.Popen[str] | None = None
        self._fault = ""
        # writing to a pipe that it has closed would end this process by SIGPIPE, due to PETSc
        self._line, its_end = socket.socketpair()
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "coulomb.pictures.report", *arguments],
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
        """Write a line to its standard input, and wait for it to end; a time limit, if there is one, or `stop`, called
        repeatedly, ends it.

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


def missing(error: ModuleNotFoundError) -> str:
    """Advice on a missing package of PACKAGES; empty for other packages."""
    module = (error.name or "").partition(".")[0]
    if module not in PACKAGES:
        return ""
    every = " ".join(dict.fromkeys(PACKAGES.values()))
    return f"{PACKAGES[module]} is not installed, and pictures need it: ./install.sh, or pip install {every}"


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
