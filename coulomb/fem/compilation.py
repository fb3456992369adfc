"""Compilation of the finite-element forms, once per machine and kind of cell; it takes seconds and is announced.

Compiled forms are looked up by their file: FFCx lists its whole directory for each of the twenty forms and elements of
a run, which takes a millisecond each time once a thousand forms have been compiled.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import logging
import os
import shlex
import shutil
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_log = logging.getLogger(__name__)

SECONDS = 10
"""Approximate time of the compiler for all forms of a run."""

_to_announce = False  # whether the next compilation is to be announced


def announce() -> None:
    """Log, once, when a form is needed that is not in FFCx's cache; on the ranks that compile."""
    global _to_announce
    _to_announce = True


class NoCompiler(ValueError):
    """A form is to be compiled, and there is no C compiler."""


def look_up_by_file(dolfinx_jit: Any) -> None:
    """Look compiled forms up by their file, and raise `NoCompiler` where one that is not there cannot be compiled;
    called with `dolfinx.jit` when DOLFINx is imported."""
    from ffcx.codegeneration import jit

    if not hasattr(jit, "get_cached_module"):  # an FFCx of another structure
        return
    look_up = jit.get_cached_module
    known: dict[tuple[str, ...], Any] = {}

    def looked_up(name: str, objects: Sequence[str], directory: str | Path, *arguments: Any) -> Any:
        key = (name, str(directory), *objects)
        if key in known:
            return known[key]
        found = _loaded(name, objects, Path(directory))
        if found is None:
            _refuse_without_compiler()  # before FFCx leaves a file for which other processes wait
            found = look_up(name, objects, directory, *arguments)
        if found[0] is not None:
            known[key] = found
        else:
            _announce_once()
        return found

    jit.get_cached_module = looked_up
    compiled = dolfinx_jit.ffcx_jit

    def explained(*arguments: Any, **options: Any) -> Any:
        try:
            return compiled(*arguments, **options)
        except RuntimeError as error:
            if str(error).startswith("Failed just-in-time compilation"):  # on several ranks, on all of them
                _refuse_without_compiler()
            raise

    dolfinx_jit.ffcx_jit = explained


def _refuse_without_compiler() -> None:
    """As setuptools chooses the compiler."""
    compiler = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    if shutil.which((shlex.split(compiler) or [""])[0]) is None:
        raise NoCompiler(
            f"the finite-element forms of this case have to be compiled, once per machine, which needs a C compiler: "
            f"{compiler} is not there; apt-get install gcc, or set CC to another compiler"
        )


def _announce_once() -> None:
    global _to_announce
    if _to_announce:
        _to_announce = False
        _log.info("compiling the finite-element forms, once per machine (about %d s)", SECONDS)


def _loaded(name: str, objects: Sequence[str], directory: Path) -> tuple[list[Any], Any] | None:
    """Objects of a module in FFCx's cache, and the module; None if it is not there, or not yet."""
    file = directory / f"{name}{importlib.machinery.EXTENSION_SUFFIXES[0]}"
    if not (directory / f"{name}.c.cached").exists() or not file.exists():
        return None
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        return None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return [getattr(module.lib, each) for each in objects], module
