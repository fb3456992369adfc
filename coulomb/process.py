"""Standard streams, signals, caches and memory of the process.  Loaded before anything that takes time.

- Ctrl-C and the signals that end a job act at once and without a message, from the first import on, until there are
  results to keep (`cli.session.Interruption`): exit codes 130, 143, that is, 128 plus the number of the signal.
- A closed pipe (`| head`) ends a command without a message, as for other programs (141).  A run continues, since its
  results are files; it also continues if the disk of its log is full.
- A closed standard stream is replaced by the null device, so that no other file gets its number.
- Under an MPI launcher standard output may be a terminal device, but is treated as a log: plain text only.
- If no cache can be written (a read-only home), forms and fonts are kept in the directory for temporary files.
"""

from __future__ import annotations

import atexit
import errno
import io
import os
import resource
import signal
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from .ranks import has_launcher, start_alone
from .regular_file import unwritable

_goes_on = False


class _Stream(io.FileIO):
    """A standard stream without exceptions: after the first failed write it is replaced by the null device."""

    fault: OSError | None = None

    def write(self, data: object) -> int:
        try:
            return super().write(data)  # type: ignore[arg-type, return-value]
        except OSError as error:
            self.fault = error
            if error.errno != errno.EPIPE and self.fileno() == 1:
                word = "warning" if _goes_on else "error"
                with suppress(OSError):
                    os.write(2, f"{word}: standard output: {error.strerror}; further output is discarded\n".encode())
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return memoryview(data).nbytes  # type: ignore[arg-type]


def begin() -> None:
    """Set up the process before the rest is imported."""
    _open_streams()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    given = os.environ.get("PETSC_OPTIONS", "").split()
    if "-no_signal_handler" not in given:  # it would report a signal as an error, with a traceback
        os.environ["PETSC_OPTIONS"] = " ".join([*given, "-no_signal_handler"])
    if has_launcher():
        os.environ["TERM"] = "dumb"
        # no daemon, which would report the end of this process
        os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")
    else:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # under a launcher it may concern MPI's own pipes
        start_alone()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")  # else it looks through all installed packages for them
    _keep_caches_somewhere()


def restore_signal_handlers() -> None:
    """Restore signal handlers after the start of MPI: Open MPI 5 takes over SIGHUP and ignores it."""
    for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGUSR1):
        signal.signal(number, signal.getsignal(number))


def ignore_broken_pipes() -> None:
    """From here on a closed pipe does not end the process, which has results to write."""
    global _goes_on
    _goes_on = True
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def leave(code: int, failed: int) -> NoReturn:
    """End the process in order, but without the time that Python takes to delete all modules, a sixth of `--help`.

    Functions registered for the end are called, and PETSc and MPI end as they would (PETSc prints what -log_view asks
    for).  Under a profiler or debugger, which continue after the program, Python ends as usual.  Exit code 0 becomes
    `failed` if the output, the only result, could not be written.
    """
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    lost = isinstance(raw, _Stream) and raw.fault is not None and raw.fault.errno != errno.EPIPE
    code = failed if lost and code == 0 and not _goes_on else code
    if sys.getprofile() is None and sys.gettrace() is None:
        atexit._run_exitfuncs()
        petsc, mpi = (sys.modules.get(name) for name in ("petsc4py.PETSc", "mpi4py.MPI"))
        if petsc is not None:
            petsc._finalize()
        if mpi is not None and mpi.Is_initialized() and not mpi.Is_finalized():
            mpi.Finalize()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(code)
    sys.exit(code)


def animated() -> bool:
    """Whether standard output is an interactive terminal, on which a line can be updated."""
    dull = has_launcher() or "NO_COLOR" in os.environ or os.environ.get("TERM", "dumb") in ("dumb", "unknown", "")
    return not dull and sys.stdout.isatty()


def peak_memory(pid: int | str = "self") -> int:
    """Peak memory of a process in bytes; 0 if it has ended.

    From the kernel's high-water mark, since getrusage includes the memory before exec, that is, the parent's.  Without
    such a file, getrusage is used for this process.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if pid == "self" else 0
    return max((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), default=0)


def _open_streams() -> None:
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number: this one
    for name, number in (("stdout", 1), ("stderr", 2)):
        encoding = getattr(getattr(sys, name), "encoding", None) or "utf-8"
        raw = _Stream(number, "w", closefd=False)
        text = io.TextIOWrapper(
            io.BufferedWriter(raw), encoding, errors="backslashreplace", line_buffering=number == 2 or raw.isatty()
        )
        setattr(sys, name, text)


def _keep_caches_somewhere() -> None:
    """Redirect the caches of DOLFINx and matplotlib if the home directory is not writable."""
    home = os.path.expanduser("~")
    if not os.environ.get("XDG_CACHE_HOME"):  # empty means the working directory to DOLFINx, and unset in the standard
        os.environ.pop("XDG_CACHE_HOME", None)
    cache = os.environ.get("XDG_CACHE_HOME", os.path.join(home, ".cache"))
    if os.path.isabs(home) and not unwritable(Path(cache)):
        return
    try:
        place = _own_directory()
    except OSError:  # no writable place: the libraries report it when they need one
        return
    os.environ["XDG_CACHE_HOME"] = str(place)
    os.environ.setdefault("MPLCONFIGDIR", str(place / "matplotlib"))
    if not os.path.isdir(home):
        os.environ["HOME"] = str(place)


def _own_directory() -> Path:
    """A directory for temporary files with a fixed name, owned by this user only."""
    place = Path(tempfile.gettempdir()) / f"coulomb-{os.getuid()}"
    place.mkdir(mode=0o700, exist_ok=True)
    status = place.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o022:
        return Path(tempfile.mkdtemp(prefix="coulomb-"))
    return place
