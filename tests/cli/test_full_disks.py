"""Output to full disks."""

import contextlib
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT, run_coulomb, run_python
from test_standard_streams import CASE, HISTORY, certified, shell


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)
    Path("history.toml").write_text(HISTORY)


@contextlib.contextmanager
def disk(size):
    """A small disk, at small/."""
    Path("small").mkdir()
    if os.getuid() != 0 or subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", "small"]).returncode:
        pytest.skip("only root may mount a small disk")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", "small"], check=True)


@pytest.mark.parametrize(("size", "force"), [("72k", "--force"), ("100k", "")])
def test_a_run_onto_a_small_disk(size, force):
    with disk(size):
        done = shell(f"coulomb run case.toml --output small/out {force}")
        if done.returncode == 0:
            assert certified("small/out") and done.stderr == ""
        else:
            assert done.returncode == (1 if force else 2) and len(done.stderr.splitlines()) == 1, done.stderr
            assert re.match(r"error: (output )?small/out: .*(no space|No space|disk full)", done.stderr)
            assert not Path("small/out/summary.json").exists() and not list(Path("small").rglob(".partial*"))


def test_a_disk_that_hdf5_finds_full():
    """A full disk that the estimate did not predict: one line of message, no HDF5 stack, no segmentation fault."""
    script = "import sys; from coulomb.io import output; output.size_on_disk = lambda _: 0.0\n"
    script += (
        "from coulomb.__main__ import main; sys.argv = ['coulomb', 'run', 'case.toml', '--output', 'small/out']; main()"
    )
    Path("run.py").write_text(script)
    with disk("64k"):
        Path("small/filler").write_bytes(bytes(24_000))
        done = run_python("run.py", timeout=240, code=1)
        assert len(done.stderr.splitlines()) == 1, (done.returncode, done.stderr)
        assert re.match(r"error: small/out: cannot be written: ", done.stderr)


def test_a_history_onto_a_small_disk_keeps_its_steps():
    with disk("240k"):
        done = shell("coulomb run history.toml --output small/out --force")
        assert done.returncode == 1
        *_, last = done.stderr.splitlines()
        assert re.match(r"error: small/out: cannot be written: .*free some space, then: coulomb resume small/out", last)
        steps = sorted(path.parent.name for path in Path("small/out/steps").glob("*/summary.json"))
        assert steps and steps[0] == "0001" and len(steps) < 3
        subprocess.run(["mount", "-o", "remount,size=2M", "small"], check=True)
        run_coulomb("resume", "small/out", "--quiet")


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("export case.toml small/file", 1),
        ("new block small/file", 2),
        ("import blocks.inp small/file.toml", 2),
        ("convert part.msh small/file.xdmf", 1),
        ("plot out --save small/file.png", 1),
        ("report out --save small/file", 1),
    ],
)
def test_a_file_onto_a_full_disk(command, code):
    if "out --save" in command:
        run_coulomb("run", "case.toml", "--quiet")
    shutil.copy(ROOT / "demos" / "foot.msh", "part.msh")
    shutil.copy(ROOT / "demos" / "blocks.inp", "blocks.inp")
    with disk("16k"):
        Path("small/filler").write_bytes(bytes(16_384 if code == 2 else 12_000))
        done = run_coulomb(
            *command.split(), process="export" in command, code=code
        )  # HDF5 cannot close its file in a process
        assert len(done.stderr.splitlines()) == 1, done.stderr
        assert re.match(r"error: small/file.*: cannot be written: No space left on device$", done.stderr)
        left = [path for path in Path("small").rglob("*") if path.is_file() and path.name != "filler"]
        assert not left
