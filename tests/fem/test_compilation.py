"""The compilation of forms is announced, once per machine."""

import pytest
from conftest import ROOT, run_coulomb
from ffcx.codegeneration import jit

from coulomb.fem.compat import mesh  # noqa: F401 - changes FFCx's look-up
from coulomb.fem.compilation import NoCompiler

SMALL = ("check-case", ROOT / "demos" / "block.toml", "--set", "mesh.cells=[3,1,1]")
TOLD = "compiling the finite-element forms, once per machine (about 10 s)"


def test_compilation_is_announced_once_per_machine(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = run_coulomb(*SMALL, process=True)
    assert first.returncode == 0
    lines = first.stdout.splitlines()
    assert lines[0] == TOLD and lines.count(TOLD) == 1
    assert len(list((tmp_path / "fenics").glob("*.so"))) > 1  # one line, however many are compiled
    again = run_coulomb(*SMALL, process=True)
    assert again.returncode == 0 and TOLD not in again.stdout  # every form is found again
    assert again.stdout.splitlines()[0] == lines[1]


def test_without_a_compiler_the_message_says_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", "no-such-gcc -O2")
    run = run_coulomb(*SMALL, ranks=2)
    assert run.returncode == 2 and "Traceback" not in run.stderr
    assert "error: the finite-element forms of this case have to be compiled, once per machine" in run.stderr
    assert "no-such-gcc -O2 is not there; apt-get install gcc" in run.stderr
    with pytest.raises(NoCompiler, match="no-such-gcc -O2 is not there"):
        jit.get_cached_module("libffcx_forms_0", ["form"], tmp_path, 1)
    assert not list(tmp_path.rglob("*.c"))  # for which later runs would wait
