"""Compilation of the finite-element forms, once per machine and kind of cell; it takes seconds and is announced."""

from __future__ import annotations

import fcntl
import logging
import os
import shlex
import shutil
import sysconfig
import time
from collections.abc import Callable, Sequence
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader, ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final

_log = logging.getLogger(__name__)

SECONDS: Final = 10
"""Approximate time of the compiler for all forms of a run."""

_WAIT: Final = 600.0
"""Seconds for which a living process that compiles the same form is waited for."""

_FOREIGN: Final = 60.0
"""Age in seconds from which the file of a process that leaves no lock (DOLFINx alone) has been left by a dead one."""

_to_announce = False  # whether the next compilation is to be announced

_loaded: dict[tuple[str, str], Any] = {}
"""Result of FFCx's look-up by directory and name: it loads the module again each time; stresses need three look-ups per
load step."""


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
    look_up, jit_compiled = jit.get_cached_module, dolfinx_jit.ffcx_jit
    lock = _CompilationLock()

    def looked_up(name: str, objects: Sequence[str], directory: str | Path, *arguments: Any) -> Any:
        global _to_announce
        key = str(directory), name
        if key not in _loaded and (compiled := _compiled_before(name, objects, Path(directory))) is not None:
            _loaded[key] = compiled
        if key in _loaded:
            return _loaded[key]
        if not Path(directory, f"{name}.c").exists():
            _refuse_without_compiler()  # before FFCx leaves a file for which other processes wait
        lock.acquire(Path(directory), name)
        try:
            loaded = look_up(name, objects, directory, *arguments)
        except BaseException:
            lock.release()
            raise
        if loaded[0] is not None:
            lock.release()
            _loaded[key] = loaded
        elif _to_announce:
            _to_announce = False
            _log.info("compiling the finite-element forms, once per machine (about %d s)", SECONDS)
        return loaded

    def explained(*arguments: Any, **options: Any) -> Any:
        try:
            return jit_compiled(*arguments, **options)
        except RuntimeError as error:
            if "compilation" in str(error):  # on several ranks, on all of them
                _refuse_without_compiler()
            raise
        finally:
            lock.release()

    jit.get_cached_module, dolfinx_jit.ffcx_jit = looked_up, explained
    jit._compile_objects = _with_arity_errors(jit._compile_objects, arity_mismatch)


def _compiled_before(name: str, objects: Sequence[str], directory: Path) -> tuple[list[Any], ModuleType] | None:
    """The objects of a form in the cache and its module, as FFCx loads them, but without a list of the directory: 5 ms
    after some hundred forms, nine times in the run of a box.  None if it is not there."""
    library = directory / f"{name}{EXTENSION_SUFFIXES[0]}"
    if not (library.exists() and (directory / f"{name}.c.cached").exists()):
        return None
    loader = ExtensionFileLoader(name, str(library))
    module = module_from_spec(ModuleSpec(name, loader, origin=str(library)))
    loader.exec_module(module)
    return [getattr(module.lib, each) for each in objects], module


class _CompilationLock:
    """Lock of a process while it compiles a form, by which others see whether the process still lives.

    FFCx makes `NAME.c` before it compiles and `NAME.c.cached` after it, and waits for the second where there is the
    first.  If the process has been killed in between, every later run would wait in vain.  The operating system gives
    back the lock on `NAME.lock` of a dead process, also on a network's file system.
    """

    def __init__(self) -> None:
        self._file = -1

    def acquire(self, directory: Path, name: str) -> None:
        """Wait for a living process that compiles, take the lock, and remove what a dead process has left; nothing if
        the form is there."""
        self.release()  # of a form for which FFCx was called directly
        source, ready, path = (directory / f"{name}{ending}" for ending in (".c", ".c.cached", ".lock"))
        until = time.monotonic() + _WAIT
        while not ready.exists() and time.monotonic() < until:
            ours = path.exists()  # then a process with a lock has made `NAME.c`
            if self._taken(path):
                if ready.exists():  # since the look above: others may have loaded it
                    break
                if not source.exists():
                    return
                if ours or time.time() - source.stat().st_mtime > _FOREIGN:
                    source.unlink(missing_ok=True)
                    return
                path.unlink(missing_ok=True)
            self.release()
            time.sleep(0.1)
        self.release()

    def _taken(self, path: Path) -> bool:
        """Whether this process has the lock now, or there can be none, as without rights, which FFCx reports."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_RDWR | os.O_CREAT)
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            pass
        return True

    def release(self) -> None:
        """Give the lock back."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


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
