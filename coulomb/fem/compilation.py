"""Compilation of the finite-element forms, once per machine and kind of cell; it takes seconds and is announced."""

from __future__ import annotations

import logging
import os
import shlex
import shutil
import sysconfig
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

_log = logging.getLogger(__name__)

SECONDS = 10
"""Approximate time of the compiler for all forms of a run."""

_to_announce = False  # whether the next compilation is to be announced

_loaded: dict[tuple[str, str], Any] = {}
"""Result of FFCx's look-up by directory and name: it lists the whole directory and loads the module again each time,
5 ms after some hundred forms; stresses need three look-ups per load step."""


def announce() -> None:
    """Log, once, when a form is needed that is not in FFCx's cache; on the ranks that compile."""
    global _to_announce
    _to_announce = True


class NoCompiler(ValueError):
    """A form is to be compiled, and there is no C compiler."""


def watch_compilation(dolfinx_jit: Any, arity_mismatch: type[BaseException]) -> None:
    """Announce compilations, and raise `NoCompiler` before one that is impossible; called when DOLFINx, whose module
    `jit` is given, is imported.  UFL's error for forms as a - L is in recent versions no `Exception`."""
    from ffcx.codegeneration import jit

    if not hasattr(jit, "get_cached_module"):  # an FFCx of another structure
        return
    look_up, compiled = jit.get_cached_module, dolfinx_jit.ffcx_jit

    def looked_up(name: str, objects: Sequence[str], directory: str | Path, *arguments: Any) -> Any:
        global _to_announce
        key = str(directory), name
        if key in _loaded:
            return _loaded[key]
        if not Path(directory, f"{name}.c").exists():
            _refuse_without_compiler()  # before FFCx leaves a file for which other processes wait
        found = look_up(name, objects, directory, *arguments)
        if found[0] is not None:
            _loaded[key] = found
        elif _to_announce:
            _to_announce = False
            _log.info("compiling the finite-element forms, once per machine (about %d s)", SECONDS)
        return found

    def explained(*arguments: Any, **options: Any) -> Any:
        try:
            return compiled(*arguments, **options)
        except RuntimeError as error:
            if "compilation" in str(error):  # on several ranks, on all of them
                _refuse_without_compiler()
            raise

    jit.get_cached_module, dolfinx_jit.ffcx_jit = looked_up, explained
    jit._compile_objects = _with_arity_errors(jit._compile_objects, arity_mismatch)


def _with_arity_errors(compile_objects: Callable[..., Any], mismatch: type[BaseException]) -> Callable[..., Any]:
    """Compilation with a mismatch as a ValueError.

    Without an `Exception` FFCx leaves a file that later compilations wait for, and DOLFINx does not tell other ranks.
    """

    def compiling(*arguments: Any, **options: Any) -> Any:
        try:
            return compile_objects(*arguments, **options)
        except mismatch as error:
            raise ValueError(str(error)) from None

    return compiling


def _refuse_without_compiler() -> None:
    """As setuptools chooses the compiler."""
    compiler = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    if shutil.which((shlex.split(compiler) or [""])[0]) is None:
        raise NoCompiler(
            f"the finite-element forms of this case have to be compiled, once per machine, which needs a C compiler: "
            f"{compiler} is not there; apt-get install gcc, or set CC to another compiler"
        )
