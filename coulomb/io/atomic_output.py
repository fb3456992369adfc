"""One run at a time in a directory, and how its results take the place of earlier ones.

A run locks its directory by `flock` on a file in it, which ends with its process, also on NFS.

A kill at any time leaves the old results or the new ones whole, or files that the next command moves to their place.
New results are written into `.partial`, the summary last, which commits them.  Then those that are there are moved
away, the summary first, and become DIRECTORY.previous; the new ones are moved into place, iterations.csv first, the
summary last: a directory with a summary never mixes two runs.  The steps of a load history are written one by one:
earlier results leave the directory before the first.  Files that are not of the format stay where they are.

On one process but for `locked` and `refuse_to_replace`; standard library only, but for the ranks.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..ranks import on_rank_0
from ..regular_file import unwritable
from .run_directory import FAILED, FIELDS, FILES, ITERATIONS, LOCK, MESH, STEPS, SUMMARY, RunDirectory, read_json

if TYPE_CHECKING:
    from mpi4py import MPI

PARTIAL, OWN, OLD = ".partial", ".partial-own", ".old"
"""Directories in that of the results: of new ones, of new ones that replace earlier ones of the same run, and of those
that become .previous.  Names that begin as the first are of killed runs where there is no summary."""

_NAMES: Final = (SUMMARY, *FILES, *(name.replace(".xdmf", ".h5") for name in FIELDS), STEPS, FAILED, MESH)

# --- the lock -----------------------------------------------------------------------------------------------------

_held: dict[Path, int] = {}
"""Descriptors of the locks of this process, which may request the same lock, or one below it, twice."""


@contextmanager
def locked(directory: str | Path, comm: MPI.Comm | None) -> Iterator[bool]:
    """Lock a directory, created if necessary, for the duration of the context; rank 0 holds the lock; collective.

    Gives whether this process had not locked it before.

    Raises:
        ValueError: On every rank, if another run holds it, with its holder and a remedy.
        OSError: On every rank, if the directory cannot be written to.
    """
    folder, made, mine = Path(directory), list[Path](), list[Path]()

    def take() -> bool:
        made.extend(path for path in (folder, *folder.parents) if not path.exists())
        folder.mkdir(parents=True, exist_ok=True)
        place = folder.resolve()
        if not any(place.is_relative_to(other) for other in _held):
            _held[place] = _take(folder / LOCK)
            mine.append(place)
            finish(folder)
            for partial in folder.glob(f"{PARTIAL}*"):
                shutil.rmtree(partial, ignore_errors=True)
        return bool(mine)

    try:
        yield on_rank_0(comm, take)
    finally:
        for place in mine:
            with suppress(OSError):
                (folder / LOCK).unlink()
            os.close(_held.pop(place))
        for path in made:  # a refused run leaves no directory behind
            with suppress(OSError):
                path.rmdir()


def _take(path: Path) -> int:
    """Lock a file; returns its descriptor."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(descriptor, 1000, 0).decode(errors="replace").strip() or "a run that has just started"
        os.close(descriptor)
        raise ValueError(
            f"{path.parent} is in use by {holder}: wait for its end, or choose another directory"
        ) from None
    except OSError:  # a file system without locks
        pass
    with suppress(OSError):  # a full disk: what the message would say; or it was removed
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{_this_process()}\n".encode(), 0)
    with suppress(FileNotFoundError):
        if os.path.samestat(os.stat(path), os.fstat(descriptor)):
            return descriptor
    os.close(descriptor)  # it was released, and removed, in the meantime
    return _take(path)


def in_use(directory: Path) -> bool:
    """Whether a run is in a directory."""
    try:
        with (directory / LOCK).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:  # also where there is no lock, or a file system without
        return isinstance(error, BlockingIOError)
    return False


def _this_process() -> str:
    now = datetime.now().isoformat(sep=" ", timespec="seconds")
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]).replace("__main__.py", "coulomb")[:300]
    return f"process {os.getpid()} on {socket.gethostname()}, since {now} ({command})"


# --- what is there ------------------------------------------------------------------------------------------------


def previous(target: Path) -> Path:
    """The directory that keeps the results before."""
    place = target.resolve() if target.is_symlink() or target.name in ("", "..") else target
    return place.with_name(f"{place.name}.previous")


def refuse_to_replace(target: Path, overwrite: bool, comm: MPI.Comm) -> str:
    """Check before a run what it would replace; collective.

    Returns:
        The directory that will keep the results that are there; empty if there are none.

    Raises:
        ValueError: On every rank, with a remedy: if there are results, and they are not to be replaced; if files with
            names of the format are none of this package, or if DIRECTORY.previous has others or write-protected ones.
    """

    def look() -> str:
        kept, there = previous(target), _has_results(target)
        if there and not overwrite:
            raise ValueError(f"{target} holds results, which are to be kept: choose another directory (--output)")
        for folder in (target, kept):
            names = _names_in(folder)
            if names and not _is_ours(folder):
                raise ValueError(
                    f"{folder / names[0]} is not known to be a result of coulomb, which would replace it (no summary "
                    "or case of coulomb is beside it): move it away, or choose another directory (--output)"
                )
        if there:
            _refuse_to_lose(kept)
        return str(kept) if there else ""

    try:
        return on_rank_0(comm, look)
    except OSError as error:
        raise ValueError(f"output {target}: cannot be read: {error.strerror or error}") from None


def _refuse_to_lose(kept: Path) -> None:
    """A ValueError if the results in DIRECTORY.previous cannot be replaced, with a remedy."""
    if reason := unwritable(kept.parent):
        raise ValueError(f"results cannot be kept as {kept}: {reason}; move them away")
    for path in [kept] if kept.is_file() else sorted(kept.rglob("*")):
        if path.name == LOCK:
            os.close(_take(path))
        elif path == kept or not (_is_of_format(path.relative_to(kept)) and path.lstat().st_mode & 0o222):
            raise ValueError(f"{path} is write-protected or no result of coulomb, and {kept} is replaced: move it away")


def _names_in(folder: Path) -> list[str]:
    """The names of the format in a directory, which need not exist."""
    return [name for name in _NAMES if os.path.lexists(folder / name)]


def _has_results(folder: Path) -> bool:
    """Whether there is an answer that could be lost; a case alone is none."""
    files = RunDirectory(folder)
    return files.summary.exists() or bool(files.complete_steps)


def _is_ours(folder: Path) -> bool:
    """Whether a summary or a case is one of this package."""
    files = RunDirectory(folder)
    for path in (files.summary, files.step(1).summary, files.case):
        with suppress(ValueError):
            keys = read_json(path).keys()
            if {"mesh", "body"} & keys and {"contact", "auto_contact"} & keys:
                return True
            if "certificate" in keys and {"coulomb", "history", "last"} & keys:
                return True
    return False


def _is_of_format(path: Path) -> bool:
    """Whether a path in a directory of results is of the format."""
    *_, last = parts = path.parts
    known = last.lstrip(".").removesuffix(".partial") in _NAMES or last.startswith((PARTIAL, OLD))
    in_steps = parts[0] == STEPS and re.fullmatch(r"\d{4,}", last) is not None
    return known or in_steps or (parts[0] == MESH and path.suffix in (".xdmf", ".h5"))


# --- replacing ----------------------------------------------------------------------------------------------------


def finish(target: Path) -> None:
    """Move complete results into place, also those of a run that was killed at it.  Those before are kept as
    TARGET.previous, unless they are of the same run (`OWN`).  After an OSError the next run tries again."""
    if (target / OLD).is_dir():
        set_aside(target)
    for new in (target / PARTIAL, target / OWN):
        if (new / SUMMARY).exists():
            if (new / ITERATIONS).exists():  # nothing of it is in place
                set_aside(target, keep=new.name == PARTIAL)
            for file in sorted(new.iterdir(), key=lambda file: (file.name == SUMMARY) - (file.name == ITERATIONS)):
                os.replace(file, target / file.name)
            new.rmdir()


def finish_for_reader(target: Path) -> None:
    """Move complete results into place after a run was killed at it, if no run is there and the files may be moved."""
    if RunDirectory(target).moving:
        with suppress(OSError, ValueError), locked(target, None):
            pass


def set_aside(target: Path, keep: bool = True) -> None:
    """Move the results in a directory, the summary first, to TARGET.previous, or remove them if they are none that
    could be lost, or are not to be kept.  Links stay links."""
    kept, old = previous(target), target / OLD
    if not (old.is_dir() or (keep and _has_results(target))):
        for name in _names_in(target):
            _remove(target / name)
        return
    try:
        _refuse_to_lose(kept)
    except ValueError as error:  # since the run began
        raise OSError(errno.EEXIST, str(error)) from None
    if kept.exists():  # which may take long, before anything is moved
        _remove(kept)
    old.mkdir(exist_ok=True)
    for name in _names_in(target):
        os.rename(target / name, old / name)
    shutil.move(old, kept)  # a copy where the directory is a disk of its own


def _remove(path: Path) -> None:
    (shutil.rmtree if path.is_dir() and not path.is_symlink() else os.unlink)(path)
