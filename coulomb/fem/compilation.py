"""When forms are compiled: once per machine and kind of cell, which takes seconds that somebody waits for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

SECONDS = 10
"""What the compiler takes for all forms of a run, roughly."""


def announce(say: Callable[[str], None]) -> None:
    """Have it said, once, when a form is asked for that is not in FFCx's cache; on ranks that compile.

    Args:
        say: What says it.
    """
    from ffcx.codegeneration import jit

    if not hasattr(jit, "get_cached_module"):  # an FFCx that we do not know: nothing is said
        return
    look_up, said = jit.get_cached_module, False

    def looked_up(*arguments: Any) -> Any:
        nonlocal said
        found = look_up(*arguments)
        if found[0] is None and not said:
            said = True
            say(f"compiling the finite-element forms, once per machine (about {SECONDS} s)")
        return found

    jit.get_cached_module = looked_up
