"""One run at a time in a directory of results.

The lock is a file in the directory that says whose it is.  It is held twice over.  `flock` on it ends with its process,
whatever ended that, so that on one machine (and on NFS 4 and Lustre where they offer it, between machines) nothing is
ever stale.  Where the file system offers no `flock`, or keeps it to one machine, what is written in the file decides: a
process of this machine that is gone, or whose number another one has got since, holds nothing; one of another machine
cannot be seen from here, and whoever knows that it is gone removes the file.  O_EXCL says who made the file.
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
from .run_directory import LOCK

_held: dict[Path, int] = {}
"""Descriptors of the locks of this process, which may ask twice for the same."""

_NOT_OFFERED = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)


class InUseError(ValueError):
    """The directory belongs to a run that goes on."""


@dataclass(frozen=True)
class Holder:
    """Who holds a lock.

    Attributes:
        pid: Number of the process.
        host: Its machine.
        started: When it began, as its kernel counts: another process with its number began at another time.
        since: When it took the lock, in words.
        command: Its command line.
    """

    pid: int
    host: str
    started: str
    since: str
    command: str

    @property
    def is_here(self) -> bool:
        """Whether its process is one of this machine's, by number."""
        return self.host == socket.gethostname()

    @property
    def shares_kernel(self) -> bool:
        """Whether its `flock` would be seen here: on this machine, in whatever container."""
        return self.is_here or self.started.partition(" ")[0] == _started(os.getpid()).partition(" ")[0]

    @property
    def is_gone(self) -> bool:
        """Whether it is known to have ended; of another machine nothing is known."""
        return self.is_here and _started(self.pid) != self.started

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.since} ({self.command})"


@contextmanager
def locked(directory: str | Path, comm: MPI.Comm) -> Iterator[None]:
    """Hold a directory, made if need be, for as long as the context lasts; rank 0 holds it for all; collective.

    Raises:
        InUseError: On every rank, if another run holds it: whose it is, and what to do.
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
        for path in made:  # of a run that was refused nothing is left
            with suppress(OSError):
                path.rmdir()


def refuse_in_use(directory: str | Path, comm: MPI.Comm) -> None:
    """See whether another run holds a directory, before anything is computed for it; collective.

    Raises:
        InUseError: On every rank, as `locked`.
    """
    path = Path(directory) / LOCK

    def look() -> str:
        try:
            descriptor = os.open(path, os.O_RDWR)
        except OSError:  # there is none; what else is wrong shows when it is taken
            return ""
        try:
            return "" if path.parent.resolve() in _held else _in_use(path, descriptor, _flock(descriptor))
        finally:
            os.close(descriptor)

    if fault := on_rank_0(comm, look):
        raise InUseError(fault)


def _make(folder: Path) -> list[Path]:
    """Make a directory and those it is in; what was made, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _take(path: Path) -> int:
    """The descriptor of the lock, ours now."""
    while True:
        try:
            descriptor, ours = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                descriptor, ours = os.open(path, os.O_RDWR), False
            except FileNotFoundError:  # given back just now
                continue
        try:
            alone = _flock(descriptor)
            if not _is_still(path, descriptor):
                os.close(descriptor)
                continue
            if fault := "" if ours and alone is not False else _in_use(path, descriptor, alone):
                raise InUseError(fault)
            if not ours:  # left behind by a process that was killed, and so may be what it was writing
                for partial in path.parent.glob(".partial-*"):
                    shutil.rmtree(partial, ignore_errors=True)
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, (json.dumps(asdict(_me())) + "\n").encode(), 0)
            return descriptor
        except BaseException:
            os.close(descriptor)
            raise


def _flock(descriptor: int) -> bool | None:
    """Whether the file is ours alone now; None where the file system does not say."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _NOT_OFFERED:
            return None
        return False
    return True


def _is_still(path: Path, descriptor: int) -> bool:
    """Whether the file is where it was, and has not been given back in the meantime."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _in_use(path: Path, descriptor: int, alone: bool | None) -> str:
    """Who else holds the lock, and what to do; nothing if it is free."""
    holder = _holder(descriptor)
    remove = f"if that run is known to have ended, remove {path}"
    if alone is False:
        who = str(holder) if holder is not None else "a run that has just begun"
        return f"{path.parent} is in use by {who}: wait for its end, or choose another directory"
    if holder is None:
        return "" if alone else f"{path.parent} is in use by a run that has just begun; {remove}"
    if holder.is_gone or (alone and holder.shares_kernel):
        return ""
    if holder.is_here:
        return f"{path.parent} is in use by {holder}: wait for its end, or choose another directory"
    return f"{path.parent} is in use by {holder}, which cannot be seen from {socket.gethostname()}; {remove}"


def _holder(descriptor: int) -> Holder | None:
    """What the file says; None if it says nothing."""
    try:
        told = json.loads(os.pread(descriptor, 1 << 16, 0))
        return Holder(int(told["pid"]), **{field.name: str(told[field.name]) for field in fields(Holder)[1:]})
    except (ValueError, KeyError, TypeError):
        return None


def _me() -> Holder:
    now = datetime.now().isoformat(sep=" ", timespec="seconds")
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]).replace("__main__.py", "coulomb")[:300]
    return Holder(os.getpid(), socket.gethostname(), _started(os.getpid()), now, command)


def _started(pid: int) -> str:
    """When a process began: the boot of its machine, and clock ticks since; empty if there is none, or no /proc."""
    try:
        ticks = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[19]
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except (OSError, IndexError):
        with suppress(OSError):
            os.kill(pid, 0)
            return "running"
        return ""
    return f"{boot} {ticks}"
