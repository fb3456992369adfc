"""UFL and FFCx 2022 (Debian 12) ask pkg_resources for their own version: it reads all that is installed first."""

from __future__ import annotations

import importlib.metadata
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager

_SLOW = "pkg_resources"  # a tenth of a second and more, of every start


@contextmanager
def versions_from_metadata() -> Iterator[None]:
    """Where pkg_resources is not loaded yet, what is imported inside gets one that knows `get_distribution` alone."""
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
