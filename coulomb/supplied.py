"""What classes can do by rooms above theirs, which they do not know: files, pictures, large motions.

`coulomb/__init__.py`, which runs before any module of the package, supplies the functions by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

supplied: dict[str, Callable[..., Any]] = {}
"""By name: `write`, `faces`, `error`, `plot`, `picture`, `plot_history`, which take a `Solution` first; `refine`, which
takes a problem; `large` and `nonlinear_body` give the classes of problems and bodies of large motions."""
