"""Paths: only regular files are read, since a pipe or a device might not end; where can be written, and how a file is
replaced."""

from __future__ import annotations

import errno
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}


def refuse_irregular(path: str | Path) -> None:
    """Check before opening that a path is a file or a directory.

    Raises:
        OSError: If it is a pipe, a device or a socket, or does not exist.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a name cannot have a NUL character", str(path))
    kind = stat.S_IFMT(os.stat(path).st_mode)
    if kind in _KINDS:
        raise OSError(errno.EINVAL, f"it is {_KINDS[kind]}: save the contents in a file first", str(path))


def read_bytes(path: str | Path, most: int | None = None) -> bytes:
    """Contents of a file.

    Raises:
        OSError: If it cannot be read, is not a regular file, or is larger than `most` bytes.
    """
    refuse_irregular(path)
    with Path(path).open("rb") as file:
        content = file.read() if most is None else file.read(most + 1)
    if most is not None and len(content) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most / 1e6:g} MB", str(path))
    return content


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """The name beside a file under which another one is written that takes its place at the end; after an error it is
    removed, and the file is what it was."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        yield partial
        os.replace(partial, path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise


def unwritable(directory: Path) -> str:
    """Reason why no files can be written into a directory, which need not exist yet; empty if they can."""
    place = directory.absolute()
    try:
        while not (place.exists() or place.is_symlink()) and place != place.parent:
            place = place.parent
        if not place.is_dir():
            return f"{place} is no directory"
    except OSError as error:  # a name that is too long
        return error.strerror or str(error)
    if not os.access(place, os.W_OK | os.X_OK):
        return f"no permission to write in {place}"
    if os.statvfs(place).f_blocks == 0:  # /proc, /sys: root has permission, but there are no files
        try:
            tempfile.TemporaryFile(dir=place).close()
        except OSError:
            return f"{place} is a view of the system and keeps no files"
    return ""
