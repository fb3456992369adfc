"""Replacing the results in a directory: what is there, and how new results take the place of old ones.

A run that is killed at any time loses neither the old nor the new results.  New results are written completely into
`.partial-*`; renaming that to `.complete-*` commits them; then the old summary is removed, the files are moved, and
the new summary is moved last, so that a directory with a summary never mixes two runs.  The next run in the directory
finishes a move that was cut short.  The steps of a load history are written one by one: the old results wait in
`replaced-*` until the new history is complete.

Standard library only, on one process.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .run_directory import CASE, FAILED, FIELDS, HISTORY, LOCK, PICTURE, REPORT, STEPS, SUMMARY, RunDirectory, read_json

_PARTIAL, _COMPLETE, _REPLACED = ".partial-", ".complete-", "replaced-"
_FILES = (SUMMARY, HISTORY, CASE, PICTURE, REPORT, *FIELDS, *(name.replace(".xdmf", ".h5") for name in FIELDS))
_NOTE = "REPLACED.txt"
_NOTE_TEXT = """\
Earlier results, which `coulomb run --overwrite` is replacing by those of a new load history.  They are removed when the
new history is complete.  To keep them, move this directory elsewhere.
"""


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
            if path.name in _FILES and not (stat.S_ISREG(mode) or stat.S_ISLNK(mode)):
                return f"{path} is not a file: move it away, or choose another directory (--output)"
        strangers = [path for path in self._all() if path.parent != self.folder and not _is_ours(path)]
        if strangers:
            return (
                f"{strangers[0]} is not a result of coulomb, but among load steps: move it away, or choose another "
                "directory (--output)"
            )
        return ""

    def _all(self) -> Iterator[Path]:
        """The files, also those in the directories of steps; links are not followed."""
        for name in self.names:
            path = self.folder / name
            yield path
            if name in (STEPS, FAILED) and path.is_dir() and not path.is_symlink():
                yield from sorted(path.rglob("*"))


def present(folder: Path) -> Present:
    """What there is in a directory, which need not exist."""
    names = tuple(name for name in (*_FILES, STEPS, FAILED) if os.path.lexists(folder / name))
    files = RunDirectory(folder)
    steps = len(files.complete_steps) if files.is_history else 0
    moving = folder.is_dir() and any(folder.glob(f"{_COMPLETE}*"))
    return Present(folder, names, steps, steps > 0 or moving or _says(files.summary) or _says(files.case))


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
    """Whether a path below `steps` or `failed` is of the format."""
    if path.is_dir() and not path.is_symlink():
        inside = (STEPS, FAILED, *(part for part in path.parts[-1:] if re.fullmatch(r"\d{4,}", part)))
        return path.name in inside or path.name.startswith((_PARTIAL, _COMPLETE))
    hidden = any(part.startswith((_PARTIAL, _COMPLETE)) for part in path.parts)
    return hidden or path.name in _FILES or path.name.lstrip(".") in _FILES or path.name == LOCK


# --- a single answer ----------------------------------------------------------------------------------------------


def commit(folder: Path, target: Path) -> None:
    """Replace the results in a directory by complete ones.

    Args:
        folder: Directory `.partial-*` in `target` with all new files, among them a summary.
        target: The directory.

    Raises:
        OSError: If a file cannot be moved; the new ones are kept.
    """
    finish(target)
    complete = target / folder.name.replace(_PARTIAL, _COMPLETE)
    os.rename(folder, complete)
    _move(complete, target, first=True)


def finish(target: Path) -> None:
    """Finish the moves that were cut short in a directory.

    Raises:
        OSError: If a file cannot be moved.
    """
    for complete in sorted(target.glob(f"{_COMPLETE}*")):
        _move(complete, target, first=(target / SUMMARY).exists())


def _move(complete: Path, target: Path, first: bool) -> None:
    if (complete / SUMMARY).is_file():
        if first:  # nothing has been moved yet
            for name in (STEPS, FAILED):
                _remove(target / name)
            for name in (CASE, REPORT, PICTURE, SUMMARY):  # the summary last: until then the move begins anew
                (target / name).unlink(missing_ok=True)
        for file in sorted(complete.iterdir()):
            if file.name != SUMMARY:
                os.replace(file, target / file.name)
        os.replace(complete / SUMMARY, target / SUMMARY)
    shutil.rmtree(complete, ignore_errors=True)


def _remove(path: Path) -> None:
    """Remove load steps, or the last iterate of a failed one: files of the format only; of links the link."""
    if path.is_symlink():
        path.unlink()
    if not path.is_dir():
        return
    for inside in sorted(path.rglob("*"), reverse=True):
        if inside.is_dir() and not inside.is_symlink():
            with suppress(OSError):  # not empty
                inside.rmdir()
        elif _is_ours(inside):
            inside.unlink()
    with suppress(OSError):
        path.rmdir()


# --- a load history -----------------------------------------------------------------------------------------------


def set_aside(target: Path) -> Path | None:
    """Move the results of a directory into a new directory `replaced-*` in it; None if there are none.

    Raises:
        OSError: If they cannot be moved; they are then where they were.
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
        put_back(aside, target)
        raise
    return aside


def put_back(aside: Path, target: Path) -> None:
    """Move results back that were set aside, in place of what has been written since.

    Raises:
        OSError: If they cannot be moved.
    """
    (target / CASE).unlink(missing_ok=True)
    for name in (STEPS, FAILED):
        if os.path.lexists(aside / name):
            _remove(target / name)
    for path in sorted(aside.iterdir()):
        if path.name != _NOTE:
            os.replace(path, target / path.name)
    (aside / _NOTE).unlink(missing_ok=True)
    aside.rmdir()


def aside_in(target: Path) -> list[Path]:
    """Directories of results that were set aside and are still there."""
    if not target.is_dir():
        return []
    return sorted(path for path in target.glob(f"{_REPLACED}*") if (path / _NOTE).is_file())


def discard(target: Path) -> str:
    """Remove all results that were set aside in a directory; other files are left.  Returns nothing to report."""
    for aside in aside_in(target):
        for name in (STEPS, FAILED):
            _remove(aside / name)
        for name in (*_FILES, _NOTE):
            with suppress(OSError):
                (aside / name).unlink()
        with suppress(OSError):
            aside.rmdir()
    return ""
