"""What `Solution` can do but the model cannot, since it knows neither file formats nor pictures.

`coulomb/__init__.py`, which runs before any module of the package, supplies the functions from `coulomb.io` and
`coulomb.pictures` by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

supplied: dict[str, Callable[..., Any]] = {}
"""By name: `write`, `faces`, `plot`, `picture`, `plot_history`; all take a `Solution` first."""
