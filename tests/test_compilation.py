"""The compilation of forms is announced, once per machine."""

from conftest import ROOT, run_coulomb

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
