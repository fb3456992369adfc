"""Runs into a directory with results: edit, run, look; one at a time; and what a kill or a full disk leaves."""

import contextlib
import fcntl
import functools
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import pytest
from conftest import SMALL_CASE, make_block, run_coulomb, run_python, solved_block
from mpi4py import MPI

import coulomb
from coulomb.io import atomic_output, output
from coulomb.io.atomic_output import finish, locked, refuse_to_replace, set_aside
from coulomb.io.run_directory import LOCK, RunDirectory
from coulomb.recheck import check

OTHER = ("--set", "contact.friction=0.4")
RUN = ("run", "case.toml", "--output", "out", *OTHER)
GROWING = "traction=[{face='top',value=[0,0,-1e7],amplitude=[[0,0],[1,1]]}]"
HISTORY = ("--set", GROWING, "--set", "history={times=[0.5,1]}")
FILES = {"case.json", "contact.h5", "contact.xdmf", "iterations.csv", "solution.h5", "solution.xdmf", "summary.json"}
OUT, KEPT, comm = Path("out"), Path("out.previous"), MPI.COMM_SELF


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(SMALL_CASE)


def run(*options, code=0, case="case.toml", quiet=("--quiet",)):
    done = run_coulomb("run", case, *(() if case == "out" else ("--output", "out")), *quiet, *options, code=code)
    return done.stdout + done.stderr


def everything(folder="out"):
    return {
        path.relative_to(folder): os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_symlink() or path.is_file()
    }


def visible():
    return {path: text for path, text in everything().items() if path.parts[0][0] != "."}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The results of the small case, and of its history."""
    home = tmp_path_factory.mktemp("made")
    (home / "case.toml").write_text(SMALL_CASE)
    for name, options in (("single", ()), ("history", HISTORY)):
        run_coulomb("run", home / "case.toml", "--output", home / name, *options)
    return home


def there(made, name, folder="out"):
    """In the place of what is there."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(made / name, folder)
    return everything(folder)


def friction(folder="out"):
    return json.loads(Path(folder, "summary.json").read_text())["friction"]


# --- edit, run, look ----------------------------------------------------------------------------------------------


def test_a_changed_case_replaces_the_results_and_keeps_those_before(made):
    before = there(made, "single")
    Path("out/notes.txt").write_text("mine")
    assert run(*OTHER, quiet=()).endswith("results in out/, those before in out.previous/\n")
    assert friction() == 0.4 and check("out").passed and everything(KEPT) == before and check(KEPT).passed
    assert set(map(str, everything())) == FILES | {"notes.txt"}
    before = everything()
    run("--set", "contact.friction=0.5")
    assert friction() == 0.5 and friction(KEPT) == 0.4 and Path("out/notes.txt").read_text() == "mine"
    assert sorted(path.name for path in Path().iterdir()) == ["case.toml", "out", "out.previous"]


@pytest.mark.parametrize(("there_is", "options"), [("history", ()), ("single", HISTORY), ("history", HISTORY)])
def test_histories_and_single_runs_replace_each_other(made, there_is, options):
    before = there(made, there_is)
    run(*options)
    assert check("out").passed and everything(KEPT) == before and check(KEPT).passed
    at_top = {str(name) for name in everything() if len(name.parts) == 1}
    assert at_top == FILES - {"contact.h5", "solution.h5", "iterations.csv"} | {"history.csv"} if options else FILES
    assert Path("out/steps").exists() == bool(options)


@pytest.mark.parametrize("options", [(), HISTORY])
def test_a_failed_run_is_replaced(options):
    """One that did not converge, of a history in its first step, where an earlier answer is kept."""
    run()
    run(*options, "--set", "solver.tolerance=1e-11", "--set", "solver.max_outer=1", "--force", code=2)  # a wrong key
    sliding = ("--set", "clamp=[]", "--set", "contact.friction=0.01")
    run(*options, *sliding, "--set", "traction=[{face='top',value=[1e7,0,-1e7]}]", code=1)
    assert not check("out").passed if not options else Path("out/failed/summary.json").exists()
    assert check(KEPT).passed
    run(*options)
    assert check("out").passed and not Path("out/failed").exists()
    assert set(map(str, everything(KEPT))) == FILES


def test_an_unfinished_history_is_begun_anew_with_a_word_on_resume(made):
    there(made, "history")
    shutil.rmtree("out/steps/0002")
    summary = Path("out/steps/0001/summary.json")
    said = run(*HISTORY, quiet=())
    assert "out has an unfinished load history, which `coulomb resume out` would continue" in said
    assert "results in out/, those before in out.previous/" in said
    assert len(list(OUT.glob("steps/*"))) == 2 and len(list(KEPT.glob("steps/*"))) == 1 and summary.exists()
    assert "would continue" not in run(*HISTORY, quiet=())


@pytest.mark.parametrize("there_is", ["single", "history"])
def test_the_careful_keep_results(made, there_is):
    run("--keep")
    before = there(made, there_is)
    assert "out holds results, which are to be kept: choose another directory" in run("--keep", code=2)
    with pytest.raises(ValueError, match="out holds results"):
        solved_block(2).write("out", overwrite=False)
    with pytest.raises(ValueError, match="out holds results"):
        coulomb.LoadHistory([1.0]).run(make_block(2), coulomb.HistoryFiles("out", overwrite=False))
    assert everything() == before and not KEPT.exists()


def test_a_script_runs_again():
    for _ in range(2):
        coulomb.LoadHistory([1.0, 2.0]).run(make_block(2), coulomb.HistoryFiles("out"))
        assert len(list(OUT.glob("steps/*"))) == 2
    assert len(list(KEPT.glob("steps/*"))) == 2
    output.write(solved_block(2), "out")
    assert not Path("out/steps").exists() and len(list(KEPT.glob("steps/*"))) == 2
    coulomb.LoadHistory([1.0]).run(make_block(2), coulomb.HistoryFiles("out", resume=True))  # nothing to continue
    assert Path("out/steps/0001").exists() and Path("out.previous/solution.h5").exists()


@pytest.mark.parametrize("given", ["out", "out/case.json", "copy.json"])
def test_the_recorded_case_is_run_again(made, given):
    there(made, "single")
    if given == "copy.json":
        shutil.copy("out/case.json", given)
        run_coulomb("run", given, "--quiet", *OTHER)
        assert Path("results/summary.json").exists() and friction("results") == 0.4
    else:
        run_coulomb("run", given, "--quiet", *OTHER)
        assert friction() == 0.4 and friction(KEPT) == 0.3 and not Path("results").exists()
    KEPT.mkdir(exist_ok=True)
    Path("nothing").mkdir()
    assert "nothing: has no case.json: give a case file" in run(case="nothing", code=2)


def test_a_case_whose_mesh_the_run_has_made():
    """Its refined mesh is in the directory that it replaces."""
    done = run_coulomb("run", "case.toml", "--output", "out", "--refine-to", "20%", "--quiet", code=None)
    assert done.returncode in (0, 1) and Path("out/mesh/mesh.xdmf").exists()
    for _ in range(2):
        run(*OTHER, case="out")
    assert friction() == 0.4 and Path("out/mesh/mesh.h5").exists() and check("out").passed


def test_on_ranks(made):
    """The whole loop, with decisions of one rank: replaced, kept, refused."""
    there(made, "single")
    for options, code in (((*OTHER, *HISTORY), 0), (("--keep",), 2)):
        done = run_coulomb("run", "out", "--quiet", *options, ranks=2, code=code)
        assert done.stderr.count("error: out holds results") == (code == 2)
    assert check("out").passed and friction("out/steps/0002") == 0.4 and check(KEPT).passed


# --- files of the user --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["out/history.csv", "out/steps/data.txt", "out.previous/history.csv"])
def test_files_of_the_user_are_never_replaced(name):
    """Even with names of our format, in a directory without results."""
    path = Path(name)
    path.parent.mkdir(parents=True)
    path.write_text("a;b\n1;2\n")
    assert "is not known to be a result of coulomb" in run(code=2)
    with pytest.raises(ValueError, match="is not known to be a result of coulomb"):
        solved_block(2).write("out")
    assert path.read_text() == "a;b\n1;2\n"


@pytest.mark.parametrize("keys", [("mesh", "contact"), ("body", "auto_contact")])
def test_a_case_alone_is_known(keys):
    """Of a run that was killed before it had results."""
    OUT.mkdir()
    Path("out/case.json").write_text(json.dumps({key: {} for key in keys}))
    assert refuse_to_replace(OUT, True, comm) == ""


def test_foreign_and_protected_files_in_what_would_be_lost(made):
    """They go with the results before, and stop what would remove these."""
    there(made, "history")
    notes, field = Path("out.previous/steps/0001/notes.txt"), Path("out.previous/solution.xdmf")
    Path("out/steps/0001/notes.txt").write_text("mine")
    Path("out/solution.xdmf").chmod(0o444)
    run()
    before = everything(KEPT)
    for path in (field, notes):
        assert f"{path} is write-protected or no result of coulomb" in run(code=2)
        path.unlink()
    assert before.keys() - everything(KEPT).keys() == {path.relative_to(KEPT) for path in (field, notes)}
    run()


@pytest.mark.parametrize("name", ["out.previous", "out.previous/notes"])
def test_what_would_be_lost_appears_during_a_run(made, name):
    """The new answer waits until it is moved away."""
    before, refusal = there(made, "single"), f"{name} is write-protected or no result of coulomb"
    with pytest.raises(OSError, match=refusal), locked("out", comm):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).touch()
        output.write(solved_block(2), "out")
    assert visible() == before
    assert refusal in run(code=2)
    Path(name).rename("elsewhere")
    with locked("out", comm):
        assert "case.json" not in map(str, everything()) and everything(KEPT) == before
    assert check("out").passed


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
    for _ in range(2):
        run(*OTHER)
        assert OUT.is_symlink() and check("out").passed and not any(path.is_symlink() for path in OUT.iterdir())
        assert Path("kept.csv").read_bytes() == kept and everything("elsewhere") == elsewhere
    assert check("place.previous").passed and not KEPT.exists()


def test_a_link_to_nothing():
    OUT.symlink_to("nothing")
    assert "out is no directory" in run(code=2)


def test_results_beside_the_case_and_above_others(made):
    """The directory itself stays what it is: a shell, another run and the user's files are in it."""
    there(made, "single", "runs/other")
    shutil.copy("case.toml", "runs")
    os.chdir("runs")
    inode, other = os.stat(".").st_ino, everything("other")
    for number in (0.3, 0.4):
        run_coulomb("run", "case.toml", "--output", ".", "--quiet", "--set", f"contact.friction={number}")
    assert friction(".") == 0.4 and friction("../runs.previous") == 0.3
    assert os.stat(".").st_ino == os.stat("../runs").st_ino == inode and everything("other") == other
    assert set(map(str, everything("../runs.previous"))) == FILES


# --- kills and full disks -----------------------------------------------------------------------------------------


class KilledError(BaseException):
    """A kill."""


def killed_at(number, change, monkeypatch):
    """Whether a change of files was killed before one of its calls of the system, counted from 0."""
    with monkeypatch.context() as patch:
        for name in ("rename", "replace", "unlink", "rmdir", "mkdir"):

            def call(*args, real=getattr(os, name), **options):
                nonlocal number
                number -= 1
                if number < 0:
                    raise KilledError
                return real(*args, **options)

            patch.setattr(os, name, call)
        with contextlib.suppress(KilledError):
            change()
            return False
    return True


@pytest.mark.parametrize("keep", [True, False])
@pytest.mark.parametrize("there_is", ["single", "history"])
def test_a_kill_at_any_moment_of_the_move(made, there_is, keep, monkeypatch):
    """Before each change on disk in turn: what has a summary is whole, the old results are whole there or beside, or on
    their way and the new ones committed; the next run finishes the move, and keeps the old ones."""
    old, older = everything(made / there_is), everything(made / "single")
    new = {path: text + b" " for path, text in older.items()}
    for kills in itertools.count():
        there(made, there_is)
        there(made, "single", "out.previous")
        partial = Path("out/.partial" if keep else "out/.partial-own")
        partial.mkdir()
        for name, text in new.items():
            (partial / name).write_bytes(text)
        killed = killed_at(kills, functools.partial(finish, OUT), monkeypatch)
        if Path("summary.json") in visible():
            assert visible() in (old, new)
        if keep and visible() != old:
            assert old in (everything(KEPT), everything("out/.old") | visible())
        if RunDirectory(OUT).moving:
            if not Path("out/summary.json").exists():
                with pytest.raises(ValueError, match="the next coulomb run here finishes"):
                    RunDirectory(OUT).read_summary()
            with locked(OUT, comm):
                assert refuse_to_replace(OUT, True, comm)
            assert everything() == new
        assert everything(KEPT) == (old if keep else older)
        if not killed:
            break
    assert everything() == new and kills >= 10


@pytest.mark.parametrize("there_is", ["single", "history"])
def test_a_kill_while_a_history_takes_the_place(made, there_is, monkeypatch):
    old = everything(made / there_is)
    for kills in itertools.count():
        there(made, there_is)
        there(made, "history" if there_is == "single" else "single", "out.previous")
        killed = killed_at(kills, lambda: set_aside(OUT), monkeypatch)
        assert old in (everything(), everything(KEPT), everything("out/.old") | visible())
        finish(OUT)
        set_aside(OUT)
        assert not everything() and everything(KEPT) == old
        if not killed:
            break
    assert kills >= 10


def test_results_are_there_while_those_before_are_removed(made, monkeypatch):
    """Which may take long: who looks meanwhile sees them."""
    before, remove = there(made, "single"), atomic_output._remove
    there(made, "history", "out.previous")

    def removed(path):
        assert visible() == before
        remove(path)

    monkeypatch.setattr(atomic_output, "_remove", removed)
    set_aside(OUT)
    assert everything(KEPT) == before and not everything()


@pytest.mark.parametrize("command", ["check", "report"])
def test_a_command_that_reads_finishes_a_move(made, command):
    there(made, "single")
    Path("out/.partial").mkdir()
    for name in ("summary.json", "solution.h5"):
        shutil.move(f"out/{name}", f"out/.partial/{name}")
    with Path("out/run.lock").open("w") as file:  # of a run, which may be at it
        fcntl.flock(file, fcntl.LOCK_EX)
        run_coulomb(command, "out", code=2)
    run_coulomb(command, "out")
    assert set(map(str, everything())) - {"report.html"} == FILES


def test_a_directory_that_is_a_disk_of_its_own(made, monkeypatch):
    """As a volume of a container: nothing can be renamed from there to DIRECTORY.previous."""
    rename = os.rename

    def on_a_disk(path, to):
        if Path(to) == KEPT:
            raise OSError(18, "Invalid cross-device link")
        rename(path, to)

    before = there(made, "history")
    monkeypatch.setattr(os, "rename", on_a_disk)
    set_aside(OUT)
    assert everything(KEPT) == before and not everything()


def test_a_full_disk_keeps_the_old_results(made, monkeypatch):
    solution, before = solved_block(2), there(made, "single")
    full = Mock(side_effect=OSError(28, "No space left on device"))

    def full_at_last(path, *_):
        return full() if Path(path).name == ".old" else mkdir(path, *_)

    mkdir = os.mkdir
    for owner, name in ((output, "write_fields"), (output, "write_json"), (os, "mkdir")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, full_at_last if owner is os else full)
            with pytest.raises(OSError, match="No space"):
                output.write(solution, "out")
        assert visible() == before and not KEPT.exists()
    with locked("out", comm):  # the next run finds the answer that could not be moved
        assert friction() != json.loads(before[Path("summary.json")])["friction"] or check("out").passed
    assert everything(KEPT) == before


SLOW = ("--set", "mesh.cells=[6,3,3]", "--set", "history={end=1, steps=7}", *HISTORY[:2])


def test_a_killed_history(made):
    """The results before are whole beside it, and it resumes; the lock of the killed process does not hold."""
    before = there(made, "single")
    command = [sys.executable, "-m", "coulomb", "run", "case.toml", "--output", "out", *SLOW]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while not Path("out/steps/0002/summary.json").exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert f"process {process.pid} on " in Path("out/run.lock").read_text()
    assert everything(KEPT) == before
    Path("out/.partial-abc").mkdir()
    run_coulomb("resume", "out")
    assert check("out").passed and everything(KEPT) == before
    assert not [path for path in OUT.iterdir() if path.name[0] == "." or path.name == LOCK]


def test_a_history_that_ends_before_its_first_step_changes_nothing(made):
    before = there(made, "history")
    progress = iter((False, True))
    with pytest.raises(coulomb.NotConverged, match="interrupted"):
        coulomb.LoadHistory([1.0]).run(make_block(2), coulomb.HistoryFiles("out"), progress=lambda _: next(progress))
    assert everything() == before and not KEPT.exists()


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


@pytest.mark.parametrize(
    ("held", "command"), [("out", RUN), ("out.previous", RUN), ("out", ("resume", "out"))], ids=str
)
def test_a_second_run_is_refused_and_changes_nothing(command, held, made):
    for folder in ("out", "out.previous"):
        there(made, "history", folder)
    with another_run(held) as other:
        before = everything(".")
        done = run_coulomb(*command, code=2)
        assert done.stderr.count("error:") == 1, done.stderr
        holder = f"error: {held} is in use by process {other.pid} on {socket.gethostname()}, since 2"
        assert holder in done.stderr and "(hold.py " in done.stderr
        assert everything(".") == before
        with pytest.raises(ValueError, match=f"in use by process {other.pid} "):
            solved_block(2).write("out")


def test_the_lock_of_a_killed_run(monkeypatch):
    """The next run takes it, also on a file system without locks."""
    script = "from mpi4py import MPI; import os; from coulomb.io.atomic_output import locked\n"
    run_python(
        "-c", f"{script}hold = locked('out', MPI.COMM_WORLD); hold.__enter__(); os.kill(os.getpid(), 9)", code=None
    )
    assert f" on {socket.gethostname()}, since " in Path("out/run.lock").read_text()
    for _ in range(2):
        with locked("out", comm):
            assert f"process {os.getpid()} " in Path("out/run.lock").read_text()
        assert not any(OUT.iterdir())
        Path("out/run.lock").write_text("process 7 on elsewhere")
        monkeypatch.setattr(fcntl, "flock", Mock(side_effect=OSError(38, "Function not implemented")))


def test_one_process_may_lock_twice(tmp_path):
    folder = tmp_path / "deep" / "out"
    with locked(folder, comm), locked(folder, comm), locked(folder / "steps" / "0001", comm):
        assert (folder / LOCK).exists() and not (folder / "steps" / "0001" / LOCK).exists()
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
        done = run_python("-c", script, HISTORY[1], HISTORY[3], code=None)
    assert "ValueError: out is in use by process" in done.stderr.splitlines()[-1]
