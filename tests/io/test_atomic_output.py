"""Runs into a directory with results: one at a time, and nothing is destroyed unless the user asks for it, nor by a
kill."""

import contextlib
import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer
from conftest import SMALL_CASE, run_coulomb, run_python, solved_block
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.cli.run_case import in_place_of
from coulomb.io import output
from coulomb.io.atomic_output import InUseError, commit, finish, locked, set_aside, set_aside_in
from coulomb.io.recheck import check
from coulomb.io.run_directory import LOCK, RunDirectory

OTHER = ("--set", "contact.friction=0.4")
GROWING = "traction=[{face='top',value=[0,0,-1e7],amplitude=[[0,0],[1,1]]}]"
HISTORY = ("--set", GROWING, "--set", "history={times=[0.5,1]}")
FILES = {"case.json", "contact.h5", "contact.xdmf", "history.csv", "solution.h5", "solution.xdmf", "summary.json"}
OUT, comm = Path("out"), MPI.COMM_SELF


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(SMALL_CASE)


def run(*options, code=0):
    done = run_coulomb("run", "case.toml", "--output", "out", "--quiet", *options)
    assert done.returncode == code, done.stderr
    return done.stderr


def everything(folder="out"):
    return {
        path.relative_to(folder): os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_symlink() or path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The results of the small case, and of its history."""
    home = tmp_path_factory.mktemp("made")
    (home / "case.toml").write_text(SMALL_CASE)
    for name, options in (("single", ()), ("history", HISTORY)):
        done = run_coulomb("run", home / "case.toml", "--output", home / name, *options)
        assert done.returncode == 0, done.stderr
    return home


def there(made, name):
    shutil.copytree(made / name, "out")
    return everything()


def friction():
    return json.loads(Path("out/summary.json").read_text())["friction"]


# --- what may be replaced -----------------------------------------------------------------------------------------


def test_the_same_case_is_run_again_also_with_another_method(made):
    there(made, "single")
    Path("out/notes.txt").write_text("mine")
    assert run("--set", "solver.method=successive-tresca") == ""
    assert json.loads(Path("out/summary.json").read_text())["method"]["solver"].startswith("successive")
    assert set(map(str, everything())) == FILES | {"notes.txt"} and check("out").passed


def test_another_case_is_refused_and_overwritten_on_request(made):
    before = there(made, "single")
    said = run(*OTHER, code=2)
    assert "out holds the results of another case (contact.friction is 0.4, was 0.3)" in said
    assert "--overwrite" in said and "--output" in said and everything() == before
    Path("out/notes.txt").write_text("mine")
    assert run(*OTHER, "--overwrite") == ""
    assert friction() == 0.4 and check("out").passed
    assert set(map(str, everything())) == FILES | {"notes.txt"}


@pytest.mark.parametrize(("there_is", "options"), [("history", ()), ("single", HISTORY), ("history", HISTORY)])
def test_histories_and_single_runs(made, there_is, options):
    before = there(made, there_is)
    said = run(*options, code=2)
    assert "--overwrite" in said and everything() == before
    assert ("coulomb resume out" in said) == (there_is == "history" and bool(options))
    run(*options, "--overwrite")
    assert check("out").passed and not set_aside_in(OUT)
    at_top = {str(name) for name in everything() if len(name.parts) == 1}
    assert at_top == FILES - ({"contact.h5", "solution.h5"} if options else set())
    assert Path("out/steps").exists() == bool(options)


def test_results_from_python(made):
    there(made, "single")
    Path("out/case.json").unlink()
    assert "run from Python" in run(code=2)
    shutil.rmtree("out")
    before = there(made, "history")
    with pytest.raises(ValueError, match="holds a load history of 2 steps"):
        solved_block(2).write("out")
    assert everything() == before


def test_a_changed_mesh_file_is_another_case():
    BoxFile().write(Path("part.msh"))
    mesh = SMALL_CASE.replace("box = [3.0, 1.0, 1.0]\ncells = [3, 1, 1]", 'file = "part.msh"')
    Path("case.toml").write_text(mesh)
    run()
    assert run() == ""  # the same again
    with Path("part.msh").open("a") as file:
        file.write("\n$Comments\nchanged\n$EndComments\n")
    assert "the contents of mesh.file" in run(code=2)


@pytest.mark.parametrize("name", ["history.csv", "steps/data.txt"])
def test_files_of_the_user_are_never_replaced(name):
    """Even with names of our format, in a directory without results: not even if that is asked for."""
    path = Path("out", name)
    path.parent.mkdir(parents=True)
    path.write_text("a;b\n1;2\n")
    for options in ((), ("--overwrite",)):
        assert "is not known to be a result of coulomb" in run(*options, code=2)
    assert everything() == {Path(name): b"a;b\n1;2\n"}


def test_foreign_and_protected_files_among_results(made):
    there(made, "history")
    Path("out/steps/0001/notes.txt").write_text("mine")
    before = everything()
    assert "notes.txt is not a result of coulomb" in run("--overwrite", code=2)
    Path("out/steps/0001/notes.txt").unlink()
    Path("out/solution.xdmf").chmod(0o444)
    assert "out/solution.xdmf is write-protected" in run("--overwrite", code=2)
    assert everything() == {path: text for path, text in before.items() if path.name != "notes.txt"}


def test_links_are_replaced_not_what_they_point_to(made):
    there(made, "history")
    shutil.move("out", "place")
    OUT.symlink_to("place")
    shutil.move("out/steps", "elsewhere")
    Path("out/steps").symlink_to("../elsewhere")
    Path("kept.csv").write_bytes(Path("out/history.csv").read_bytes())
    Path("out/history.csv").unlink()
    Path("out/history.csv").symlink_to("../kept.csv")
    kept, elsewhere = Path("kept.csv").read_bytes(), everything("elsewhere")
    run(*OTHER, "--overwrite")
    assert OUT.is_symlink() and check("out").passed and not any(path.is_symlink() for path in OUT.iterdir())
    assert Path("kept.csv").read_bytes() == kept and everything("elsewhere") == elsewhere


# --- kills and full disks -----------------------------------------------------------------------------------------


class KilledError(BaseException):
    """A kill."""


@pytest.mark.parametrize("there_is", ["single", "history"])
def test_a_kill_at_any_moment_of_the_move(made, there_is, monkeypatch):
    """Before each change on disk in turn: what has a summary is whole, and old or new results are complete somewhere;
    the next run finishes the move."""
    old = there(made, there_is)
    new = {Path(name): name.encode() for name in FILES}
    finished, kills = False, 0
    while not finished:
        shutil.rmtree("out")
        there(made, there_is)
        partial = Path("out/.partial-1")
        partial.mkdir()
        for name, text in new.items():
            (partial / name).write_bytes(text)
        left = kills
        with monkeypatch.context() as patch:
            for owner, name in ((os, "rename"), (os, "replace"), (Path, "unlink"), (Path, "rmdir")):
                real = getattr(owner, name)

                def change(*args, real=real, **options):
                    nonlocal left
                    left -= 1
                    if left < 0:
                        raise KilledError
                    return real(*args, **options)

                patch.setattr(owner, name, change)
            try:
                commit(partial, OUT)
                finished = True
            except KilledError:
                kills += 1
        found = everything()
        visible = {path: text for path, text in found.items() if not path.parts[0].startswith(".")}
        if Path("summary.json") in visible:
            assert visible in (old, new)
        hidden = {Path(*path.parts[1:]): text for path, text in found.items() if path.parts[0].startswith(".complete")}
        assert visible == old or {**visible, **hidden}.items() >= new.items()
        if list(OUT.glob(".complete*")):
            if not Path("out/summary.json").exists():
                with pytest.raises(ValueError, match="complete: the next coulomb run here finishes that"):
                    RunDirectory(OUT).read_summary()
            finish(OUT)
            assert everything() == new
    assert everything() == new and kills >= 10


def test_the_next_run_finishes_a_move(made):
    there(made, "single")
    Path("out/.complete-moving").mkdir()
    for name in ("summary.json", "solution.h5"):
        shutil.move(f"out/{name}", f"out/.complete-moving/{name}")
    assert ".complete-moving, where they are complete" in run_coulomb("check", "out").stderr
    with locked("out", comm):
        assert set(map(str, everything())) == FILES | {"run.lock"}
    assert check("out").passed


def test_a_full_disk_keeps_the_old_results(made, monkeypatch):
    solution, before = solved_block(2), there(made, "single")

    def full(*_):
        raise OSError(28, "No space left on device")

    for function in ("_write_fields", "write_json"):
        with monkeypatch.context() as patch:
            patch.setattr(output, function, full)
            with pytest.raises(OSError, match="No space"):
                output.write(solution, "out", overwrite=True)
        assert everything() == before


SLOW = ("--set", "mesh.cells=[6,3,3]", "--set", "history={end=1, steps=7}", *HISTORY[:2])


def test_a_killed_history_keeps_the_old_results(made):
    """The old ones wait beside the new steps; they are removed when `coulomb resume` completes the history.  The lock
    of the killed process does not hold the directory."""
    before = there(made, "single")
    command = [sys.executable, "-m", "coulomb", "run", "case.toml", "--output", "out", "--overwrite", *SLOW]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while not Path("out/steps/0002/summary.json").exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert f"process {process.pid} on " in Path("out/run.lock").read_text()
    kept = {path: text for path, text in everything("out/replaced-1").items() if path.name != "REPLACED.txt"}
    assert kept == before and check("out/replaced-1").passed
    Path("out/.partial-abc").mkdir()
    done = run_coulomb("resume", "out")
    assert done.returncode == 0, done.stderr
    assert check("out").passed and not Path("out/replaced-1").exists()
    assert not [path for path in OUT.iterdir() if path.name[0] == "." or path.name == LOCK]


def test_a_history_that_ends_before_its_first_step(made):
    before = there(made, "history")
    with pytest.raises(typer.Exit), in_place_of(OUT, True, False, comm):
        assert not (FILES - {"REPLACED.txt"}).intersection(map(str, everything()))
        Path("out/case.json").write_text("{}")
        raise typer.Exit(130)
    assert everything() == before


def test_files_that_cannot_be_set_aside_stay(made, monkeypatch):
    before, real = there(made, "single"), os.rename

    def refuse(one, other):
        if Path(other).name == "solution.h5" and "replaced-1" in str(other):
            raise OSError(5, "Input/output error")
        real(one, other)

    monkeypatch.setattr(os, "rename", refuse)
    with pytest.raises(typer.Exit), in_place_of(OUT, True, False, comm):
        pass
    assert everything() == before


def test_results_set_aside_are_removed_only_on_request(made):
    """A later run without --overwrite leaves them; foreign files in them are left in any case."""
    there(made, "history")
    set_aside(OUT)
    run(*HISTORY)
    assert Path("out/replaced-1/summary.json").exists()
    Path("out/replaced-1/steps/0001/notes.txt").write_text("mine")
    run(*HISTORY, "--overwrite")
    assert everything("out/replaced-1") == {Path("steps/0001/notes.txt"): b"mine"}
    assert all(step.passed for step in check("out").steps)


# --- one run at a time --------------------------------------------------------------------------------------------

HOLD = """\
import sys, time
from mpi4py import MPI
from coulomb.io.atomic_output import locked
with locked(sys.argv[1], MPI.COMM_WORLD):
    print("held", flush=True)
    time.sleep(60)
"""


@contextlib.contextmanager
def another_run(directory):
    """Another process that holds the directory; yields the process."""
    Path("hold.py").write_text(HOLD)
    process = subprocess.Popen([sys.executable, "hold.py", directory], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("command", [("run", "case.toml", "--output", "out", *OTHER, "--overwrite"), ("resume", "out")])
def test_a_second_run_is_refused_and_changes_nothing(command, made):
    there(made, "history")
    with another_run("out") as other:
        before = everything()
        done = run_coulomb(*command)
        assert done.returncode == 2 and done.stderr.count("error:") == 1, done.stderr
        holder = f"error: out is in use by process {other.pid} on {socket.gethostname()}, since 2"
        assert holder in done.stderr and "(hold.py " in done.stderr
        assert everything() == before
        with pytest.raises(InUseError, match=f"in use by process {other.pid} "):
            locked("out", comm).__enter__()


@pytest.mark.parametrize("elsewhere", [True, False])
def test_the_lock_of_a_killed_run(elsewhere, monkeypatch):
    """Here the next run takes it; of another machine, or on a file system without locks, the user has to remove it."""
    script = "from mpi4py import MPI; import os; from coulomb.io.atomic_output import locked\n"
    run_python("-c", f"{script}hold = locked('out', MPI.COMM_WORLD); hold.__enter__(); os.kill(os.getpid(), 9)")
    names, colon, holder = Path("out/run.lock").read_text().partition(": ")
    assert names.split()[0] == socket.gethostname()
    with locked("out", comm):
        pass
    assert not OUT.exists() or not any(OUT.iterdir())
    OUT.mkdir(exist_ok=True)
    for name in names.split():  # its host, after a restart, or its boot, in another container
        Path("out/run.lock").write_text(f"{name}{colon}{holder}")
        with locked("out", comm):
            pass
    Path("out/run.lock").write_text(f"{'elsewhere another-boot' if elsewhere else names}{colon}{holder}")
    if not elsewhere:

        def none(*_):
            raise OSError(38, "Function not implemented")

        monkeypatch.setattr(fcntl, "flock", none)
    for _ in range(2):
        with pytest.raises(InUseError, match=rf"cannot be seen from .*remove .*{LOCK}"):
            locked("out", comm).__enter__()
    Path("out/run.lock").unlink()
    with locked("out", comm):
        pass


def test_one_process_may_lock_twice(tmp_path):
    folder = tmp_path / "deep" / "out"
    with locked(folder, comm), locked(folder, comm):
        assert (folder / LOCK).exists()
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]
    with locked(folder, comm):
        (folder / "file").touch()
    assert [path.name for path in folder.iterdir()] == ["file"]


def test_a_history_from_python_holds_its_directory(made):
    there(made, "history")
    script = "import coulomb, sys; from coulomb.case.case import read_case\n"
    script += "case = read_case('case.toml', sys.argv[1:])\n"
    script += "case.load_history().run(case.problem(), coulomb.HistoryFiles('out', resume=True))"
    with another_run("out"):
        done = run_python("-c", script, HISTORY[1], HISTORY[3])
    assert "InUseError: out is in use by process" in done.stderr.splitlines()[-1]
