"""A file to which HDF5 writes through Python, so that a full disk is an error and not the end of the process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any


class HDF5Target:
    """The file, as `h5py.File` takes it.

    Errors are kept for the end: with one HDF5 could neither close the file nor end the process.

    Args:
        path: Created, or replaced.

    Raises:
        OSError: If it cannot be opened.
    """

    def __init__(self, path: Path):
        self._file, self._fault = path.open("w+b", buffering=0), ""

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and not self._fault:
            done += self._attempt(lambda: self._file.write(view[done:])) or 0  # noqa: B023
        return len(view)

    def read(self, size: int) -> bytes:
        found = self._attempt(lambda: self._file.read(size)) or b""
        return bytes(found).ljust(size, b"\0")  # what could not be written is missing

    def seek(self, *place: int) -> int:
        return self._file.seek(*place)

    def tell(self) -> int:
        return self._file.tell()

    def truncate(self, size: int) -> int:
        self._attempt(lambda: self._file.truncate(size))
        return size

    def flush(self) -> None:
        """Nothing is buffered."""

    def close(self) -> str:
        """Close the file; what went wrong since it was opened, or nothing."""
        self._attempt(self._file.close)
        return self._fault

    def _attempt(self, action: Callable[[], Any]) -> Any:
        try:
            return action()
        except OSError as error:
            self._fault = self._fault or error.strerror or str(error)
            return None
