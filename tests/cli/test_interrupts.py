"""Signals that stop a run, its log, and the displayed time left."""

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from conftest import RANKS_ON_FEW_CORES, ROOT, make_block, run_coulomb, run_python
from coulomb.cli.time_left import TimeLeft, about
from mpi4py import MPI
from rich.console import Console
from test_load_history import rubbed

from coulomb import KPRGP, Automatic, HistoryFiles, InteriorPoint, LoadHistory, NotConverged, Status, SuccessiveTresca
from coulomb.cli.terminal import Display
from coulomb.model.load_history import StepFailed
from coulomb.solvers.results import Progress

BLOCK = ROOT / "demos" / "block.toml"
SMALL = ("--set", "mesh.cells=[6,6,3]", "--set", "output.picture=false")
SLOW = (  # three seconds of path following
    *("--set", "mesh.cells=[30,10,10]", "--set", "output.picture=false"),
    *("--set", "solver={linear_solver='iterative', method='successive-tresca'}"),
)


class Stop:
    """Progress that requests a stop at a step."""

    def __init__(self, at):
        self.at, self.calls = at, 0

    def __call__(self, progress):
        self.calls += 1
        return self.calls >= self.at


@pytest.mark.parametrize("solver", [InteriorPoint(), Automatic(), SuccessiveTresca(), InteriorPoint(), KPRGP()])
def test_an_interrupted_solver_returns_its_answer(solver):
    tresca = isinstance(solver, InteriorPoint | KPRGP)
    problem = make_block(3, slip_stress=1e7 if tresca else None)
    stop = Stop(5)
    with pytest.raises(NotConverged, match="interrupted") as failure:
        problem.solve(solver=solver, progress=stop)
    result = failure.value.result
    assert result.status is Status.INTERRUPTED and result.residual > 1e-8
    assert max(result.newton_steps, len(result.history)) == stop.calls == 5  # no further step is taken
    solution = problem.solution(result)
    assert solution.contact_force.any() and not solution.certificate.passed


def test_an_interruption_at_the_solution_is_convergence():
    steps = []
    result = make_block(3).solve(progress=steps.append).result
    stopped = make_block(3).solve(progress=Stop(len(steps))).result
    assert stopped.status is Status.CONVERGED and stopped.newton_steps == result.newton_steps


def test_an_interrupted_load_history_continues(tmp_path):
    history = LoadHistory([1.0, 2.0, 3.0])
    unbroken, stopped = HistoryFiles(tmp_path / "whole"), tmp_path / "stopped"
    history.run(rubbed(3), unbroken)
    whole = unbroken.rows
    first = whole[0]["path_following"]
    with pytest.raises(StepFailed, match="interrupted in the load step from 1 s to 2 s, which is discarded") as failure:
        history.run(rubbed(3), HistoryFiles(stopped), progress=Stop(first + 3))
    assert failure.value.result.status is Status.INTERRUPTED
    assert len(list((stopped / "steps").iterdir())) == 1
    files = HistoryFiles(stopped, resume=True)
    history.run(rubbed(3), files, on_step=lambda step: True)  # stops after a step
    assert len(files.rows) == 2
    history.run(rubbed(3), files)
    rows = files.rows
    # To the tolerance of the solution, since what was found of A in earlier steps is not in the files.
    assert [row["normal_force"] for row in rows] == pytest.approx([row["normal_force"] for row in whole], rel=1e-8)


def signalled(command, log, number, at):
    """Exit code and standard error of a command that gets a signal once its log has a line."""
    launcher = ("OMPI_COMM", "OMPI_MCA", "OMPI_UNIVERSE", "PMIX", "PRTE")
    clean = {key: value for key, value in os.environ.items() if not key.startswith(launcher)}
    clean |= RANKS_ON_FEW_CORES
    process = subprocess.Popen(
        list(map(str, command)), env=clean, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 300.0
    while process.poll() is None and time.monotonic() < until and not (log.exists() and at in log.read_text()):
        time.sleep(0.01)
    process.send_signal(number)
    return process.wait(timeout=240), process.stderr.read()


@pytest.mark.parametrize(
    ("number", "ranks"),
    [(signal.SIGINT, 1), (signal.SIGTERM, 1), (signal.SIGUSR1, 2)],
)
def test_a_signal_stops_a_run_with_everything_kept(tmp_path, number, ranks):
    log, out = tmp_path / "log.txt", tmp_path / "out"
    command = [sys.executable, "-m", "coulomb", "run", BLOCK, *SLOW, "--output", out, "--log", log]
    command = ["mpirun", "-n", ranks, *command] if ranks > 1 else command
    code, said = signalled(command, log, number, "path following   2")
    assert code == 130, said
    assert said.count("stopping after this step, everything is kept; once more to stop at once") == 1
    assert re.search(r"error: interrupted: .*; the answer so far is in .*out/, marked as interrupted", said)
    contents = json.loads((out / "summary.json").read_text())
    assert contents["status"] == "interrupted" and not contents["certificate"]["passed"]
    assert (out / "solution.h5").exists() and (out / "contact.h5").exists()
    assert "Traceback" not in said


def test_a_signal_stops_a_load_history_which_resumes(tmp_path):
    log, out = tmp_path / "log.txt", tmp_path / "out"
    case = ROOT / "demos" / "history.toml"
    command = [sys.executable, "-m", "coulomb", "run", case, "--output", out, "--log", log]
    code, said = signalled([*command, *SMALL], log, signal.SIGINT, "step   2 ")
    assert code == 130, said
    done = len(list((out / "steps").glob("*/summary.json")))
    assert 2 <= done < 24
    assert f"the {done} load steps before are in {out}/; to continue: coulomb resume {out}" in said
    done = run_coulomb("resume", out, "--quiet", "--log", log)
    assert done.returncode == 0 and done.stdout == done.stderr == ""
    with (out / "history.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 24
    assert log.read_text().count("coulomb resume") >= 1 and "step  24 " in log.read_text()


def test_a_signal_to_one_rank_stops_all(tmp_path):
    script = tmp_path / "stop.py"
    script.write_text(
        "import os, signal, sys\nfrom mpi4py import MPI\nimport coulomb\nfrom coulomb.benchmarks.block import block\n"
        "from coulomb.cli.interruption import Interruption\ncomm = MPI.COMM_WORLD\n"
        "with Interruption(comm) as interruption:\n"
        "    def progress(at):\n"
        "        if at.path_following == 3 and comm.rank == 1:\n            os.kill(os.getpid(), signal.SIGTERM)\n"
        "        return interruption.asked()\n"
        "    try:\n        block(4, 0.3).solve(progress=progress)\n"
        "    except coulomb.NotConverged as failure:\n"
        "        steps = set(comm.allgather((failure.result.status.value, failure.result.newton_steps)))\n"
        "        sys.exit(0 if len(steps) == 1 and steps <= {('interrupted', 3), ('interrupted', 4)} else 9)\n"
    )
    done = run_python(script, ranks=2, timeout=240)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("stopping after this step") == 1


def test_the_second_signal_ends_it_at_once(tmp_path):
    script = tmp_path / "twice.py"
    script.write_text(
        "import os, signal\nfrom mpi4py import MPI\nfrom coulomb.cli.interruption import Interruption\n"
        "with Interruption(MPI.COMM_SELF) as interruption:\n    assert not interruption.asked()\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n    assert interruption.asked() and interruption.asked()\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n    print('still here')\n"
    )
    done = run_python(script, timeout=240)
    assert done.returncode == -signal.SIGINT and "still here" not in done.stdout


def test_signal_handlers_are_restored():

    from coulomb.cli.interruption import SIGNALS, Interruption

    before = [signal.getsignal(number) for number in SIGNALS]
    with Interruption(MPI.COMM_SELF) as interruption:
        assert [signal.getsignal(number) for number in SIGNALS] == before  # until the handler is read
        interruption.asked()
        assert signal.getsignal(signal.SIGTERM) not in before
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_the_log_has_all_messages_and_steps(tmp_path):
    log = tmp_path / "deep" / "run.log"
    command = ("run", BLOCK, "--set", "mesh.cells=[6,2,2]", "--set", "output.picture=false", "--output", tmp_path)
    loud = run_coulomb(*command, "--log", log)
    assert loud.returncode == 0
    lines = log.read_text().splitlines()
    stamp = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} +\d+\.\d\d s  ")
    assert all(stamp.match(line) for line in lines)
    data = [line[stamp.match(line).end() :] for line in lines]
    assert data[0].startswith("coulomb run ") and data[1:] == loud.stdout.splitlines()
    quiet = run_coulomb(*command, "--log", log, "--quiet")
    assert quiet.returncode == 0 and quiet.stdout == ""
    assert len(log.read_text().splitlines()) == 2 * len(
        lines
    )  # appended to, and complete although standard output is quiet
    fixed = run_coulomb(*command, "--log", log, "--set", "solver.method='successive-tresca'")
    data = log.read_text().splitlines()[2 * len(lines) :]
    contents = json.loads((tmp_path / "summary.json").read_text())
    assert fixed.returncode == 0
    assert sum("  path following" in line for line in data) == contents["iterations"]["path_following"]


def test_errors_are_logged_and_a_full_disk_ends_only_the_log(tmp_path):
    log = tmp_path / "run.log"
    assert (
        run_coulomb("run", BLOCK, "--set", "contact.face='left'", "--output", tmp_path / "out", "--log", log).returncode
        == 2
    )
    assert "error: contact face 'left' is fully clamped" in log.read_text()
    small = ("--set", "mesh.cells=[6,2,2]", "--set", "output.picture=false", "--output", tmp_path)
    done = run_coulomb("run", BLOCK, *small, "--log", "/dev/full")
    assert done.returncode == 0 and "certificate passed" in done.stdout
    assert done.stderr.splitlines()[0] == "warning: the log /dev/full ends here: No space left on device"
    assert len(done.stderr.splitlines()) == 1


def test_the_log_has_the_time_left_of_load_steps(tmp_path):
    log = tmp_path / "run.log"
    case = ROOT / "demos" / "history.toml"
    changes = ("--set", "mesh.cells=[4,4,2]", "--set", "history={end=2.0, steps=3}", "--set", "output.picture=false")
    done = run_coulomb("run", case, *changes, "--output", tmp_path / "out", "--log", log)
    assert done.returncode == 0 and "load steps left" not in done.stdout
    left = re.findall(r"(\d) load steps left, about [\d.]+ s", log.read_text())
    assert left == ["2", "1"]


def geometric(rate, steps, seconds=2.0):
    left = TimeLeft(1e-8)
    for step in range(1, steps + 1):
        left.note(Progress(0, step, 10.0 ** (-rate * step)), seconds * step)
    return left


def test_time_left_of_a_residual_that_falls_geometrically():
    assert geometric(0.5, 5).seconds is None  # too early
    assert geometric(0.5, 6).seconds == pytest.approx(2.0 * 10)  # 5 decades at half a decade a step
    assert geometric(0.5, 12).seconds == pytest.approx(2.0 * 4)
    assert geometric(0.5, 20).seconds == 0.0
    assert geometric(0.01, 20).seconds is None  # hardly falls
    assert geometric(-0.5, 20).seconds is None


def test_time_left_restarts_with_the_residual():
    left = geometric(0.5, 8)
    left.note(Progress(0, 1, 1.0), 20.0)
    assert left.seconds is None
    left = TimeLeft(1e-8)
    for step in range(1, 10):
        left.note(Progress(2, step, 10.0**-step), float(step))  # inside a Tresca problem: no estimate
    assert left.seconds is None


def test_rounded_times():
    assert [about(s) for s in (0.2, 1.4, 99.0, 100.0, 600.0, 5900.0, 7000.0, 4e5)] == [
        *("0 s", "1 s", "99 s", "1.7 min", "10 min", "98 min", "1.9 h", "111 h")
    ]


def shown(monkeypatch, terminal, **options):
    """What a display shows of ten steps, a decade and ten seconds each."""
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=120, highlight=False)
    monkeypatch.setattr("coulomb.cli.terminal.animated", lambda: terminal)
    clock = iter(range(0, 10_000, 10))
    monkeypatch.setattr("coulomb.cli.terminal.time.perf_counter", lambda: float(next(clock)))
    display = Display(console, **options)
    texts = []
    monkeypatch.setattr(display, "_status", display._status and type("S", (), {"update": texts.append})())
    for step in range(1, 7):
        display(Progress(0, step, 10.0**-step))
    return texts, stream.getvalue()


def test_the_terminal_shows_the_time_left_and_a_pipe_does_not(monkeypatch):
    texts, _ = shown(monkeypatch, True, tolerance=1e-8)
    assert texts[4] == "path following   5  residual 1.0e-05"
    assert texts[5] == "path following   6  residual 1.0e-06  about 20 s left"
    texts, data = shown(monkeypatch, False, tolerance=1e-8)
    assert texts == [] and "left" not in data and "path following   5" in data


def test_a_crash_is_exit_code_3(tmp_path):
    script = tmp_path / "die.py"
    script.write_text(
        "import sys\nfrom coulomb.case import case\nfrom coulomb.cli import app as cli\ndef read_case(*_):\n"
        "    raise RuntimeError('unforeseen')\n"
        "case.read_case = read_case\nsys.argv = ['coulomb', 'run', 'x.toml']\ncli.main()\n"
    )
    done = run_python(script, timeout=240)
    assert done.returncode == 3 and "RuntimeError: unforeseen" in done.stderr


def test_a_signal_during_the_sum_over_the_ranks_is_not_lost():
    """It comes after this rank's part of the sum, on a busy machine once in a few runs; the next question finds it."""
    from coulomb.cli.interruption import Interruption

    class Late:
        rank, signals = 0, 1

        def allreduce(self, requested, op):
            for _ in range(self.signals):
                os.kill(os.getpid(), signal.SIGUSR1)
            self.signals = 0
            return requested

    with Interruption(Late()) as interruption:
        assert [interruption.asked() for _ in range(3)] == [False, True, True]
