"""The process of the command line: pipes, closed streams, full disks, signals in any phase."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import SMALL_CASE, run_coulomb

CASE = SMALL_CASE.replace("[3, 1, 1]", "[6, 2, 2]") + 'directory = "out"\n'
LAUNCHER = ("OMPI_COMM", "OMPI_MCA", "OMPI_UNIVERSE", "PMIX", "PRTE")
COULOMB = (sys.executable, "-m", "coulomb")
STEPS = """[{face="top", value=[0,0,-1e-4], amplitude=[[0,0],[1,1]]}]"""


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
        ("coulomb run case.toml >&-", {0}, 0),
        ("coulomb run case.toml <&- >&- 2>&-", {0}, 0),
        ("coulomb run case.toml --report 2>&1 | true", {0}, 0),
        ("coulomb --help | head -1", {0, 141}, 1),
        ("coulomb run --help | true", {0, 141}, 0),
        ("coulomb info | head -1", {0, 141}, 1),
        ("coulomb info >&-", {0}, 0),
        ("coulomb check-case case.toml >&-", {0}, 0),
        ("coulomb new block new.toml >&-", {0}, 0),
    ],
)
def test_closed_pipe(line, codes, shown):
    done = shell(line)
    assert done.returncode in codes and done.stderr == "", done.stderr
    assert len(done.stdout.splitlines()) <= shown
    assert "run case" not in line or (certified() and Path("out/case.json").exists())


@pytest.mark.parametrize(
    ("command", "code"), [("run case.toml", 0), ("info", 1), ("--help", 1), ("--version", 1), ("new block x.toml", 1)]
)
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


def test_narrow_encoding():
    Path("größe.toml").write_text(CASE)
    done = shell("coulomb run größe.toml", PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and r"gr\xf6\xdfe.toml" in done.stdout and done.stderr == ""


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


@pytest.mark.parametrize("kind", ["read-only", "no directory"])
def test_unwritable_home(kind, tmp_path):
    with read_only(tmp_path / "home") as home:
        where = str(home) if kind == "read-only" else "/dev/null"
        clean = {"HOME": where, "TMPDIR": str(tmp_path), "XDG_CACHE_HOME": ""}
        done = shell("coulomb run case.toml --set output.picture=true", **clean)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert Path("out/picture.png").stat().st_size > 1000
    assert list((tmp_path / f"coulomb-{os.getuid()}" / "fenics").glob("*.so"))


def test_a_cache_of_another_user_is_not_used(tmp_path, monkeypatch):
    from coulomb import process

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own = process._own_directory()
    assert own == process._own_directory() == tmp_path / f"coulomb-{os.getuid()}"
    own.chmod(0o777)
    assert process._own_directory() != own


# --- signals -------------------------------------------------------------------------------------------------------

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGHUP]
EARLY = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGUSR1: 138, signal.SIGHUP: 129}


def signals_not_ignored():
    """Signals may be ignored where the tests were started, as behind `&` or nohup."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


class Watched:
    """A command that gets a signal when it has reached a given point."""

    def __init__(self, *arguments):
        command = [*COULOMB, *map(str, arguments)]
        self.process = subprocess.Popen(
            command,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=signals_not_ignored,
        )
        self.until = time.monotonic() + 300.0

    def when(self, seen):
        while self.process.poll() is None and not seen() and time.monotonic() < self.until:
            time.sleep(0.001)
        assert self.process.poll() is None and seen(), self.process.communicate()
        return self

    def mapped(self, library):
        """Once it has loaded a library."""
        maps = Path(f"/proc/{self.process.pid}/maps")
        return self.when(lambda: library in maps.read_text())

    def signalled(self, *numbers):
        """Exit code as in a shell, and the messages."""
        for number in numbers:
            self.process.send_signal(number)
            time.sleep(0.05 if len(numbers) > 1 else 0.0)
        out, errors = self.process.communicate(timeout=300)
        code = self.process.returncode
        return 128 - code if code < 0 else code, out, errors


LOADING = [(signal.SIGINT, "_pydantic_core")]  # the others are not needed
LOADING += [(number, library) for number in SIGNALS for library in ("libmpi.so", "libpetsc", "libdolfinx")]


@pytest.mark.parametrize(("number", "library"), LOADING, ids=str)
def test_a_signal_while_it_loads(number, library):
    code, out, errors = Watched("run", "case.toml").mapped(library).signalled(number)
    assert (code, out, errors) == (EARLY[number], "", "")


@pytest.mark.parametrize("number", SIGNALS[:2], ids=lambda number: number.name)
@pytest.mark.parametrize("command", ["check-case", "run"])
def test_a_signal_before_there_is_something_to_keep(number, command):
    """Mesh, assembly, factorisation: immediate end without a message."""
    arguments = [command, "case.toml", "--set", "mesh.cells=[90,30,30]", "--log", "log"]
    watched = Watched(*(arguments if command == "run" else arguments[:-2])).mapped("libdolfinx")
    time.sleep(1.0)
    code, _, errors = watched.signalled(number)
    assert (code, errors) == (EARLY[number], "")
    assert not Path("out/summary.json").exists()


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_a_signal_in_the_loop(number):
    log = Path("log")
    slow = ["--set", "mesh.cells=[36,12,12]", "--set", "solver={linear_solver='iterative', method='successive-tresca'}"]
    watched = Watched("run", "case.toml", *slow, "--log", log)
    code, _, errors = watched.when(lambda: log.exists() and "path following   2" in log.read_text()).signalled(number)
    assert code == 130 and "Traceback" not in errors and "PETSC" not in errors
    expected = r"\nstopping after this step, .*\n(warning: .*\n)*error: interrupted: .*, marked as interrupted\n"
    assert re.fullmatch(expected, errors), errors
    assert json.loads(Path("out/summary.json").read_text())["status"] == "interrupted"
    assert not Path("out/run.lock").exists() and not list(Path("out").glob(".*"))


@pytest.mark.parametrize("drawn", ["picture", "report"])
def test_a_signal_while_it_draws(drawn):
    """The results are complete and certified; only the picture being drawn is missing."""
    summary = Path("out/summary.json")
    pictures = ["--set", f"output.picture={'true' if drawn == 'picture' else 'false'}"]
    watched = Watched("run", "case.toml", *pictures, *(["--report"] if drawn == "report" else []))
    code, out, errors = watched.when(lambda: summary.exists() and Path("out/case.json").exists()).signalled(
        signal.SIGINT
    )
    assert code == 130 and certified(), errors
    assert "certificate passed" in out and "Traceback" not in errors
    first, second = errors.strip().splitlines()
    assert first.startswith("stopping after this step")
    assert second == f"error: interrupted at the end: the results are complete in out/, but the {drawn} may be missing"
    assert sorted(path.name for path in Path("out").iterdir()) == sorted(
        ["case.json", "contact.h5", "contact.xdmf", "history.csv", "solution.h5", "solution.xdmf", "summary.json"]
    )


def test_two_signals_while_it_draws_end_it_with_the_results_kept():
    watched = Watched("run", "case.toml", "--set", "output.picture=true")
    watched.when(lambda: Path("out/summary.json").exists() and Path("out/case.json").exists())
    code, _, errors = watched.signalled(signal.SIGINT, signal.SIGINT)
    assert code == 130 and certified() and "Traceback" not in errors
    assert run_coulomb("check", "out").returncode == 0


def test_the_last_step_of_a_history_is_kept_when_the_picture_is_not():
    history = ["--set", f"clamp={STEPS}", "--set", "traction=[]", "--set", "history={times=[0.5,1]}"]
    last = Path("out/steps/0002/summary.json")
    watched = Watched("run", "case.toml", *history, "--set", "output.picture=true").when(last.exists)
    code, _, errors = watched.signalled(signal.SIGTERM)
    assert code in (0, 130) and "Traceback" not in errors  # 0 if the picture was finished first
    assert run_coulomb("resume", "out", "--quiet").returncode == 0


def test_nohup_continues_after_the_terminal_ends():
    """A SIGHUP that is ignored stays ignored."""
    script = "import signal, os; signal.signal(signal.SIGHUP, signal.SIG_IGN)\nfrom mpi4py import MPI\n"
    script += "from coulomb.cli.interruption import Interruption\n"
    script += "with Interruption(MPI.COMM_SELF) as it:\n    it.asked()\n"
    script += "    os.kill(os.getpid(), signal.SIGHUP)\n    assert not it.asked()\n"
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment(), capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr


def test_the_drawing_process_ends_with_its_caller(tmp_path):
    """A process of coulomb.pictures.apart does not outlive a caller that is killed."""
    run = run_coulomb("run", "case.toml", "--quiet")
    assert run.returncode == 0
    process = subprocess.Popen([*COULOMB, "report", "out"], env=environment(), stderr=subprocess.DEVNULL)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    until = time.monotonic() + 300.0
    child = ""
    while not child and time.monotonic() < until:
        child = children.read_text().strip()
    with contextlib.suppress(FileNotFoundError):  # it has begun to import
        while "coulomb.pictures.report" not in Path(f"/proc/{child}/cmdline").read_text() and time.monotonic() < until:
            pass
    maps = Path(f"/proc/{child}/maps")
    while "numpy" not in maps.read_text() and time.monotonic() < until:
        time.sleep(0.001)
    process.kill()
    process.wait()
    while time.monotonic() < until and Path(f"/proc/{child}").exists():
        time.sleep(0.01)
    assert not Path(f"/proc/{child}").exists() and not Path("out/report.html").exists()
