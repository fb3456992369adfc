"""Interruption of solvers, load histories and the command line by signals; its log."""

import csv
import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest
from conftest import MPIEXEC, RANKS_ON_FEW_CORES, ROOT, make_block, run_coulomb, run_python
from mpi4py import MPI
from shared_problems import rubbed
from test_standard_streams import CASE, COULOMB, certified, environment

from coulomb import HistoryFiles, InteriorPoint, LoadHistory, NotConverged, Status, SuccessiveTresca
from coulomb.cli.session import SIGNALS, Interruption
from coulomb.cli.terminal import about
from coulomb.model.load_history import StepFailed
from coulomb.solvers import KPRGP, Automatic

BLOCK = ROOT / "demos" / "block.toml"


class Stop:
    """Progress that requests a stop at a step."""

    def __init__(self, at):
        self.at, self.calls = at, 0

    def __call__(self, progress):
        self.calls += 1
        return self.calls >= self.at


@pytest.mark.parametrize("solver", [InteriorPoint(), Automatic(), SuccessiveTresca(), KPRGP()])
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


class Watched:
    """A command that gets a signal when it has reached a given point."""

    def __init__(self, *command):
        self.process = subprocess.Popen(
            list(map(str, command)),
            env=environment(**RANKS_ON_FEW_CORES),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=signals_not_ignored,
            start_new_session=True,
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

    def logged(self, log, text):
        return self.when(lambda: log.exists() and text in log.read_text())

    def signalled(self, number, group=False):
        """Exit code as in a shell, and the messages; to the whole group as by Ctrl-C."""
        (os.killpg if group else os.kill)(self.process.pid, number)
        out, errors = self.process.communicate(timeout=300)
        code = self.process.returncode
        return 128 - code if code < 0 else code, out, errors


def signals_not_ignored():
    """Signals may be ignored where the tests were started, as behind `&` or nohup."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


RUN = (*COULOMB, "run", "case.toml")


@pytest.mark.parametrize(
    ("number", "library"), [(signal.SIGINT, "_pydantic_core"), (signal.SIGUSR1, "libpetsc")], ids=str
)
def test_a_signal_while_it_loads(number, library, small_case):
    found = Watched(*RUN).mapped(library).signalled(number)
    assert found == (128 + number, "", "")


def test_a_signal_before_there_is_something_to_keep(small_case):
    """Mesh, assembly, factorisation: immediate end without a message."""
    watched = Watched(*RUN, "--set", "mesh.cells=[90,30,30]").mapped("libdolfinx")
    time.sleep(1.0)
    code, _, errors = watched.signalled(signal.SIGTERM)
    assert (code, errors) == (128 + signal.SIGTERM, "")
    assert not Path("out/summary.json").exists()


@pytest.mark.parametrize(("number", "ranks"), [(signal.SIGHUP, 1), (signal.SIGUSR1, 2)])
def test_a_signal_stops_a_run_with_everything_kept(number, ranks, small_case):
    log, launcher = Path("log"), (MPIEXEC, "-n", ranks) if ranks > 1 else ()
    slow = ["--set", "mesh.cells=[30,10,10]", "--set", "solver={linear_solver='iterative', method='successive-tresca'}"]
    watched = Watched(*launcher, *RUN, *slow, "--log", log).logged(log, "path following   2")
    code, _, errors = watched.signalled(number)
    assert code == 130 and "Traceback" not in errors and "PETSC" not in errors
    assert errors.count("stopping after this step, everything is kept; once more to stop at once") == 1
    assert re.search(r"error: interrupted: .*; the answer so far is in out/, marked as interrupted\n", errors), errors
    contents = json.loads(Path("out/summary.json").read_text())
    assert contents["status"] == "interrupted" and not contents["certificate"]["passed"]
    assert {"solution.h5", "contact.h5"} <= {path.name for path in Path("out").iterdir()}
    assert not Path("out/run.lock").exists() and not list(Path("out").glob(".*"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=str)
def test_a_stopped_refinement_keeps_a_mesh_it_has_solved(number, small_case):
    """The last one, or where it is killed the one whose results were written last; both can be checked."""
    log, again = Path("log"), r"(?s)(mesh of \d+ displacement.*){3}"
    watched = Watched(*RUN, "--refine-to", "0.01%", "--log", log)
    watched.when(lambda: log.exists() and re.search(again, log.read_text()))
    code, _, errors = watched.signalled(number)
    summary = json.loads(Path("out/summary.json").read_text())
    meshes = [one["unknowns"] for one in summary["error"]["meshes"]]
    assert summary["valid"] and meshes[0] == summary["unknowns"]["displacement"] > meshes[1]
    run_coulomb("check", "out")
    if number == signal.SIGKILL:
        assert code == 137 and re.match(r"not finished: error bars of .* %, 0.01 % was asked for", summary["message"])
    else:
        assert code == 130 and f"error: interrupted: {summary['message']}; the answer on the finest mesh" in errors
        assert re.match(r"error bars of .* %, 0.01 % was asked for: the next mesh, ", summary["message"])


@pytest.mark.parametrize("drawn", ["picture", "report"])
def test_a_signal_while_it_draws(drawn, small_case):
    """The results are complete and certified; only the picture being drawn is missing."""
    summary = Path("out/summary.json")
    pictures = ["--set", f"output.picture={'true' if drawn == 'picture' else 'false'}"]
    watched = Watched(*RUN, *pictures, *(["--report"] if drawn == "report" else []))
    code, out, errors = watched.when(summary.exists).signalled(signal.SIGINT, group=True)
    assert code == 130 and certified(), errors
    assert "certificate passed" in out and "Traceback" not in errors
    first, second = errors.strip().splitlines()
    assert first.startswith("stopping after this step")
    assert second == f"error: interrupted at the end: the results are complete in out/, but the {drawn} may be missing"
    assert sorted(path.name for path in Path("out").iterdir()) == sorted(
        ["case.json", "contact.h5", "contact.xdmf", "iterations.csv", "solution.h5", "solution.xdmf", "summary.json"]
    )


def test_a_signal_stops_a_load_history_which_resumes(tmp_path):
    log, out = tmp_path / "log.txt", tmp_path / "out"
    small = ("--set", "mesh.cells=[6,6,3]", "--set", "output.picture=false")
    command = [*COULOMB, "run", ROOT / "demos" / "history.toml", "--output", out, "--log", log, *small]
    code, _, said = Watched(*command).logged(log, "step   2 ").signalled(signal.SIGINT)
    assert code == 130, said
    done = len(list((out / "steps").glob("*/summary.json")))
    assert 2 <= done < 24
    assert f"the {done} load steps before are in {out}/; to continue: coulomb resume {out}" in said
    assert f"{24 - done} load steps left, about " in log.read_text()
    done = run_coulomb("resume", out, "--quiet", "--log", log)
    assert done.stdout == done.stderr == ""
    with (out / "history.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 24
    assert log.read_text().count("coulomb resume") >= 1 and "step  24 " in log.read_text()


@pytest.fixture
def small_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)


def test_a_signal_to_one_rank_stops_all(tmp_path):
    script = tmp_path / "stop.py"
    script.write_text(
        f"import os, signal, sys\nsys.path.insert(0, {str(ROOT)!r})\n"
        "from mpi4py import MPI\nimport coulomb\nfrom benchmarks.block import block\n"
        "from coulomb.cli.session import Interruption\ncomm = MPI.COMM_WORLD\n"
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
    assert done.stderr.count("stopping after this step") == 1


def test_the_second_signal_ends_it_at_once(tmp_path):
    script = tmp_path / "twice.py"
    script.write_text(
        "import os, signal\nfrom mpi4py import MPI\nfrom coulomb.cli.session import Interruption\n"
        "with Interruption(MPI.COMM_SELF) as interruption:\n    assert not interruption.asked()\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n    assert interruption.asked() and interruption.asked()\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n    print('still here')\n"
    )
    done = run_python(script, timeout=240, code=-signal.SIGINT)
    assert "still here" not in done.stdout


def test_signal_handlers_are_restored():
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
    lines = log.read_text().splitlines()
    stamp = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} +\d+\.\d\d s  ")
    assert all(stamp.match(line) for line in lines)
    data = [line[stamp.match(line).end() :] for line in lines]
    assert data[0].startswith("coulomb run ") and data[1:] == loud.stdout.splitlines()
    quiet = run_coulomb(*command, "--log", log, "--quiet")
    assert quiet.stdout == ""
    assert len(log.read_text().splitlines()) == 2 * len(lines)  # appended to, and complete although output is quiet
    run_coulomb(*command, "--log", log, "--set", "solver.method='successive-tresca'")
    data = log.read_text().splitlines()[2 * len(lines) :]
    contents = json.loads((tmp_path / "summary.json").read_text())
    assert sum("  path following" in line for line in data) == contents["iterations"]["path_following"]


def test_errors_are_logged_and_a_full_disk_ends_only_the_log(tmp_path):
    log = tmp_path / "run.log"
    wrong = ("--set", "contact.face='left'", "--output", tmp_path / "out")
    run_coulomb("run", BLOCK, *wrong, "--log", log, code=2)
    assert "error: contact face 'left' is fully clamped" in log.read_text()
    small = ("--set", "mesh.cells=[6,2,2]", "--set", "output.picture=false", "--output", tmp_path)
    done = run_coulomb("run", BLOCK, *small, "--log", "/dev/full")
    assert "certificate passed" in done.stdout
    assert done.stderr.splitlines()[0] == "warning: the log /dev/full ends here: No space left on device"
    assert len(done.stderr.splitlines()) == 1


def test_rounded_times():
    assert [about(s) for s in (0.2, 1.4, 99.0, 100.0, 600.0, 5900.0, 7000.0, 4e5)] == [
        *("0 s", "1 s", "99 s", "1.7 min", "10 min", "98 min", "1.9 h", "111 h")
    ]


def test_a_crash_is_exit_code_3(tmp_path):
    script = tmp_path / "die.py"
    script.write_text(
        "import sys\nfrom coulomb.case import case\nfrom coulomb.cli import app as cli\ndef read_case(*_):\n"
        "    raise RuntimeError('unforeseen')\n"
        "case.read_case = read_case\nsys.argv = ['coulomb', 'run', 'x.toml']\ncli.main()\n"
    )
    done = run_python(script, timeout=240, code=3)
    assert "RuntimeError: unforeseen" in done.stderr


def test_a_signal_during_the_sum_over_the_ranks_is_not_lost():
    """It comes after this rank's part of the sum, on a busy machine once in a few runs; the next question finds it."""

    class Late:
        rank, signals = 0, 1

        def allreduce(self, requested, op):
            for _ in range(self.signals):
                os.kill(os.getpid(), signal.SIGUSR1)
            self.signals = 0
            return requested

    with Interruption(Late()) as interruption:
        assert [interruption.asked() for _ in range(3)] == [False, True, True]


def test_nohup_continues_after_the_terminal_ends(monkeypatch):
    """A SIGHUP that is ignored stays ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interruption(MPI.COMM_SELF) as interruption:
            interruption.asked()
            os.kill(os.getpid(), signal.SIGHUP)
            assert not interruption.asked()
    finally:
        signal.signal(signal.SIGHUP, before)
