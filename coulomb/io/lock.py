"""One run at a time in a directory of results.

The lock is a file in the directory with the process that holds it, protected in two ways.  A `flock` on the file ends
with its process in any case, so that locks are never stale on one machine (and between machines on NFS 4 and Lustre, if
they support it).  If the file system has no `flock`, or only a local one, the contents of the file decide: a process of
this machine that has ended, or whose number has been reused, holds no lock; a process of another machine cannot be
checked, and the user must remove the file once it has ended.  O_EXCL determines which process created the file.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from pathlib import Path

from mpi4py import MPI

from ..ranks import on_rank_0
from .replacing import finish
from .run_directory import LOCK

_held: dict[Path, int] = {}
"""Descriptors of the locks of this process, which may request the same lock twice."""

_NOT_OFFERED = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)


class InUseError(ValueError):
    """The directory is in use by another run."""


@dataclass(frozen=True)
class Holder:
    """The holder of a lock.

    Attributes:
        pid: Number of the process.
        host: Its machine.
        started: Its start time in the kernel's units, which differs for a later process with the same number.
        since: Time at which it took the lock, as text.
        command: Its command line.
    """

    pid: int
    host: str
    started: str
    since: str
    command: str

    @property
    def is_here(self) -> bool:
        """Whether a process with its number exists on this machine."""
        return self.host == socket.gethostname()

    @property
    def shares_kernel(self) -> bool:
        """Whether its `flock` is visible here: on this machine, in any container."""
        return self.is_here or self.started.partition(" ")[0] == _started(os.getpid()).partition(" ")[0]

    @property
    def is_gone(self) -> bool:
        """Whether it is known to have ended; unknown for other machines."""
        return self.is_here and _started(self.pid) != self.started

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.since} ({self.command})"


@contextmanager
def locked(directory: str | Path, comm: MPI.Comm) -> Iterator[None]:
    """Lock a directory, created if necessary, for the duration of the context; rank 0 holds the lock; collective.

    Raises:
        InUseError: On every rank, if another run holds it, with its holder and a remedy.
        OSError: On every rank, if the directory cannot be written to.
    """
    folder, fault, mine = Path(directory), "", False
    made: list[Path] = []

    def take() -> str:
        nonlocal mine
        made.extend(_make(folder))
        if folder.resolve() not in _held:
            try:
                _held[folder.resolve()] = _take(folder / LOCK)
            except InUseError as error:
                return str(error)
            mine = True
        return ""

    try:
        fault = on_rank_0(comm, take)
        if fault:
            raise InUseError(fault)
        yield
    finally:
        if mine:
            with suppress(OSError):
                (folder / LOCK).unlink()
            os.close(_held.pop(folder.resolve()))
        for path in made:  # a refused run leaves no directory behind
            with suppress(OSError):
                path.rmdir()


def refuse_in_use(directory: str | Path, comm: MPI.Comm) -> None:
    """Check before any computation whether another run holds a directory; collective.

    Raises:
        InUseError: On every rank, as `locked`.
    """
    path = Path(directory) / LOCK

    def look() -> str:
        try:
            descriptor = os.open(path, os.O_RDWR)
        except OSError:  # there is no lock; other errors appear when it is taken
            return ""
        try:
            return "" if path.parent.resolve() in _held else _in_use(path, descriptor, _flock(descriptor))
        finally:
            os.close(descriptor)

    if fault := on_rank_0(comm, look):
        raise InUseError(fault)


def _make(folder: Path) -> list[Path]:
    """Create a directory and its parents; returns those created, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _take(path: Path) -> int:
    """Take the lock; returns its descriptor."""
    while True:
        try:
            descriptor, ours = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                descriptor, ours = os.open(path, os.O_RDWR), False
            except FileNotFoundError:  # released in the meantime
                continue
        try:
            alone = _flock(descriptor)
            if not _is_still(path, descriptor):
                os.close(descriptor)
                continue
            if fault := "" if ours and alone is not False else _in_use(path, descriptor, alone):
                raise InUseError(fault)
            if not ours:  # left by a killed process, possibly with partial files
                for partial in path.parent.glob(".partial-*"):
                    shutil.rmtree(partial, ignore_errors=True)
            finish(path.parent)
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, (json.dumps(asdict(_me())) + "\n").encode(), 0)
            return descriptor
        except BaseException:
            os.close(descriptor)
            raise


def _flock(descriptor: int) -> bool | None:
    """Whether this process has the lock on the file; None if the file system has no locks."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _NOT_OFFERED:
            return None
        return False
    return True


def _is_still(path: Path, descriptor: int) -> bool:
    """Whether the file still exists, that is, was not released in the meantime."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _in_use(path: Path, descriptor: int, alone: bool | None) -> str:
    """Message with another holder of the lock and a remedy; empty if it is free."""
    holder = _holder(descriptor)
    remove = f"if that run is known to have ended, remove {path}"
    if alone is False:
        who = str(holder) if holder is not None else "a run that has just started"
        return f"{path.parent} is in use by {who}: wait for its end, or choose another directory"
    if holder is None:
        return "" if alone else f"{path.parent} is in use by a run that has just started; {remove}"
    if holder.is_gone or (alone and holder.shares_kernel):
        return ""
    if holder.is_here:
        return f"{path.parent} is in use by {holder}: wait for its end, or choose another directory"
    return f"{path.parent} is in use by {holder}, which cannot be seen from {socket.gethostname()}; {remove}"


def _holder(descriptor: int) -> Holder | None:
    """The holder in the file; None if it is empty or unreadable."""
    try:
        entries = json.loads(os.pread(descriptor, 1 << 16, 0))
        return Holder(int(entries["pid"]), **{field.name: str(entries[field.name]) for field in fields(Holder)[1:]})
    except (ValueError, KeyError, TypeError):
        return None


def _me() -> Holder:
    now = datetime.now().isoformat(sep=" ", timespec="seconds")
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]).replace("__main__.py", "coulomb")[:300]
    return Holder(os.getpid(), socket.gethostname(), _started(os.getpid()), now, command)


def _started(pid: int) -> str:
    """Start time of a process: boot of its machine, and clock ticks since; empty without such a process or /proc."""
    try:
        ticks = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[19]
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except (OSError, IndexError):
        with suppress(OSError):
            os.kill(pid, 0)
            return "running"
        return ""
    return f"{boot} {ticks}"
