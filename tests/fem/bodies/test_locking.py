"""Locking of a directory of results by one run at a time; a load history has one case."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from unittest import mock

import pytest
from conftest import ROOT, run_coulomb, run_python
from coulomb.io.lock import InUseError, locked, refuse_in_use
from mpi4py import MPI
from test_load_history import rubbed

from coulomb import HistoryFiles, LoadHistory
from coulomb.io.run_directory import LOCK

HISTORY = ROOT / "demos" / "history.toml"
TINY = (
    *("--set", "mesh.cells=[2,2,1]", "--set", "history={end=6.0, steps=3}", "--set", "output.picture=false"),
    *("--output", "out"),
)
comm = MPI.COMM_SELF

HOLD = """\
import sys, time
from mpi4py import MPI
from coulomb.io.lock import locked
with locked(sys.argv[1], MPI.COMM_WORLD):
    print("held", flush=True)
    time.sleep(60)
"""


@contextlib.contextmanager
def another_run(directory, tmp_path):
    """Another process that holds the directory; yields the process."""
    script = tmp_path / "hold.py"
    script.write_text(HOLD)
    process = subprocess.Popen([sys.executable, script, directory], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.wait()


def everything(folder):
    return {path: path.read_bytes() for path in sorted(Path(folder).rglob("*")) if path.is_file()}


def left_behind(folder, **changes):
    """The lock of a killed process of this machine."""
    script = "from mpi4py import MPI; import os, sys; from coulomb.io.lock import locked\n"
    script += "hold = locked(sys.argv[1], MPI.COMM_WORLD); hold.__enter__(); os.kill(os.getpid(), 9)"
    run_python("-c", script, folder)
    contents = json.loads((folder / LOCK).read_text())
    (folder / LOCK).write_text(json.dumps({**contents, **changes}))


def without_flock():
    return mock.patch("coulomb.io.lock.fcntl.flock", side_effect=OSError(38, "Function not implemented"))


@pytest.mark.parametrize("command", ["run", "resume"])
def test_a_second_run_is_refused_and_changes_nothing(command, tmp_path):
    assert run_coulomb("run", HISTORY, *TINY, cwd=tmp_path).returncode == 0
    assert not (tmp_path / "out" / LOCK).exists()
    with another_run(tmp_path / "out", tmp_path) as other:
        before = everything(tmp_path / "out")
        arguments = ("run", HISTORY, *TINY) if command == "run" else ("resume", "out")
        done = run_coulomb(*arguments, cwd=tmp_path)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
        for part in (f"error: out is in use by process {other.pid} on {socket.gethostname()}, since 2", "(hold.py "):
            assert part in done.stderr
        assert everything(tmp_path / "out") == before


def test_locking_on_two_ranks(tmp_path):
    with another_run(tmp_path / "out", tmp_path) as other:
        done = run_coulomb("run", HISTORY, *TINY, ranks=2, cwd=tmp_path, timeout=240)
        assert done.returncode == 2 and done.stderr.count(f"out is in use by process {other.pid} ") == 1
    script = "from mpi4py import MPI; import os; from coulomb.io.lock import locked; c = MPI.COMM_WORLD\n"
    script += "with locked('two', c): assert c.allreduce(os.path.exists('two/run.lock'))\n"
    script += "c.barrier(); assert not os.path.exists('two/run.lock')"
    done = run_python("-c", script, ranks=2, cwd=tmp_path, timeout=240)
    assert done.returncode == 0, done.stderr


def test_the_lock_of_a_killed_run_is_removed(tmp_path):
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "coulomb", "run", HISTORY, "--output", folder, "--set", "mesh.cells=[6,6,3]"]
    process = subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL)
    until = time.monotonic() + 300.0
    while not (folder / "steps" / "0001" / "summary.json").exists() and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert json.loads((folder / LOCK).read_text())["pid"] == process.pid
    (folder / ".partial-abc").mkdir()
    refuse_in_use(folder, comm)
    with locked(folder, comm):
        assert json.loads((folder / LOCK).read_text())["pid"] == os.getpid()
        assert not (folder / ".partial-abc").exists()  # what it was writing
    assert not (folder / LOCK).exists()


@pytest.mark.parametrize("flock", [True, False])
def test_the_holder_of_an_old_lock(flock, tmp_path):
    with contextlib.nullcontext() if flock else without_flock():
        left_behind(tmp_path)
        refuse_in_use(tmp_path, comm)
        with locked(tmp_path, comm):
            pass
        left_behind(tmp_path, pid=os.getpid())  # the process number has been reused since, by this process
        with locked(tmp_path, comm):
            pass
        left_behind(tmp_path, host="elsewhere", started="another-boot 77")
        for ask in (lambda: refuse_in_use(tmp_path, comm), lambda: locked(tmp_path, comm).__enter__()):
            with pytest.raises(InUseError, match=rf"on elsewhere.*cannot be seen from .*remove .*{LOCK}"):
                ask()
        (tmp_path / LOCK).unlink()
        with locked(tmp_path, comm):
            pass


def test_without_flock_a_running_process_holds_the_lock(tmp_path):
    with another_run(tmp_path, tmp_path) as other, without_flock():
        for ask in (lambda: refuse_in_use(tmp_path, comm), lambda: locked(tmp_path, comm).__enter__()):
            with pytest.raises(InUseError, match=f"in use by process {other.pid} "):
                ask()
        (tmp_path / LOCK).write_text("")  # made, and not yet written
        with pytest.raises(InUseError, match="a run that has just started; if that run is known to have ended, remove"):
            refuse_in_use(tmp_path, comm)


def test_one_process_may_lock_twice(tmp_path):
    folder = tmp_path / "deep" / "out"
    with locked(folder, comm), locked(folder, comm):
        refuse_in_use(folder, comm)
    assert not list(tmp_path.iterdir())
    with locked(folder, comm):
        (folder / "file").touch()
    assert [path.name for path in folder.iterdir()] == ["file"]


def test_a_history_from_python_holds_its_directory(tmp_path):
    held = []
    LoadHistory([1.0]).run(
        rubbed(2),
        HistoryFiles(tmp_path / "out"),
        on_step=lambda _: held.append((tmp_path / "out" / LOCK).exists()),
    )
    assert held == [True]
    with another_run(tmp_path / "out", tmp_path), pytest.raises(ValueError, match="is in use by process"):
        LoadHistory([1.0]).run(rubbed(2), HistoryFiles(tmp_path / "out", resume=True))
