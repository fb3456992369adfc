"""The compilation of forms needs a compiler; that it is announced is in tests/cli/test_standard_streams.py."""

import pytest
from conftest import ROOT, make_block, run_coulomb
from ffcx.codegeneration import jit

from coulomb.fem.compat import mesh  # noqa: F401 - changes FFCx's look-up
from coulomb.fem.compilation import NoCompiler

SMALL = ("check-case", ROOT / "demos" / "block.toml", "--set", "mesh.cells=[3,1,1]")


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


def test_a_loaded_form_is_not_looked_up_again(monkeypatch):
    """FFCx lists its directory at each look-up."""
    for _ in range(2):  # the first may compile, the second loads
        make_block(1)
    monkeypatch.setattr("importlib.machinery.FileFinder", None)
    make_block(1)
