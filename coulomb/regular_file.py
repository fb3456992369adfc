"""Files that are files: a pipe has no end that one could wait for, a device perhaps none at all."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}


def refuse_irregular(path: str | Path) -> None:
    """See that a path, if it leads anywhere, leads to a file or a directory, before it is opened.

    Raises:
        OSError: If it leads to a pipe, a device or a socket, or nowhere.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "a name cannot have a NUL character", str(path))
    kind = stat.S_IFMT(os.stat(path).st_mode)
    if kind in _KINDS:
        raise OSError(errno.EINVAL, f"it is {_KINDS[kind]}: save the contents in a file first", str(path))


def read_bytes(path: str | Path, most: int | None = None) -> bytes:
    """What a file holds.

    Args:
        path: The file.
        most: How many bytes are read at most.

    Raises:
        OSError: If it cannot be read, is none, or is larger.
    """
    refuse_irregular(path)
    with Path(path).open("rb") as file:
        found = file.read() if most is None else file.read(most + 1)
    if most is not None and len(found) > most:
        raise OSError(errno.EFBIG, f"it is larger than {most / 1e6:g} MB", str(path))
    return found
