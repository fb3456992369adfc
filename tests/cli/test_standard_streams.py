"""Standard streams of the command line: pipes, closed and full ones, terminals; a home that cannot be written."""

import contextlib
import json
import os
import pty
import subprocess
import sys
import threading
from pathlib import Path
from unittest import mock

import pytest
from conftest import SMALL_CASE

from coulomb import process
from coulomb.ranks import RANK_VARIABLES

CASE = SMALL_CASE.replace("[3, 1, 1]", "[6, 2, 2]") + 'directory = "out"\n'
HISTORY = CASE.replace(
    'face = "left"\n', 'face = "top"\nvalue = [0.0, 0.0, -1e-4]\namplitude = [[0, 0], [1, 1]]\n'
).replace('[[traction]]\nface = "top"\nvalue = [0.0, 0.0, -1e7]\n', "")
HISTORY += "[history]\ntimes = [0.5, 1.0, 1.5]\n"
LAUNCHER = ("OMPI_COMM", "OMPI_MCA", "OMPI_UNIVERSE", "PMIX", "PRTE")
COULOMB = (sys.executable, "-m", "coulomb")


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)


def environment(**changes):
    clean = {key: value for key, value in os.environ.items() if not key.startswith(LAUNCHER)}
    clean.pop("PYTEST_CURRENT_TEST", None)
    return clean | changes


def shell(line, **changes):
    """A line of shell, in which `coulomb` is this checkout's."""
    line = line.replace("coulomb", " ".join(COULOMB))
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", line], env=environment(**changes), capture_output=True, text=True, timeout=240
    )


def certified(directory="out"):
    return json.loads(Path(directory, "summary.json").read_text())["certificate"]["passed"]


@pytest.mark.parametrize(
    ("line", "codes", "shown"),
    [
        ("coulomb run case.toml | head -2", {0}, 2),
        ("coulomb run case.toml <&- >&- 2>&-", {0}, 0),
        ("coulomb run case.toml --set output.picture=true 2>&1 | true", {0}, 0),
        ("coulomb --help | head -1", {0, 141}, 1),
        ("coulomb info >&-", {0}, 0),
    ],
)
def test_closed_pipe(line, codes, shown):
    done = shell(line)
    assert done.returncode in codes and done.stderr == "", done.stderr
    assert len(done.stdout.splitlines()) <= shown
    assert "run case" not in line or (certified() and Path("out/case.json").exists())


@pytest.mark.parametrize(("command", "code"), [("run case.toml", 0), ("--version", 1)])
def test_standard_output_on_a_full_disk(command, code):
    done = shell(f"coulomb {command} >/dev/full")
    word = "error" if code else "warning"
    assert (done.returncode, done.stderr) == (
        code,
        f"{word}: standard output: No space left on device; further output is discarded\n",
    )
    assert "run" not in command or certified()


def test_standard_error_on_a_full_disk():
    done = shell("coulomb run none.toml 2>/dev/full")
    assert done.returncode == 2 and done.stderr == done.stdout == ""


def test_narrow_encoding_and_forced_colours():
    Path("größe.toml").write_text(CASE)
    done = shell("coulomb run größe.toml > said; cat said", PYTHONIOENCODING="ascii", FORCE_COLOR="1", TERM="xterm")
    assert done.returncode == 0 and r"gr\xf6\xdfe.toml" in done.stdout and done.stderr == ""
    assert "\x1b" not in done.stdout and "certificate passed" in done.stdout


@contextlib.contextmanager
def read_only(path):
    """A directory in which not even root can write."""
    path.mkdir()
    if os.getuid() != 0:
        path.chmod(0o555)
        yield path
        return
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "ro,size=64k", "none", path], capture_output=True).returncode:
        pytest.skip("root that may not mount")
    try:
        yield path
    finally:
        subprocess.run(["umount", "-l", path], check=True)


def test_unwritable_home(tmp_path):
    """Forms are compiled, announced and found again in the directory for temporary files."""
    told = "compiling the finite-element forms, once per machine (about 10 s)"
    Path("case.toml").write_text(CASE.replace("[mesh]\n", '[mesh]\ncell = "tetrahedron"\n'))
    with read_only(tmp_path / "home") as home:
        clean = {"HOME": str(home), "TMPDIR": str(tmp_path), "XDG_CACHE_HOME": ""}
        done = shell("coulomb run case.toml --set output.picture=true", **clean)
        again = shell("coulomb run case.toml", **clean)
    assert done.returncode == again.returncode == 0 and done.stderr == "", done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == told and lines.count(told) == 1  # one line, however many are compiled
    assert again.stdout.splitlines()[0] == lines[1] and told not in again.stdout
    assert Path("out/solution.h5").exists()
    assert len(list((tmp_path / f"coulomb-{os.getuid()}" / "fenics").glob("*.so"))) > 1


def test_a_home_that_is_no_directory(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("HOME", "/dev/null")
    for name in ("XDG_CACHE_HOME", "MPLCONFIGDIR"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    process._keep_caches_somewhere()
    own = str(tmp_path / f"coulomb-{os.getuid()}")
    assert (os.environ["HOME"], os.environ["XDG_CACHE_HOME"]) == (own, own)
    assert os.environ["MPLCONFIGDIR"] == f"{own}/matplotlib"


def test_a_cache_of_another_user_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own = process._own_directory()
    assert own == process._own_directory() == tmp_path / f"coulomb-{os.getuid()}"
    own.chmod(0o777)
    assert process._own_directory() != own


# --- terminals ----------------------------------------------------------------------------------------------------


def on_a_terminal(*command, **changes):
    """The output of a command whose standard output is a terminal."""
    master, slave = pty.openpty()
    process = subprocess.Popen(command, env=environment(**changes), stdout=slave, stderr=slave)
    os.close(slave)
    shown = bytearray()

    def read():
        with contextlib.suppress(OSError):
            while part := os.read(master, 4096):
                shown.extend(part)

    reader = threading.Thread(target=read)
    reader.start()
    assert process.wait(timeout=240) == 0
    reader.join(timeout=60)
    os.close(master)
    return shown.decode()


def test_a_line_changes_on_a_terminal():
    run = (*COULOMB, "run", "case.toml")
    assert "\x1b[" in on_a_terminal(*run, TERM="xterm")
    shown = on_a_terminal(*run, TERM="xterm", NO_COLOR="1")
    assert "\x1b" not in shown and "path following   2" in shown and "certificate passed" in shown


@pytest.mark.parametrize(
    ("changes", "terminal", "dynamic"),
    [
        ({"TERM": "xterm"}, True, True),
        ({"TERM": "xterm"}, False, False),
        ({"TERM": "dumb"}, True, False),
        ({"TERM": ""}, True, False),
        ({"TERM": "xterm", "NO_COLOR": "1"}, True, False),
        ({"TERM": "xterm", "PMIX_RANK": "0"}, True, False),
    ],
    ids=str,
)
def test_plain_text_unless_it_is_interactive(changes, terminal, dynamic, monkeypatch):
    """Open MPI gives its processes terminals, whose output may go to a file."""
    for name in ("NO_COLOR", *RANK_VARIABLES):
        monkeypatch.delenv(name, raising=False)
    for name, value in changes.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.stdout", mock.Mock(isatty=lambda: terminal))
    assert process.animated() == dynamic
