"""The compilation of forms needs a compiler; that it is announced is in tests/cli/test_standard_streams.py."""

import os
import signal
import subprocess
import sys
import time

import pytest
from conftest import ROOT, make_block, run_coulomb
from ffcx.codegeneration import jit

from coulomb.fem import compilation
from coulomb.fem.compat import mesh  # noqa: F401 - changes FFCx's look-up
from coulomb.fem.compilation import NoCompiler

SMALL = ("check-case", ROOT / "demos" / "block.toml", "--set", "mesh.cells=[3,1,1]")


def test_without_a_compiler_the_message_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", "no-such-gcc -O2")
    run = run_coulomb(*SMALL, ranks=2, code=2)
    assert "Traceback" not in run.stderr
    assert "error: the finite-element forms of this case have to be compiled, once per machine" in run.stderr
    assert "no-such-gcc -O2 is not there; apt-get install gcc" in run.stderr
    with pytest.raises(NoCompiler, match="no-such-gcc -O2 is not there"):
        jit.get_cached_module("libffcx_forms_0", ["form"], tmp_path, 1)
    assert not list(tmp_path.rglob("*.c"))  # for which later runs would wait


def test_forms_in_the_cache_need_no_list_of_it(monkeypatch):
    """FFCx lists its directory at each look-up, for which it makes a FileFinder; and loads the form again."""
    make_block(1)  # may compile
    monkeypatch.setattr("importlib.machinery.FileFinder", None)
    monkeypatch.setattr("coulomb.fem.compilation._loaded", {})
    make_block(1)
    monkeypatch.setattr("coulomb.fem.compilation.ExtensionFileLoader", None)
    make_block(1)


FORM = """
from mpi4py import MPI
from coulomb.fem import compat
import ufl
domain = compat.mesh.create_unit_cube(MPI.COMM_WORLD, 1, 1, 1)
V = compat.functionspace(domain, 1)
form = compat.fem.form(ufl.TrialFunction(V) * ufl.TestFunction(V) * ufl.dx)
print(len(list(__import__("pathlib").Path(CACHE).rglob("libffcx_forms*.c.cached"))), "compiled")
"""


def _compiling(cache, compiler):
    script = f"CACHE = {str(cache)!r}" + FORM
    env = {**os.environ, "XDG_CACHE_HOME": str(cache), "CC": f"{compiler}"}
    return subprocess.Popen([sys.executable, "-c", script], env=env, cwd=ROOT, text=True, stdout=subprocess.PIPE)


def _script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def test_a_run_killed_in_the_compiler_leaves_nothing_that_others_wait_for(tmp_path):
    killed = _compiling(tmp_path, _script(tmp_path / "kills", "kill -9 $PPID"))
    assert killed.wait() == -signal.SIGKILL
    left = {file.suffix for file in tmp_path.rglob("libffcx*")}
    assert ".c" in left and ".cached" not in left  # else the next line shows nothing
    run = _compiling(tmp_path, "gcc")
    assert run.communicate()[0] == "1 compiled\n" and run.returncode == 0


def test_two_processes_that_compile_at_once_compile_once(tmp_path):
    slow = _script(tmp_path / "slow", f'echo x >> {tmp_path}/calls; sleep 0.7; exec gcc "$@"')
    runs = [_compiling(tmp_path, slow) for _ in range(3)]
    assert [run.communicate()[0] for run in runs] == ["1 compiled\n"] * 3
    alone = (tmp_path / "calls").read_text().count("x")
    again = tmp_path / "again"
    again.mkdir()
    assert _compiling(again, slow).communicate()[0] == "1 compiled\n"
    assert (tmp_path / "calls").read_text().count("x") == 2 * alone


def test_a_file_of_dolfinx_alone_is_waited_for_until_it_is_old(tmp_path):
    """Such a process leaves no lock by which it could be seen to live."""
    name = "libffcx_forms_0"
    source = tmp_path / f"{name}.c"
    source.touch()
    os.utime(source, (time.time() - 3600.0,) * 2)
    assert jit.get_cached_module(name, ["form"], tmp_path, 1) == (None, None)  # this process is to compile it


def test_a_form_compiled_by_another_process_just_before_the_lock_is_kept(tmp_path, monkeypatch):
    """Compiled again, its library would be written over while that process calls it: a segmentation fault."""
    name, flock = "libffcx_forms_0", compilation.fcntl.flock

    def others_finish(*of):
        (tmp_path / f"{name}.c.cached").touch()
        flock(*of)

    for ending in (".c", ".lock"):
        (tmp_path / f"{name}{ending}").touch()
    monkeypatch.setattr(compilation.fcntl, "flock", others_finish)
    lock = compilation._CompilationLock()
    lock.acquire(tmp_path, name)
    assert (tmp_path / f"{name}.c").exists() and lock._file == -1
