"""Output to full disks and missing folders; help texts, and exports of a history."""

import contextlib
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import typer.main
import typer.testing
from conftest import ROOT, run_coulomb, run_python
from test_pipes_and_signals import CASE, certified, shell

from coulomb.case.case import read_case
from coulomb.cli import app as cli
from coulomb.fem.geometry.user_values import evaluate_amplitude, evaluate_motion
from coulomb.io.fclib import read_fclib

HISTORY = CASE.replace(
    'face = "left"\n', 'face = "top"\nvalue = [0.0, 0.0, -1e-4]\namplitude = [[0, 0], [1, 1]]\n'
).replace('[[traction]]\nface = "top"\nvalue = [0.0, 0.0, -1e7]\n', "")
HISTORY += "[history]\ntimes = [0.5, 1.0, 1.5]\n"


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


@pytest.mark.parametrize("size", ["64k", "72k", "100k"])
@pytest.mark.parametrize("force", ["", "--force"])
def test_a_run_onto_a_small_disk(size, force):
    with disk(size):
        done = shell(f"coulomb run case.toml --output small/out {force}")
        if done.returncode == 0:
            assert certified("small/out") and done.stderr == ""
        else:
            assert done.returncode == (1 if force else 2) and len(done.stderr.splitlines()) == 1, done.stderr
            assert re.match(r"error: (output )?small/out: .*(no space|No space|disk full)", done.stderr)
            assert not Path("small/out/summary.json").exists() and not list(Path("small").rglob(".partial*"))


@pytest.mark.parametrize("size", ["64k", "72k"])
def test_a_disk_that_hdf5_finds_full(size):
    """A full disk that the estimate did not predict: one line of message, no HDF5 stack, no segmentation fault."""
    script = "import sys; from coulomb.io import output; output.size_on_disk = lambda _: 0.0\n"
    script += (
        "from coulomb.cli.app import main; sys.argv = ['coulomb', 'run', 'case.toml', '--output', 'small/out']; main()"
    )
    Path("run.py").write_text(script)
    with disk(size):
        Path("small/filler").write_bytes(bytes(24_000))
        done = run_python("run.py", timeout=240)
        assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, (done.returncode, done.stderr)
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
        assert run_coulomb("resume", "small/out", "--quiet").returncode == 0


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("export case.toml small/file", 1),
        ("new block small/file", 2),
        ("convert part.msh small/file.xdmf", 1),
        ("plot out --save small/file.png", 1),
        ("report out --save small/file", 1),
    ],
)
def test_a_file_onto_a_full_disk(command, code):
    if "out --save" in command:
        assert run_coulomb("run", "case.toml", "--quiet").returncode == 0
    shutil.copy(ROOT / "demos" / "foot.msh", "part.msh")
    with disk("16k"):
        Path("small/filler").write_bytes(bytes(16_384 if "new" in command else 12_000))
        done = run_coulomb(*command.split(), process="export" in command)  # HDF5 cannot close its file in a process
        assert done.returncode == code and len(done.stderr.splitlines()) == 1, done.stderr
        assert re.match(r"error: small/file.*: cannot be written: No space left on device$", done.stderr)
        left = [path for path in Path("small").rglob("*") if path.is_file() and path.name != "filler"]
        assert not left


def test_a_full_disk_ends_the_log_but_not_the_run():
    with disk("4k"):
        Path("small/filler").write_bytes(bytes(4096))
        done = shell("coulomb run case.toml --log small/log")
        assert done.returncode == 0 and certified()
        assert done.stderr == "warning: the log small/log ends here: No space left on device\n"


@pytest.mark.parametrize("command", ["plot out --save there/file.png", "report out --save there/file.html"])
def test_a_missing_folder(command):
    done = run_coulomb(*command.split())
    assert done.returncode == 2
    assert re.fullmatch(r"error: --save there/file\.\w+: there is no folder there; create it first\n", done.stderr)
    Path("there/file.png").mkdir(parents=True)
    Path("there/file.html").mkdir()
    done = run_coulomb(*command.split())
    assert done.returncode == 2 and "is a folder; name the file in it" in done.stderr


@pytest.mark.parametrize("scale", ["nan", "inf", "-1", "1e300"])
def test_scales_that_are_not_numbers(scale):
    done = run_coulomb("plot", "out", "--save", "file.png", "--scale", scale)
    assert done.returncode == 2 and done.stderr.startswith("error: --scale must be from 0 to 1e12, but is ")


# --- export of a history -------------------------------------------------------------------------------------------


def test_an_export_reports_its_time():
    exported = {}
    for time in (None, 0.5, 1.5):
        option = [] if time is None else ["--time", time]
        done = run_coulomb("export", "history.toml", f"{time}.hdf5", *option)
        assert done.returncode == 0, done.stderr
        assert done.stdout.endswith(f", in one step from rest to time {time or 1.5:g}\n")
        exported[time] = read_fclib(f"{time}.hdf5")
    problem = read_case("history.toml").problem()
    for time, file in exported.items():
        np.testing.assert_allclose(file.q, -problem.at(time or 1.5).b, rtol=1e-12, atol=1e-12 * np.abs(file.q).max())
    assert not np.allclose(exported[0.5].q, exported[1.5].q)
    assert not list(Path().glob(".*.partial"))


def test_an_export_at_a_wrong_time():
    for case, option, said in (
        ("history.toml", "2", "--time 2: must be from 0 to the end of the history, 1.5"),
        ("history.toml", "nan", "--time nan: must be from 0 to the end of the history, 1.5"),
        ("case.toml", "1", "--time is for load histories"),
    ):
        done = run_coulomb("export", case, "x.hdf5", "--time", option)
        assert done.returncode == 2 and said in done.stderr and not Path("x.hdf5").exists()
    done = run_coulomb("export", "case.toml", "there/x.hdf5")
    assert done.returncode == 2 and "there is no folder there" in done.stderr
    done = run_coulomb("export", "case.toml", "x.hdf5")
    assert done.returncode == 0 and re.fullmatch(r"\d+ contacts in x\.hdf5\n", done.stdout)


# --- helps ---------------------------------------------------------------------------------------------------------


def commands(command, path=()):
    yield path, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from commands(inner, (*path, name))


def words(text):
    return re.findall(r"[^\s│╭╮╰╯─]+", re.sub(r"\x1b\[[0-9;]*m", "", text))


@pytest.mark.parametrize(
    ("path", "command"),
    [pytest.param(*found, id=" ".join(found[0]) or "coulomb") for found in commands(typer.main.get_command(cli.app))],
)
def test_help_texts_are_complete(path, command):
    """Text in brackets is shown as text, not taken as markup."""
    environment = {"COLUMNS": "400", "TERMINAL_WIDTH": "400", "TERM": "dumb"}
    done = typer.testing.CliRunner().invoke(cli.app, [*path, "--help"], env=environment)
    assert done.exit_code == 0
    shown = words(done.output)
    helps = [getattr(parameter, "help", None) or "" for parameter in command.params]
    for text in (command.help or "", command.epilog or "", *helps):
        lost = [word for word in words(text) if not any(word in whole for whole in shown)]
        assert not lost, (path, lost)


def test_amplitudes_are_constant_beyond_their_tables():
    """As docs/case-files.md, the docstring and the templates say."""
    table = [(1.0, 2.0), (2.0, 5.0)]
    assert [evaluate_amplitude(table, time, "load") for time in (-9.0, 1.0, 1.5, 2.0, 1e9)] == [2.0, 2.0, 3.5, 5.0, 5.0]
    motion = [(1.0, 0.1, 0.0, 0.0), (2.0, 0.3, 0.0, 0.0)]
    assert [evaluate_motion(motion, time, "foot")[0] for time in (0.0, 3.0)] == [0.1, 0.3]


@pytest.mark.parametrize("tolerance", ["nan", "inf", "2"])
def test_tolerances_that_are_not_numbers(tolerance):
    done = run_coulomb("fclib", "none.hdf5", "--tolerance", tolerance)
    assert done.returncode == 2 and "--tolerance" in done.stderr and "cannot be read" not in done.stderr
