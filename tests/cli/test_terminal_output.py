"""Output on a terminal and in a log: plain text unless it is interactive."""

import contextlib
import os
import pty
import subprocess
import threading
from pathlib import Path

import pytest
from conftest import RANKS_ON_FEW_CORES
from test_pipes_and_signals import CASE, COULOMB, environment, shell


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)


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


RUN = (*COULOMB, "run", "case.toml")


def test_a_line_changes_on_a_terminal():
    assert "\x1b[" in on_a_terminal(*RUN, TERM="xterm")


@pytest.mark.parametrize("changes", [{"TERM": "dumb"}, {"TERM": "xterm", "NO_COLOR": "1"}, {"TERM": ""}], ids=str)
def test_plain_text_on_request(changes):
    shown = on_a_terminal(*RUN, **changes)
    assert "\x1b" not in shown and "path following   2" in shown and "certificate passed" in shown


def test_plain_text_under_mpirun():
    """Open MPI gives its processes terminals, whose output may go to a file."""
    command = ["mpirun", "-n", "2", *RUN]
    done = subprocess.run(
        command, env=environment(TERM="xterm", **RANKS_ON_FEW_CORES), capture_output=True, timeout=240
    )
    assert done.returncode == 0 and b"\x1b" not in done.stdout + done.stderr
    assert b"path following   2" in done.stdout
    done = subprocess.run(
        ["mpirun", "-n", "1", *COULOMB, "--help"], env=environment(TERM="xterm"), capture_output=True, timeout=240
    )
    assert b"\x1b" not in done.stdout and b"check-case" in done.stdout


def test_plain_text_in_a_log_with_forced_colours():
    done = shell("coulomb run case.toml > said; cat said", FORCE_COLOR="1", TERM="xterm")
    assert "\x1b" not in done.stdout and "certificate passed" in done.stdout
