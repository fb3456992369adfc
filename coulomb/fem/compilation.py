"""Compilation of the finite-element forms, once per machine and kind of cell; it takes seconds and is announced."""

from __future__ import annotations

import logging
from typing import Any

_log = logging.getLogger(__name__)

SECONDS = 10
"""Approximate time of the compiler for all forms of a run."""


def announce() -> None:
    """Log, once, when a form is needed that is not in FFCx's cache; on the ranks that compile."""
    from ffcx.codegeneration import jit

    if not hasattr(jit, "get_cached_module"):  # an FFCx of another structure: no announcement
        return
    look_up, announced = jit.get_cached_module, False

    def looked_up(*arguments: Any) -> Any:
        nonlocal announced
        found = look_up(*arguments)
        if found[0] is None and not announced:
            announced = True
            _log.info("compiling the finite-element forms, once per machine (about %d s)", SECONDS)
        return found

    jit.get_cached_module = looked_up
