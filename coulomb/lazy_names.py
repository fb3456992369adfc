"""Names of a package that are loaded when they are first used, so that importing it takes no time."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module


def lazy_names(
    package: str, homes: Mapping[str, tuple[str, ...]], moved: Mapping[str, tuple[str, ...]] | None = None
) -> Callable[[str], object]:
    """The `__getattr__` of a package.

    Args:
        package: Its name.
        homes: Names by the module, relative to the package, that has them.
        moved: Likewise names of the version before, by the package where they are now; they warn.
    """
    places = {
        name: (home, old)
        for table, old in ((homes, False), (moved or {}, True))
        for home in table
        for name in table[home]
    }

    def load(name: str) -> object:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, old = places[name]
        value: object = getattr(import_module(f".{home}", package), name)
        if old:
            warnings.warn(f"{package}.{name} is now {package}.{home}.{name}", DeprecationWarning, stacklevel=2)
        else:
            setattr(sys.modules[package], name, value)
        return value

    return load
