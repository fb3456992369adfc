"""One run at a time in a directory, and how its results take the place of earlier ones.

A run locks its directory by `flock` on a file in it, which ends with its process in any case; the file names the
process for others.

A run that is killed at any time loses neither the old nor the new results.  New results are written completely into
`.partial-*`; its new name `.complete` commits them.  Then the old ones are removed, the summary first, the name changes
to `.complete-moving`, and the new ones are moved into place, the summary last, so that a directory with a summary never
mixes two runs.  The next run finishes a move that was cut short.  The steps of a load history are written one by one:
the old results wait in `replaced-*` until the new history is complete.

Files on one process; standard library only, but for the ranks.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import socket
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from ..ranks import on_rank_0
from .run_directory import (
    CASE,
    FAILED,
    FIELDS,
    HISTORY,
    LOCK,
    MESH,
    PICTURE,
    REPORT,
    STEPS,
    SUMMARY,
    RunDirectory,
    read_json,
)

if TYPE_CHECKING:
    from mpi4py import MPI

PARTIAL = ".partial-"
_COMPLETE, _MOVING, _REPLACED = ".complete", ".complete-moving", "replaced-"
_FILES = (SUMMARY, HISTORY, CASE, PICTURE, REPORT, *FIELDS, *(name.replace(".xdmf", ".h5") for name in FIELDS))
_NOTE = "REPLACED.txt"
_NOTE_TEXT = """\
Earlier results, which `coulomb run --overwrite` is replacing by those of a new load history.  They are removed when the
new history is complete.  To keep them, move this directory elsewhere.
"""

# --- the lock -----------------------------------------------------------------------------------------------------

_held: dict[Path, int] = {}
"""Descriptors of the locks of this process, which may request the same lock twice."""


class InUseError(ValueError):
    """The directory is in use by another run."""


@contextmanager
def locked(directory: str | Path, comm: MPI.Comm) -> Iterator[None]:
    """Lock a directory, created if necessary, for the duration of the context; rank 0 holds the lock; collective.

    Raises:
        InUseError: On every rank, if another run holds it, with its holder and a remedy.
        OSError: On every rank, if the directory cannot be written to.
    """
    folder, mine = Path(directory), False
    made: list[Path] = []

    def take() -> str:
        nonlocal mine
        made.extend(path for path in (folder, *folder.parents) if not path.exists())
        folder.mkdir(parents=True, exist_ok=True)
        if folder.resolve() not in _held:
            try:
                _held[folder.resolve()] = _take(folder / LOCK)
            except InUseError as error:
                return str(error)
            mine = True
            finish(folder)
        return ""

    try:
        if fault := on_rank_0(comm, take):
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


def _take(path: Path) -> int:
    """Lock a file; returns its descriptor."""
    descriptor, locks = os.open(path, os.O_RDWR | os.O_CREAT, 0o644), True
    try:
        machine, _, holder = os.pread(descriptor, 1000, 0).decode(errors="replace").strip().partition(": ")
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            who = f"{path.parent} is in use by {holder or 'a run that has just started'}"
            raise InUseError(f"{who}: wait for its end, or choose another directory") from None
        except OSError:  # a file system without locks
            locks = False
        if not _is_still(path, descriptor):  # released in the meantime
            os.close(descriptor)
            return _take(path)
        if machine and not (locks and set(machine.split()).intersection(_machine())):
            raise InUseError(  # some file systems have locks between the processes of one machine only
                f"{path.parent} is in use by {holder}, which cannot be seen from {socket.gethostname()}; if that run "
                f"is known to have ended, remove {path}"
            )
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{' '.join(_machine())}: {_this_process()}\n".encode(), 0)
    except BaseException:
        with suppress(OSError):
            os.close(descriptor)
        raise
    for partial in path.parent.glob(f"{PARTIAL}*"):  # of a killed run
        shutil.rmtree(partial, ignore_errors=True)
    return descriptor


def _is_still(path: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _machine() -> tuple[str, ...]:
    """Two names of this machine: of its host, also after a restart, and of its boot, also in another container."""
    try:
        return socket.gethostname(), Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except OSError:
        return (socket.gethostname(),)


def _this_process() -> str:
    now = datetime.now().isoformat(sep=" ", timespec="seconds")
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]).replace("__main__.py", "coulomb")[:300]
    return f"process {os.getpid()} on {socket.gethostname()}, since {now} ({command})"


# --- what is there ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Present:
    """Files of the format of results in a directory.

    Attributes:
        folder: The directory.
        names: Those at its top, files and directories.
        steps: Number of complete load steps.
        recognised: Whether they are results of this package: a summary or a case says so.
    """

    folder: Path
    names: tuple[str, ...]
    steps: int
    recognised: bool

    @property
    def results(self) -> bool:
        """Whether there is an answer that could be lost; a case alone is none."""
        return self.steps > 0 or SUMMARY in self.names

    def fault(self) -> str:
        """Reason why they must not be replaced even if that is asked for; empty if they may be."""
        if self.names and not self.recognised:
            return (
                f"{self.folder / self.names[0]} is not known to be a result of coulomb, which would replace it (no "
                f"{SUMMARY} or {CASE} of coulomb is beside it): move it away, or choose another directory (--output)"
            )
        for path in self._all():
            mode = path.lstat().st_mode
            if stat.S_ISREG(mode) and not mode & 0o222:
                return f"{path} is write-protected: choose another directory (--output), or permit it (chmod u+w)"
            if path.name in _FILES and stat.S_ISDIR(mode):
                return f"{path} is not a file: move it away, or choose another directory (--output)"
            if path.parent != self.folder and not _is_ours(path):
                return (
                    f"{path} is not a result of coulomb, but among load steps: move it away, or choose another "
                    "directory (--output)"
                )
        return ""

    def _all(self) -> Iterator[Path]:
        """The files, also those in the directories of steps; links are not followed."""
        for name in self.names:
            path = self.folder / name
            yield path
            if name in (STEPS, FAILED, MESH) and not path.is_symlink():
                yield from sorted(path.rglob("*"))


def present(folder: Path) -> Present:
    """What there is in a directory, which need not exist."""
    names = tuple(name for name in (*_FILES, STEPS, FAILED, MESH) if os.path.lexists(folder / name))
    files = RunDirectory(folder)
    steps = len(files.complete_steps) if files.is_history else 0
    return Present(folder, names, steps, steps > 0 or _says(files.summary) or _says(files.case))


def _says(path: Path) -> bool:
    """Whether a summary or a case is one of this package."""
    try:
        contents = read_json(path)
    except ValueError:
        return False
    if path.name == CASE:
        return {"mesh", "contact"} <= contents.keys()
    return "certificate" in contents and bool({"coulomb", "history", "last"} & contents.keys())


def _is_ours(path: Path) -> bool:
    """Whether a path below `steps`, `failed` or `mesh` is of the format."""
    if any(part.startswith((PARTIAL, _COMPLETE)) for part in path.parts):
        return True
    if path.is_dir() and not path.is_symlink():
        return path.name == FAILED or bool(re.fullmatch(r"\d{4,}", path.name))
    of_mesh = path.parent.name == MESH and path.suffix in (".xdmf", ".h5")
    return of_mesh or path.name.lstrip(".") in _FILES or path.name == LOCK


# --- a single answer ----------------------------------------------------------------------------------------------


def commit(folder: Path, target: Path) -> None:
    """Replace the results in a directory by those in a directory `.partial-*` in it, which has all files; an OSError if
    one cannot be moved, where the new ones are kept."""
    finish(target)
    os.rename(folder, target / _COMPLETE)
    finish(target)


def finish(target: Path) -> None:
    """Move complete results into place, also those of a run that was killed at it."""
    complete, moving = target / _COMPLETE, target / _MOVING
    if complete.is_dir():
        _remove_results(target)
        os.rename(complete, moving)
    if moving.is_dir():
        for file in sorted(moving.iterdir(), key=lambda file: file.name == SUMMARY):
            os.replace(file, target / file.name)
        moving.rmdir()


def _remove_results(folder: Path) -> None:
    """Remove what is of the format, the summary first; of links the link."""
    for name in present(folder).names:
        _remove(folder / name)


def _remove(path: Path) -> None:
    if path.is_symlink() or not path.is_dir():
        path.unlink()
        return
    for inside in path.iterdir():
        if _is_ours(inside):
            _remove(inside)
    with suppress(OSError):  # not empty: a user's file is in it
        path.rmdir()


# --- a load history -----------------------------------------------------------------------------------------------


def set_aside(target: Path) -> Path | None:
    """Move the results of a directory into a new directory `replaced-*` in it; None if there are none.

    After an OSError they are where they were.
    """
    names = present(target).names
    if not names:
        return None
    number = 1
    while os.path.lexists(target / f"{_REPLACED}{number}"):
        number += 1
    aside = target / f"{_REPLACED}{number}"
    aside.mkdir()
    try:
        (aside / _NOTE).write_text(_NOTE_TEXT, encoding="utf-8")
        for name in names:
            os.rename(target / name, aside / name)
    except OSError:
        _put_back(aside, target)
        raise
    return aside


def _put_back(aside: Path, target: Path) -> None:
    for path in sorted(aside.iterdir()):
        if path.name != _NOTE:
            os.rename(path, target / path.name)
    (aside / _NOTE).unlink(missing_ok=True)
    aside.rmdir()


def set_aside_in(target: Path) -> list[Path]:
    """Directories of results that were set aside and are still there."""
    return sorted(path for path in target.glob(f"{_REPLACED}*") if (path / _NOTE).is_file())


def settle(target: Path, aside: Path | None, replaced: bool) -> str:
    """At the end of a load history: what becomes of the results that `set_aside` has set aside, and a remark for the
    user.

    They are removed once the history is complete, if they may be `replaced`, moved back if it has no step, and kept
    otherwise.

    Raises:
        OSError: If they cannot be moved back.
    """
    files = RunDirectory(target)
    done = files.complete_steps
    if not done:
        if aside is None or files.failed.path.exists():
            return "" if aside is None else f"the results before are in {aside}"
        _remove_results(target)
        _put_back(aside, target)
        return f"no load step was completed: {target} has its earlier results"
    try:
        complete = not files.step(done[-1]).read_summary().get("step", {}).get("pending")
    except ValueError:
        complete = False
    if complete and replaced:
        discard(target)
    left = set_aside_in(target)
    return f"{', '.join(map(str, left))}: earlier results, kept until the load history is complete" if left else ""


def discard(target: Path) -> str:
    """Remove all results that were set aside in a directory, but no user's files.  Returns nothing to report."""
    for aside in set_aside_in(target):
        _remove_results(aside)
        (aside / _NOTE).unlink()
        with suppress(OSError):
            aside.rmdir()
    return ""
