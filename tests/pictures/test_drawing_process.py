"""The process that draws picture.png ends with the run; what is said of missing packages."""

import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT, SMALL_CASE, run_coulomb

from coulomb.pictures.drawing_process import PACKAGES
from coulomb.ranks import RANK_VARIABLES

MARK = "COULOMB_TEST_OF_THE_OVERVIEW"


def marked(mark):
    """Processes whose environment has the mark."""
    found = []
    for place in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"{MARK}={mark}".encode() in place.read_bytes():
                found.append(int(place.parent.name))
        except OSError:  # it has ended, or is another user's
            continue
    return found


def started(mark, *words):
    environment = {key: value for key, value in os.environ.items() if key not in RANK_VARIABLES} | {MARK: mark}
    command = [sys.executable, "-m", "coulomb", *words]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def waits_for(condition, seconds=30.0):
    until = time.monotonic() + seconds
    while not condition() and time.monotonic() < until:
        time.sleep(0.02)
    return condition()


needs_proc = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc on this platform")


@needs_proc
def test_a_wrong_case_leaves_no_process(tmp_path):
    run = started(str(tmp_path), "run", str(tmp_path / "none.toml"))
    assert "none.toml" in run.communicate()[0] and run.returncode == 2
    assert waits_for(lambda: not marked(tmp_path))


@needs_proc
def test_a_kill_while_it_loads_leaves_no_process(tmp_path):
    run = started(str(tmp_path), "run", str(ROOT / "demos" / "block.toml"), "--output", str(tmp_path / "results"))
    assert waits_for(lambda: len(marked(tmp_path)) > 1)  # the run, and the process that draws
    run.send_signal(signal.SIGKILL)
    run.communicate()
    assert run.returncode != 0
    assert waits_for(lambda: not marked(tmp_path))


@needs_proc
def test_a_report_is_not_written_after_its_caller_is_killed(tmp_path):
    (tmp_path / "case.toml").write_text(SMALL_CASE)
    run_coulomb("run", "case.toml", "--output", "out", "--quiet", cwd=tmp_path)
    run = started(str(tmp_path), "report", str(tmp_path / "out"))
    assert waits_for(lambda: len(marked(tmp_path)) > 1)
    (child,) = (pid for pid in marked(tmp_path) if pid != run.pid)
    assert waits_for(lambda: "numpy" in Path(f"/proc/{child}/maps").read_text())
    run.kill()
    run.communicate()
    assert waits_for(lambda: not marked(tmp_path)) and not (tmp_path / "out" / "report.html").exists()


# --- without the packages for pictures -------------------------------------------------------------------------------

SMALL = ("run", ROOT / "demos" / "block.toml", "--set", "mesh.cells=[3,1,1]")
EVERY = " ".join(dict.fromkeys(PACKAGES.values()))


@pytest.fixture
def without(monkeypatch, tmp_path):
    """Makes modules unavailable in the processes that a test starts."""

    def take(*modules):
        place = tmp_path / "missing"
        place.mkdir()
        for name in modules:
            error = f"ModuleNotFoundError(\"No module named '{name}'\", name={name!r})"
            (place / f"{name}.py").write_text(f"raise {error}\n")
        monkeypatch.setenv("PYTHONPATH", f"{place}:{ROOT}")

    return take


def test_the_extra_lists_the_packages():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert {re.match(r"[\w-]+", entry)[0] for entry in extras["pictures"]} == set(PACKAGES.values())
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert not {re.match(r"[\w-]+", entry)[0] for entry in needed} & set(PACKAGES.values())


def test_a_run_continues_without_picture_and_report(tmp_path, without):
    without(*PACKAGES)
    done = run_coulomb(*SMALL, "--report", "--output", tmp_path / "out", process=True)
    said = [line for line in done.stderr.splitlines() if line]
    assert len(said) == 2
    for line, name in zip(said, ("picture.png", "report.html"), strict=True):
        assert re.fullmatch(
            rf"warning: {name} could not be (drawn|written): \w+ is not installed, and pictures need it: "
            rf"\./install\.sh, or pip install {EVERY}",
            line,
        )
        assert not (tmp_path / "out" / name).exists()
    assert "certificate passed" in done.stdout


@pytest.mark.parametrize(("command", "module"), [("plot", "pyvista"), ("report", "PIL")])
def test_drawing_commands_say_what_to_install(tmp_path, without, block, command, module):
    without(module)
    save = tmp_path / ("x.png" if command == "plot" else "x.html")
    done = run_coulomb(command, block, "--save", save, process=True, code=1)
    assert not save.exists()
    assert done.stderr == (
        f"error: {PACKAGES[module]} is not installed, and pictures need it: ./install.sh, or pip install {EVERY}\n"
    )
