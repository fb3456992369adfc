"""What is loaded when it is first used: names of a package, so that importing it takes no time, and what classes can do
by rooms above theirs, which they do not know: files and pictures.

The `__init__.pyi` beside its `__init__.py` is the only list of them: lines `from .module import Name as Name`, which
type checkers read as well.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazily_loaded(package: str, file: str) -> tuple[list[str], Callable[[str], object]]:
    """The `__all__` and the `__getattr__` of a package with this `__init__.py`."""
    lines = re.findall(r"^from (\.[\w.]+) import (\w+) as", Path(file).with_suffix(".pyi").read_text(), re.M)
    homes = {name: home for home, name in lines}

    def load(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value: object = getattr(import_module(homes[name], package), name)
        setattr(sys.modules[package], name, value)
        return value

    return sorted(homes), load


late_bound: dict[str, Callable[..., Any]] = {}
"""By name: `write`, `faces`, `fields_on_bodies`, `error`, `plot`, `picture`, `plot_history`, which take a `Solution`
first; `refine`, which takes a problem."""
