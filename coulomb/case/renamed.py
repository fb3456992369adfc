"""Values of case files that have been renamed: the old ones are still accepted, and reported."""

from __future__ import annotations

from typing import Any

_METHODS = {"fixed-point": "successive-tresca", "one-loop": "interior-point"}
"""Former values of solver.method, and what replaced them."""


def current_method(method: Any) -> Any:
    """The present name of solver.method; any other value unchanged."""
    return _METHODS.get(method, method) if isinstance(method, str) else method


def renamed(tables: dict[str, Any]) -> list[str]:
    """Messages on former values in a case, one line each.

    Args:
        tables: The tables of the case, not yet validated.
    """
    solver = tables.get("solver")
    method = solver.get("method") if isinstance(solver, dict) else None
    if not isinstance(method, str) or method not in _METHODS:
        return []
    return [f'solver.method = "{method}" is now called "{_METHODS[method]}"; the old name is still accepted']
