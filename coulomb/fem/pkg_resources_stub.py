"""UFL and FFCx 2022 (Debian 12) get their version from pkg_resources, which reads all installed packages at import."""

from __future__ import annotations

import importlib.metadata
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager

_SLOW = "pkg_resources"  # more than a tenth of a second of every start


@contextmanager
def versions_from_metadata() -> Iterator[None]:
    """If pkg_resources is not loaded yet, imports inside this context get a stub with `get_distribution` only."""
    if _SLOW in sys.modules:
        yield
        return
    quick = types.ModuleType(_SLOW)
    quick.get_distribution = importlib.metadata.distribution  # type: ignore[attr-defined]
    sys.modules[_SLOW] = quick
    try:
        yield
    finally:
        del sys.modules[_SLOW]
